"""Fins as simulators have them: a lift across the local flow at one place, for terms u^2 delta of a force and a moment.

    Y = c u^2 delta,  N = x Y      becomes      (X, Y) = c V delta (-v_l, u),  N = x Y,  v_l = v + x r,  V^2 = u^2 + v_l^2

Both agree where the fin meets the flow head on. Going astern such a fin gives nothing (gz-sim's LiftDrag, unless reversible, which it is
not here), and the term u^2 delta still pushes.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from seatrial.export.motion import Motion, current_in
from seatrial.export.terms import Sorted
from seatrial.vehicles.hull import AXES


class Fin(NamedTuple):
    """A fin that lifts across the hull.

    Attributes:
        control: `delta_r` or `delta_s`.
        axis: of the force, 1 for sway and 2 for heave.
        lift: force by u^2 and angle, kg/(m rad).
        place: ahead of the origin, m.
    """

    control: str
    axis: int
    lift: float
    place: float

    @property
    def turns(self) -> float:
        """1 where a positive angle turns the fin by the right hand about the axis down (rudder) or to starboard (plane), else -1.

        A fin so turned shows its leading edge to starboard, or up, and is lifted that way.
        """
        return 1.0 if (self.lift > 0) == (self.axis == 1) else -1.0


_PAIRS = {"delta_r": (1, 5, 1.0), "delta_s": (2, 4, -1.0)}
"""Axis of the force, of the moment, and the sign by which moment = sign x place x force."""


def fins_of(terms: Sorted) -> tuple[tuple[Fin, ...], tuple[str, ...]]:
    """Fins made of the terms u^2 delta, and the names of such terms that are no force and moment of one fin."""
    found, used = [], set()
    for control, (axis, moment, sign) in _PAIRS.items():
        lift = terms.fin.get((axis, control), 0.0)
        if lift:
            found.append(Fin(control, axis, lift, sign * terms.fin.get((moment, control), 0.0) / lift))
            used |= {(axis, control), (moment, control)}
    return tuple(found), tuple(
        f"{AXES[axis]}_uu{control}" for axis, control in terms.fin if (axis, control) not in used
    )


def fin_force(fins: tuple[Fin, ...]) -> Motion:
    """Forces of the fins, in our axes; they feel the velocity over ground, since LiftDrag knows no current."""

    def force(nu: Any, phi: Any, theta: Any, controls: Mapping[str, Any]) -> Any:
        u, v, w = (one + water for one, water in zip(nu[:3], current_in(controls), strict=True))
        q, r = nu[4:]
        found = np.zeros_like(np.asarray(nu, float))
        for fin in fins:
            across = v + r * fin.place if fin.axis == 1 else w - q * fin.place
            push = np.where(u > 0, fin.lift * np.hypot(u, across), 0.0) * controls.get(fin.control, 0.0)
            sign = 1.0 if fin.axis == 1 else -1.0
            found[0] -= push * across
            found[fin.axis] += push * u
            found[6 - fin.axis] += sign * fin.place * push * u
        return found

    return force


def fin_words(fins: tuple[Fin, ...]) -> str:
    """How fins are carried, in words."""
    names = " and ".join(f"{AXES[fin.axis]}_uu{fin.control} at x = {fin.place:.3f} m" for fin in fins)
    return (
        f"{names}: lift across the local flow at the fin, the same as u^2 delta where the flow is head on; it slows the vehicle besides, "
        "and gives nothing astern"
    )
