"""Least squares of accelerations as a baseline: a vehicle's own equations fitted to smoothed rates, then simulated.

    dnu_i/dt = f_i(x, c; 0) + sum_k theta_k df_i/dtheta_k (x, c)

at every sample, with x and dnu/dt of the measured signals smoothed (`regression/accelerations.py`), each axis weighed by what is left
of it; one step of Gauss and Newton ends it if the equations are linear in the coefficients, a few where added mass is among them.
It uses no priors and no delay. Noise in the states draws it aside, and nothing makes what it fits a stable vehicle: that is what a
baseline is for.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.compiled.batching import bucket_length, filled
from seatrial.compiled.programs import program
from seatrial.core.errors import InputError, NumericalError
from seatrial.core.record import Record
from seatrial.core.signals import ACTUAL, ANGLES, QUATERNION, RATES
from seatrial.estimation.prediction.baselines import ROWS_EACH, Baseline, FittedBaseline, cannot_be_fitted, noise_of
from seatrial.estimation.regression.accelerations import MIN_SAMPLES, smooth
from seatrial.estimation.simulation.starts import start_of
from seatrial.numerics.rotations import quaternion_of_angles
from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.simulate import simulate

NAME, WORDS = "accelerations", "least squares of accelerations"
STEPS = 5  # Steps of Gauss and Newton, each with every axis weighed anew
POOR = 3.0  # Standard deviations of a rate, in median ones, beyond which it is not used: it lies in a gap, or at an end


def acceleration_baseline(model: VehicleModel) -> Baseline:
    """Return the baseline that fits a vehicle's free coefficients to smoothed accelerations.

    Args:
        model: vehicle; its own controls are used, whatever controls the baseline is asked to fit with.
    """
    return Baseline(NAME, WORDS, partial(_fit, model))


def _check_runs(model: VehicleModel, records: Sequence[Record], channels: Sequence[str]) -> None:
    """Refuse runs that cannot tell the coefficients of the vehicle."""
    if not records:
        raise cannot_be_fitted("there is no run to fit")
    if not model.coefficients:
        raise cannot_be_fitted("the vehicle has no free coefficient")
    shown = model.channel_units()
    if not any(channel in shown for channel in channels):
        raise cannot_be_fitted(f"the vehicle has none of the channels {', '.join(channels)}")
    for state in (one for one in model.states if one in RATES):
        for record in records:
            count = int(np.isfinite(record.channel(state)).sum()) if state in record.measured else 0
            if count < MIN_SAMPLES or np.nanstd(record.channel(state)) == 0:
                raise cannot_be_fitted(
                    f'{state}, which the equations need, has {count} measured samples in run "{record.label}"'
                )
    if sum(record.time.size for record in records) < ROWS_EACH * len(model.coefficients):
        raise cannot_be_fitted(f"fewer than {ROWS_EACH} samples for each of {len(model.coefficients)} coefficients")


def _fit(
    model: VehicleModel, records: Sequence[Record], channels: Sequence[str], controls: Sequence[str]
) -> FittedBaseline:
    """Fit the coefficients and return what simulates the vehicle.

    Raises:
        InputError: runs that cannot tell them.
        NumericalError: coefficients of which only a combination is known, or a fitted vehicle that diverges on a run it was fitted to.
    """
    _check_runs(model, records, channels)
    shown = model.channel_units()
    chosen = tuple(channel for channel in channels if channel in shown)
    names = tuple(term.text for term in model.coefficients)
    params = dict(zip(names, _regressed(model, records).tolist(), strict=True))

    def means(record: Record, start: int) -> np.ndarray:
        return _simulated(model, params, chosen, record, start)

    for record in records:
        if not np.isfinite(means(record, 0)).all():
            raise NumericalError(
                f'the vehicle that fits the accelerations diverges when run "{record.label}" is simulated'
            )
    return FittedBaseline(NAME, chosen, noise_of(records, chosen, means), params, means)


def _regressed(model: VehicleModel, records: Sequence[Record]) -> Float[np.ndarray, " k"]:
    """Return the coefficients."""
    rows = tuple(i for i, state in enumerate(model.states) if state in RATES)
    pieces = [_motion(model, record) for record in records]
    values = np.zeros(len(model.coefficients))
    for _ in range(STEPS):
        target, design = [], []
        for state, rate, control in pieces:
            fitted, slope = _along(model, rows, values, state, control)
            target.append(rate - fitted + slope @ values)
            design.append(slope)
        y, phi = np.concatenate(target), np.concatenate(design)
        weight = 1.0 / np.maximum(np.sqrt(np.nanmean((y - phi @ values) ** 2, axis=0)), 1e-12)
        y, phi = (y * weight).ravel(), (phi * weight[:, None]).reshape(-1, values.size)
        known = np.isfinite(y) & np.isfinite(phi).all(1)
        values = _least_squares(model, phi[known], y[known])
    return values


def _least_squares(model: VehicleModel, phi: np.ndarray, y: np.ndarray) -> np.ndarray:
    size = np.linalg.norm(phi, axis=0)
    names = [term.text for term in model.coefficients]
    if (size == 0).any():
        raise NumericalError(f"these runs do not show {names[int(np.argmin(size))]}")
    result, _, rank, _ = np.linalg.lstsq(phi / size, y, rcond=1e-9)
    if rank < len(names):
        raise NumericalError(f"these runs show only combinations of {', '.join(names)}")
    return result / size


def _motion(model: VehicleModel, record: Record) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return states, shape (n, s), rates of the velocities, NaN if they are not known, shape (n, v), and controls of one run."""
    states, rates = [], []
    turned = _attitude(record)
    for name in model.states:
        if name in RATES:
            result = smooth(record.time, record.channel(name), where=f'record "{record.label}", channel "{name}"')
            states.append(result.value)
            rates.append(np.where(result.rate_sd <= POOR * np.median(result.rate_sd), result.rate, np.nan))
        else:
            states.append(turned[name] if name in turned else _other(record, name))
    held = np.column_stack([record.channel(name) for name in model.controls])
    seen = 0.5 * (held + np.concatenate([held[:1], held[:-1]]))  # a smoothed rate is that of the steps before and after
    return np.column_stack(states), np.column_stack(rates), seen


def _attitude(record: Record) -> dict[str, np.ndarray]:
    angles = [_other(record, name) for name in ANGLES]
    return dict(zip(QUATERNION, map(np.asarray, quaternion_of_angles(*angles)), strict=True))


def _other(record: Record, name: str) -> np.ndarray:
    """Return a state that is no velocity: measured, along straight lines; an actuator's, its command; else 0."""
    if name in record.measured:
        column = record.channel(name)
        there = np.isfinite(column)
        return np.interp(record.time, record.time[there], column[there])
    command = name.removesuffix(ACTUAL)
    return record.channel(command) if command in record.controls else np.zeros(record.time.size)


def _along(
    model: VehicleModel, rows: tuple[int, ...], values: np.ndarray, state: np.ndarray, control: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return rates of the velocities, shape (n, v), and their derivatives by the coefficients, shape (n, v, k)."""
    samples = bucket_length(len(state))
    result = _linearised(model, rows, values, filled(state, samples), filled(control, samples))
    rate, slope = (np.asarray(part)[: len(state)] for part in result)
    return rate, slope


@program(static_argnums=(0, 1))
def _linearised(
    model: VehicleModel, rows: tuple[int, ...], values: Array, state: Array, control: Array
) -> tuple[Array, Array]:
    names = [term.text for term in model.coefficients]

    def rate(values: Array, state: Array, control: Array) -> Array:
        known = dict(zip(names, values, strict=True))
        result = model.derivative(known, tuple(state), tuple(control))
        return jnp.stack([jnp.asarray(result[i]) for i in rows])

    each = jax.vmap(rate, (None, 0, 0))(values, state, control)
    return each, jax.vmap(jax.jacfwd(rate), (None, 0, 0))(values, state, control)


def _simulated(
    model: VehicleModel, params: dict[str, float], channels: tuple[str, ...], record: Record, start: int
) -> np.ndarray:
    """Return the channels of the simulated vehicle, from what is measured first at or after `start`; all NaN if nothing is."""
    means = np.full((record.time.size, len(channels)), np.nan)
    later = replace(
        record, time=record.time[start:], control=record.control[start:], measurement=record.measurement[start:]
    )
    try:
        first = start_of(model, later, None)
    except InputError:
        return means
    samples = bucket_length(later.time.size)
    control = filled(np.column_stack([later.channel(name) for name in model.controls]), samples)
    step = filled(np.append(np.diff(later.time), 0.0), samples, 0.0)
    shown = _outputs(model, channels, params, control, step, np.asarray(first, float))
    means[start:] = np.asarray(shown)[: later.time.size]
    return means


@program(static_argnums=(0, 1))
def _outputs(
    model: VehicleModel, channels: tuple[str, ...], params: dict[str, Array], control: Array, step: Array, first: Array
) -> Array:
    states = simulate(model, params, control, step, first)

    def shown(state: Array, held: Array) -> Array:
        return jnp.stack([jnp.asarray(model.output(one, params, tuple(state), tuple(held))) for one in channels])

    return jax.vmap(shown)(states, control)
