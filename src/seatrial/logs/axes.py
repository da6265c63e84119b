"""Axes of logs turned into seatrial's: north, east, down over the earth and forward, right, down in the body.

A log in east, north, up with body axes forward, left, up (REP 103) has some signs, the heading and its quaternions turned.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float

from seatrial.core.errors import InputError
from seatrial.core.signals import QUATERNION

Axes = Literal["NED", "ENU"]
"""Of a log: north, east, down with forward, right, down; or east, north, up with forward, left, up."""

# Signals whose sign differs between the two; x and v_north are along north, y and v_east along east in both
_TURNED = {
    *("v", "w", "q", "r", "vdot", "wdot", "qdot", "rdot", "theta", "z", "v_down"),
    *("tau_Y", "tau_Z", "tau_M", "tau_N", "a_y", "a_z", "v_g", "w_g"),
}


def from_axes(
    columns: Mapping[str, Float[np.ndarray, " n"]], axes: Axes, where: str
) -> dict[str, Float[np.ndarray, " n"]]:
    """Turn the channels of a log into seatrial's axes.

    Args:
        columns: for each channel its samples, SI, shape (n,).
        axes: of the log.
        where: the log, for the error.

    Raises:
        InputError: a quaternion with a part missing.
    """
    turned = dict(columns)
    if quaternion := [name for name in QUATERNION if name in columns]:
        complete(quaternion, QUATERNION, where)
    if axes == "NED":
        return turned
    for name, values in columns.items():
        if name == "psi":
            turned[name] = math.pi / 2 - values
        elif name in _TURNED:
            turned[name] = -values
    if quaternion:
        w, x, y, z = (columns[name] for name in QUATERNION)
        half = math.sqrt(0.5)
        turned |= zip(QUATERNION, (half * (w + z), half * (x + y), half * (x - y), half * (w - z)), strict=True)
    return turned


def complete(found: Sequence[str], needed: Sequence[str], where: str) -> None:
    """Refuse a vector or quaternion with a part missing.

    Args:
        found: names of the channels that the log has.
        needed: names of all parts of one vector or quaternion.
        where: file, for the error.

    Raises:
        InputError: saying which.
    """
    if missing := [name for name in needed if name not in found]:
        raise InputError(
            f"{where}, channels {', '.join(found)}",
            found=f"no {', '.join(missing)}",
            expected=", ".join(needed),
            remedy="map the missing ones from the same table",
        )
