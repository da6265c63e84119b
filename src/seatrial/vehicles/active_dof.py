"""What of a vehicle's motion is modelled: a reduced model is the whole one with less freedom."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from seatrial.core.coefficients import CoefficientName
from seatrial.core.signals import RATES
from seatrial.vehicles.attitude import Kind
from seatrial.vehicles.hull import AXES
from seatrial.vehicles.thrusters import Thruster

AddedCoriolis = Literal["named", "automatic"]
Current = Literal["state", "given"] | tuple[float, float, float] | None


@dataclass(frozen=True)
class Freedom:
    """What of the motion is modelled; a restriction of the whole vehicle is one with less of it.

    Attributes:
        moves: velocities that are states; none of a vehicle that is held, of which forces are measured.
        given: velocities and angles that are measured, and enter as controls.
        attitude: how an attitude is kept that turns about more than one axis.
        positions: positions that are states.
        angles: Euler angles that sensors show or limits bound, which are kept also if no force depends on them.
        current: the water's velocity north, east and down: as states that stay as they are, as given signals, as numbers in m/s, or none.
    """

    moves: tuple[str, ...] = RATES
    given: tuple[str, ...] = ()
    attitude: Kind = "quaternion"
    positions: tuple[str, ...] = ()
    angles: tuple[str, ...] = ()
    current: Current = None


def acts(name: CoefficientName, freedom: Freedom, thrusters: Sequence[Thruster]) -> bool:
    """Return whether a term has a part in the motion.

    Args:
        name: term.
        freedom: what moves and what is given.
        thrusters: those of an open frame; empty for one propeller on the axis.
    """
    rates = {AXES.index(name.axis)} if name.axis in AXES else {0}
    if name.axis == "T" and thrusters:
        rates = {i for thruster in thrusters for i, x in enumerate(thruster.column) if abs(x) > 0}
    if freedom.moves and not any(RATES[i] in freedom.moves for i in rates):
        return False
    if name.is_added_mass:
        return name.signals[0] in freedom.moves
    if name.axis == "T" and thrusters:
        return True
    present = (*freedom.moves, *freedom.given)
    return not any(
        factor.signal in RATES and factor.signal not in present and not factor.change for factor in name.factors
    )


def acting_terms(
    terms: Sequence[str], moves: Sequence[str], given: Sequence[str] = (), thrusters: Sequence[Thruster] = ()
) -> tuple[str, ...]:
    """Return those terms that have a part in the motion: on an axis that moves, and without a velocity that is held at zero.

    Args:
        terms: names of coefficients.
        moves: velocities that are states.
        given: velocities and angles that are measured.
        thrusters: those of an open frame; empty for one propeller on the axis.
    """
    freedom = Freedom(tuple(moves), tuple(given))
    return tuple(term for term in terms if acts(CoefficientName.parse(term), freedom, thrusters))
