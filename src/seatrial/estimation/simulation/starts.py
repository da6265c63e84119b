"""The state of a vehicle at the first sample of a record: as stated, as first measured, or level and at rest."""

from collections.abc import Mapping

import numpy as np

from seatrial.core.argument_checks import check_numbers
from seatrial.core.errors import InputError
from seatrial.core.record import Record
from seatrial.core.signals import ACTUAL, ANGLES, QUATERNION, RATES
from seatrial.numerics.rotations import quaternion_of_angles
from seatrial.vehicles.model import VehicleModel


def start_of(
    model: VehicleModel, record: Record, known: Mapping[str, float] | None, free: bool = False
) -> tuple[float, ...]:
    """Return the state at the first sample, SI: as known, else as first measured; angles, positions and actuators else at rest.

    Raises:
        InputError: a velocity of which neither says anything, unless it is `free`; or what is known of no state.
    """
    named = [*(ANGLES if QUATERNION[0] in model.states else ()), *(set(model.states) - set(QUATERNION))]
    stated = check_numbers(known, "start", known=sorted({*named, *(name.removesuffix(ACTUAL) for name in named)}))
    known = {**first_measured(record), **stated}
    missing = [state for state in model.states if state in RATES and state not in known]
    if missing and not free:
        raise InputError(
            f'record "{record.label}", start',
            found=f"nothing about {', '.join(missing)}",
            expected="the state at the first sample",
            remedy=f"measure it, or give start={{{', '.join(f'{name!r}: 0.0' for name in missing)}}} or other values",
        )
    return level_start(model, known)


def first_measured(record: Record) -> dict[str, float]:
    """Return the first value of every channel of a record that has one, and of every control, SI."""
    columns = {name: record.channel(name) for name in (*record.controls, *record.measured)}
    finite = {name: column[np.isfinite(column)] for name, column in columns.items()}
    return {name: float(column[0]) for name, column in finite.items() if column.size}


def level_start(model: VehicleModel, known: Mapping[str, float]) -> tuple[float, ...]:
    """Return every state from values of signals, SI: an actuator from its command, a quaternion also from angles, all else 0."""
    parts = quaternion_of_angles(*(known.get(angle, 0.0) for angle in ANGLES))
    if set(QUATERNION) <= set(known):
        parts = tuple(known[name] for name in QUATERNION)
    turned = dict(zip(QUATERNION, (np.array(parts) / np.linalg.norm(parts)).tolist(), strict=True))
    return tuple(
        turned[state] if state in turned else known.get(state, known.get(state.removesuffix(ACTUAL), 0.0))
        for state in model.states
    )
