"""What is estimated beside the coefficients: delay, current, what sensors add, process noise, and how trials differ."""

from typing import NamedTuple

from seatrial.campaign.config.campaign import Campaign
from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError, nearest
from seatrial.core.signals import SIGNALS, signal_unit
from seatrial.estimation.filter_error import process_name
from seatrial.estimation.output_error import deviation_name, own_name, spread_name
from seatrial.estimation.posterior import Parameter
from seatrial.estimation.priors import LogUniform, Normal, Prior
from seatrial.estimation.sensors import Sensor, bias_name, correlation_name, dof_name, lag_name, noise_name
from seatrial.estimation.simulation import CURRENT
from seatrial.vehicles.model import VehicleModel

DOF = LogUniform(1.5, 200.0)
"""Prior of degrees of freedom where none is given: from tails without a variance to the normal."""

_ERROR = 'distribution = "normal", mean = 0.0 and sd = 0.2'
_SIZE = 'distribution = "half-normal", lower = 0.0 and, as scale, how much it may differ between trials'
_SCALE = 'distribution = "log-uniform", lower = 0.0001 and upper = 0.1'
_LAG = 'distribution = "half-normal", scale = 1.0 and lower = 0.0'
_TIME = 'distribution = "log-uniform", lower = 0.05 and upper = 10.0'


class Nuisance(NamedTuple):
    """An unknown that no coefficient is: name in the file's `[prior]`, SI unit, label (LaTeX), prior, and whether it has a sign."""

    name: str
    unit: str
    label: str
    prior: Prior
    signed: bool = False

    def parameter(self) -> Parameter:
        """The unknown, shared by all trials."""
        return Parameter(self.name, self.unit, self.label, self.prior)

    def of_trial(self, label: str) -> Parameter:
        """One trial's own."""
        return Parameter(own_name(self.name, label), self.unit, f"{self.label}[{label}]", self.prior)


def nuisances(campaign: Campaign, model: VehicleModel) -> list[Nuisance]:
    """Every unknown beside coefficients and initial states, those of which each trial has its own once.

    Raises:
        InputError: a prior that is missing, or a name under `varying` that is neither a coefficient nor an own unknown.
    """
    table, found = campaign.source.estimation, []
    units = {term.text: model.unit_of(term) for term in model.coefficients}
    for name in varying(campaign, model):
        label = CoefficientName.parse(name).label
        prior = _prior(campaign, spread_name(name), units[name], f'estimation.varying has "{name}"', _SIZE)
        found.append(Nuisance(spread_name(name), units[name], rf"s_{{{label}}}", prior))
    if campaign.has_delay:
        found.append(Nuisance("delay", "s", r"t_{\mathrm{delay}}", campaign.prior("delay", "s")))
    if table.current != "none":
        current = _prior(campaign, CURRENT, "m/s", f'estimation.current = "{table.current}"', _ERROR)
        found.append(Nuisance(CURRENT, "m/s", r"u_{\mathrm{current}}", current, signed=True))
    for sensor in campaign.sensors:
        found += _of_sensor(campaign, sensor)
    if table.likelihood == "filter-error":
        for state in model.states:
            # Its own unit: what a state gains in one second.
            name, unit = process_name(state), signal_unit(state)
            prior = _prior(campaign, name, unit, 'estimation.likelihood = "filter-error"', _SCALE)
            found.append(Nuisance(name, unit, rf"q_{{{_label(state)}}}", prior))
    return found


def varying(campaign: Campaign, model: VehicleModel) -> tuple[str, ...]:
    """Coefficients of this model that vary between trials.

    Raises:
        InputError: a name that no structure has.
    """
    known = [term.text for term in campaign.model(campaign.full).coefficients]
    for name in campaign.source.estimation.varying:
        if name not in known:
            raise InputError(
                campaign.where("estimation.varying"),
                found=f'"{name}"',
                expected="a coefficient: " + ", ".join(known),
                remedy=nearest(name, known),
            )
    return tuple(term.text for term in model.coefficients if term.text in campaign.source.estimation.varying)


def deviations(names: tuple[str, ...], labels: tuple[str, ...]) -> list[Parameter]:
    """How far each trial's coefficients lie from the common ones, in units of their spread."""
    return [
        Parameter(
            deviation_name(name, label),
            "1",
            rf"\delta_{{{CoefficientName.parse(name).label}}}[{label}]",
            Normal(0.0, 1.0),
        )
        for name in names
        for label in labels
    ]


def _of_sensor(campaign: Campaign, sensor: Sensor) -> list[Nuisance]:
    channel, label = sensor.channel, _label(sensor.channel)
    unit = signal_unit(channel)
    key = f"sensors.{channel}"
    coloured, biased = f'the residuals of {channel} are "coloured"', f"{key}.bias says that there is one"
    known = {
        noise_name(channel): (unit, rf"\sigma_{{{label}}}", campaign.noise_prior(channel), "", ""),
        correlation_name(channel): ("s", rf"\tau_{{{label}}}", None, coloured, _TIME),
        dof_name(channel): ("1", rf"\nu_{{{label}}}", DOF, "", ""),
        bias_name(channel): (unit, rf"b_{{{label}}}", None, biased, _ERROR),
        lag_name(channel): ("s", rf"t_{{\mathrm{{lag}},{label}}}", None, f"{key}.lag = true", _LAG),
    }
    found = []
    for name in sensor.parameters:
        unit, text, default, because, example = known[name]
        given = default is None or name in campaign.source.prior
        prior = _prior(campaign, name, unit, because, example) if given else default
        found.append(Nuisance(name, unit, text, prior, signed=name == bias_name(channel)))
    return found


def _prior(campaign: Campaign, name: str, unit: str, because: str, example: str) -> Prior:
    """Prior of an unknown that the file asks for elsewhere.

    Raises:
        InputError: none is given; or as `Campaign.prior`.
    """
    if name not in campaign.source.prior:
        raise InputError(
            campaign.where(f"prior.{name}"),
            found=f"nothing, though {because}",
            expected=f"a prior of {name}, SI unit {unit}",
            remedy=f"add [prior.{name}] with, for example, {example}",
        )
    return campaign.prior(name, unit)


def _label(channel: str) -> str:
    return SIGNALS[channel].label if channel in SIGNALS else rf"\dot{{{channel.removesuffix('dot')}}}"
