"""What a log is and what it becomes: the file with its channel map going in, the table in SI coming out."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Float

from seatrial.core.errors import InputError, not_among
from seatrial.core.record import Channel, Role
from seatrial.core.signals import SIGNALS, is_signal, signal_unit
from seatrial.core.units import to_si
from seatrial.logs.axes import Axes
from seatrial.logs.curve import CellCurve
from seatrial.logs.formats.protocol import LogFile, TextLayout
from seatrial.logs.formats.text_layout import signs_of

Clock = Literal["as_stamped", "even", "drop_repeated"]
Between = Literal["held", "line"]


@dataclass(frozen=True)
class ColumnMap:
    """One channel: value = scale * sum_j factor_j curve(cell_j) + offset, in `unit`; then converted to SI.

    Of a command with a law of thrust it is scale * law(sum_j factor_j cell_j + offset): a law that is not linear acts on the sum.

    Attributes:
        column: name in the header; or, where there are `parts`, the sum as it was written.
        unit: unit of the cells, for example `rpm`; of a sum, its own.
        role: whether the channel drives the vehicle or observes it.
        scale: plain factor on the cell, for example -1 to flip the sign.
        offset: added after scaling, in `unit`; before a law, in units of the command, for example 1500 where the sum has no neutral.
        curve: what a cell's number stands for; by default itself.
        parts: factors and columns of a sum, see `parse_sum`; by default the column alone.
        law: force of a command, in `unit`; no curve stands beside it.
        between: what a control does from one sample to the next: it is held, or changes along a straight line; None for one
            that is held and may be doubted.
    """

    column: str
    unit: str
    role: Role
    scale: float = 1.0
    offset: float = 0.0
    curve: CellCurve | None = None
    parts: tuple[tuple[float, str], ...] = ()
    between: Between | None = None
    law: CellCurve | None = None

    @property
    def columns(self) -> tuple[tuple[float, str], ...]:
        """Every column with its factor."""
        return self.parts or ((1.0, self.column),)


@dataclass(frozen=True)
class LogSource:
    """One log file and how to read it.

    Attributes:
        path: of the log: CSV or TSV (gzip-compressed where the name ends in `.gz`), Parquet, NetCDF, MATLAB, NumPy archive, ROS 1 bag,
            folder of a ROS 2 bag, MCAP, dataflash `.BIN`, MAVLink `.tlog`, PX4 `.ulg` or MOOS `.alog`.
        time_column: column of the time stamps, whole or decimal; by default the first clock of the table that moves, for
            example `header.stamp`, else the time of receipt.
        time_unit: their unit, for example `ns`; by default what the log states.
        channels: one column map for each seatrial signal (`u`, `udot`, `n`, `tau_X`, …).
        clock: `as_stamped` trusts the stamps; `even` rebuilds an evenly spaced clock from arrival times in bursts;
            `drop_repeated` keeps the first row of every repeated stamp.
        shift: added to every stamp, s, to bring the log onto the clock of another; exact to the nanosecond.
        delimiter: of text, as are the four that follow: one character, or `whitespace`; by default the suffix says (.csv comma, .tsv tab).
        skip_rows: lines above the header, or above the data of a file without one.
        header_rows: rows of the header, of which the first names the columns (2 where a row of units follows).
        names: column names of a file without a header.
        encoding: of the text.
        table: a topic, type of message, struct, group or variable; needed only where a log has several.
        axes: in which its velocities, angles and forces are.
    """

    path: Path
    time_column: str | None
    time_unit: str | None
    channels: Mapping[str, ColumnMap]
    clock: Clock = "as_stamped"
    shift: float = 0.0
    delimiter: str | None = None
    skip_rows: int = 0
    header_rows: int = 1
    names: tuple[str, ...] | None = None
    encoding: str = "utf-8"
    table: str | None = None
    axes: Axes = "NED"


@dataclass(frozen=True, eq=False)
class CurvedCells:
    """Numbers of a column, or commands, that a curve or law explains; its reach is checked once it is known which rows are kept.

    Attributes:
        curve: what they stand for.
        cells: as logged, or the command that a sum makes; NaN if empty, shape (n,).
        where: log and column, for errors.
    """

    curve: CellCurve
    cells: Float[np.ndarray, " n"]
    where: str


@dataclass(frozen=True, eq=False)
class LogTable:
    """The mapped columns of one log, in SI, on the log's own stamps.

    Attributes:
        time: seconds since `epoch`, strictly increasing, shape (n,).
        epoch: exact stamp of the first row, s, on the clock of the file.
        columns: for each channel its samples in SI, NaN if the cell was empty, shape (n,). A number that no curve reaches has the
            value before it; `align` refuses it in a row that is kept.
        channels: name, unit and role of each.
        source: name of the file.
        sha256: hash of its bytes.
        options: how it was read, as JSON-able values.
        notes: what was found and mended, for the user.
        cautions: what makes its numbers doubtful, likewise.
        curved: for each channel of which curves say what its numbers stand for, the numbers.
    """

    time: Float[np.ndarray, " n"]
    epoch: Decimal
    columns: Mapping[str, Float[np.ndarray, " n"]]
    channels: tuple[Channel, ...]
    source: str
    sha256: str
    options: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    cautions: tuple[str, ...] = ()
    curved: Mapping[str, tuple[CurvedCells, ...]] = field(default_factory=dict)

    @property
    def place(self) -> str:
        """The file, after the topic or message where a log has several; for cautions and errors."""
        table = None if "delimiter" in self.options else self.options.get("table")
        return f"{table} of {self.source}" if table else self.source


def given_twice(place: str, channel: str, other: str) -> InputError:
    """Return the refusal of a channel that two logs of a run give, by the places of both."""
    return InputError(
        f'{place}, channel "{channel}"',
        found=f"a channel that {other} gives too",
        expected="one source for each channel",
        remedy="drop it from one of the maps",
    )


def check_source(source: LogSource) -> None:
    """Check all that can be checked without opening the file.

    Raises:
        InputError: no channels, unknown channel, unit, role or clock, scale that is not a number, or a bad layout.
    """
    where = str(source.path)
    if not source.channels:
        raise InputError(
            f"{where}, channels",
            found="an empty map",
            expected="at least one channel",
            remedy='map one, for example u = {column = "speed", unit = "m/s", role = "measurement"}',
        )
    _one_of(source.clock, get_args(Clock), f"{where}, clock")
    _one_of(source.axes, get_args(Axes), f"{where}, axes")
    if source.time_unit is not None:
        time_scale(source, source.time_unit)
    if not math.isfinite(source.shift):
        raise InputError(
            f"{where}, shift", found=repr(source.shift), expected="a finite number of seconds", remedy="correct it"
        )
    for key, value, least in (("skip_rows", source.skip_rows, 0), ("header_rows", source.header_rows, 1)):
        if not isinstance(value, int) or value < least:
            raise InputError(
                f"{where}, {key}",
                found=repr(value),
                expected=f"a whole number of at least {least}",
                remedy="count the lines above the first row of numbers",
            )
    for name, column in source.channels.items():
        key = f'{where}, channel "{name}"'
        if not is_signal(name):
            _one_of(name, tuple(SIGNALS), f"{where}, channels")
        _one_of(column.role, get_args(Role), f"{key}, role")
        if not (math.isfinite(column.scale) and math.isfinite(column.offset) and column.scale != 0):
            raise InputError(
                key,
                found=f"scale {column.scale!r}, offset {column.offset!r}",
                expected="finite numbers and a scale that is not zero",
                remedy="correct the map",
            )
        si_factor(source, name)


def si_factor(source: LogSource, name: str) -> float:
    """Return what one unit of a channel's column is in SI.

    Raises:
        InputError: unknown unit or one of the wrong dimension.
    """
    return to_si(1.0, source.channels[name].unit, signal_unit(name), f'{source.path}, channel "{name}", unit')


def time_scale(source: LogSource, unit: str) -> Decimal:
    """Return the seconds in one unit of the time column, exactly: the shortest decimal of the factor, 1E-9 for `ns`.

    Raises:
        InputError: not a unit of time.
    """
    return Decimal(repr(to_si(1.0, unit, "s", f"{source.path}, time_unit")))


def log_file(source: LogSource) -> LogFile:
    """Return the log of a source, with the layout of its text."""
    layout = TextLayout(source.delimiter, source.skip_rows, source.header_rows, source.names, source.encoding)
    return LogFile(source.path, layout)


def source_options(source: LogSource) -> dict[str, Any]:
    """Return how a log is read, as JSON-able values, without the path of this machine."""
    return {
        "source": source.path.name,
        "table": source.table,
        "time_column": source.time_column,
        "time_unit": source.time_unit,
        "clock": source.clock,
        "shift": source.shift,
        "axes": source.axes,
        "channels": {
            name: {
                "column": column.column,
                "unit": column.unit,
                "role": column.role,
                "scale": float(column.scale),
                "offset": float(column.offset),
            }
            | ({} if (explained := column.curve or column.law) is None else {"curve": explained.name})
            | ({} if column.between is None else {"between": column.between})
            for name, column in source.channels.items()
        },
    }


def text_options(source: LogSource) -> dict[str, Any]:
    """Return how a log of text is laid out, as JSON-able values."""
    return {
        "delimiter": signs_of(log_file(source)).separator,
        "skip_rows": source.skip_rows,
        "header_rows": 0 if source.names else source.header_rows,
        "encoding": source.encoding,
        "names": list(source.names) if source.names else None,
    }


def _one_of(value: str, allowed: tuple[str, ...], where: str) -> None:
    if value not in allowed:
        raise not_among(where, value, allowed, found=repr(value))
