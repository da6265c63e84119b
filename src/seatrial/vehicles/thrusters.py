"""Where thrust acts: one propeller on the axis, or the several thrusters of an open frame, tau = B T.

    column of B = (d, r x d)    d: direction, r: place;    inflow = d . (v + omega x r)

Thrust is the sum of the terms of the axis T, the same for every thruster, in its own speed n and inflow u; or the commanded force.
Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2nd ed., 2021, section 9.1.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from seatrial.core.errors import InputError
from seatrial.numerics.rotations import cross, dot, total


@dataclass(frozen=True)
class Thruster:
    """Place and direction of positive thrust, in body axes; m, and any length of direction."""

    place: tuple[float, float, float]
    direction: tuple[float, float, float]

    @property
    def column(self) -> tuple[float, ...]:
        """Force and moment of a thrust of 1 N, as (X, Y, Z, K, M, N)."""
        direction = np.array(self.direction) / np.linalg.norm(self.direction)
        return (*(float(x) for x in direction), *(float(x) for x in np.cross(self.place, direction)))

    def inflow(self, velocity: Sequence[Any]) -> Any:
        """Return the velocity of the thruster along its direction."""
        moved = cross((velocity[3], velocity[4], velocity[5]), self.place)
        local = (total((v, extra)) for v, extra in zip(velocity[:3], moved, strict=True))
        return dot(self.column[:3], local)


PROPELLER = Thruster((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
"""One propeller on the axis of the hull, whose control is `n`."""


def allocation(thrusters: Sequence[Thruster]) -> Float[np.ndarray, "6 n"]:
    """Return the matrix B of the force and moment (X, Y, Z, K, M, N) of each thruster's newton."""
    return np.array([thruster.column for thruster in thrusters]).reshape(-1, 6).T


def commands_for(
    thrusters: Sequence[Thruster], wanted: Float[np.ndarray, " 6"], tolerance: float = 1e-9
) -> Float[np.ndarray, " n"]:
    """Return the least thrusts that make a wanted force and moment.

    Args:
        thrusters: of the frame.
        wanted: force and moment, N and N m, shape (6,).
        tolerance: what may be missed, as a share of the largest part wanted, or of 1 where that is more.

    Raises:
        InputError: no thrusts make it.
    """
    matrix = allocation(thrusters)
    result = np.linalg.pinv(matrix) @ wanted
    missing = np.abs(matrix @ result - wanted).max()
    if missing > tolerance * max(1.0, float(np.abs(wanted).max())):
        raise InputError(
            "thruster allocation",
            found=f"a force and moment that the thrusters miss by {missing:.3g}",
            expected="one within the range of the allocation matrix",
            remedy="ask for no force or moment on an axis that no thruster drives",
        )
    return result
