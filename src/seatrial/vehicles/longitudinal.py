"""Longitudinal dynamics (surge, heave, pitch) with body axes from the centre of buoyancy.

    m (du/dt + z_g dq/dt) = X - (W - B) sin(theta) - m (w q - x_g q^2)
    m (dw/dt - x_g dq/dt) = Z + (W - B) cos(theta) + m (u q + z_g q^2)
    I_yy dq/dt + m (z_g du/dt - x_g dw/dt) = M - W (z_g sin(theta) + x_g cos(theta)) - m q (z_g w + x_g u)
    dz/dt = w cos(theta) - u sin(theta),   dtheta/dt = q

It is the whole vehicle of `whole.py` with v, p, r and phi held at zero. X, Z and M are sums of named coefficients, Coriolis forces
of the added mass included (X_wq, Z_uq, M_uw, …); X also has (1 - t_d) times the thrust. Prestero (MIT/WHOI, 2001) and Hall and
Anstee (DSTO-TR-2576, 2011).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite

import numpy as np

from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError
from seatrial.core.signals import SIGNALS
from seatrial.vehicles.active_dof import Freedom
from seatrial.vehicles.hull import GRAVITY, Hull, added_mass_matrix, rigid_mass_matrix
from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.surge import SurgeHull, surge_vehicle
from seatrial.vehicles.whole import assemble

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
    model = assemble(_body(hull), free, Freedom(_RATES, positions=("z",)))
    constants = (
        *(
            (name, getattr(hull, name))
            for name in ("mass", "pitch_inertia", "x_g", "z_g", "net_weight", "thrust_deduction")
        ),
        *hull.fixed.items(),
        *((f"trim {name}", value) for name, value in hull.trim.items()),
    )
    return replace(model, constants=constants)


def surge_restriction(hull: LongitudinalHull, terms: Sequence[str]) -> VehicleModel:
    """Build the surge model that is left when heave and pitch are held at zero: the terms of u and the thrust alone."""

    def belongs(name: str) -> bool:
        term = CoefficientName.parse(name)
        return term.axis in ("X", "T") and set(term.signals) <= {"u", "n", "tau_X"}

    fixed = {name: value for name, value in hull.fixed.items() if belongs(name)}
    trimmed = {name: value for name, value in hull.trim.items() if name in ("u", "n", "tau_X")}
    surge = SurgeHull(hull.name, hull.mass, hull.thrust_deduction, fixed, trimmed)
    return surge_vehicle(surge, [term for term in terms if belongs(term)])


def _body(hull: LongitudinalHull) -> Hull:
    """Return the same vehicle in six degrees of freedom, as far as it is known."""
    return Hull(
        hull.name,
        hull.mass,
        (None, hull.pitch_inertia, None),
        centre_of_gravity=(hull.x_g, 0.0, hull.z_g),
        weight=hull.weight,
        buoyancy=hull.weight - hull.net_weight,
        thrust_deduction=hull.thrust_deduction,
        fixed=hull.fixed,
        trim=hull.trim,
    )


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
        for broken, result, expected in (
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
                raise InputError(f"{where}, term {term.text}", found=result, expected=expected, remedy="leave it out")
        seen[term] = term.text
    inertial = [term for term in terms if term.is_added_mass and term.text in hull.fixed]
    moving = np.ix_((0, 2, 4), (0, 2, 4))
    matrix = (rigid_mass_matrix(_body(hull)) + added_mass_matrix({t.text: hull.fixed[t.text] for t in inertial}))[
        moving
    ]
    if not np.linalg.eigvalsh(0.5 * (matrix + matrix.T)).min() > 0:
        raise InputError(
            f"{where}, mass matrix",
            found=f"rows {matrix.tolist()}",
            expected="a positive definite matrix of rigid body and added mass",
            remedy="added masses on the diagonal are negative in SNAME notation: check their signs, and the centre of gravity",
        )
