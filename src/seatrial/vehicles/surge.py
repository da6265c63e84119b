"""Surge dynamics with any set of terms: (m - X_udot) du/dt = sum X_i phi_i + (1 - t_d) sum T_j phi_j.

It is the whole vehicle of `whole.py` with everything but u held at zero.
The model of "Experiment Design, Bayesian Estimation and Model Selection of an Autonomous Underwater Vehicle"
is the set {X_u, X_uabsu, T_nabsn}, its eq. (3); X_du3 adds the term of its section IV.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import copysign, isfinite

import numpy as np

from seatrial.core.coefficients import AXES, CoefficientName
from seatrial.core.errors import InputError
from seatrial.core.signals import motion_name
from seatrial.core.term_checks import check_each_once, check_trim
from seatrial.vehicles.active_dof import Freedom
from seatrial.vehicles.axis_equation import RATE_OF
from seatrial.vehicles.hull import Hull
from seatrial.vehicles.model import Params, VehicleModel
from seatrial.vehicles.whole import assemble


@dataclass(frozen=True)
class SurgeHull:
    """What is known about the vehicle beforehand.

    Attributes:
        name: short name.
        mass: dry mass, kg; None where it is unknown, and forces then are per unit of effective mass.
        thrust_deduction: t_d, the part of the thrust lost to the hull, 0 <= t_d < 1.
        fixed: coefficients that are not estimated, SI, for example `{"X_udot": -0.93}`.
        trim: equilibrium about which the vehicle works: signal name to SI value.
    """

    name: str
    mass: float | None
    thrust_deduction: float = 0.0
    fixed: Mapping[str, float] = field(default_factory=dict)
    trim: Mapping[str, float] = field(default_factory=dict)


def surge_vehicle(hull: SurgeHull, terms: Sequence[str]) -> VehicleModel:
    """Build the surge model whose free coefficients are `terms`.

    Args:
        hull: mass, thrust deduction, fixed coefficients and trim.
        terms: coefficient names on the axes X and T; those fixed by the hull are left out of `params`.

    Raises:
        InputError: malformed name, another axis, a signal the surge model lacks, two names of one regressor,
            or an unphysical constant.
    """
    free = tuple(CoefficientName.parse(term) for term in terms if term not in hull.fixed)
    fixed = tuple(CoefficientName.parse(name) for name in hull.fixed)
    _check(hull, free + fixed)
    mass = 1.0 if hull.mass is None else hull.mass
    body = Hull(hull.name, hull.mass, thrust_deduction=hull.thrust_deduction, fixed=hull.fixed, trim=hull.trim)
    model = assemble(body, free, Freedom(("u",)))
    constants = (
        ("mass", mass),
        ("thrust_deduction", hull.thrust_deduction),
        *hull.fixed.items(),
        *((f"trim {name}", hull.trim[name]) for name in hull.trim if any(name in t.trim_signals for t in free + fixed)),
    )
    return replace(model, constants=constants)


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
    return _zero(rate, float(speeds[beyond - 1]), float(speeds[beyond])) if beyond else 0.0


def _zero(function: Callable[[float], float], low: float, high: float) -> float:
    """Halve an interval until no number lies between its ends, at which the function has other signs."""
    sign = function(low)
    while low != (middle := 0.5 * (low + high)) != high:
        low, high = (middle, high) if function(middle) * sign > 0 else (low, middle)
    return middle


def _motion(axis: str) -> str:
    return motion_name(RATE_OF[axis]) if axis in RATE_OF else "such axis"


def _check(hull: SurgeHull, terms: tuple[CoefficientName, ...]) -> None:
    where = f'vehicle "{hull.name}"'
    if hull.mass is not None and not (isfinite(hull.mass) and hull.mass > 0):
        raise InputError(
            f"{where}, mass",
            found=f"{hull.mass} kg",
            expected="a positive mass",
            remedy='give the dry mass, or "unknown"',
        )
    if not 0 <= hull.thrust_deduction < 1:
        raise InputError(
            f"{where}, thrust_deduction",
            found=str(hull.thrust_deduction),
            expected="a number from 0 to below 1",
            remedy="0.1 is typical of a torpedo-shaped vehicle",
        )
    for name, value in (*hull.fixed.items(), *hull.trim.items()):
        if not isfinite(value):
            raise InputError(
                f"{where}, {name}", found=str(value), expected="a finite number", remedy="give its SI value"
            )
    added = hull.fixed.get("X_udot", 0.0)
    if hull.mass is not None and added >= hull.mass:
        raise InputError(
            f"{where}, X_udot",
            found=f"{added} kg against a mass of {hull.mass} kg",
            expected="m - X_udot > 0",
            remedy="added mass X_udot is negative in SNAME notation: check its sign",
        )
    available = {"u", "n", "tau_X", *hull.trim}
    check_each_once(terms, where)
    for term in terms:
        if term.axis not in ("X", "T"):
            raise InputError(
                f"{where}, term {term.text}",
                found=f"{term.text}, a {AXES[term.axis][1]}, in a model of surge alone: it has no {_motion(term.axis)}",
                expected="terms on the axes X and T",
                remedy="leave it out, or model a whole vehicle, with `moves`, or an unknown mass",
            )
        if term.is_added_mass and term != CoefficientName.parse("X_udot"):
            raise InputError(
                f"{where}, term {term.text}",
                found="another power or product of du/dt",
                expected="X_udot",
                remedy="leave the term out: the surge model is linear in du/dt",
            )
        for signal in term.signals:
            if signal not in available:
                raise InputError(
                    f"{where}, term {term.text}",
                    found=f'{term.text}, which has the signal "{signal}", in a model of surge alone',
                    expected="one of " + ", ".join(sorted(available)),
                    remedy="the surge model knows the surge speed, the propeller speed and a commanded surge force",
                )
        check_trim(term, hull.trim, where)
