"""Other models of what the vehicle's equations leave over, as small changes of a campaign, each with the lines that make it in its file.

What a change needs and the campaign does not say, a prior, is derived from the size of what was measured and of what was estimated, and
is told with the result. To add a model of the error, add it to `error_models`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.priors import prior_of_keys
from seatrial.core.coefficients import CoefficientName
from seatrial.core.record import Record
from seatrial.core.signals import SPEEDS, signal_unit
from seatrial.estimation.posterior.filter_error import process_name
from seatrial.estimation.posterior.output_error import spread_name
from seatrial.estimation.priors import Prior
from seatrial.estimation.simulation.disturbance import disturbance_name, disturbance_time_name, force_per_rate
from seatrial.estimation.simulation.sensor_errors import correlation_name, drift_name, drift_time_name
from seatrial.selection.structures import Structure
from seatrial.vehicles.model import VehicleModel

SMALLEST = 1e-4  # Least process noise or force that a prior allows, over the size of the motion
SHARE = 0.5  # Size by which a coefficient may vary from run to run, over its value
LONGEST = 3.0  # Longest memory of an error that drifts, over the length of a run: of a longer one a run sees an offset
# Coefficients that all vary: each run's own are integrated out for every draw, which for four takes a quarter of an
# hour.
MOST_VARYING = 3


@dataclass(frozen=True)
class Scale:
    """How large things are, from which priors that nobody stated are derived.

    Attributes:
        interval: between samples, s.
        duration: of a run, s.
        sizes: standard deviation of each measured channel within runs, SI.
        coefficients: value and standard deviation of each at the mode of the campaign's own model, SI.
        forces: that accelerate the vehicle by the size of its motion in one second, by axis, SI.
    """

    interval: float
    duration: float
    sizes: Mapping[str, float]
    coefficients: Mapping[str, tuple[float, float]]
    forces: Mapping[str, float]


@dataclass(frozen=True)
class ErrorModel:
    """One model of the error as a change of a campaign.

    Attributes:
        name: in tables.
        words: what it says, as a sentence goes on.
        estimation: keys of `[estimation]` with what they become.
        priors: tables that are added, by parameter.
    """

    name: str
    words: str
    estimation: Mapping[str, Any] = field(default_factory=dict)
    priors: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def lines(self) -> list[str]:
        """Return the lines that make it in a campaign file."""
        messages = ["[estimation]", *(f"{key} = {_toml(value)}" for key, value in self.estimation.items())]
        for name, table in self.priors.items():
            messages += [f"[prior.{name}]", *(f"{key} = {_toml(value)}" for key, value in table.items())]
        return messages


def scale_of(
    model: VehicleModel,
    records: Sequence[Record],
    coefficients: Mapping[str, tuple[float, float]],
    values: Mapping[str, float],
) -> Scale:
    """Return how large things are.

    Args:
        model: vehicle.
        records: fitted runs.
        coefficients: value and standard deviation of each, SI.
        values: of all parameters of the model, SI.
    """
    channels = [name for name in records[0].measured if name in model.channel_units()]
    sizes = {name: float(np.mean([np.nanstd(record.channel(name)) for record in records])) for name in channels}
    return Scale(
        float(np.median(np.concatenate([np.diff(record.time) for record in records]))),
        float(np.median([np.ptp(record.time) for record in records])),
        sizes,
        coefficients,
        {axis: sizes.get(SPEEDS[axis], 1.0) * force_per_rate(model, axis, values) for axis in model.disturbance_axes},
    )


def error_models(campaign: Campaign, structure: Structure, scale: Scale) -> list[ErrorModel]:
    """Return the other models of the error that a campaign can have for one structure, without what it has already."""
    model, estimation, channels = campaign.model(structure), campaign.estimation, campaign.channels
    is_output_error, sensors = estimation.likelihood == "output-error", campaign.sensor_models
    interval, duration = scale.interval, scale.duration
    drifts = {}
    for channel in channels:
        drifts[drift_name(channel)] = _size(scale.sizes[channel])
        drifts[drift_time_name(channel)] = _log_uniform(interval, LONGEST * duration)
    times = {correlation_name(channel): _log_uniform(0.5 * interval, 0.5 * duration) for channel in channels}
    residuals = {
        "white": ("independent errors of each sample", {}),
        "coloured": ("errors correlated in time", times),
        "drifting": ("white noise over an error that drifts", drifts),
        "heavy": ("independent errors with outliers", {}),
    }
    models = [
        ErrorModel(
            kind, words, ({} if is_output_error else {"likelihood": "output-error"}) | {"residuals": kind}, tables
        )
        for kind, (words, tables) in residuals.items()
        if not is_output_error or {sensor.noise for sensor in sensors} != {kind}
    ]
    # Random forces are integrated out by a filter, which does not know sensors that answer late.
    filtered, is_late = {"likelihood": "filter-error", "residuals": "white"}, any(sensor.lag for sensor in sensors)
    if estimation.likelihood != "filter-error" and not is_late:
        tables = {process_name(state): _size(scale.sizes.get(state, 1.0)) for state in model.states}
        models.append(ErrorModel("process noise", "random forces on every state", filtered, tables))
    axes = model.disturbance_axes
    if axes and not is_late and not any(disturbance_name(axis) in campaign.priors for axis in axes):
        tables = {}
        for axis in axes:
            tables[disturbance_name(axis)] = _size(scale.forces[axis])
            tables[disturbance_time_name(axis)] = _log_uniform(interval, 0.5 * duration)
        models.append(ErrorModel("disturbance", "a force correlated in time", filtered, tables))
    names = [term.text for term in model.coefficients]
    offsets = [name for name in names if name.endswith("_0")]
    for name, words, chosen in (
        ("offset of each run", "a constant force that differs from run to run", offsets),
        ("all vary by run", "coefficients that differ from run to run", names if len(names) <= MOST_VARYING else []),
    ):
        added = [one for one in chosen if one in scale.coefficients]
        if not set(added) <= set(estimation.varying):
            tables = {spread_name(one): _spread(one, scale, campaign.prior) for one in added}
            together = tuple(dict.fromkeys([*estimation.varying, *added]))
            models.append(ErrorModel(name, words, {"varying": together}, tables))
    return [
        replace(one, priors={name: table for name, table in one.priors.items() if name not in campaign.priors})
        for one in models
    ]


def with_error_model(campaign: Campaign, structure: Structure, error: ErrorModel) -> Campaign:
    """Return the campaign with another model of the error."""
    if not error.estimation:
        return campaign
    model, sensors = campaign.model(structure), campaign.sensors
    units = {term.text: model.unit_of(term) for term in model.coefficients}
    added = {
        name: prior_of_keys(table, _unit(name, units, model), campaign.where(f"prior.{name}"), name)
        for name, table in error.priors.items()
    }
    kept = dict(campaign.priors)
    if "residuals" in error.estimation:
        sensors = {channel: one.model_copy(update={"residuals": None}) for channel, one in sensors.items()}
    if "likelihood" in error.estimation:
        gone = (disturbance_name(""), disturbance_time_name(""), process_name(""))
        kept = {name: prior for name, prior in kept.items() if not name.startswith(gone)}
    settings = campaign.estimation.model_copy(update=error.estimation)
    return replace(campaign, estimation=settings, sensors=sensors, priors=kept | added)


def _spread(name: str, scale: Scale, prior: Callable[[str], Prior]) -> dict[str, Any]:
    """Return the prior of how far runs differ in a coefficient."""
    value, sd = scale.coefficients[name]
    # A constant force is near zero, and its size says nothing of how far runs differ: what its prior allows does.
    size = float(prior(name).sd) if name.endswith("_0") else max(SHARE * abs(value), sd)
    return {"distribution": "half-normal", "scale": _round(size), "lower": 0.0}


def _size(size: float) -> dict[str, Any]:
    return _log_uniform(SMALLEST * size, size)


def _log_uniform(lower: float, upper: float) -> dict[str, Any]:
    return {"distribution": "log-uniform", "lower": _round(lower), "upper": _round(upper)}


def _unit(name: str, units: Mapping[str, str], model: VehicleModel) -> str:
    if name.startswith(spread_name("")):
        return units[name.removeprefix(spread_name(""))]
    if name.startswith((disturbance_time_name(""), correlation_name(""), drift_time_name(""))):
        return "s"
    if name.startswith(drift_name("")):
        return signal_unit(name.removeprefix(drift_name("")))
    if name.startswith(disturbance_name("")):
        return model.unit_of(CoefficientName.parse(f"{name.removeprefix(disturbance_name(''))}_0"))
    return signal_unit(name.removeprefix(process_name("")))


def _round(x: float) -> float:
    return float(f"{x:.2g}")


def _toml(value: Any) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return f'"{value}"' if isinstance(value, str) else f"{value:g}"
