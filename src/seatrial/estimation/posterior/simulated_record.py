"""A record as a vehicle's sensors would give it: motion under a schedule or a pilot, noise of each sensor's kind, gaps between its samples.

What pushes the vehicle beside its controls is drawn before and held over each step: process noise as a rate of change of a state,

    dx/dt = f(x, c) + s e / sqrt(h),  e standard normal, h the step, s what the state gains in one second

and a disturbance as the mean of its force over the step (`seatrial.estimation.simulation.disturbance`).
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import inf
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from seatrial.compiled.engine import check_precision
from seatrial.compiled.programs import program
from seatrial.core.argument_checks import check_kind, check_known, check_number, check_numbers, check_text
from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError, NumericalError
from seatrial.core.files import sha256_of_json
from seatrial.core.record import SIMULATED, Channel, Provenance, Record, make_record
from seatrial.core.signals import ANGLES, QUATERNION, SPEEDS, signal_unit
from seatrial.estimation.posterior.filter_error import process_name
from seatrial.estimation.posterior.output_error import output_error
from seatrial.estimation.posterior.posterior import as_key
from seatrial.estimation.posterior.record_posterior import check_model, starts_of, stated_sensors
from seatrial.estimation.posterior.replicate import draw_noise
from seatrial.estimation.posterior.unknowns import noisy_states
from seatrial.estimation.simulation.delayed_control import DELAY
from seatrial.estimation.simulation.disturbance import (
    OverStep,
    disturbance_name,
    disturbance_time_name,
    disturbed_axes,
    over_step,
)
from seatrial.estimation.simulation.sensor_errors import Sensor, bias_name, correlation_name, dof_name, drift_time_name
from seatrial.estimation.simulation.simulator import CURRENT, Feedback, Simulator
from seatrial.estimation.simulation.starts import start_of
from seatrial.estimation.simulation.trial_data import ChannelData, channel_data
from seatrial.manoeuvres.autopilot import Autopilot
from seatrial.manoeuvres.pilot import Moment, Pilot
from seatrial.manoeuvres.relay import Relay
from seatrial.manoeuvres.schedule import Schedule
from seatrial.vehicles.model import VehicleModel, cached_model, outside_force
from seatrial.vehicles.simulate import simulate as motion


def simulate(
    model: VehicleModel,
    values: Mapping[str, float],
    schedule: Schedule,
    sensors: Sequence[Sensor | str],
    *,
    feedback: Autopilot | Relay | None = None,
    start: Mapping[str, float] | Sequence[float] | None = None,
    rates: Mapping[str, float] | None = None,
    key: jax.Array | int | Sequence[jax.Array] = 0,
    label: str = "trial",
) -> Record:
    """Simulate a trial.

    Args:
        model: vehicle.
        values: true value of every coefficient and of what the sensors need (`sigma_u`, and `bias_u` and the like where a sensor has
            them), SI; also `delay`, `current`, `process_u`, and `disturbance_X` with `disturbance_time_X` where they are to be.
        schedule: controls over time, SI, and set-points of an autopilot.
        sensors: measured channels; a name alone is a sensor of white noise.
        feedback: an autopilot or a relay, which decides the controls at each sample; the schedule does if not given.
        start: state at the first sample, signal name to SI value; velocities are needed, angles and positions begin at 0. Or the whole
            state, SI, in the order of the states of the vehicle.
        rates: samples a second of sensors that are slower than the schedule, by channel, 1/s.
        key: random key of the noise, or a seed; or a key of the noise of each sensor.
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
    time = schedule.time
    chosen = stated_sensors(model, sensors)
    if feedback is not None:
        _check_feedback(feedback, model, [one.channel for one in chosen])
    names = feedback.commands if isinstance(feedback, Autopilot) else model.controls
    commands = {name: _control(schedule, name) for name in names}
    values = _checked_values(model, chosen, values)
    blank = _blank(time, commands, chosen, checked_rates(rates, [one.channel for one in chosen], time), label)
    stated = start if start is None or isinstance(start, Mapping) else [start]
    (first,) = starts_of(
        model, [replace(blank, measurement=np.full_like(blank.measurement, np.nan))], stated, free=False
    )
    likelihood, _ = output_error(model, [blank], chosen, [first], delay=DELAY in values, current=CURRENT in values)
    if isinstance(key, list | tuple):
        keys = [as_key(one) for one in key]
    else:  # the second of two keys, as `replicate` has it, so that a record and its replicates differ in nothing but their keys
        keys = list(jax.random.split(jax.random.split(as_key(key), 2)[1], (1, len(chosen)))[0])
    if len(keys) != len(chosen):
        raise InputError(
            "key",
            found=f"{len(keys)} keys",
            expected=f"one for each of {len(chosen)} sensors, or one for all",
            remedy="give a whole number, for example 0",
        )
    columns = simulate_trial(
        likelihood.simulator, values, time, commands, first, np.isfinite(blank.measurement), keys, feedback
    )
    if set(QUATERNION) <= set(columns):  # of length 1, as an attitude filter gives it
        length = np.sqrt(sum(columns[part] ** 2 for part in QUATERNION))
        columns |= {part: columns[part] / length for part in QUATERNION}
    begun = dict(start or {}) if start is None or isinstance(start, Mapping) else list(start)
    about = {"values": values, "start": begun, "rates": dict(rates or {})}
    about |= {} if feedback is None else {"feedback": repr(feedback)}
    return make_record(time, columns, blank.channels, Provenance(SIMULATED, sha256_of_json(about), about), label)


def simulate_trial(
    simulator: Simulator,
    values: Mapping[str, float],
    time: Float[np.ndarray, " n"],
    commands: Mapping[str, Float[np.ndarray, " n"]],
    start: Sequence[float],
    measured: Bool[np.ndarray, "n m"],
    keys: Sequence[Array],
    feedback: Pilot | None = None,
) -> dict[str, Float[np.ndarray, " n"]]:
    """Return every command and what every sensor shows of a trial, SI, NaN if it does not measure.

    Args:
        simulator: vehicle and sensors.
        values: of all parameters, SI, those of process noise and disturbances among them if they are to be.
        time: of each sample, s.
        commands: every control of the vehicle, then what else a pilot is given, SI, each of shape (n,).
        start: state at the first sample, SI.
        measured: whether each sensor gives a sample.
        keys: of each sensor's noise; that of the pushes follows from the first.
        feedback: that decides the controls; they are as commanded without.

    Raises:
        InputError: a pilot that feeds back a channel whose noise is in proportion to its signal.
        NumericalError: a vehicle that runs away.
    """
    sensors, model = simulator.sensors, simulator.model
    blank = np.where(measured, 0.0, np.nan)
    channels = tuple(channel_data(time, column) for column in blank.T)

    def noise_about(shown: Float[np.ndarray, "n m"]) -> list[Float[np.ndarray, " n"]]:
        drawn = _noise(sensors, dict(values), channels, tuple(shown.T), tuple(keys))
        return [np.asarray(one) for one in drawn]

    # Differences of even times differ by rounding, and each other step would be another number to integrate with.
    step = np.diff(time, append=2 * time[-1] - time[-2])
    step = np.full(time.size, time[1]) if np.ptp(step) <= 1e-9 * time[1] else step
    pushes = _pushes(model, values, step, keys[0])
    pushed = replace(simulator, model=with_pushes(model, tuple(pushes)))
    count, held = len(model.controls), list(commands.values())
    if feedback is None:
        shown, end = _follow(pushed, dict(values), np.asarray(start, float), (*held[:count], *pushes.values()), step)
    else:
        _check_fed_back(feedback, sensors)
        ahead = noise_about(np.zeros_like(blank))
        errors = {sensor.channel: ahead[i] + blank[:, i] for i, sensor in enumerate(sensors)}
        moments = Moment(time, (*pushes.values(), *held), tuple(errors[name] for name in feedback.outputs))
        run = _closed_loop(pushed, _Pushed(feedback, len(pushes)), values, step)
        shown, end, command = run(np.asarray(start, float), moments)
        commands = {**commands, **dict(zip(model.controls, map(np.asarray, command), strict=False))}
    exact = np.asarray(shown)
    for sensor, column in zip(sensors, exact.T, strict=True):
        if not np.isfinite(column).all():
            raise NumericalError(
                f"the simulated vehicle diverges: {sensor.channel} is no number from {time[np.argmin(np.isfinite(column))]:g} s on; "
                "check the signs of the damping: negative coefficients dissipate"
            )
    if not np.isfinite(end).all():
        raise NumericalError(f"the simulated vehicle diverges after {time[-1]:g} s")
    noise = noise_about(exact)
    return {
        **commands,
        **{one.channel: np.where(measured[:, i], exact[:, i] + noise[i], np.nan) for i, one in enumerate(sensors)},
    }


def _check_fed_back(feedback: Pilot, sensors: Sequence[Sensor]) -> None:
    """Refuse noise of a channel that is fed back and whose size is not known before the motion is."""
    for sensor in sensors:
        if sensor.noise == "proportional" and sensor.channel in feedback.outputs:
            raise InputError(
                f"simulation, noise of {sensor.channel}",
                found='"proportional", of a channel that the autopilot feeds back',
                expected="noise that is drawn before the motion: white, coloured, heavy or drifting",
                remedy=f"simulate this trial with another kind of noise of {sensor.channel}",
            )


@dataclass(frozen=True, eq=False)
class _Pushed:
    """A pilot of a vehicle on which some last controls act that it does not decide; it is told them first."""

    pilot: Pilot
    count: int

    @property
    def outputs(self) -> tuple[str, ...]:
        return self.pilot.outputs

    def begin(self) -> Any:
        return self.pilot.begin()

    def decide(self, memory: Any, time: Any, seen: tuple, told: tuple) -> Any:
        return self.pilot.decide(memory, time, seen, told[self.count :])

    def controls(self, memory: Any, told: tuple) -> tuple:
        return (*self.pilot.controls(memory, told[self.count :]), *told[: self.count])


@cached_model
def with_pushes(model: VehicleModel, pushes: Sequence[str]) -> VehicleModel:
    """Return the vehicle with further controls: `process_u`, added to the rate of a state, and `outside_X`, a force on an axis."""
    if not pushes:
        return model
    count = len(model.controls)
    places = {process_name(state): place for place, state in enumerate(model.states)}

    def under(params: Any, control: tuple) -> dict[str, Any]:
        given = zip(pushes, control[count:], strict=True)
        return {**params, **{name: push for name, push in given if name not in places}}

    def derivative(params: Any, state: tuple, control: tuple) -> tuple:
        rates = list(model.derivative(under(params, control), state, control[:count]))
        for name, push in zip(pushes, control[count:], strict=True):
            if name in places:
                rates[places[name]] = rates[places[name]] + push
        return tuple(rates)

    outputs = {
        name: lambda params, state, control, view=view: view(under(params, control), state, control[:count])
        for name, view in model.outputs.items()
    }
    return replace(model, controls=(*model.controls, *pushes), derivative=derivative, outputs=outputs)


def _pushes(
    model: VehicleModel, values: Mapping[str, float], step: Float[np.ndarray, " n"], key: Array
) -> dict[str, Float[np.ndarray, " n"]]:
    """Draw what acts on a vehicle over each step beside its controls, by the names of `with_pushes`."""
    noisy = [state for state in model.states if values.get(process_name(state), 0.0) > 0]
    result = {}
    if noisy:
        draws = np.asarray(jax.random.normal(jax.random.fold_in(key, 1), (len(noisy), step.size)))
        result = {
            process_name(state): values[process_name(state)] * one / np.sqrt(step)
            for state, one in zip(noisy, draws, strict=True)
        }
    for number, axis in enumerate(disturbed_axes(values, model), 2):
        sd = values[disturbance_name(axis)]
        part = OverStep(*map(np.asarray, over_step(sd, values[disturbance_time_name(axis)], step)))
        first, gained, apart = np.asarray(jax.random.normal(jax.random.fold_in(key, number), (3, step.size)))
        gained, force = part.gained * gained, np.empty(step.size)
        force[0] = sd * first[0]
        for k in range(1, step.size):
            force[k] = part.memory[k - 1] * force[k - 1] + gained[k - 1]
        result[outside_force(axis)] = part.mean * force + part.with_gained * gained + part.apart * apart
    return result


@program(static_argnums=0)
def _noise(
    sensors: tuple[Sensor, ...],
    values: Mapping[str, Any],
    channels: tuple[ChannelData, ...],
    shown: tuple[Array, ...],
    keys: tuple[Array, ...],
) -> tuple[Array, ...]:
    parts = zip(sensors, channels, shown, keys, strict=True)
    return tuple(draw_noise(sensor, values, channel, x, key) for sensor, channel, x, key in parts)


@program(static_argnums=0)
def _follow(
    simulator: Simulator, values: Mapping[str, Any], start: Any, control: tuple, step: Any
) -> tuple[Array, Array]:
    followed = simulator.simulate(values, start, control, step)
    return jnp.stack(followed.kept, -1), jnp.stack(followed.end)


def _closed_loop(
    simulator: Simulator, pilot: Pilot, values: Mapping[str, float], step: Float[np.ndarray, " n"]
) -> Callable[[Array, Moment], tuple[Array, Array, tuple]]:
    """Return what a trial under a pilot shows, its last state and its controls; compiled."""

    @program
    def run(start: Array, moments: Moment) -> tuple[Array, Array, tuple]:
        followed = simulator.simulate(values, start, Feedback(pilot, moments), step)
        return jnp.stack(followed.kept, -1), jnp.stack(followed.end), followed.command

    return run


def _check_feedback(feedback: Autopilot | Relay, model: VehicleModel, channels: Sequence[str]) -> None:
    drives = feedback.vehicle if isinstance(feedback, Autopilot) else tuple(name for name, _ in feedback.family.trim)
    if drives != model.controls or not set(feedback.outputs) <= set(channels):
        raise InputError(
            "feedback",
            found=f"a pilot that feeds {', '.join(feedback.outputs)} back and drives {', '.join(drives)}",
            expected=f"sensors {', '.join(channels)} and controls {', '.join(model.controls)}",
            remedy="measure the channels that are fed back, and name every control of the vehicle in its order",
        )


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
            remedy="add it to the record, constant if it did not act",
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
            remedy="add it, constant if it does not act",
        )
    return schedule.controls[name]


def _blank(
    time: np.ndarray,
    controls: Mapping[str, np.ndarray],
    sensors: Sequence[Sensor],
    rates: Mapping[str, float],
    label: str,
) -> Record:
    """Return a record without measurements: zeros if each sensor gives a sample."""
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
    of_mounts = dict.fromkeys(name for one in sensors if one.mount for name in one.mount.unknown)
    of_vehicle = [*(term.text for term in model.coefficients), *(one.name for one in model.unknowns)]
    needed = [*of_vehicle, *of_mounts, *of_sensors, *pushed]
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
