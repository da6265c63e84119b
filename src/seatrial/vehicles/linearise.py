"""Trim in surge and in level flight, and small motions about any point: d(dx)/dt = A dx + B dc with A = df/dx and B = df/dc.

Derivatives are exact, by forward differentiation of the model. The quaternion of a whole vehicle is four states of which three
are free: A then has an eigenvalue -2 `PULL` of its length.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from math import copysign
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.compiled.programs import program
from seatrial.core.errors import InputError
from seatrial.vehicles.model import Params, VehicleModel

LONGITUDINAL_STATES = ("u", "w", "q", "z", "theta")


class Trim(NamedTuple):
    """Steady level flight: state and control in the model's order, SI."""

    state: tuple[float, ...]
    control: tuple[float, ...]


def trim_speed(model: VehicleModel, params: Params, control: Sequence[float], limit: float = 20.0) -> float:
    """Return the equilibrium surge speed, m/s, that the vehicle reaches from rest under a constant control.

    It is the first zero of du/dt on the side to which the vehicle sets off; others may lie beyond, unstable.

    Args:
        model: surge vehicle.
        params: value of each free coefficient, SI.
        control: constant value of each control, SI.
        limit: speed at which the search gives up, m/s.

    Raises:
        InputError: no equilibrium up to `limit`, for example because the damping does not dissipate.
    """

    def rate(u: float) -> float:
        return float(model.derivative(params, (u,), tuple(control))[0])

    start = rate(0.0)
    speeds = copysign(limit, start) * np.linspace(0.0, 1.0, 401)
    beyond = next((i for i, speed in enumerate(speeds) if rate(speed) * start <= 0), None)
    if beyond is None:
        raise InputError(
            f'vehicle "{model.name}", trim',
            found=f"du/dt = {start:.3g} m/s^2 at rest and of that sign up to {speeds[-1]:g} m/s",
            expected="drag that balances the thrust at some speed",
            remedy="check the signs of the damping coefficients: negative dissipates",
        )
    if beyond == 0:
        return 0.0
    low, high = float(speeds[beyond - 1]), float(speeds[beyond])
    sign = rate(low)
    while low != (middle := 0.5 * (low + high)) != high:  # until no number lies between
        low, high = (middle, high) if rate(middle) * sign > 0 else (low, middle)
    return middle


def trim(model: VehicleModel, params: Params, *, u: float | None = None, n: float | None = None) -> Trim:
    """Solve for steady level flight: du/dt = dw/dt = dq/dt = dz/dt = q = 0, by Levenberg-Marquardt with exact derivatives.

    Args:
        model: longitudinal vehicle driven by n; without delta_s only a vehicle that needs none has a trim.
        params: value of each free coefficient, SI.
        u: surge speed, m/s, for which the propeller speed is sought; or
        n: propeller speed, rad/s, for which the surge speed is sought.

    Raises:
        InputError: both or none of u and n given, no propeller, or no level flight within 60 degrees of pitch and fin.
    """
    from scipy.optimize import root

    where = f'vehicle "{model.name}", trim'
    if model.states != LONGITUDINAL_STATES or "n" not in model.controls or (u is None) == (n is None):
        raise InputError(
            where,
            found=f"u = {u}, n = {n}, states {', '.join(model.states)}, controls {', '.join(model.controls) or 'none'}",
            expected="one of u and n, of a longitudinal vehicle driven by n",
            remedy="give the speed or the propeller speed, and a thrust term such as T_nabsn",
        )

    given = u if u is not None else n
    rates, jacobian = (partial(one, model, u is not None) for one in (_level_rates, _level_jacobian))
    first = np.copysign(100.0, u) if u is not None else _level_speed(model, params, n)
    result = root(
        rates,
        np.array([first, 0.0, 0.0, 0.0]),
        args=(given, dict(params)),
        jac=jacobian,
        method="lm",
        options={"xtol": 1e-15, "ftol": 1e-15},
    )
    residual = float(np.abs(rates(result.x, given, dict(params))).max())
    if not (residual < 1e-9 and np.abs(result.x[2:]).max() < np.pi / 3):
        raise InputError(
            where,
            found=f"accelerations down to {residual:.3g} at pitch {result.x[2]:.3g} rad and stern plane {result.x[3]:.3g} rad",
            expected="an equilibrium in level flight",
            remedy="go faster, trim the buoyancy, or check the signs of the coefficients of Z and M",
        )
    state, control = _level(model, u is not None, result.x, given)
    return Trim(tuple(float(x) for x in state), tuple(float(x) for x in control))


def linearise(
    model: VehicleModel, params: Params, state: Sequence[Any], control: Sequence[Any]
) -> tuple[Float[Array, "d d"], Float[Array, "d c"]]:
    """Return the Jacobians (A, B) of the state's rate; the point need not be an equilibrium.

    Args:
        model: any vehicle, d states and c controls.
        params: value of each free coefficient, SI.
        state: in the model's order, SI.
        control: in the model's order, SI.
    """
    point = jnp.concatenate([jnp.asarray(state, float), jnp.asarray(control, float)])
    (slopes,), _ = slopes_and_rates(
        model, {name: jnp.asarray(value)[None] for name, value in params.items()}, point[None]
    )
    return slopes[:, : len(model.states)], slopes[:, len(model.states) :]


@program(static_argnums=0)
def slopes_and_rates(model: VehicleModel, params: Params, points: Array) -> tuple[Array, Array]:
    """Return the Jacobians of the rates of the states by states and controls, (m, d, d + c), and the rates, (m, d), of m vehicles.

    Args:
        model: d states and c controls.
        params: values of each free coefficient, SI, shape (m,).
        points: state and control of each vehicle, shape (m, d + c), SI.
    """

    def of_one(values: dict, point: Array) -> tuple[Array, Array]:
        def rates(y: Array) -> tuple[Array, Array]:
            state, control = tuple(y[: len(model.states)]), tuple(y[len(model.states) :])
            result = jnp.stack([jnp.asarray(rate, float) for rate in model.derivative(values, state, control)])
            return result, result

        return jax.jacfwd(rates, has_aux=True)(point)

    return jax.vmap(of_one)(params, points)


def _level(model: VehicleModel, speed_given: bool, x: Any, given: Any) -> Trim:
    """Return level flight with the unknowns x: the other one of speed and propeller speed, then w, theta and delta_s."""
    speed, turns = (given, x[0]) if speed_given else (x[0], given)
    control = {"n": turns, "delta_s": x[3]}
    return Trim((speed, x[1], 0.0, 0.0, x[2]), tuple(control.get(name, 0.0) for name in model.controls))


@program(static_argnums=(0, 1))
def _level_rates(model: VehicleModel, speed_given: bool, x: Any, given: Any, params: Params) -> Any:
    """Return the rates of u, w, q and z in level flight."""
    return jnp.stack(model.derivative(params, *_level(model, speed_given, x, given))[:4])


@program(static_argnums=(0, 1))
def _level_jacobian(model: VehicleModel, speed_given: bool, x: Any, given: Any, params: Params) -> Any:
    """Return their Jacobian by the unknowns."""
    return jax.jacfwd(_level_rates, argnums=2)(model, speed_given, x, given, params)


def _level_speed(model: VehicleModel, params: Params, n: float | None) -> float:
    """Return the speed at which thrust and drag balance with heave, pitch and stern plane at zero: where the search starts."""

    def surge(params: Params, state: tuple, control: tuple) -> tuple:
        return model.derivative(params, (state[0], 0.0, 0.0, 0.0, 0.0), control)

    control = [n if name == "n" else 0.0 for name in model.controls]
    return trim_speed(replace(model, states=("u",), derivative=surge), params, control)
