"""What is estimated beside the coefficients: delay, current, what sensors add, disturbances, process noise, and how trials differ."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import NamedTuple

from seatrial.campaign.config.settings import EstimationSettings
from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError
from seatrial.core.signals import signal_label, signal_unit
from seatrial.core.usual_priors import DRIFT_TIME_PRIOR, SIZE_PRIOR, TIME_PRIOR
from seatrial.estimation.disturbance import AXES, disturbance_name, disturbance_time_name, disturbed_axes
from seatrial.estimation.filter_error import process_name
from seatrial.estimation.mounts import LATE, SCALE, mount_unit
from seatrial.estimation.output_error import deviation_name, own_name, spread_name
from seatrial.estimation.posterior import Parameter
from seatrial.estimation.priors import LogUniform, Normal, Prior, Uniform
from seatrial.estimation.sensor_errors import (
    Sensor,
    bias_name,
    correlation_name,
    dof_name,
    drift_name,
    drift_time_name,
    lag_name,
    noise_name,
)
from seatrial.estimation.simulation import CURRENT
from seatrial.vehicles.model import Unknown, VehicleModel

DOF = LogUniform(1.5, 200.0)
"""Prior of degrees of freedom where none is given: from tails without a variance to the normal."""
NOISES = 5.0
"""Largest noise of a sensor over its nominal one, where no prior of it is given."""

_ERROR = 'distribution = "normal", mean = 0.0 and sd = 0.2'
_SIZE = 'distribution = "half-normal", lower = 0.0 and scale = the difference between trials that you expect'
_LAG = 'distribution = "half-normal", scale = 1.0 and lower = 0.0'


class Nuisance(NamedTuple):
    """An unknown that no coefficient is.

    Attributes:
        name: of its prior.
        unit: SI.
        label: LaTeX.
        default: prior where none is stated; None where one has to be.
        because: what asks for it, in words.
        example: of a prior, in words.
        signed: whether it may be below 0.
    """

    name: str
    unit: str
    label: str
    default: Prior | None = None
    because: str = ""
    example: str = ""
    signed: bool = False

    def parameter(self, prior: Prior) -> Parameter:
        """The unknown, shared by all trials."""
        return Parameter(self.name, self.unit, self.label, prior)

    def of_trial(self, label: str, prior: Prior) -> Parameter:
        """One trial's own."""
        return Parameter(own_name(self.name, label), self.unit, f"{self.label}[{label}]", prior)


def no_nuisance_prior(where: Callable[[str], str], missing: Sequence[Nuisance]) -> InputError:
    """Return the error of unknowns for which no prior is stated.

    Args:
        where: names a key of the file.
        missing: all of them.
    """
    reasons = dict.fromkeys(one.because for one in missing)
    return InputError(
        where(f"prior.{missing[0].name}"),
        found=f"nothing, though {', and '.join(reasons)}",
        expected="a prior of " + ", and of ".join(f"{one.name}, SI unit {one.unit}" for one in missing),
        remedy="add "
        + "; and ".join(f"a section [prior.{one.name}], for example with {one.example}" for one in missing),
    )


def nuisances(
    estimation: EstimationSettings,
    sensors: Sequence[Sensor],
    noise: Mapping[str, float],
    model: VehicleModel,
    stated: Collection[str],
) -> Iterator[Nuisance]:
    """Yield every unknown beside coefficients and initial states, those of which each trial has its own once.

    Args:
        estimation: what is estimated.
        sensors: of the measured channels.
        noise: nominal, of each channel, SI.
        model: vehicle.
        stated: names that have a prior in the file, among which a delay and disturbances may be.
    """
    for one in varying(estimation, model):
        because = f'estimation.varying has "{one.name}"'
        yield Nuisance(spread_name(one.name), one.unit, rf"s_{{{one.label}}}", None, because, _SIZE)
    if "delay" in stated:
        yield Nuisance("delay", "s", r"t_{\mathrm{delay}}")
    if estimation.current != "none":
        because = f'estimation.current = "{estimation.current}"'
        yield Nuisance(CURRENT, "m/s", r"u_{\mathrm{current}}", None, because, _ERROR, signed=True)
    for one in model.unknowns:
        yield Nuisance(one.name, one.unit, one.label, signed=one.signed)
    for name in dict.fromkeys(name for sensor in sensors if sensor.mount for name in sensor.mount.unknown):
        part, _, whose = name.partition("_")
        yield Nuisance(name, mount_unit(name), rf"{part}_{{\mathrm{{{whose}}}}}", signed=part not in (SCALE, LATE))
    for sensor in sensors:
        yield from of_sensor(sensor, noise[sensor.channel])
    if estimation.likelihood == "filter-error":
        disturbed = disturbed_axes(stated, model)
        for axis in disturbed:
            yield from _of_disturbance(axis, model)
        for state in model.states:
            if disturbed and process_name(state) not in stated:
                continue
            # Its own unit: what a state gains in one second.
            name, label, because = process_name(state), signal_label(state), 'estimation.likelihood = "filter-error"'
            yield Nuisance(name, signal_unit(state), rf"q_{{{label}}}", None, because, SIZE_PRIOR)


def check_disturbances(
    stated: Collection[str], likelihood: str, model: VehicleModel, where: Callable[[str], str]
) -> None:
    """Check that disturbances that have a prior lie on axes that move, and that the likelihood knows them.

    Args:
        stated: names that have a prior in the file.
        likelihood: of the campaign.
        model: vehicle of all terms.
        where: names a key of the file.

    Raises:
        InputError: the first disturbance that cannot be.
    """
    for name in stated:
        if not name.startswith(disturbance_name("")):
            continue
        axis = name.removeprefix(disturbance_time_name("")).removeprefix(disturbance_name(""))
        if axis not in model.pushed:
            raise InputError(
                where(f"prior.{name}"),
                found=f"a disturbance on the axis {axis}, which does not move" if axis in tuple(AXES) else f'"{axis}"',
                expected="an axis that moves: " + (", ".join(model.pushed) or "none of this vehicle"),
                remedy="leave it out, or let the vehicle move along it",
            )
        if likelihood != "filter-error":
            raise InputError(
                where(f"prior.{name}"),
                found=f'a disturbance with estimation.likelihood = "{likelihood}"',
                expected="a likelihood that integrates it out",
                remedy='set estimation.likelihood = "filter-error" and residuals = "white"',
            )


def varying(estimation: EstimationSettings, model: VehicleModel) -> tuple[Unknown, ...]:
    """Return the coefficients and other unknowns of a model that vary between trials."""
    return tuple(one for one in may_vary(model) if one.name in estimation.varying)


def may_vary(model: VehicleModel) -> tuple[Unknown, ...]:
    """Return what may lie about a common value in each trial: coefficients, and unknowns such as `net_weight` that may have either sign."""
    terms = (Unknown(term.text, model.unit_of(term), term.label, 0.0) for term in model.coefficients)
    return (*terms, *(one for one in model.unknowns if one.signed))


def deviations(varying: tuple[Unknown, ...], labels: tuple[str, ...]) -> list[Parameter]:
    """How far each trial's unknowns lie from the common ones, in units of their spread."""
    return [
        Parameter(deviation_name(one.name, label), "1", rf"\delta_{{{one.label}}}[{label}]", Normal(0.0, 1.0))
        for one in varying
        for label in labels
    ]


def _of_disturbance(axis: str, model: VehicleModel) -> list[Nuisance]:
    size, time = disturbance_name(axis), disturbance_time_name(axis)
    unit = model.unit_of(CoefficientName.parse(f"{axis}_0"))
    both = f"a disturbance on {axis} has a standard deviation, {size}, and a correlation time, {time}"
    return [
        Nuisance(size, unit, rf"s_{{d,{axis}}}", None, both, SIZE_PRIOR),
        Nuisance(time, "s", rf"\tau_{{d,{axis}}}", None, both, TIME_PRIOR),
    ]


def of_sensor(sensor: Sensor, noise: float) -> list[Nuisance]:
    """Return every unknown of a sensor, whose nominal noise is given in SI."""
    channel, label = sensor.channel, signal_label(sensor.channel)
    unit, key = signal_unit(channel), f"sensors.{channel}"
    slow, biased = f'the residuals of {channel} are "{sensor.noise}"', f"{key}.bias says that there is one"
    lag, own = f"{key}.lag = true", Uniform(0.0, NOISES * noise)
    known = [
        Nuisance(noise_name(channel), unit, rf"\sigma_{{{label}}}", own),
        Nuisance(correlation_name(channel), "s", rf"\tau_{{{label}}}", None, slow, TIME_PRIOR),
        Nuisance(dof_name(channel), "1", rf"\nu_{{{label}}}", DOF),
        Nuisance(drift_name(channel), unit, rf"\sigma_{{\mathrm{{drift}},{label}}}", None, slow, SIZE_PRIOR),
        Nuisance(drift_time_name(channel), "s", rf"\tau_{{\mathrm{{drift}},{label}}}", None, slow, DRIFT_TIME_PRIOR),
        Nuisance(bias_name(channel), unit, rf"b_{{{label}}}", None, biased, _ERROR, signed=True),
        Nuisance(lag_name(channel), "s", rf"t_{{\mathrm{{lag}},{label}}}", None, lag, _LAG),
    ]
    by_name = {one.name: one for one in known}
    return [by_name[name] for name in sensor.parameters]
