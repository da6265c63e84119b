"""A record as a vehicle's sensors would give it: motion under a schedule, noise of each sensor's kind, gaps between its samples."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import jax
import numpy as np

from seatrial.core.errors import InputError, NumericalError
from seatrial.core.files import sha256_of_json
from seatrial.core.record import SIMULATED, Channel, Provenance, Record, make_record
from seatrial.core.signals import signal_unit
from seatrial.estimation.posterior import as_key
from seatrial.estimation.record_posterior import likelihood_of, sensors_of, start_of
from seatrial.estimation.replicate import replicate
from seatrial.estimation.sensors import Sensor
from seatrial.manoeuvres.schedule import Schedule
from seatrial.vehicles.model import VehicleModel


def simulate(
    model: VehicleModel,
    values: Mapping[str, float],
    schedule: Schedule,
    sensors: Sequence[Sensor | str],
    *,
    start: Mapping[str, float] | None = None,
    rates: Mapping[str, float] | None = None,
    key: jax.Array | int = 0,
    label: str = "trial",
) -> Record:
    """Simulate a trial.

    Args:
        model: vehicle.
        values: true value of every coefficient and of what the sensors need (`sigma_u`, and `bias_u` and the like where a sensor has
            them), SI; also `delay`, `current` and `process_u` where they are to be.
        schedule: controls over time.
        sensors: measured channels; a name alone is a sensor of white noise.
        start: state at the first sample, signal name to SI value; velocities are needed, angles and positions begin at 0.
        rates: samples a second of sensors that are slower than the schedule.
        key: random key of the noise, or a seed.
        label: short name of the record.

    Raises:
        InputError: a value or a velocity at the start that is missing, or a control that the schedule lacks.
        NumericalError: a vehicle that runs away.
    """
    controls = {name: _control(schedule, name) for name in model.controls}
    time = np.asarray(schedule.time, float)
    blank = _blank(time, controls, sensors, rates or {}, label)
    chosen = sensors_of(model, [blank], sensors)
    _check_values(model, chosen, values)
    starts = [start_of(model, replace(blank, measurement=np.full_like(blank.measurement, np.nan)), start or {})]
    likelihood, data = likelihood_of(model, [blank], chosen, values, starts)
    made = replicate(likelihood, dict(values), data, as_key(key))
    columns = dict(controls)
    for sensor, channel in zip(chosen, made.channels, strict=True):
        shown, present = (np.asarray(column[0])[: time.size] for column in (channel.measured, channel.present))
        if not np.isfinite(shown).all():
            raise NumericalError(
                f"the simulated vehicle runs away: {sensor.channel} is no number from {time[np.argmin(np.isfinite(shown))]:g} s on; "
                "check the signs of the damping: negative coefficients dissipate"
            )
        columns[sensor.channel] = np.where(present > 0, shown, np.nan)
    told = {"values": dict(values), "start": dict(start or {}), "rates": dict(rates or {})}
    return make_record(time, columns, blank.channels, Provenance(SIMULATED, sha256_of_json(told), told), label)


def _control(schedule: Schedule, name: str) -> np.ndarray:
    if name not in schedule.controls:
        raise InputError(
            "schedule",
            found="the controls " + ", ".join(schedule.controls),
            expected=f"{name} among them, which drives the vehicle",
            remedy="add it, held at one value where it is not to act",
        )
    return np.asarray(schedule.controls[name], float)


def _blank(
    time: np.ndarray,
    controls: Mapping[str, np.ndarray],
    sensors: Sequence[Sensor | str],
    rates: Mapping[str, float],
    label: str,
) -> Record:
    """A record without measurements: zeros where each sensor gives a sample."""
    channels = [Channel(name, signal_unit(name), "control") for name in controls]
    columns = []
    for sensor in sensors:
        name = sensor if isinstance(sensor, str) else sensor.channel
        every = max(1, round(1.0 / (rates[name] * (time[1] - time[0])))) if name in rates else 1
        columns.append(np.where(np.arange(time.size) % every == 0, 0.0, np.nan))
        channels.append(Channel(name, signal_unit(name), "measurement"))
    source = Provenance(SIMULATED, "")
    return Record(
        time, np.column_stack(list(controls.values())), np.column_stack(columns), tuple(channels), source, label
    )


def _check_values(model: VehicleModel, sensors: Sequence[Sensor], values: Mapping[str, float]) -> None:
    needed = [term.text for term in model.coefficients] + [name for sensor in sensors for name in sensor.parameters]
    if missing := [name for name in needed if name not in values]:
        raise InputError(
            "values",
            found="none of " + ", ".join(missing),
            expected="a value of " + ", ".join(needed),
            remedy=f'for example values["{missing[0]}"] = 0.0',
        )
