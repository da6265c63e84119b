"""Other models of what the vehicle's equations leave over, as small changes of a campaign, each with the lines that make it in its file.

What a change needs and the campaign does not say, a prior, is derived from the size of what was measured and of what was estimated, and
stands beside the result. To add a model of the error, add it to `error_models`.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.priors import prior_of_keys
from seatrial.core.record import Record
from seatrial.core.signals import SPEEDS
from seatrial.estimation.posterior.filter_error import process_name
from seatrial.estimation.posterior.unknowns import unknowns_of
from seatrial.estimation.simulation.disturbance import disturbance_name, disturbance_time_name, force_per_rate
from seatrial.estimation.simulation.sensor_errors import correlation_name, drift_name, drift_time_name
from seatrial.selection.structures import Structure

SMALLEST = 1e-4  # Least process noise or force that a prior allows, over the size of the motion
LONGEST = 3.0  # Longest memory of an error that drifts, over the length of a run: of a longer one a run sees an offset


@dataclass(frozen=True)
class ErrorModel:
    """One model of the error as a change of a campaign.

    Attributes:
        name: in tables.
        estimation: keys of `[estimation]` with what they become.
        priors: tables that are added, by parameter.
    """

    name: str
    estimation: Mapping[str, Any] = field(default_factory=dict)
    priors: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def lines(self) -> list[str]:
        """Return the lines that make it in a campaign file."""
        tables = {"estimation": self.estimation, **{f"prior.{name}": table for name, table in self.priors.items()}}
        return [
            line
            for name, table in tables.items()
            for line in (f"[{name}]", *(f"{key} = {json.dumps(value)}" for key, value in table.items()))
        ]


def error_models(
    campaign: Campaign, structure: Structure, records: Sequence[Record], values: Mapping[str, float]
) -> list[ErrorModel]:
    """Return the other models of the error that a campaign can have for one structure, without what it has already.

    Args:
        campaign: configuration.
        structure: of which the vehicle is built.
        records: fitted runs.
        values: of all coefficients of the structure, SI.
    """
    model, estimation, channels = campaign.model(structure), campaign.estimation, campaign.channels
    is_output_error, sensors = estimation.likelihood == "output-error", campaign.sensor_models
    interval = float(np.median(np.concatenate([np.diff(record.time) for record in records])))
    duration = float(np.median([np.ptp(record.time) for record in records]))
    measured = [name for name in records[0].measured if name in model.channel_units()]
    sizes = {name: float(np.mean([np.nanstd(record.channel(name)) for record in records])) for name in measured}
    drifts = {}
    for channel in channels:
        drifts[drift_name(channel)] = _size(sizes[channel])
        drifts[drift_time_name(channel)] = _log_uniform(interval, LONGEST * duration)
    times = {correlation_name(channel): _log_uniform(0.5 * interval, 0.5 * duration) for channel in channels}
    residuals = {"white": {}, "coloured": times, "drifting": drifts, "heavy": {}}
    likelihood = {} if is_output_error else {"likelihood": "output-error"}
    models = [
        ErrorModel(kind, likelihood | {"residuals": kind}, tables)
        for kind, tables in residuals.items()
        if not is_output_error or {sensor.noise for sensor in sensors} != {kind}
    ]
    # Random forces are integrated out by a filter, which does not know sensors that answer late.
    filtered, is_late = {"likelihood": "filter-error", "residuals": "white"}, any(sensor.lag for sensor in sensors)
    if estimation.likelihood != "filter-error" and not is_late:
        tables = {process_name(state): _size(sizes.get(state, 1.0)) for state in model.states}
        models.append(ErrorModel("process noise", filtered, tables))
    axes = model.disturbance_axes
    if axes and not is_late and not any(disturbance_name(axis) in campaign.priors for axis in axes):
        tables = {}
        for axis in axes:
            # At most the force that accelerates the vehicle by the size of its motion in one second.
            force = sizes.get(SPEEDS[axis], 1.0) * force_per_rate(model, axis, values)
            tables[disturbance_name(axis)] = _size(force)
            tables[disturbance_time_name(axis)] = _log_uniform(interval, 0.5 * duration)
        models.append(ErrorModel("disturbance", filtered, tables))
    return [
        replace(one, priors={name: table for name, table in one.priors.items() if name not in campaign.priors})
        for one in models
    ]


def with_error_model(campaign: Campaign, structure: Structure, error: ErrorModel) -> Campaign:
    """Return the campaign with another model of the error."""
    if not error.estimation:
        return campaign
    sensors = campaign.sensors
    kept = dict(campaign.priors)
    if "residuals" in error.estimation:
        sensors = {channel: one.model_copy(update={"residuals": None}) for channel, one in sensors.items()}
    if "likelihood" in error.estimation:
        gone = (disturbance_name(""), disturbance_time_name(""), process_name(""))
        kept = {name: prior for name, prior in kept.items() if not name.startswith(gone)}
    settings = campaign.estimation.model_copy(update=error.estimation)
    changed = replace(campaign, estimation=settings, sensors=sensors, priors=kept)
    unknown = unknowns_of(campaign.model(structure), changed.sensor_models, error.priors)
    units = {one.name: one.unit for one in unknown}
    added = {
        name: prior_of_keys(table, units[name], campaign.where(f"prior.{name}"), name)
        for name, table in error.priors.items()
    }
    return replace(changed, priors=kept | added)


def _size(size: float) -> dict[str, Any]:
    return _log_uniform(SMALLEST * size, size)


def _log_uniform(lower: float, upper: float) -> dict[str, Any]:
    return {"distribution": "log-uniform", "lower": float(f"{lower:.2g}"), "upper": float(f"{upper:.2g}")}
