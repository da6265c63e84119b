"""A vehicle from equations of motion of single axes: what they govern are its states, every other signal is given.

    inertia_i d(rate_i)/dt = sum_j c_ij phi_ij(states, given) + known terms

Signals that no equation governs are controls: rudder and propeller, but also measured velocities, such as the surge speed of a ship
in a zigzag, whose own equation is not sought.
"""

from collections.abc import Sequence

from seatrial.core.errors import InputError
from seatrial.vehicles.axis_equation import AxisEquation
from seatrial.vehicles.model import Params, VehicleModel


def axes_vehicle(name: str, equations: Sequence[AxisEquation], per_unit_inertia: bool = True) -> VehicleModel:
    """Build a vehicle whose free coefficients are the terms of its equations.

    Args:
        name: short name.
        equations: one for each axis that moves.
        per_unit_inertia: whether inertias are unknown and forces divided by them; they are 1 then.

    Raises:
        InputError: no equation, two of one axis, or a term with an acceleration.
    """
    equations = tuple(equations)
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
            force = 0.0
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
    return VehicleModel(name, rates, given, free, constants, per_unit_inertia, derivative)
