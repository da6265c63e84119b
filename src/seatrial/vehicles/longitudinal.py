"""Longitudinal dynamics (surge, heave, pitch) with body axes from the centre of buoyancy.

    m (du/dt + z_g dq/dt) = X - (W - B) sin(theta) - m (w q - x_g q^2)
    m (dw/dt - x_g dq/dt) = Z + (W - B) cos(theta) + m (u q + z_g q^2)
    I_yy dq/dt + m (z_g du/dt - x_g dw/dt) = M - W (z_g sin(theta) + x_g cos(theta)) - m q (z_g w + x_g u)
    dz/dt = w cos(theta) - u sin(theta),   dtheta/dt = q

X, Z and M are sums of named coefficients, Coriolis forces of the added mass included (X_wq, Z_uq, M_uw, …); X also has
(1 - t_d) times the thrust. Prestero (MIT/WHOI, 2001) and Hall and Anstee (DSTO-TR-2576, 2011) with v = p = r = phi = 0.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from typing import Any

import jax.numpy as jnp
import numpy as np

from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError
from seatrial.core.signals import SIGNALS
from seatrial.vehicles.model import Params, VehicleModel
from seatrial.vehicles.surge import SurgeHull, surge_vehicle

GRAVITY = 9.81
"""m/s^2, as both sources round it."""
STATES = ("u", "w", "q", "z", "theta")
CONTROLS = ("n", "delta_s", "tau_X", "tau_Z", "tau_M")
_RATES = ("u", "w", "q")


@dataclass(frozen=True)
class LongitudinalHull:
    """What is known about the vehicle beforehand; the body axes start at the centre of buoyancy.

    Attributes:
        name: short name.
        mass: dry mass, kg.
        pitch_inertia: I_yy about the centre of buoyancy, kg m^2.
        x_g: centre of gravity ahead of the centre of buoyancy, m.
        z_g: centre of gravity below the centre of buoyancy, m.
        buoyancy: B, N; None for a neutrally buoyant vehicle, B = W.
        thrust_deduction: t_d, the part of the thrust lost to the hull, 0 <= t_d < 1.
        fixed: coefficients that are not estimated, SI, for example `{"Z_wdot": -35.5}`.
        trim: equilibrium about which the vehicle works: signal name to SI value.
    """

    name: str
    mass: float
    pitch_inertia: float
    x_g: float = 0.0
    z_g: float = 0.0
    buoyancy: float | None = None
    thrust_deduction: float = 0.0
    fixed: Mapping[str, float] = field(default_factory=dict)
    trim: Mapping[str, float] = field(default_factory=dict)

    @property
    def weight(self) -> float:
        """W, N."""
        return self.mass * GRAVITY

    @property
    def net_weight(self) -> float:
        """W - B, N; negative where the vehicle floats."""
        return 0.0 if self.buoyancy is None else self.weight - self.buoyancy


def longitudinal_vehicle(hull: LongitudinalHull, terms: Sequence[str]) -> VehicleModel:
    """Build the longitudinal model whose free coefficients are `terms`; its states are u, w, q, z and theta.

    Args:
        hull: rigid body, buoyancy, thrust deduction, fixed coefficients and trim.
        terms: coefficient names on the axes X, Z, M and T; those fixed by the hull are left out of `params`.

    Raises:
        InputError: malformed name, another axis, a signal the model lacks, two names of one regressor,
            or an unphysical constant.
    """
    free = tuple(CoefficientName.parse(term) for term in terms if term not in hull.fixed)
    fixed = tuple(CoefficientName.parse(name) for name in hull.fixed)
    _check(hull, free + fixed)
    used = tuple(name for name in CONTROLS if any(name in term.signals for term in free + fixed))
    known, trimmed = dict(hull.fixed), dict(hull.trim)
    inertial = [term for term in free + fixed if term.is_added_mass]
    acting = [term for term in free + fixed if not term.is_added_mass]
    mass, x_g, z_g, weight, net = hull.mass, hull.x_g, hull.z_g, hull.weight, hull.net_weight

    def derivative(params: Params, state: tuple, control: tuple) -> tuple:
        u, w, q, _, theta = state
        sin, cos = jnp.sin(theta), jnp.cos(theta)
        values = {**known, **params}
        signals = {"u": u, "w": w, "q": q, "theta": theta, **dict(zip(used, control, strict=True))}
        force = {
            "X": -net * sin - mass * (w * q - x_g * q * q),
            "Z": net * cos + mass * (u * q + z_g * q * q),
            "M": -weight * (z_g * sin + x_g * cos) - mass * q * (z_g * w + x_g * u),
            "T": 0.0,
        }
        for term in acting:
            force[term.axis] = force[term.axis] + values[term.text] * term.regressor(signals, trimmed)
        surge = force["X"] + (1.0 - hull.thrust_deduction) * force["T"]
        u_rate, w_rate, q_rate = _solve(_inertia(hull, inertial, values), (surge, force["Z"], force["M"]))
        return (u_rate, w_rate, q_rate, w * cos - u * sin, q)

    constants = (
        *(
            (name, getattr(hull, name))
            for name in ("mass", "pitch_inertia", "x_g", "z_g", "net_weight", "thrust_deduction")
        ),
        *hull.fixed.items(),
        *((f"trim {name}", value) for name, value in hull.trim.items()),
    )
    return VehicleModel(hull.name, STATES, used, free, constants, False, derivative)


def surge_restriction(hull: LongitudinalHull, terms: Sequence[str]) -> VehicleModel:
    """Build the surge model that is left when heave and pitch are held at zero: the terms of u and the thrust alone."""

    def belongs(name: str) -> bool:
        term = CoefficientName.parse(name)
        return term.axis in ("X", "T") and set(term.signals) <= {"u", "n", "tau_X"}

    fixed = {name: value for name, value in hull.fixed.items() if belongs(name)}
    trimmed = {name: value for name, value in hull.trim.items() if name in ("u", "n", "tau_X")}
    surge = SurgeHull(hull.name, hull.mass, hull.thrust_deduction, fixed, trimmed)
    return surge_vehicle(surge, [term for term in terms if belongs(term)])


def _inertia(hull: LongitudinalHull, inertial: Sequence[CoefficientName], values: Mapping[str, Any]) -> list[list[Any]]:
    """Rigid body plus added mass: rows X, Z, M, columns du/dt, dw/dt, dq/dt."""
    m, x_g, z_g = hull.mass, hull.x_g, hull.z_g
    rows: list[list[Any]] = [[m, 0.0, m * z_g], [0.0, m, -m * x_g], [m * z_g, -m * x_g, hull.pitch_inertia]]
    for term in inertial:
        row, column = "XZM".index(term.axis), _RATES.index(term.signals[0])
        rows[row][column] = rows[row][column] - values[term.text]
    return rows


def _solve(rows: Sequence[Sequence[Any]], right: tuple) -> tuple:
    """Cramer's rule on scalars: the cofactors of a known mass matrix are numbers before anything is compiled."""
    a, b, c = (tuple(row[j] for row in rows) for j in range(3))
    across_bc, across_ca, across_ab = _cross(b, c), _cross(c, a), _cross(a, b)
    scale = 1.0 / _dot(a, across_bc)
    return tuple(scale * _dot(across, right) for across in (across_bc, across_ca, across_ab))


def _cross(a: tuple, b: tuple) -> tuple:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def _dot(a: tuple, b: tuple) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _check(hull: LongitudinalHull, terms: tuple[CoefficientName, ...]) -> None:
    where = f'vehicle "{hull.name}"'
    numbers = {name: value for name, value in vars(hull).items() if isinstance(value, int | float)}
    for name, value in {**numbers, **hull.fixed, **hull.trim}.items():
        positive = name in ("mass", "pitch_inertia", "buoyancy")
        if not isfinite(value) or (positive and value <= 0) or (name == "thrust_deduction" and not 0 <= value < 1):
            raise InputError(
                f"{where}, {name}",
                found=str(value),
                expected="a positive number"
                if positive
                else "a finite number, of a thrust deduction from 0 to below 1",
                remedy="give its SI value",
            )
    available, seen = {"u", "w", "q", "theta", *CONTROLS}, {}
    for term in terms:
        for broken, found, expected in (
            (term.axis not in "XZMT", f'axis "{term.axis}"', "X, Z, M or T: this is the longitudinal model"),
            (
                term.is_added_mass
                and all(term != CoefficientName.parse(f"{axis}_{rate}dot") for axis in "XZM" for rate in _RATES),
                "an acceleration in another product",
                "an added mass X, Z or M of udot, wdot or qdot alone",
            ),
            (
                not set(term.signals) <= available,
                f"signals {', '.join(term.signals)}",
                "signals among " + ", ".join(name for name in SIGNALS if name in available),
            ),
            (
                not set(term.trim_signals) <= set(hull.trim),
                f"no trim value of {', '.join(term.trim_signals)}",
                "the trim point of every change",
            ),
            (term in seen, f"the same regressor as {seen.get(term)}", "each regressor once"),
        ):
            if broken:
                raise InputError(f"{where}, term {term.text}", found=found, expected=expected, remedy="leave it out")
        seen[term] = term.text
    inertial = [term for term in terms if term.is_added_mass and term.text in hull.fixed]
    matrix = np.array(_inertia(hull, inertial, hull.fixed))
    if not np.linalg.eigvalsh(0.5 * (matrix + matrix.T)).min() > 0:
        raise InputError(
            f"{where}, mass matrix",
            found=f"rows {matrix.tolist()}",
            expected="a positive definite matrix of rigid body and added mass",
            remedy="added masses on the diagonal are negative in SNAME notation: check their signs, and the centre of gravity",
        )
