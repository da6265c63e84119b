"""Where a vehicle's states are at the start of a trial: at trim, or where first measured."""

from collections.abc import Mapping

import numpy as np

from seatrial.core.record import Record
from seatrial.core.signals import ACTUAL, ANGLES, QUATERNION
from seatrial.numerics.rotations import quaternion_of_angles
from seatrial.vehicles.model import VehicleModel


def level_start(model: VehicleModel, known: Mapping[str, float]) -> tuple[float, ...]:
    """Every state from values of some signals, SI: a quaternion from angles, an actuator from its command, 0 where nothing is known."""
    angles = tuple(known.get(angle, 0.0) for angle in ANGLES)
    turned = dict(zip(QUATERNION, map(float, quaternion_of_angles(*angles)), strict=True))
    return tuple(
        turned[state] if state in turned else known.get(state, known.get(state.removesuffix(ACTUAL), 0.0))
        for state in model.states
    )


def first_measured(record: Record) -> dict[str, float]:
    """First value of every channel of a record that has one, and of every control, SI."""
    found = {}
    for name in (*record.controls, *record.measured):
        column = record.channel(name)
        finite = np.flatnonzero(np.isfinite(column))
        if finite.size:
            found[name] = float(column[finite[0]])
    return found
