"""Rotations between body axes and north-east-down axes: Euler angles (yaw, pitch, roll) and unit quaternions.

    R = R_z(psi) R_y(theta) R_x(phi)  takes body components to north-east-down ones
    q = (q_w, q_x, q_y, q_z),  dq/dt = q * (0, p, q, r) / 2

On tuples of scalars; a zero or one that is a Python number is seen before anything is compiled, so that an angle held at zero costs
nothing. Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2nd ed., 2021, sections 2.2.1 and 2.2.2.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np

from seatrial.numerics.array_module import array_module

Vector = tuple[Any, Any, Any]
Quaternion = tuple[Any, Any, Any, Any]
Rows = tuple[Vector, Vector, Vector]


def times(a: Any, b: Any) -> Any:
    """Return the product, in which a factor that is known to be 0 or 1 leaves no trace."""
    if _is(a, 0.0) or _is(b, 0.0):
        return 0.0
    if _is(a, 1.0):
        return b
    if _is(b, 1.0):
        return a
    if _is(a, -1.0):
        return -b
    return -a if _is(b, -1.0) else a * b


def total(parts: Iterable[Any]) -> Any:
    """Return the sum, in which parts that are known to be 0 leave no trace; from left to right."""
    result: Any = 0.0
    for part in parts:
        if not _is(part, 0.0):
            result = part if _is(result, 0.0) else result + part
    return result


def dot(a: Iterable[Any], b: Iterable[Any]) -> Any:
    """Return the sum of products."""
    return total(times(x, y) for x, y in zip(a, b, strict=True))


def cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product."""
    return (
        total((times(a[1], b[2]), -times(a[2], b[1]))),
        total((times(a[2], b[0]), -times(a[0], b[2]))),
        total((times(a[0], b[1]), -times(a[1], b[0]))),
    )


def matrix_of_angles(phi: Any, theta: Any, psi: Any) -> Rows:
    """Return the rows of R; its last row holds the body components of the vertical.

    Args:
        phi: roll, rad.
        theta: pitch, rad.
        psi: yaw, rad.
    """
    (s1, c1), (s2, c2), (s3, c3) = (_sine_and_cosine(angle) for angle in (phi, theta, psi))
    s1s2, c1s2 = times(s1, s2), times(c1, s2)
    return (
        (times(c3, c2), total((-times(s3, c1), times(c3, s1s2))), total((times(s3, s1), times(c3, c1s2)))),
        (times(s3, c2), total((times(c3, c1), times(s3, s1s2))), total((-times(c3, s1), times(s3, c1s2)))),
        (-s2 if not _is(s2, 0.0) else 0.0, times(c2, s1), times(c2, c1)),
    )


def angle_rates(phi: Any, theta: Any, rotation: Vector) -> Vector:
    """Return the rates of phi, theta and psi for the body rates (p, q, r); infinite at a pitch of 90 degrees.

    Args:
        phi: roll, rad.
        theta: pitch, rad.
        rotation: p, q and r, rad/s.
    """
    p, q, r = rotation
    (s1, c1), (s2, c2) = _sine_and_cosine(phi), _sine_and_cosine(theta)
    turn = total((times(q, s1), times(r, c1)))
    heading = turn if _is(c2, 1.0) or _is(turn, 0.0) else turn / c2
    return total((p, times(heading, s2))), total((times(q, c1), -times(r, s1))), heading


def matrix_of_quaternion(q: Quaternion) -> Rows:
    """Return the rows of R for a unit quaternion; one of length a gives vectors near a^2 as long."""
    w, x, y, z = q
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )


def quaternion_rate(q: Quaternion, rotation: Vector, pull: float) -> Quaternion:
    """Return dq/dt for the body rates (p, q, r), with a pull that keeps q normalised: its length goes to 1 at the rate 2 `pull`, 1/s.

    The pull does not turn the body; it removes the error of length that any integrator makes.
    """
    w, x, y, z = q
    a, b, c = (times(0.5, rate) for rate in rotation)
    stretch = pull * (1.0 - (w * w + x * x + y * y + z * z))
    return (
        stretch * w - total((times(a, x), times(b, y), times(c, z))),
        stretch * x + total((times(a, w), times(c, y), -times(b, z))),
        stretch * y + total((times(b, w), times(a, z), -times(c, x))),
        stretch * z + total((times(c, w), times(b, x), -times(a, y))),
    )


def quaternion_of_angles(phi: Any, theta: Any, psi: Any) -> Quaternion:
    """Return the unit quaternion of Euler angles.

    Args:
        phi: roll, rad.
        theta: pitch, rad.
        psi: yaw, rad.
    """
    xp = array_module(phi, theta, psi)
    (s1, s2, s3), (c1, c2, c3) = (
        tuple(function(0.5 * angle) for angle in (phi, theta, psi)) for function in (xp.sin, xp.cos)
    )
    return (
        c1 * c2 * c3 + s1 * s2 * s3,
        s1 * c2 * c3 - c1 * s2 * s3,
        c1 * s2 * c3 + s1 * c2 * s3,
        c1 * c2 * s3 - s1 * s2 * c3,
    )


def angles_of_quaternion(q: Quaternion) -> Vector:
    """Euler angles (phi, theta, psi) of a quaternion of any length; theta from -90 to 90 degrees."""
    (w, x, y, z), xp = q, array_module(*q)
    length = w * w + x * x + y * y + z * z
    sine = 2.0 * (w * y - x * z) / length
    return (
        xp.arctan2(2.0 * (w * x + y * z), w * w - x * x - y * y + z * z),
        xp.arcsin(xp.clip(sine, -1.0, 1.0)),
        xp.arctan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z),
    )


def _sine_and_cosine(angle: Any) -> tuple[Any, Any]:
    if _is(angle, 0.0):
        return 0.0, 1.0
    if array_module(angle) is np:
        return np.sin(angle), np.cos(angle)
    from seatrial.numerics.sine import sine_and_cosine

    return sine_and_cosine(angle)


def _is(value: Any, number: float) -> bool:
    return isinstance(value, int | float) and value == number
