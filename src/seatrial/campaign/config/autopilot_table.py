"""Reads `[autopilot]`: the loops through which trials run."""

from collections.abc import Mapping, Sequence
from math import inf

from seatrial.campaign.config.file_keys import FileKeys
from seatrial.campaign.config.schema import LoopTable, Quantity
from seatrial.campaign.config.settings import AutopilotSettings
from seatrial.core.errors import InputError, nearest
from seatrial.core.signals import ANGLES, RATES, set_point, signal_unit
from seatrial.manoeuvres.autopilot import Loop
from seatrial.vehicles.model import VehicleModel

WHOLE = 1e-6
"""Share of a sample by which an interval may differ from whole samples."""


def read_autopilot(
    tables: Mapping[str, LoopTable],
    keys: FileKeys,
    model: VehicleModel,
    channels: Sequence[str],
    trim: Mapping[str, float],
    sample_time: float,
) -> AutopilotSettings:
    """Read the loops of an autopilot, none where there are no tables.

    Args:
        tables: as written, by the channel that each holds.
        keys: of the file.
        model: of the full structure.
        channels: that are measured.
        trim: of the vehicle, SI.
        sample_time: of designs, s.

    Raises:
        InputError: a channel that is not measured, something that cannot be moved, gains of another unit, or times that are none.
    """
    loops, set_points = [], []
    for at, (name, table) in enumerate(tables.items()):
        _check_measured(name, channels, keys, f"autopilot.{name}")
        if table.derivative is not None:
            _check_measured(table.derivative, channels, keys, f"autopilot.{name}.derivative")
        later = [set_point(other) for other in list(tables)[at + 1 :]]
        loops.append(_loop(name, table, keys, model, later, sample_time))
        unit, stated = signal_unit(name), table.set_point
        set_points.append(
            trim.get(name, 0.0) if stated is None else keys.si(stated, unit, f"autopilot.{name}.set_point")
        )
    return AutopilotSettings(tuple(loops), tuple(set_points))


def _loop(
    name: str, table: LoopTable, keys: FileKeys, model: VehicleModel, later: Sequence[str], sample_time: float
) -> Loop:
    key = f"autopilot.{name}"
    movable = [one for one in (*model.controls, *later) if one not in (*RATES, *ANGLES)]
    for moved in table.moves:
        if moved not in movable:
            raise InputError(
                keys.where(f"{key}.moves"),
                found=f'"{moved}"',
                expected="controls of the vehicle, or set-points of loops further down: " + ", ".join(movable),
                remedy="move the outer loop of a cascade above the inner one"
                if moved.endswith("_set")
                else nearest(moved, movable),
            )
    unit, held = signal_unit(next(iter(table.moves))), signal_unit(name)

    def si(written: Quantity | None, of: str, of_key: str, otherwise: float) -> float:
        return otherwise if written is None else keys.si(written, of, f"{key}.{of_key}")

    gains = (
        si(table.kp, f"({unit})/({held})", "kp", 0.0),
        si(table.ki, f"({unit})/({held} s)", "ki", 0.0),
        si(table.kd, f"({unit}) s/({held})", "kd", 0.0),
    )
    limit, rate = si(table.limit, unit, "limit", inf), si(table.rate, f"({unit})/s", "rate", inf)
    interval = si(table.interval, "s", "interval", sample_time)
    for of_key, value in (("limit", limit), ("rate", rate)):
        if not value > 0:
            raise InputError(
                keys.where(f"{key}.{of_key}"),
                found=f"{value:g}",
                expected="more than 0",
                remedy="leave it out where there is none",
            )
    every = round(interval / sample_time)
    if every < 1 or abs(every * sample_time - interval) > WHOLE * sample_time:
        raise InputError(
            keys.where(f"{key}.interval"),
            found=f"{interval:g} s",
            expected=f"a whole multiple of design.sample_time, {sample_time:g} s",
            remedy=f"set design.sample_time to {interval:g} s or to a whole fraction of it",
        )
    return Loop(name, tuple(table.moves.items()), *gains, table.derivative, limit, rate, every, interval)


def _check_measured(name: str, channels: Sequence[str], keys: FileKeys, key: str) -> None:
    if name not in channels:
        raise InputError(
            keys.where(key),
            found=f'"{name}", which no sensor shows',
            expected="a measured channel: " + ", ".join(channels),
            remedy=f"add [sensors.{name}]: the autopilot sees what the sensor shows",
        )
