"""Deterministic simulation: RK4 from sample to sample with the control held."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from seatrial.compiled.programs import program
from seatrial.numerics.integrate import Integrator, Move, rk4_step, time_loop
from seatrial.vehicles.model import Params, VehicleModel


def simulate(
    model: VehicleModel,
    params: Params,
    control: Float[Array, "n n_controls"],
    step: Float[Array, " n"],
    initial: Float[Array, " n_states"],
    integrator: Integrator = rk4_step,
) -> Float[Array, "n n_states"]:
    """Return the trajectory at the sample times; row 0 is the initial state. May be batched with `jax.vmap`.

    Args:
        model: vehicle.
        params: value of each free coefficient, SI.
        control: control held from each sample to the next, SI.
        step: time from each sample to the next, s; the last entry is not used.
        initial: state at the first sample, SI.
        integrator: one-step method.
    """
    return _trajectory(model, integrator)(dict(params), control, step, initial)


def move_by(
    model: VehicleModel,
    params: Params,
    integrator: Integrator = rk4_step,
    others: Callable[[tuple, tuple], tuple] = lambda joint, held: (),
) -> Move:
    """Return what moves a vehicle of given coefficients from sample to sample; traced.

    Late actuators stand, at every stage of the integrator, where their closed form has them: exact, and stable for any lag.

    Args:
        model: vehicle.
        params: value of each free coefficient, SI.
        integrator: one-step method.
        others: `(joint, held) ->` rates of what travels behind the state and is integrated with it.
    """
    n, body = len(model.states), len(model.states) - len(model.exact_lags)

    def rates(joint: tuple, held: tuple) -> tuple:
        return (*model.derivative(params, joint[:n], held), *others(joint, held))

    def move(joint: tuple, held: tuple, h: Any) -> tuple:
        if not model.exact_lags:
            return integrator(lambda x: rates(x, held), joint, h)

        def actual(time: Any) -> tuple:
            return tuple(
                follow(params, before, held, time)
                for follow, before in zip(model.exact_lags, joint[body:n], strict=True)
            )

        def rate(x: tuple) -> tuple:
            *own, time = x
            slopes = rates((*own[:body], *actual(time), *own[body:]), held)
            return (*slopes[:body], *slopes[n:], 1.0)

        moved = integrator(rate, (*joint[:body], *joint[n:], 0.0 * h), h)
        return (*moved[:body], *actual(h), *moved[body:-1])

    return move


@lru_cache(maxsize=64)
def _trajectory(model: VehicleModel, integrator: Integrator):
    @program
    def trajectory(params: dict, control: Array, step: Array, initial: Array) -> Array:
        columns = tuple(control[:, i] for i in range(control.shape[1]))
        start, move = tuple(jnp.asarray(initial, float)), move_by(model, params, integrator)
        _, states = time_loop(move, start, columns, step, lambda state, *_: ((), state))
        return jnp.stack(states, axis=-1)

    return trajectory
