"""Steering in a few numbers: Nomoto's and Norrbin's models as views of the sway and yaw of any vehicle.

    r / delta = K (1 + T3 s) / ((1 + T1 s)(1 + T2 s)),   T = T1 + T2 - T3        Nomoto et al. (1957)
    T dr/dt + n3 r^3 + n2 r^2 + n1 r + n0 = K delta                              Norrbin (1963)

K is the rate of turn of a radian of rudder; it is negative where positive rudder turns to port. n1 is 1, or -1 for a vehicle that is
unstable on course. Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2nd ed., 2021, section 7.2.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from seatrial.core.errors import InputError
from seatrial.vehicles.linearise import Trim, linearise
from seatrial.vehicles.model import Params, VehicleModel
from seatrial.vehicles.trim import steady_motion


class Nomoto(NamedTuple):
    """Gain in 1/s and time constants in s; T1 and T2 are complex where sway and yaw oscillate, negative where they are unstable."""

    K: float
    T: float
    T1: complex
    T2: complex
    T3: float


class Norrbin(NamedTuple):
    """Gain, 1/s, time constant, s, and the polynomial of the rate of turn in rad/s."""

    K: float
    T: float
    n0: float
    n1: float
    n2: float
    n3: float


def nomoto(model: VehicleModel, params: Params, at: Trim, rudder: str = "delta_r") -> Nomoto:
    """Nomoto's numbers of small motions of v and r about a motion, all other states held.

    Args:
        model: vehicle with the states v and r.
        params: value of each free coefficient, SI.
        at: state and control, a steady motion on a straight course for the usual meaning.
        rudder: the control.

    Raises:
        InputError: no such states or control.
    """
    _check(model, rudder)
    a, b = (np.asarray(x) for x in linearise(model, params, at.state, at.control))
    index = [model.states.index(name) for name in ("v", "r")]
    a, b = a[np.ix_(index, index)], b[index, model.controls.index(rudder)]
    determinant = float(np.linalg.det(a))
    # r(s)/delta(s) = (b2 s + a21 b1 - a11 b2) / (s^2 - trace s + determinant)
    top = float(a[1, 0] * b[0] - a[0, 0] * b[1])
    one, other = sorted(-1.0 / np.linalg.eigvals(a), key=abs, reverse=True)
    third = float(b[1]) / top
    return Nomoto(top / determinant, float(np.real(one + other)) - third, one.item(), other.item(), third)


def norrbin(model: VehicleModel, params: Params, at: Trim, rates: Sequence[float], rudder: str = "delta_r") -> Norrbin:
    """Norrbin's numbers: the time constant of small motions, the polynomial of steady turns, all states but v and r held.

    Args:
        model: vehicle with the states v and r.
        params: value of each free coefficient, SI.
        at: straight motion about which the vehicle turns.
        rates: rates of turn, rad/s, of both signs, at which the rudder is found that keeps them.
        rudder: the control.

    Raises:
        InputError: no such states or control, fewer than four rates, or a rate that no rudder keeps.
    """
    linear = nomoto(model, params, at, rudder)
    if len(set(rates)) < 4:
        raise InputError(
            f'vehicle "{model.name}", Norrbin',
            found=f"{len(set(rates))} rates of turn",
            expected="at least four, of both signs",
            remedy="give rates over the range of turns that the model is for",
        )
    planar = _sway_and_yaw(model, at, rudder)
    angles = [steady_motion(planar, params, {"r": rate}).control[0] for rate in rates]
    r = np.asarray(rates)
    polynomial = np.linalg.lstsq(np.column_stack([r**0, r, r**2, r**3]), np.asarray(angles), rcond=None)[0]
    sign = 1.0 if np.real(linear.T1 * linear.T2) > 0 else -1.0
    gain = sign / float(polynomial[1])
    return Norrbin(gain, sign * linear.T, *(gain * float(part) for part in polynomial))


def _sway_and_yaw(model: VehicleModel, at: Trim, rudder: str) -> VehicleModel:
    """The vehicle with v and r alone moving, and the rudder its only control."""
    index = [model.states.index(name) for name in ("v", "r")]
    angle = model.controls.index(rudder)

    def derivative(params: Params, state: tuple, control: tuple) -> tuple[Any, ...]:
        whole, commands = list(at.state), list(at.control)
        for i, value in zip(index, state, strict=True):
            whole[i] = value
        commands[angle] = control[0]
        rates = model.derivative(params, tuple(whole), tuple(commands))
        return tuple(rates[i] for i in index)

    held = tuple((f"held {i}", float(x)) for i, x in enumerate((*at.state, *at.control)))
    return replace(
        model,
        states=("v", "r"),
        controls=(rudder,),
        constants=(*model.constants, *held),
        derivative=derivative,
        views={},
    )


def _check(model: VehicleModel, rudder: str) -> None:
    missing = [name for name in ("v", "r") if name not in model.states] + [rudder] * (rudder not in model.controls)
    if missing:
        raise InputError(
            f'vehicle "{model.name}", steering',
            found=f"no {', '.join(missing)}",
            expected=f"states v and r, and the control {rudder}",
            remedy="build the vehicle with sway and yaw moving and terms of the rudder",
        )
