"""Steady motions and steering numbers by which published vehicles are checked.

Velocities, roll and pitch constant, by Levenberg-Marquardt with exact derivatives:

    d(u, v, w, p, q, r)/dt = 0,  d(phi, theta)/dt = 0,  and as many values held as there are controls

Held values are controls (the motion that they lead to), or states and their rates, whose controls are then sought: a speed and a
depth rate, or a rate of turn. A steady turn is a steady motion: its heading changes.
Nomoto's numbers are of small motions of sway and yaw about one: r(s) / delta(s) = K (1 + T3 s) / ((1 + T1 s) (1 + T2 s)).
"""

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import root

from seatrial.core.signals import ANGLES, CURRENT_COMPONENTS, POSITIONS, QUATERNION
from seatrial.numerics.rotations import angle_rates, quaternion_of_angles
from seatrial.vehicles.linearise import Trim, linearise
from seatrial.vehicles.model import Params, VehicleModel

_STARTS = (1.0, 2.0, 0.3, 5.0, -1.0)
"""Surge speeds, m/s, from which the search sets out in turn."""
_TURNS = 100.0
"""Propeller speed, rad/s, from which it sets out: at rest a thrust by n|n| has no slope."""


def steady_motion(
    model: VehicleModel, params: Params, held: Mapping[str, float], guess: Mapping[str, float] | None = None
) -> Trim:
    """Find a steady motion; there may be others, and it may be unstable.

    Args:
        model: any vehicle.
        params: value of each free coefficient, SI.
        held: values of as many controls, states, Euler angles or rates (`zdot`) as there are controls, SI.
        guess: values to set out from, of unknown states and controls.
    """
    names = _unknown(model)
    residual, slope = _balance(model, tuple(held))
    values = np.array([float(value) for value in held.values()])
    for speed in _STARTS:
        first = {"u": speed, **held, **(guess or {})}
        start = np.array([first.get(name, _TURNS * np.sign(speed) * name.startswith("n")) for name in names])
        found = root(
            residual,
            start,
            (values, dict(params)),
            "lm",
            slope,
            options={"xtol": 1e-15, "ftol": 1e-15, "maxiter": 2000},
        )
        left = float(np.abs(residual(found.x, values, dict(params))).max())
        tilt = [abs(x) for name, x in zip(names, found.x, strict=True) if name in ANGLES[:2]]
        if left < 1e-9 and max(tilt, default=0.0) < np.radians(85):
            state, control = _at(model, found.x)
            return Trim(tuple(float(x) for x in state), tuple(float(x) for x in control))
    raise AssertionError(f"no steady motion with {held}")


def _unknown(model: VehicleModel) -> tuple[str, ...]:
    """Names of what a motion is made of: states without positions and current, roll and pitch for a quaternion, and controls."""
    apart = (*POSITIONS, *CURRENT_COMPONENTS, *QUATERNION, "psi")
    angles = ANGLES[:2] if QUATERNION[0] in model.states else ()
    return (*(name for name in model.states if name not in apart), *angles, *model.controls)


def _at(model: VehicleModel, x: Any) -> tuple[tuple, tuple]:
    """State and control of the unknowns; heading and position zero, water at rest."""
    known = dict(zip(_unknown(model), x, strict=True))
    if QUATERNION[0] in model.states:
        turned = quaternion_of_angles(known["phi"], known["theta"], 0.0)
        known |= dict(zip(QUATERNION, turned, strict=True))
    return tuple(known.get(name, 0.0) for name in model.states), tuple(known[name] for name in model.controls)


@lru_cache(maxsize=64)
def _balance(model: VehicleModel, held: tuple[str, ...]) -> tuple[Any, Any]:
    """Rates that must vanish and held values that must be met, and their Jacobian by the unknowns; compiled once."""
    names = _unknown(model)
    apart = (*POSITIONS, *CURRENT_COMPONENTS, *QUATERNION, "psi")

    def residual(x: Any, values: Any, params: Params) -> Any:
        state, control = _at(model, x)
        rates = dict(zip(model.states, model.derivative(params, state, control), strict=True))
        known = dict(zip(names, x, strict=True))
        parts = [rates[name] for name in model.states if name not in apart]
        if QUATERNION[0] in model.states:
            turning = tuple(known.get(name, 0.0) for name in ("p", "q", "r"))
            parts += angle_rates(known["phi"], known["theta"], turning)[:2]
        for name, value in zip(held, values, strict=True):
            parts.append((known[name] if name in known else rates[name.removesuffix("dot")]) - value)
        return jnp.stack([jnp.asarray(part, float) for part in parts])

    return jax.jit(residual), jax.jit(jax.jacfwd(residual))


class Nomoto(NamedTuple):
    """Gain in 1/s and time constants in s; T1 and T2 are complex where sway and yaw oscillate, negative where they are unstable."""

    K: float
    T: float
    T1: complex
    T2: complex
    T3: float


def nomoto(model: VehicleModel, params: Params, at: Trim, rudder: str = "delta_r") -> Nomoto:
    """Nomoto's numbers of small motions of v and r about a motion, all other states held.

    Args:
        model: vehicle with the states v and r.
        params: value of each free coefficient, SI.
        at: state and control, a steady motion on a straight course for the usual meaning.
        rudder: the control.
    """
    a, b = (np.asarray(x) for x in linearise(model, params, at.state, at.control))
    index = [model.states.index(name) for name in ("v", "r")]
    a, b = a[np.ix_(index, index)], b[index, model.controls.index(rudder)]
    determinant = float(np.linalg.det(a))
    # r(s)/delta(s) = (b2 s + a21 b1 - a11 b2) / (s^2 - trace s + determinant)
    top = float(a[1, 0] * b[0] - a[0, 0] * b[1])
    one, other = sorted(-1.0 / np.linalg.eigvals(a), key=abs, reverse=True)
    third = float(b[1]) / top
    return Nomoto(top / determinant, float(np.real(one + other)) - third, one.item(), other.item(), third)
