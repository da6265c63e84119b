"""Forecasts of a record from moments along it: by its measurements up to each moment, and its controls.

A Kalman filter follows the record. Beside the states x of the vehicle it estimates the force d that no term makes on each axis
(`simulation/disturbance.py`) and the error b of each sensor that drifts. Both fade from where the filter sees them:

    x(t + h) = f(x^, d^ e^(-h / tau_d)),   y(t + h) = h(x) + b^ e^(-h / tau_b),   var y = H P(t + h) H' + sigma^2

One sample ahead, the errors of a forecast are the innovations. The filter is linear about the measured motion. Where the posterior has no
such force, sizes and memories of force and sensor errors are those by which the fitted records are forecast best. Several sets of these,
and several estimates of the coefficients, are weighed by the scores of what they forecast of the same record before.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float, Int

from seatrial.compiled.batching import bucket_length, filled
from seatrial.compiled.programs import program
from seatrial.core.record import Record
from seatrial.core.signals import SPEEDS
from seatrial.estimation.posterior.filter_error import FilterError, process_name
from seatrial.estimation.posterior.output_error import OutputError
from seatrial.estimation.posterior.posterior import Posterior, as_key
from seatrial.estimation.prediction.linear_filter import (
    Belief,
    acting_control,
    errors_over,
    follow,
    functions_of,
    linear,
    linear_motion,
    observed,
    predicted,
    shown_by,
    variances,
    without_memory,
)
from seatrial.estimation.prediction.prediction import posterior_of_record
from seatrial.estimation.prediction.prediction_scores import crps_normal
from seatrial.estimation.simulation.disturbance import (
    disturbance_name,
    disturbance_time_name,
    force_per_rate,
    over_step,
)
from seatrial.estimation.simulation.sensor_errors import drift_name, drift_time_name, noise_name
from seatrial.estimation.simulation.simulator import Simulator
from seatrial.estimation.simulation.trial_data import TrialData, first_samples
from seatrial.sampling.run import Draws

UNSEEN_SD = 1.0  # Standard deviation of a state at the start that no sensor measures, in its own unit
# Sizes that are tried, over the size of the motion: of errors of a sensor, and of what a force or process noise adds in one second.
MIN_NOISE, MAX_NOISE, MIN_PUSH, MAX_PUSH = 1e-5, 1.0, 1e-4, 10.0
# Where that search begins, of each size and of each memory over the length of a record; and of what is to be little at first.
BEGIN_SHARE, FEW_SHARE = 0.05, 1e-3
# Samples of all records, from their beginnings, by which sizes are found, and of each at least.
MAX_SAMPLES, MIN_SAMPLES = 1600, 300
MAX_ITERATIONS, DIFFERENCE = 30, 1e-4  # Steps of that search, and change of a logarithm from which slopes follow
MAX_DRAWS = 20
# The set for runs in which the model is wrong by more: sensor errors over the size of the motion, forces over those found, and memory over
# the horizon.
WIDE_ERROR, WIDE_FORCE, LONG = 0.2, 0.1, 5.0
# Power of the inverse of scores by which forecasts are weighed; chosen from 2, 4, 8 and 16 by forecasts of fitted runs of two ships.
SHARPNESS = 8.0
FITTED_SETS = 2  # Sets that are not wide
PAST = 6  # Forecasts before the first that is asked for, by which sets are weighed


@dataclass(frozen=True, eq=False)
class Forecast:
    """A record as forecast from k of its samples, up to h samples ahead; m channels.

    Attributes:
        record: what was forecast.
        channels: measured channels, in the order of the last axis.
        begins: samples from which it is forecast, shape (k,).
        mean: SI, shape (k, h, m), NaN beyond the end of the record.
        sd: standard deviation of a measurement about it, SI, shape (k, h, m).
    """

    record: Record
    channels: tuple[str, ...]
    begins: Int[np.ndarray, " k"]
    mean: Float[np.ndarray, "k h m"]
    sd: Float[np.ndarray, "k h m"]

    @property
    def measured(self) -> Float[np.ndarray, "k h m"]:
        """What was measured, SI, NaN if nothing was, or beyond the end of the record."""
        columns = np.column_stack([self.record.channel(name) for name in self.channels])
        rows = self.begins[:, None] + np.arange(1, self.mean.shape[1] + 1)
        return np.where((rows < len(columns))[..., None], columns[np.minimum(rows, len(columns) - 1)], np.nan)


@dataclass(frozen=True, eq=False)
class Forecaster:
    """A fitted vehicle, and the errors that remain.

    Attributes:
        posterior: of the fitted records.
        draws: of the posterior, by parameter name, SI.
        errors: sets of sizes and memories of the force on each axis and of the errors of each sensor, SI, by parameter name.
        first_sd, others: see `make_forecaster`.
    """

    posterior: Posterior
    draws: Mapping[str, Float[np.ndarray, " draws"]]
    errors: tuple[Mapping[str, float], ...]
    first_sd: Mapping[str, float]
    others: tuple[Mapping[str, float], ...] = ()

    def forecast(
        self,
        record: Record,
        begins: Sequence[int] | Int[np.ndarray, " k"],
        steps: int,
        *,
        start: Mapping[str, float] | Sequence[float] | None = None,
        n: int = MAX_DRAWS,
        key: jax.Array | int = 0,
    ) -> Forecast:
        """Forecast a record from some of its samples, each by the measurements up to it.

        Args:
            record: fitted or not.
            begins: samples, shape (k,).
            steps: how many samples ahead.
            start: state at the first sample, as that of `predict`.
            n: draws, at most.
            key: random key, or a seed.
        """
        alone, values = posterior_of_record(self.posterior, self.draws, record, start, self.first_sd, n, as_key(key))
        output, data, begins = alone.likelihood.output, alone.data, np.asarray(begins)
        drawn = len(next(iter(values.values())))
        values = {
            name: np.append(column, np.array([other.get(name, np.mean(column)) for other in self.others]))
            for name, column in values.items()
        }
        estimates = [slice(drawn), *(slice(k, k + 1) for k in range(drawn, drawn + len(self.others)))]
        simulator, count = without_memory(output.simulator), drawn + len(self.others)
        values |= {name: np.asarray(column)[:, 0] for name, column in jax.vmap(output.apart)(values).items()}
        first = jax.vmap(lambda one: jnp.broadcast_to(output.starts(one, data)[0], data.initial[0].shape))(values)
        data, starts = jax.tree.map(lambda x: np.repeat(np.asarray(x), count, 0), data), np.asarray(first)
        control = acting_control(output.simulator, values, data)
        # Forecasts that had ended before weigh the sets.
        past = begins.min() - steps * np.arange(1, (PAST if len(self.errors) * len(estimates) > 1 else 0) + 1)
        every, place = np.unique(np.concatenate([begins, past[past >= 0]]), return_inverse=True)
        rows = {name: np.array([one[name] for one in self.errors]) for name in self.errors[0]}
        motion = linear_motion(simulator, values, data, control, starts, rows, self.initial_sd)
        over = errors_over(simulator, rows, data.step[:1].T)
        track = follow(motion, over, shown_by(data), starts, self.initial_sd, every)
        # Past the end no time passes.
        at = every[:, None] + np.arange(bucket_length(steps) + 1)
        inside, at = at < record.time.size, np.minimum(at, data.step.shape[1] - 1)
        ahead, held = np.where(inside, data.step[0][at], 0.0), tuple(column[:, at] for column in control)
        begun = [Belief(track.mean[:, :, i], track.cov[:, :, i]) for i in range(len(self.errors))]
        each = [
            one
            for errors, belief in zip(self.errors, begun, strict=True)
            for one in _ahead(simulator, values, estimates, errors, held, ahead, belief, steps)
        ]
        is_beyond = ~inside[:, 1 : steps + 1, None]
        means, sds = (np.where(is_beyond, np.nan, np.stack(one)) for one in zip(*each, strict=True))
        channels, own = tuple(sensor.channel for sensor in simulator.sensors), place[: len(begins)]
        ended = Forecast(record, channels, every, means[0], sds[0])
        mean, sd = _weighed(ended, means, sds, is_beyond, len(self.errors))
        return Forecast(record, channels, begins, mean[own], sd[own])

    @property
    def initial_sd(self) -> Float[np.ndarray, " states"]:
        """Standard deviation of each state at the first sample, SI."""
        return initial_sd_of(self.posterior.likelihood, self.first_sd)


def make_forecaster(
    posterior: Posterior,
    draws: Draws | Mapping[str, Float[np.ndarray, " draws"]],
    horizon: float,
    first_sd: Mapping[str, float] | None = None,
    others: Sequence[Mapping[str, float]] = (),
) -> Forecaster:
    """Return what forecasts records by draws of a posterior of `make_posterior`.

    Args:
        posterior: of the records that were fitted.
        draws: of it; or those of each parameter by name, SI.
        horizon: how far ahead forecasts are to be good, s.
        first_sd: how well each state is known at the start of a record, SI; if not given, as `UNSEEN_SD`.
        others: other estimates of the coefficients, SI, by name: their forecasts are weighed beside those of the draws.
    """
    table = draws if isinstance(draws, Mapping) else dict(zip(draws.names, draws.array().T, strict=True))
    values = dict.fromkeys(posterior.names, 0.0) | {name: float(np.mean(column)) for name, column in table.items()}
    likelihood, first_sd = posterior.likelihood, first_sd or {}
    model, channels = likelihood.model, likelihood.channels
    known = {process_name(state): values.get(process_name(state), 0.0) for state in model.states}
    if isinstance(likelihood, FilterError) and likelihood.disturbed:
        known |= {noise_name(channel): values[noise_name(channel)] for channel in channels}
        for sd, time, pairs in (
            (disturbance_name, disturbance_time_name, model.disturbance_axes),
            (drift_name, drift_time_name, channels),
        ):
            known |= {sd(one): values.get(sd(one), 0.0) for one in pairs} | {
                time(one): values.get(time(one), 1.0) for one in pairs
            }
        return Forecaster(posterior, table, (known,), first_sd, tuple(others))
    fitted = fit_errors(likelihood, values, posterior.data, horizon, initial_sd_of(likelihood, first_sd))
    return Forecaster(posterior, table, tuple(known | one for one in fitted), first_sd, tuple(others))


def fit_errors(
    likelihood: OutputError | FilterError,
    values: Mapping[str, float],
    data: TrialData,
    horizon: float,
    initial_sd: Float[np.ndarray, " states"],
) -> list[dict[str, float]]:
    """Return size and memory of forces and of sensors' errors by which the fitted records are forecast with the highest density.

    Two sets come from two searches, the better one first. One more is for a run in which the model is wrong by much more than in the
    fitted ones: sensor errors that are larger and last longer.

    Half of that is the likelihood, which is that of one sample ahead; half is that of all leads up to the horizon, as they lie on a
    logarithmic axis. Of a force that is not quite of the kind assumed, the likelihood alone finds a memory that is far off over many
    samples.

    Args:
        likelihood: of the posterior.
        values: of all its parameters, SI, by name.
        data: fitted records.
        horizon: longest lead, s.
        initial_sd: of each state at the first sample, SI.
    """
    if data.step.size > MAX_SAMPLES:
        data = first_samples(data, min(data.step.shape[1], max(MAX_SAMPLES // len(data.step), MIN_SAMPLES)))
    data = jax.tree.map(np.asarray, data)
    output, trials = likelihood.output, len(data.step)
    simulator, axes = without_memory(output.simulator), likelihood.model.disturbance_axes
    of_trials = {name: np.full(trials, value) for name, value in values.items()}
    of_trials |= {name: np.asarray(column) for name, column in output.apart(values).items()}
    starts = np.asarray(output.starts(dict(values), data))
    control = acting_control(output.simulator, of_trials, data)
    interval, duration = float(np.median(data.step[data.step > 0])), float(np.max(np.sum(data.step, -1)))
    memory = duration, interval / duration, 1.0
    sizes, search = {}, {}  # Scale of each parameter, and the least and the largest share of it
    for name, channel in zip(output.channels, data.channels, strict=True):
        sizes[name] = float(np.std(channel.measured[channel.present > 0])) or 1.0
        search[noise_name(name)] = search[drift_name(name)] = sizes[name], MIN_NOISE, MAX_NOISE
        search[drift_time_name(name)] = memory
    for axis in axes:
        push = sizes.get(SPEEDS[axis], 1.0) * force_per_rate(likelihood.model, axis, values)
        search[disturbance_name(axis)] = push, MIN_PUSH, MAX_PUSH
        search[disturbance_time_name(axis)] = memory
    for state in () if axes else likelihood.model.states:
        search[process_name(state)] = sizes.get(state, UNSEEN_SD), MIN_PUSH, MAX_PUSH
    scale, least, most = np.array(list(search.values())).T

    def of_rows(z: Float[np.ndarray, "rows d"]) -> dict[str, np.ndarray]:
        fixed = {
            process_name(state): np.full(len(z), values.get(process_name(state), 0.0))
            for state in likelihood.model.states
        }
        return fixed | dict(zip(search, (scale * np.exp(z)).T, strict=True))

    motion = linear_motion(
        simulator,
        of_trials,
        data,
        control,
        starts,
        of_rows(np.log(np.clip(BEGIN_SHARE, least, most))[None]),
        initial_sd,
    )
    samples = data.step.shape[1]
    steps = max(1, min(round(horizon / interval), samples // 4))
    begins = np.append(np.arange(0, samples - 1, max(1, steps // 2)), samples - 1)
    measured = shown_by(data)
    weights = 1.0 / np.arange(1, steps + 1)

    def cost(z: Float[np.ndarray, "rows d"]) -> Float[np.ndarray, " rows"]:
        errors = errors_over(simulator, of_rows(z), data.step.T)
        track = follow(motion, errors, measured, starts, initial_sd, begins)
        far, total, belief = 0.0, 0.0, track
        for lead, weight in enumerate(weights):
            rows = np.minimum(begins + lead, samples - 2)
            belief = predicted(belief, motion.at(rows), errors.at(rows))
            mean, variance = observed(belief, motion.at(rows + 1), errors)
            shown = np.where((begins + lead + 1 < samples)[:, None, None, None], measured[rows + 1], np.nan)
            score = np.log(variance) + (shown - mean) ** 2 / variance
            far = far + weight * np.nansum(score, (0, 1, 3))
            total += weight * np.isfinite(shown).sum()
        result = 0.5 * (np.isfinite(measured).sum() * 0.5 * far / total - track.log_density.sum(0))
        return np.where(np.isfinite(result), result, 1e300)

    def descent(z: np.ndarray) -> tuple[float, np.ndarray]:
        moved = cost(np.vstack([z, z + DIFFERENCE * np.eye(z.size)]))
        return float(moved[0]), (moved[1:] - moved[0]) / DIFFERENCE

    bounds = list(zip(np.log(least), np.log(most) - DIFFERENCE, strict=True))
    options = {"maxiter": MAX_ITERATIONS, "ftol": 1e-5}
    # Errors of sensors and forces may stand for each other: the search begins once at little of the ones, once at little of the others.
    ends = []
    for few in (drift_name(""), disturbance_name("")):
        share = [FEW_SHARE if name.startswith(few) and "_time_" not in name else BEGIN_SHARE for name in search]
        first = np.log(np.clip(share, least, most))
        ends.append(
            scipy.optimize.minimize(descent, first, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
        )
    ends.sort(key=lambda one: one.fun)
    result = [dict(zip(search, map(float, scale * np.exp(one.x)), strict=True)) for one in ends]
    wide = dict(result[0])
    for channel in output.channels:
        wide[drift_name(channel)] = max(WIDE_ERROR * sizes[channel], wide[drift_name(channel)])
        wide[drift_time_name(channel)] = max(LONG * horizon, wide[drift_time_name(channel)])
    for axis in axes:
        wide[disturbance_name(axis)] *= WIDE_FORCE
    return [*result, wide]


def _ahead(
    simulator: Simulator,
    values: Mapping[str, np.ndarray],
    estimates: Sequence[slice],
    errors: Mapping[str, float],
    held: tuple[Float[np.ndarray, "draws k h"], ...],
    ahead: Float[np.ndarray, "k h"],
    begun: Belief,
    steps: int,
) -> list[tuple[Float[np.ndarray, "k steps m"], Float[np.ndarray, "k steps m"]]]:
    """Return mean and standard deviation of every measurement ahead by each estimate, with one set of sizes and memories.

    Args:
        simulator: vehicle and sensors.
        values: of each draw, all estimates one after the other.
        estimates: places of each among these.
        errors: the set.
        held: controls.
        ahead: steps, s.
        begun: what the filter knows where forecasts begin, shapes (k, draws, z) and (k, draws, z, z).
        steps: how many are asked for.
    """
    count, lanes = len(ahead), bucket_length(len(ahead))

    def padded(x: np.ndarray, axis: int) -> np.ndarray:
        return np.moveaxis(filled(np.moveaxis(x, axis, 0), lanes), 0, axis)

    first, driven = padded(begun.mean.swapaxes(0, 1), 1), tuple(padded(column, 1) for column in held)
    path, shown = map(np.asarray, _pieces(simulator)(values, dict(errors), first, driven, padded(ahead, 0)))
    path, shown = path[:, :count], shown[:, :count, 1 : steps + 1]
    rows, result = {name: np.array([value]) for name, value in errors.items()}, []
    for estimate in estimates:
        # The spread of the filter is that of the mean of the draws; they differ in it by less than it is known.
        middle = {name: np.repeat(column[estimate].mean(), count) for name, column in values.items()}
        local = linear(
            simulator, middle, path[estimate].mean(0), tuple(column[estimate].mean(0) for column in held), ahead
        )
        variance = variances(local, simulator, rows, ahead, begun.cov[:, estimate].mean(1)[:, None], steps)
        with np.errstate(over="ignore", invalid="ignore"):
            result.append((shown[estimate].mean(0), np.sqrt(variance + shown[estimate].var(0))))
    return result


def _weighed(
    ended: Forecast,
    means: Float[np.ndarray, "members k h m"],
    sds: Float[np.ndarray, "members k h m"],
    is_beyond: Float[np.ndarray, "k h 1"],
    sets: int,
) -> tuple[Float[np.ndarray, "k h m"], Float[np.ndarray, "k h m"]]:
    """Return mean and standard deviation over sets and estimates, weighed by the scores of those that had ended before, by channel."""
    begins, steps = ended.begins, means.shape[2]
    is_fit = (np.isfinite(means) & np.isfinite(sds)) | is_beyond
    is_lost = ~np.all(is_fit, axis=2, keepdims=True)
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        scores = np.where(is_lost, np.inf, crps_normal(ended.measured, means, sds))
    scores = np.where(np.isfinite(ended.measured), scores, 0.0).sum(2)
    total = np.concatenate([np.zeros_like(scores[:, :1]), np.cumsum(scores, 1)], 1)
    known = total[:, np.searchsorted(begins, begins - steps, side="right")]
    least = known.min(0)
    with np.errstate(invalid="ignore", divide="ignore"):
        # Scores and not densities: by these, one forecast that is far off decides for the widest band until the end of a record.
        is_wide = np.arange(len(means))[:, None, None] * sets >= FITTED_SETS * len(means)
        weight = np.where(least > 0, (least / known) ** SHARPNESS, ~is_wide)
        weight = np.where(is_lost[:, :, 0], 0.0, weight)[:, :, None]
        weight = weight / weight.sum(0)
    means, sds = np.where(is_lost, 0.0, means), np.where(is_lost, 0.0, sds)
    mean = (weight * means).sum(0)
    return mean, np.sqrt((weight * (sds**2 + (means - mean) ** 2)).sum(0))


def initial_sd_of(likelihood: OutputError | FilterError, first_sd: Mapping[str, float]) -> Float[np.ndarray, " states"]:
    """Return the standard deviation of each state at the first sample, SI: that of a filter, or as given."""
    if isinstance(likelihood, FilterError):
        return np.array(likelihood.initial_sd)
    return np.array([first_sd.get(state, UNSEEN_SD) for state in likelihood.model.states])


@lru_cache(maxsize=16)
def _pieces(simulator: Simulator):
    """Return the compiled function of draws' values, errors, beginnings, controls and steps: states and what is shown ahead."""
    axes, channels = simulator.model.disturbance_axes, [sensor.channel for sensor in simulator.sensors]
    n, a = len(simulator.model.states), len(axes)
    times = [*map(disturbance_time_name, axes), *map(drift_time_name, channels)]

    def of_piece(values: Mapping[str, Any], errors: Mapping[str, Any], begin: Array, held: tuple, step: Array):
        move, show = functions_of(simulator, values)

        def advance(known: Array, sample: tuple) -> tuple[Array, tuple[Array, Array]]:
            held, step = sample
            state, fading = known[:n], known[n:]
            parts = [over_step(1.0, errors[time], step) for time in times]
            mean = jnp.stack([part.mean for part in parts])
            memory = jnp.stack([part.memory for part in parts])
            moved = move(state, (mean * fading)[:a], held, step)
            return jnp.concatenate([moved, memory * fading]), (state, show(state, fading[:a], held) + fading[a:])

        return jax.lax.scan(advance, begin, (held, step))[1]

    @program
    def of_draws(values: Mapping[str, Any], errors: Mapping[str, Any], begins: Array, held: tuple, step: Array):
        of_begins = jax.vmap(of_piece, (None, None, 0, 0, 0))
        return jax.vmap(of_begins, (0, None, 0, 0, None))(values, errors, begins, held, step)

    return of_draws
