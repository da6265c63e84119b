"""A record as a vehicle's sensors would give it: motion under a schedule, noise of each sensor's kind, gaps between its samples."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from math import inf
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.compiled.engine import check_precision
from seatrial.core.argument_checks import check_kind, check_known, check_number, check_numbers, check_text
from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError, NumericalError
from seatrial.core.files import sha256_of_json
from seatrial.core.record import SIMULATED, Channel, Provenance, Record, make_record
from seatrial.core.signals import ANGLES, QUATERNION, SPEEDS, signal_unit
from seatrial.estimation.posterior.filter_error import process_name
from seatrial.estimation.posterior.posterior import as_key
from seatrial.estimation.posterior.record_posterior import (
    check_model,
    likelihood_of,
    stated_sensors,
)
from seatrial.estimation.posterior.replicate import replicate
from seatrial.estimation.posterior.unknowns import noisy_states
from seatrial.estimation.simulation.delayed_control import DELAY
from seatrial.estimation.simulation.disturbance import disturbance_name, disturbance_time_name, disturbed_axes
from seatrial.estimation.simulation.sensor_errors import Sensor, bias_name, correlation_name, dof_name, drift_time_name
from seatrial.estimation.simulation.simulator import CURRENT
from seatrial.estimation.simulation.starts import start_of
from seatrial.manoeuvres.schedule import Schedule
from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.simulate import simulate as motion


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
            them), SI; also `delay`, `current`, `process_u`, and `disturbance_X` with `disturbance_time_X` where they are to be.
        schedule: controls over time, SI.
        sensors: measured channels; a name alone is a sensor of white noise.
        start: state at the first sample, signal name to SI value; velocities are needed, angles and positions begin at 0.
        rates: samples a second of sensors that are slower than the schedule, by channel, 1/s.
        key: random key of the noise, or a seed.
        label: short name of the record.

    Returns:
        what the sensors show at the times of the schedule, n of them, NaN between the samples of slower ones; in SI.

    Raises:
        InputError: a value or a velocity at the start that is missing, one that nothing uses or that nothing has, a control that the
            schedule lacks, or a rate that it has not.
        NumericalError: a vehicle that runs away.
    """
    check_precision()
    check_model(model)
    check_kind(schedule, Schedule, "schedule", "take one of `Family.schedule`, or build it of times and controls")
    check_text(label, "label", "give a short name")
    controls = {name: _control(schedule, name) for name in model.controls}
    time = schedule.time
    chosen = stated_sensors(model, sensors)
    values = _checked_values(model, chosen, values)
    blank = _blank(time, controls, chosen, checked_rates(rates, [one.channel for one in chosen], time), label)
    starts = [start_of(model, replace(blank, measurement=np.full_like(blank.measurement, np.nan)), start)]
    likelihood, data = likelihood_of(model, [blank], chosen, values, starts)
    made = replicate(likelihood, values, data, as_key(key))
    columns = dict(controls)
    for sensor, channel in zip(chosen, made.channels, strict=True):
        shown, present = (np.asarray(column[0])[: time.size] for column in (channel.measured, channel.present))
        if not np.isfinite(shown).all():
            raise NumericalError(
                f"the simulated vehicle runs away: {sensor.channel} is no number from {time[np.argmin(np.isfinite(shown))]:g} s on; "
                "check the signs of the damping: negative coefficients dissipate"
            )
        columns[sensor.channel] = np.where(present > 0, shown, np.nan)
    stated = {"values": values, "start": dict(start or {}), "rates": dict(rates or {})}
    return make_record(time, columns, blank.channels, Provenance(SIMULATED, sha256_of_json(stated), stated), label)


def simulate_motion(
    model: VehicleModel, params: Mapping[str, Any], record: Record, start: Mapping[str, float] | None = None
) -> dict[str, Float[Array, " n"]]:
    """Compute the motion under the controls of a record, without noise, for a likelihood of your own.

    JAX can trace, differentiate and batch it in `params`.

    Args:
        model: vehicle.
        params: value of each coefficient by name, SI.
        record: trial; its n times and controls are used, and its first measurements where `start` states nothing.
        start: state at the first sample, signal name to SI value; it is not a part of what JAX traces.

    Returns:
        each state and each output of the vehicle at the times of the record, SI.

    Raises:
        InputError: a control that the record lacks, or a velocity of which nothing says where it starts.
    """
    check_precision()
    check_model(model)
    if missing := [name for name in model.controls if name not in record.controls]:
        raise InputError(
            f'record "{record.label}"',
            found=f"the controls {', '.join(record.controls)}",
            expected=f"{missing[0]} among them, which drives the vehicle",
            remedy="add it to the record, held at one value if it did not act",
        )
    control = jnp.asarray(np.column_stack([record.channel(name) for name in model.controls]))
    step = np.diff(record.time, append=record.time[-1])
    states = motion(model, params, control, jnp.asarray(step), jnp.asarray(start_of(model, record, start)))
    columns, held = tuple(states.T), tuple(control.T)
    outputs = {name: jax.vmap(partial(view, params))(columns, held) for name, view in model.outputs.items()}
    return dict(zip(model.states, columns, strict=True)) | outputs


def _control(schedule: Schedule, name: str) -> np.ndarray:
    if name not in schedule.controls:
        raise InputError(
            "schedule",
            found="the controls " + ", ".join(schedule.controls),
            expected=f"{name} among them, which drives the vehicle",
            remedy="add it, held at one value where it is not to act",
        )
    return schedule.controls[name]


def _blank(
    time: np.ndarray,
    controls: Mapping[str, np.ndarray],
    sensors: Sequence[Sensor],
    rates: Mapping[str, float],
    label: str,
) -> Record:
    """Return a record without measurements: zeros where each sensor gives a sample."""
    channels = [Channel(name, signal_unit(name), "control") for name in controls]
    columns = []
    for name in (sensor.channel for sensor in sensors):
        every = max(1, round(1.0 / (rates[name] * (time[1] - time[0])))) if name in rates else 1
        columns.append(np.where(np.arange(time.size) % every == 0, 0.0, np.nan))
        channels.append(Channel(name, signal_unit(name), "measurement"))
    source = Provenance(SIMULATED, "")
    return Record(
        time,
        np.array(list(controls.values())).reshape(len(controls), time.size).T,
        np.column_stack(columns),
        tuple(channels),
        source,
        label,
    )


def checked_rates(rates: Mapping[str, float] | None, channels: Collection[str], time: np.ndarray) -> dict[str, float]:
    """Return the samples a second of some channels, each between two in the whole trial and one at every time of the schedule.

    Raises:
        InputError: a channel that is not measured, or a rate that the schedule cannot have.
    """
    given = check_numbers(rates, "rates", known=channels, above=0.0)
    fastest, slowest = 1.0 / float(time[1] - time[0]), 1.0 / float(time[-1] - time[0])
    for name, rate in given.items():
        if not slowest <= rate <= fastest * (1 + 1e-6):
            raise InputError(
                f'rates["{name}"]',
                found=f"{rate:g} samples a second",
                expected=f"from {slowest:.3g}, two in the whole trial, to {fastest:.6g}, one at every time of the schedule",
                remedy="correct it, leave it out, or take a schedule with a shorter sample time",
            )
    return given


def _checked_values(model: VehicleModel, sensors: Sequence[Sensor], values: Mapping[str, float]) -> dict[str, float]:
    """Return the values of everything that is simulated."""
    given = check_numbers(values, "values", remedy='write for example {"X_u": -3.0, "sigma_u": 0.02}')
    of_sensors = [name for sensor in sensors for name in sensor.parameters]
    pushed = [process_name(state) for state in noisy_states(given, model)]
    times = [disturbance_time_name(axis) for axis in disturbed_axes(given, model)]
    pushed += [*map(disturbance_name, disturbed_axes(given, model)), *times]
    needed = [*(term.text for term in model.coefficients), *of_sensors, *pushed]
    if missing := [name for name in needed if name not in given]:
        raise InputError(
            "values",
            found="none of " + ", ".join(missing),
            expected="a value of " + ", ".join(needed),
            remedy=f'for example values["{missing[0]}"] = 0.0',
        )
    used = {name: given[name] for name in (*needed, DELAY, CURRENT) if name in given}
    _check_others(model, {name: value for name, value in given.items() if name not in used}, [*needed, DELAY, CURRENT])
    scales = [*times, *(name(one.channel) for one in sensors for name in (correlation_name, dof_name, drift_time_name))]
    for name in (*of_sensors, *pushed, DELAY):
        if name in used and not name.startswith(bias_name("")):
            above, least = (0.0, -inf) if name in scales else (-inf, 0.0)
            check_number(used[name], f'values["{name}"]', above=above, least=least)
    return used


def _check_others(model: VehicleModel, others: Mapping[str, float], used: Sequence[str]) -> None:
    """Check that what is given beside what is needed is what the vehicle has, or has no part in its motion."""
    constants = dict(model.constants)
    for name, value in others.items():
        if name in constants:
            if not np.isclose(value, constants[name], rtol=1e-9, atol=0.0):
                raise InputError(
                    f'values["{name}"]',
                    found=f"{value:g}",
                    expected=f"{constants[name]:g}, which the vehicle was built with",
                    remedy=f'leave it out, or build the vehicle with free=["{name}", …]',
                )
        elif _would_act(model, name):
            check_known([name], used, "values")


def _would_act(model: VehicleModel, name: str) -> bool:
    """Return whether a coefficient of this name would have a part in the motion; True of what is no coefficient."""
    try:
        term = CoefficientName.parse(name)
    except InputError:
        return True
    own = "u" if term.axis == "T" else SPEEDS.get(term.axis)
    present = {*model.states, *model.controls, *(ANGLES if QUATERNION[0] in model.states else ())}
    return own in present and all(signal in present for signal in term.signals)
