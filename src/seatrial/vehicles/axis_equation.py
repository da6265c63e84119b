"""The equation of motion of one axis as a sum of named terms: inertia d(rate)/dt = sum c_j phi_j + known terms.

The rate is u, v, w, p, q or r (SNAME 1950). Thrust acts along X less the part lost to the hull, (1 - t_d) T. Rigid-body
forces enter as known terms: m (du/dt - v r) = X is the axis X with inertia m and the known term X_vr = m.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from seatrial.core.argument_checks import check_choice, check_number
from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError, too_few
from seatrial.core.term_checks import check_each_once, check_trim
from seatrial.vehicles.model import Params, VehicleModel, cached_model, outside_force

RATE_OF = {"X": "u", "Y": "v", "Z": "w", "K": "p", "M": "q", "N": "r"}  # The velocity whose rate each axis governs


@dataclass(frozen=True, eq=False)
class AxisEquation:
    """Equation of one axis. Build it with `axis_equation`, which checks it.

    Attributes:
        axis: X, Y, Z, K, M or N.
        terms: those whose coefficients are sought.
        inertia: kg or kg m^2, added inertia included; 1 if unknown, and coefficients then are per unit of inertia.
        thrust_share: 1 - t_d, by which terms of the axis T act on X.
        known: terms of given coefficient, SI, per unit of inertia if that is unknown.
        trim: equilibrium of every signal written with `d`.
    """

    axis: str
    terms: tuple[CoefficientName, ...]
    inertia: float = 1.0
    thrust_share: float = 1.0
    known: tuple[tuple[CoefficientName, float], ...] = ()
    trim: Mapping[str, float] = field(default_factory=dict)

    @property
    def rate(self) -> str:
        """The velocity whose rate the equation gives."""
        return RATE_OF[self.axis]

    @property
    def signals(self) -> tuple[str, ...]:
        """Signals the terms need, each once; accelerations by the velocity they are the rate of."""
        names = [*self.terms, *(name for name, _ in self.known)]
        return tuple(dict.fromkeys(signal for name in names for signal in name.signals))

    def share(self, term: CoefficientName) -> float:
        """Return the factor by which a term acts on this axis."""
        return self.thrust_share if term.axis == "T" else 1.0

    def regressor(
        self, term: CoefficientName, signals: Mapping[str, Float[np.ndarray, " n"]]
    ) -> Float[np.ndarray, " n"]:
        """Return the force of a unit of the coefficient at n samples."""
        size = next(iter(signals.values())).size
        return self.share(term) * np.broadcast_to(term.regressor(signals, self.trim), (size,))


def axis_equation(
    axis: str,
    terms: Sequence[str],
    inertia: float | None = None,
    thrust_deduction: float = 0.0,
    known: Mapping[str, float] | None = None,
    trim: Mapping[str, float] | None = None,
) -> AxisEquation:
    """Build the equation of one axis.

    Args:
        axis: X, Y, Z, K, M or N.
        terms: coefficient names on that axis; on X those of the thrust T too.
        inertia: kg or kg m^2, added inertia included; None for coefficients per unit of it.
        thrust_deduction: t_d.
        known: coefficients that are not sought.
        trim: equilibrium of every signal written with `d`.

    Raises:
        InputError: another axis, a malformed or repeated term, its own acceleration as a term, or an unphysical constant.
    """
    known, trim = known or {}, trim or {}
    place = f"equation of axis {axis}"
    check_choice(axis, RATE_OF, place)
    if inertia is not None:
        per_inertia = "leave it out for coefficients per unit of inertia"
        check_number(inertia, f"{place}, inertia", above=0.0, remedy=per_inertia)
    check_number(
        thrust_deduction, f"{place}, thrust_deduction", least=0.0, below=1.0, remedy="give t_d as a share of the thrust"
    )
    free = tuple(CoefficientName.parse(term) for term in terms if term not in known)
    fixed = tuple((CoefficientName.parse(term), float(value)) for term, value in known.items())
    if not free:
        raise too_few(place, "no term with an estimated coefficient", "one", "name terms")
    named = [*free, *(name for name, _ in fixed)]
    for name in named:
        _check_term(name, axis, trim, place)
    check_each_once(named, place)
    return AxisEquation(axis, free, 1.0 if inertia is None else inertia, 1.0 - thrust_deduction, fixed, trim)


def _check_term(name: CoefficientName, axis: str, trim: Mapping[str, float], place: str) -> None:
    allowed = ("X", "T") if axis == "X" else (axis,)
    if name.axis not in allowed:
        raise InputError(
            f"{place}, term {name}",
            found=f'axis "{name.axis}"',
            expected=" or ".join(allowed),
            remedy="leave the term out, or give it to the equation of its axis",
        )
    if name.is_added_mass and not (
        len(name.factors) == 1 and name.factors[0].power == 1 and name.factors[0].signal != RATE_OF[axis]
    ):
        raise InputError(
            f"{place}, term {name}",
            found="the acceleration that the equation is solved for, or a product with one",
            expected="only an acceleration of another axis, as in Y_rdot",
            remedy="count the added inertia in the inertia of the axis",
        )
    check_trim(name, trim, place)


# A vehicle from equations of motion of single axes: what they govern are its states, every other signal is given.
#
#     inertia_i d(rate_i)/dt = sum_j c_ij phi_ij(states, given) + known terms
#
# Signals that no equation governs are controls: rudder and propeller, but also measured velocities, such as the surge
# speed of a ship in a zigzag, whose own equation is not sought.


@cached_model
def axes_vehicle(name: str, equations: Sequence[AxisEquation], per_unit_inertia: bool = True) -> VehicleModel:
    """Build a vehicle whose free coefficients are the terms of its equations.

    Args:
        name: short name.
        equations: one for each axis that moves.
        per_unit_inertia: whether inertias are unknown and forces divided by them; they are 1 then.

    Raises:
        InputError: no equation, two of one axis, or a term with an acceleration.
    """
    equations = tuple(replace(equation, trim=dict(equation.trim)) for equation in equations)
    rates = tuple(equation.rate for equation in equations)
    place = f"vehicle {name}"
    if not rates or len(set(rates)) < len(rates):
        raise InputError(
            place,
            found="axes " + ", ".join(equation.axis for equation in equations) if rates else "no equation",
            expected="at least one equation, each axis once",
            remedy="put all terms of an axis into one equation",
        )
    terms = [term for equation in equations for term in (*equation.terms, *(known for known, _ in equation.known))]
    for term in terms:
        if term.is_added_mass:
            raise InputError(
                f"{place}, term {term}",
                found="an acceleration",
                expected="terms of velocities, attitudes and controls",
                remedy="count the added inertia in the inertia of the axis",
            )
    given = tuple(dict.fromkeys(signal for term in terms for signal in term.signals if signal not in rates))

    def derivative(params: Params, state: tuple, control: tuple) -> tuple:
        signals = {**dict(zip(rates, state, strict=True)), **dict(zip(given, control, strict=True))}
        moved = []
        for equation in equations:
            force = params.get(outside_force(equation.axis), 0.0)
            for term, value in (*((term, params[term.text]) for term in equation.terms), *equation.known):
                force = force + equation.share(term) * value * term.regressor(signals, equation.trim)
            moved.append(force / equation.inertia)
        return tuple(moved)

    constants = tuple(
        item
        for equation in equations
        for item in (
            (f"inertia {equation.axis}", equation.inertia),
            ("thrust share", equation.thrust_share),
            *((term.text, value) for term, value in equation.known),
            *((f"trim {signal}", value) for signal, value in equation.trim.items()),
        )
    )
    free = tuple(term for equation in equations for term in equation.terms)
    axes = tuple(equation.axis for equation in equations)
    return VehicleModel(name, rates, given, free, constants, per_unit_inertia, derivative, disturbance_axes=axes)
