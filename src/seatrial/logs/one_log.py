"""A log read into a record in one call: which column is which signal, and which of them drive the vehicle."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from seatrial.core.errors import InputError
from seatrial.core.record import Record, Role
from seatrial.core.signals import ANGLES, OVER_EARTH, QUATERNION, RATES
from seatrial.logs.align import align
from seatrial.logs.body_frame import to_body
from seatrial.logs.read import read_log
from seatrial.logs.source import ColumnMap, LogSource


def record_of_log(
    path: Path | str,
    channels: Mapping[str, tuple[str, str]],
    controls: Sequence[str],
    *,
    time: tuple[str, str] | None = None,
    step: float | None = None,
    start: float | None = None,
    end: float | None = None,
    label: str | None = None,
    **layout: Any,
) -> Record:
    """Read a log into a record.

    Args:
        path: CSV or TSV, Parquet, NetCDF, MATLAB, ROS 1 or 2 bag, MCAP, dataflash `.BIN`, MAVLink `.tlog` or MOOS `.alog`.
        channels: signal to (column, unit), for example `{"u": ("speed", "m/s"), "n": ("prop", "rpm")}`.
        controls: those of the signals that drive the vehicle.
        time: column of the time stamps and their unit; by default the log's own clock.
        step: of a uniform grid, s; by default the union of all stamps.
        start: where to begin, s from the first sample.
        end: where to end, s likewise.
        label: short name; by default the file's.
        layout: `clock`, `delimiter`, `skip_rows`, `header_rows`, `names`, `encoding`, `table` and `axes` of `LogSource`.

    Returns:
        a record in SI whose time starts at 0.

    Raises:
        InputError: a file, column or unit that cannot be used, or a control that is no channel.
    """
    if unmapped := [name for name in controls if name not in channels]:
        raise InputError(
            f"{path}, controls",
            found=", ".join(unmapped),
            expected="among " + ", ".join(channels),
            remedy="map the control to a column",
        )
    roles: dict[str, Role] = {name: "control" if name in controls else "measurement" for name in channels}
    maps = {name: ColumnMap(column, unit, roles[name]) for name, (column, unit) in channels.items()}
    source = LogSource(Path(path), *(time or (None, None)), maps, **layout)
    made: dict[str, Role] = dict.fromkeys(
        (*RATES, *ANGLES), "measurement"
    )  # of quaternions, and of velocities over the earth
    tables = to_body(
        [read_log(source)], made | {name: roles[name] for name in channels if name not in (*OVER_EARTH, *QUATERNION)}
    )
    return align(tables, step=step, start=start, end=end, label=Path(path).stem if label is None else label)
