"""Attitude and position as states, of which only those are kept that something depends on.

A body that turns about one axis alone needs one angle. One that turns about two or three needs a quaternion, or the three Euler
angles, whose rates are infinite at a pitch of 90 degrees: they are for vehicles that stay well below it.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

from seatrial.core.signals import ANGLES, POSITIONS, QUATERNION
from seatrial.numerics.rotations import (
    Rows,
    angle_rates,
    angles_of_quaternion,
    dot,
    matrix_of_angles,
    matrix_of_quaternion,
    quaternion_rate,
    total,
)

Kind = Literal["quaternion", "euler"]
# Rate, 1/s, at which a quaternion's length returns to 1: slow against any time step, fast against an integrator's
# error.
PULL = 1.0
_TURNS = ("p", "q", "r")


@dataclass(frozen=True)
class Attitude:
    """How the vehicle's attitude is kept.

    Attributes:
        states: names of its states: angles, a quaternion or nothing.
        given: angles that are measured and come in as controls; all others are zero.
    """

    states: tuple[str, ...]
    given: tuple[str, ...] = ()

    @property
    def by_quaternion(self) -> bool:
        """Whether the states are a quaternion."""
        return self.states == QUATERNION

    @property
    def angles(self) -> tuple[str, ...]:
        """Euler angles that are not zero throughout."""
        return ANGLES if self.by_quaternion else tuple(name for name in ANGLES if name in (*self.states, *self.given))

    def at(self, known: Mapping[str, Any]) -> "Pose":
        """Return the attitude for values of its states and given angles."""
        if self.by_quaternion:
            return Pose(quaternion=tuple(known[name] for name in QUATERNION))
        return Pose(angles=tuple(known[name] if name in self.angles else 0.0 for name in ANGLES))

    def rates(self, pose: "Pose", rotation: tuple[Any, Any, Any]) -> tuple[Any, ...]:
        """Return the rates of its states."""
        if pose.quaternion is not None:
            return quaternion_rate(pose.quaternion, rotation, PULL)
        if not self.states:
            return ()
        rates = dict(zip(ANGLES, angle_rates(pose.angles[0], pose.angles[1], rotation), strict=True))
        return tuple(rates[name] for name in self.states)


@dataclass(frozen=True)
class Pose:
    """One attitude, as a quaternion or as Euler angles, of which the other is computed where needed."""

    quaternion: tuple[Any, ...] | None = None
    angles: tuple[Any, ...] = ()

    @cached_property
    def rows(self) -> Rows:
        """Rotation from body axes to north, east and down."""
        return matrix_of_angles(*self.angles) if self.quaternion is None else matrix_of_quaternion(self.quaternion)

    def euler(self) -> tuple[Any, ...]:
        """Return phi, theta and psi."""
        return self.angles if self.quaternion is None else angles_of_quaternion(self.quaternion)


def attitude_states(kind: Kind, moves: Iterable[str], given: Sequence[str], needed: Iterable[str]) -> tuple[str, ...]:
    """Return the names of the states of attitude that a vehicle needs.

    Args:
        kind: how an attitude is kept that turns about more than one axis.
        moves: velocities that are states.
        given: signals that are measured, among them angles.
        needed: Euler angles that forces, positions or sensors depend on.
    """
    turning = [axis for axis in _TURNS if axis in moves or axis in given]
    needed = [angle for angle in ANGLES if angle in needed and angle not in given]
    if not needed or not turning:
        return ()
    if len(turning) == 1:
        return tuple(angle for angle in needed if angle == ANGLES[_TURNS.index(turning[0])])
    if kind == "quaternion" and not any(angle in given for angle in ANGLES):
        return QUATERNION
    return tuple(angle for angle in ANGLES if angle not in given and (angle != "psi" or "psi" in needed))


def position_angles(positions: Iterable[str]) -> set[str]:
    """Return the Euler angles on which the rates of positions depend."""
    return {angle for name in positions for angle in (ANGLES[:2] if name == "z" else ANGLES)}


def position_rates(
    positions: Sequence[str], pose: Pose, velocity: tuple[Any, Any, Any], current: Mapping[str, Any]
) -> tuple[Any, ...]:
    """Return the rates of positions for a velocity through the water, and the water's own, by position.

    Args:
        positions: those of x, y and z that are wanted.
        pose: attitude.
        velocity: surge, sway and heave through the water, m/s.
        current: the water's velocity along a position, m/s, by its name; 0 if not given.
    """
    rows = (pose.rows[POSITIONS.index(name)] for name in positions)
    return tuple(total((dot(row, velocity), current.get(name, 0.0))) for name, row in zip(positions, rows, strict=True))
