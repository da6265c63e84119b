"""Motions of many vehicles at once: one speed over time, and the steady speed and time constant under a constant one.

From du/dt = f(u): f(u*) = 0 and T = -1 / f'(u*).
"""

from collections.abc import Mapping, Sequence
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.estimation.simulation import delay_control
from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.simulate import simulate

FASTEST = 20.0
"""m/s or rad/s; a vehicle beyond it has run away."""
BATCH = 100
"""Vehicles simulated at once, so that a long record fits in memory."""


def speeds(
    model: VehicleModel,
    state: str,
    params: Mapping[str, Float[np.ndarray, " d"]],
    delay: Float[np.ndarray, " d"] | None,
    start: Float[np.ndarray, "d n_states"],
    control: Float[np.ndarray, "n n_controls"],
    step: Float[np.ndarray, " n"],
    keep: Sequence[int],
) -> tuple[Float[np.ndarray, "d k"], np.ndarray]:
    """Speed of each vehicle at the samples to keep, SI, and whether it leaves `FASTEST` or is no number at any sample.

    Args:
        model: vehicle.
        state: which of its speeds.
        params: coefficients of each, SI.
        delay: between command and action of each, s; None for none.
        start: state of each at the first sample, SI.
        control: held from each sample to the next, SI.
        step: time to the next sample, s; uniform if there is a delay.
        keep: indices of samples.
    """
    run, kept, lost = _batch(model, state, delay is not None), [], []
    for i in range(0, len(start), BATCH):
        part = slice(i, i + BATCH)
        values = {name: column[part] for name, column in params.items()}
        late = np.zeros(len(start[part])) if delay is None else delay[part]
        speed, whole = run(values, late, start[part], control, step, np.asarray(keep))
        kept.append(np.asarray(speed))
        lost.append(~np.asarray(whole))
    return np.concatenate(kept), np.concatenate(lost)


@lru_cache(maxsize=16)
def _batch(model: VehicleModel, state: str, delayed: bool):
    def one(values: dict, late: Array, start: Array, control: Array, step: Array, keep: Array) -> tuple[Array, Array]:
        if delayed:
            control = jax.vmap(delay_control, in_axes=(1, None), out_axes=1)(control, late / step[0])
        speed = simulate(model, values, control, step, start)[:, model.states.index(state)]
        return speed[keep], (jnp.abs(speed) <= FASTEST).all()

    return jax.jit(jax.vmap(one, in_axes=(0, 0, 0, None, None, None)))


def steady_motion(
    model: VehicleModel, params: Mapping[str, Float[np.ndarray, " d"]], control: Sequence[float], start: float = 0.0
) -> tuple[Float[np.ndarray, " d"], Float[np.ndarray, " d"]]:
    """Speed, m/s, in which each surge vehicle settles, and the time constant there, s; NaN where there is none.

    As `trim_speed`: the first zero of du/dt on the side to which the vehicle sets off, up to `FASTEST` away.

    Args:
        model: surge vehicle.
        params: coefficients of each, SI.
        control: held, SI.
        start: speed from which it sets off, m/s. Terms in the change from trim hold near trim only, so rest may be too far.
    """
    count = len(next(iter(params.values())))

    def rate(u):
        return model.derivative(params, (u,), tuple(control))[0] + 0.0 * u

    side = np.sign(rate(np.full(count, float(start))))
    grid = np.linspace(0.0, FASTEST, 401)
    opposed = rate(start + grid[:, None] * side) * side <= 0
    beyond, found = opposed.argmax(axis=0), opposed.any(axis=0)
    low, high = grid[np.maximum(beyond - 1, 0)], grid[beyond]
    for _ in range(50):
        middle = 0.5 * (low + high)
        ahead = rate(start + middle * side) * side > 0
        low, high = np.where(ahead, middle, low), np.where(ahead, high, middle)
    speed = start + high * side
    _, slope = jax.jvp(rate, (jnp.asarray(speed),), (jnp.ones(count),))
    slope = np.asarray(slope)
    found = found & (slope < 0)
    return np.where(found, speed, np.nan), np.where(found, -1.0 / np.where(found, slope, 1.0), np.nan)
