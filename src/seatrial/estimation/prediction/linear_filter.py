"""A Kalman filter of a vehicle, of forces that no term makes and of errors of its sensors, linear about a motion, for many trials.

    x' = x1 + A (x - x0) + B f,   f = mean of d over the step,   y = y0 + H (x - x0) + J d + b + noise

x0 is a state at each sample about which the vehicle moves to x1 and shows y0. The force d of each axis and the error b of each sensor are
Ornstein-Uhlenbeck processes, exact from sample to sample (`simulation/disturbance.py`). Rows are sets of their sizes and memories.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from seatrial.compiled.batching import bucket_length, filled
from seatrial.compiled.programs import program
from seatrial.estimation.posterior.filter_error import process_name
from seatrial.estimation.simulation.disturbance import disturbance_name, disturbance_time_name, over_step
from seatrial.estimation.simulation.mounts import LATE
from seatrial.estimation.simulation.sensor_errors import drift_name, drift_time_name, noise_name
from seatrial.estimation.simulation.simulator import Simulator
from seatrial.estimation.simulation.trial_data import TrialData
from seatrial.vehicles.model import outside_force
from seatrial.vehicles.simulate import move_by


class Motion(NamedTuple):
    """A motion to first order about states along it: n states, a axes, m channels; the first axis of every array counts its samples.

    Attributes:
        state: about which it is linear, shape (samples, ..., n).
        moved: those places one step later, shape (samples, ..., n).
        by_state: slopes of that by the state, shape (samples, ..., n, n).
        by_force: by the mean force over the step, shape (samples, ..., n, a).
        shown: what the sensors show, shape (samples, ..., m).
        seen_state: slopes of that by the state, shape (samples, ..., m, n).
        seen_force: by the force, shape (samples, ..., m, a).
    """

    state: np.ndarray
    moved: np.ndarray
    by_state: np.ndarray
    by_force: np.ndarray
    shown: np.ndarray
    seen_state: np.ndarray
    seen_force: np.ndarray

    def at(self, rows: Any) -> "Motion":
        """Return some of the samples."""
        return self._replace(**{name: array[rows] for name, array in self._asdict().items()})


class Errors(NamedTuple):
    """Forces and errors of sensors that fade, over steps; the first axis of all but the last array counts these.

    Attributes:
        memory: what is left of each force, then of each sensor's error, shape (samples, ..., a + m).
        gained: standard deviation of what is new of each at the end of the step, of the same shape.
        mean: mean force over the step, over that at its beginning, shape (samples, ..., a).
        with_gained: what is new of the mean force, over what is new at the end, shape (samples, ..., a).
        apart: standard deviation of the rest of the mean force, shape (samples, ..., a).
        process: standard deviation that each state gains, shape (samples, ..., n).
        noise: of each sensor's white noise, shape (..., m).
        spread: standard deviation of each force and sensor's error, shape (..., a + m).
    """

    memory: np.ndarray
    gained: np.ndarray
    mean: np.ndarray
    with_gained: np.ndarray
    apart: np.ndarray
    process: np.ndarray
    noise: np.ndarray
    spread: np.ndarray

    def at(self, rows: Any) -> "Errors":
        """Return some of the steps."""
        shared = ("noise", "spread")
        return self._replace(**{name: array[rows] for name, array in self._asdict().items() if name not in shared})


class Belief(NamedTuple):
    """Mean and covariance of states, forces and sensors' errors, shapes (..., z) and (..., z, z); log density of what was measured."""

    mean: np.ndarray
    cov: np.ndarray
    log_density: np.ndarray = np.zeros(())


def without_memory(simulator: Simulator) -> Simulator:
    """Return a simulator whose commands act at once and whose sensors show the motion at once, as the filter has to take them."""
    sensors = []
    for sensor in simulator.sensors:
        mount = sensor.mount
        if mount is not None:
            known = tuple(name for name in mount.unknown if not name.startswith(LATE))
            mount = replace(mount, late=0.0, unknown=known)
        sensors.append(replace(sensor, noise="drifting", lag=False, mount=mount))
    return replace(simulator, sensors=tuple(sensors), delay=False, late=0)


def shown_by(data: TrialData) -> Float[np.ndarray, "n trials 1 m"]:
    """Return what was measured, NaN if nothing was."""
    columns = [np.where(one.present > 0, one.measured, np.nan) for one in data.channels]
    return np.stack(columns, -1).swapaxes(0, 1)[:, :, None]


def acting_control(
    simulator: Simulator, values: Mapping[str, np.ndarray], data: TrialData
) -> tuple[Float[np.ndarray, "trials n"], ...]:
    """Return the controls of every trial as they act, after the delay where there is one."""
    if not simulator.delay:
        return tuple(map(np.asarray, data.control))
    return tuple(map(np.asarray, jax.vmap(simulator.delayed)(dict(values), data.control, data.step)))


def linear_motion(
    simulator: Simulator,
    values: Mapping[str, np.ndarray],
    data: TrialData,
    control: tuple[np.ndarray, ...],
    starts: Float[np.ndarray, "trials n"],
    errors: Mapping[str, np.ndarray],
    initial_sd: Float[np.ndarray, " n"],
) -> Motion:
    """Return trials to first order about their measured motion: about the last measurement, and the filter where a state has none.

    Arrays have the shape (samples, trials, 1, ...). Arguments as those of `follow`.
    """
    states, channels = simulator.model.states, [sensor.channel for sensor in simulator.sensors]
    about = np.repeat(starts[:, None], data.step.shape[1], 1)
    for place in range(len(states)):
        if states[place] in channels:
            channel = data.channels[channels.index(states[place])]
            last = np.maximum.accumulate(np.where(channel.present > 0, np.arange(about.shape[1]), -1), 1)
            seen = np.take_along_axis(channel.measured, np.maximum(last, 0), 1)
            about[:, :, place] = np.where(last >= 0, seen, about[:, :, place])
    motion = linear(simulator, values, about, control, data.step)
    if set(states) <= set(channels):
        return motion
    one = {name: column[:1] for name, column in errors.items()}
    every = np.arange(data.step.shape[1])
    track = follow(
        motion, errors_over(simulator, one, np.asarray(data.step).T), shown_by(data), starts, initial_sd, every
    )
    unseen = [place for place in range(len(states)) if states[place] not in channels]
    about[:, :, unseen] = track.mean[:, :, 0, unseen].swapaxes(0, 1)
    return linear(simulator, values, about, control, data.step)


def linear(
    simulator: Simulator,
    values: Mapping[str, np.ndarray],
    states: Float[np.ndarray, "trials samples n"],
    control: tuple[Float[np.ndarray, "trials samples"], ...],
    step: Float[np.ndarray, "trials samples"],
) -> Motion:
    """Return a motion to first order about states of each trial, of shapes (samples, trials, 1, ...)."""
    size = bucket_length(states.shape[1])
    padded = [np.moveaxis(filled(np.moveaxis(np.asarray(x), 1, 0), size), 0, 1) for x in (states, step, *control)]
    local = _slopes(simulator)(dict(values), padded[0], tuple(padded[2:]), padded[1])
    arrays = (padded[0], *local)
    return Motion(*(np.asarray(x).swapaxes(0, 1)[: states.shape[1], :, None] for x in arrays))


def errors_over(
    simulator: Simulator, errors: Mapping[str, np.ndarray], step: Float[np.ndarray, "samples trials"]
) -> Errors:
    """Return forces and errors over steps.

    Args:
        simulator: vehicle and sensors.
        errors: parameters by name, shape (rows,), SI.
        step: of each trial, s.
    """
    axes, channels = simulator.model.disturbance_axes, [sensor.channel for sensor in simulator.sensors]
    a = len(axes)

    def stacked(names: Sequence[str]) -> np.ndarray:
        rows = len(next(iter(errors.values())))
        return np.stack([errors[name] for name in names], -1) if names else np.zeros((rows, 0))

    spread = stacked([*map(disturbance_name, axes), *map(drift_name, channels)])
    time = stacked([*map(disturbance_time_name, axes), *map(drift_time_name, channels)])
    steps, place = np.unique(step, return_inverse=True)
    over = over_step(spread, time, steps[:, None, None])
    memory, mean, gained, with_gained, apart = (
        np.broadcast_to(np.asarray(one), (len(steps), *spread.shape))[place.reshape(step.shape)] for one in over
    )
    process = stacked([process_name(state) for state in simulator.model.states]) * np.sqrt(step)[..., None, None]
    noise = stacked(list(map(noise_name, channels)))
    return Errors(memory, gained, mean[..., :a], with_gained[..., :a], apart[..., :a], process, noise, spread)


def predicted(belief: Belief, motion: Motion, errors: Errors) -> Belief:
    """Return the belief one step later; all arguments at one sample, or at the same number of them."""
    n, a = motion.by_force.shape[-2:]
    z = belief.mean.shape[-1]
    m, later = z - n - a, np.arange(n, z)
    batch = belief.mean.shape[:-1]
    slope, shock = np.zeros((*batch, z, z)), np.zeros((*batch, z, 2 * a + m))
    slope[..., :n, :n] = motion.by_state
    slope[..., :n, n : n + a] = motion.by_force * errors.mean[..., None, :]
    slope[..., later, later] = errors.memory
    shock[..., :n, :a] = motion.by_force * (errors.with_gained * errors.gained[..., :a])[..., None, :]
    shock[..., :n, a + m :] = motion.by_force * errors.apart[..., None, :]
    shock[..., later, later - n] = errors.gained
    off = belief.mean.copy()
    off[..., :n] -= motion.state
    mean = (slope @ off[..., None])[..., 0]
    mean[..., :n] += motion.moved
    cov = slope @ belief.cov @ slope.swapaxes(-1, -2) + shock @ shock.swapaxes(-1, -2)
    cov[..., np.arange(n), np.arange(n)] += errors.process**2
    return Belief(mean, cov, belief.log_density)


def observed(belief: Belief, motion: Motion, errors: Errors) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean and the variance of each measurement; arguments as those of `predicted`, at the sample of the belief."""
    seen = _seen(belief, motion)
    off = belief.mean.copy()
    off[..., : motion.state.shape[-1]] -= motion.state
    mean = motion.shown + (seen @ off[..., None])[..., 0]
    return mean, ((seen @ belief.cov) * seen).sum(-1) + errors.noise**2


@np.errstate(over="ignore", invalid="ignore")  # A model that diverges has no forecast, which is not finite.
def follow(
    motion: Motion,
    errors: Errors,
    measured: Float[np.ndarray, "samples trials 1 m"],
    starts: Float[np.ndarray, "trials n"],
    initial_sd: Float[np.ndarray, " n"],
    begins: Int[np.ndarray, " k"],
) -> Belief:
    """Return the belief after some samples, shapes (k, trials, rows, z), and the log density of all up to the last, (trials, rows).

    Channels are taken in one after the other, as their white noises are independent.

    Args:
        motion: of trials, shapes (samples, trials, 1, ...).
        errors: of rows of parameters, shapes (samples, trials, rows, ...).
        measured: NaN if nothing was.
        starts: mean of each trial's state at its first sample, SI.
        initial_sd: standard deviation of that, SI.
        begins: samples.
    """
    n, rows, trials = len(initial_sd), len(errors.spread), len(starts)
    z = n + errors.spread.shape[-1]
    mean = np.zeros((trials, rows, z))
    mean[..., :n] = starts[:, None]
    spread = np.concatenate([np.broadcast_to(initial_sd, (rows, n)), errors.spread], -1)
    belief = Belief(mean, np.broadcast_to(np.eye(z) * spread[:, None] ** 2, (trials, rows, z, z)).copy())
    density, kept, wanted = np.zeros((trials, rows)), {}, set(np.asarray(begins).tolist())
    for k in range(max(wanted) + 1):
        here = motion.at(k)
        if k:
            belief = predicted(belief, motion.at(k - 1), errors.at(k - 1))
        mean, cov, seen = belief.mean, belief.cov, _seen(belief, here)
        for i, slope in enumerate(np.moveaxis(seen, -2, 0)):
            present = np.isfinite(measured[k, ..., i])
            off = mean.copy()
            off[..., :n] -= here.state
            left = np.where(present, measured[k, ..., i] - here.shown[..., i] - (slope * off).sum(-1), 0.0)
            cross = (cov @ slope[..., None])[..., 0] * present[..., None]
            variance = (slope * cross).sum(-1) + errors.noise[:, i] ** 2
            mean = mean + cross * (left / variance)[..., None]
            cov = cov - cross[..., :, None] * cross[..., None, :] / variance[..., None, None]
            density = density - 0.5 * present * (left**2 / variance + np.log(variance))
        belief = Belief(mean, cov)
        if k in wanted:
            kept[k] = belief
    means, covs = (np.stack([getattr(kept[int(k)], name) for k in begins]) for name in ("mean", "cov"))
    return Belief(means, covs, density)


@np.errstate(over="ignore", invalid="ignore")
def variances(
    motion: Motion,
    simulator: Simulator,
    errors: Mapping[str, np.ndarray],
    ahead: Float[np.ndarray, "k h"],
    cov: Float[np.ndarray, "k 1 z z"],
    steps: int,
) -> Float[np.ndarray, "k steps m"]:
    """Return the variance of every measurement ahead.

    Args:
        motion: to first order about each forecast, shapes (h, k, 1, ...).
        simulator: vehicle and sensors.
        errors: parameters by name, shape (1,), SI.
        ahead: steps, s.
        cov: covariance of states, forces and errors at the beginnings.
        steps: how many are asked for.
    """
    belief, result = Belief(np.zeros(cov.shape[:-1]), cov), []
    for lead in range(steps):
        over = errors_over(simulator, errors, ahead[:, lead, None])
        over = over.at((slice(None), 0))
        belief = predicted(belief, motion.at(lead), over)
        result.append(observed(belief, motion.at(lead + 1), over)[1][:, 0])
    return np.stack(result, 1)


def _seen(belief: Belief, motion: Motion) -> np.ndarray:
    """Return slopes of what the sensors show by states, forces and their own errors, shape (..., m, z)."""
    m = motion.shown.shape[-1]
    own = np.broadcast_to(np.eye(m), (*motion.seen_state.shape[:-1], m))
    seen = np.concatenate([motion.seen_state, motion.seen_force, own], -1)
    return np.broadcast_to(seen, (*belief.mean.shape[:-1], *seen.shape[-2:]))


def functions_of(simulator: Simulator, values: Mapping[str, Any]):
    """Return what moves the vehicle, and what it shows, of state, force and control; traced."""
    model, none = simulator.model, ((None, None),) * len(simulator.sensors)

    def under(force: Array) -> dict[str, Any]:
        return {**values, **{outside_force(axis): force[i] for i, axis in enumerate(model.disturbance_axes)}}

    def move(state: Array, force: Array, held: tuple, step: Any) -> Array:
        moved = move_by(model, under(force))(tuple(state), held, step)
        return jnp.stack([jnp.asarray(x, float) for x in moved])

    def show(state: Array, force: Array, held: tuple) -> Array:
        shown = simulator.show(under(force), tuple(state), held, none, none)
        return jnp.stack([jnp.asarray(y, float) for y, _ in shown])

    return move, show


@lru_cache(maxsize=16)
def _slopes(simulator: Simulator):
    """Return the compiled function of values, states, controls and steps of trials: what follows `state` in `Motion`."""

    def of_sample(values: Mapping[str, Any], state: Array, held: tuple, step: Array) -> tuple[Array, ...]:
        move, show = functions_of(simulator, values)
        still = jnp.zeros(len(simulator.model.disturbance_axes))
        by_state, by_force = jax.jacfwd(move, (0, 1))(state, still, held, step)
        seen_state, seen_force = jax.jacfwd(show, (0, 1))(state, still, held)
        return move(state, still, held, step), by_state, by_force, show(state, still, held), seen_state, seen_force

    @program
    def of_trials(values: Mapping[str, Any], states: Array, control: tuple, step: Array) -> tuple[Array, ...]:
        return jax.vmap(jax.vmap(of_sample, (None, 0, 0, 0)))(values, states, control, step)

    return of_trials
