"""Deterministic simulation: RK4 from sample to sample with the control held."""

from functools import lru_cache

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from seatrial.numerics.integrate import Integrator, rk4_step
from seatrial.vehicles.model import Params, VehicleModel


def simulate(
    model: VehicleModel,
    params: Params,
    control: Float[Array, "n n_controls"],
    step: Float[Array, " n"],
    initial: Float[Array, " n_states"],
    integrator: Integrator = rk4_step,
) -> Float[Array, "n n_states"]:
    """Trajectory at the sample times; row 0 is the initial state. May be batched with `jax.vmap`.

    Args:
        model: vehicle.
        params: value of each free coefficient, SI.
        control: control held from each sample to the next, SI.
        step: time from each sample to the next, s; the last entry is not used.
        initial: state at the first sample, SI.
        integrator: one-step method.
    """
    return _trajectory(model, integrator)(dict(params), control, step, initial)


@lru_cache(maxsize=64)
def _trajectory(model: VehicleModel, integrator: Integrator):
    @jax.jit
    def trajectory(params: dict, control: Array, step: Array, initial: Array) -> Array:
        def advance(state: tuple, sample: tuple) -> tuple:
            held, h = sample
            return integrator(lambda x: model.derivative(params, x, tuple(held)), state, h), state

        columns = tuple(control[:, i] for i in range(control.shape[1]))
        start = tuple(jnp.asarray(initial, float))
        _, states = jax.lax.scan(advance, start, (columns, step))
        return jnp.stack(states, axis=-1)

    return trajectory
