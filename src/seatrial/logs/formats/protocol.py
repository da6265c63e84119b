"""What every format offers: a catalogue of its tables, and their columns as a stream of small blocks.

A log holds *tables* (a ROS topic, a message type of an autopilot, a struct, the one table of a CSV file), each with
named numeric *columns* on common rows. Some columns may serve as *clock*. A format never keeps messages: it appends
the wanted numbers to blocks of a few thousand rows and hands them on.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from seatrial.core.errors import InputError, needing_extra
from seatrial.logs.formats.unit_in_name import ENDINGS, name_and_units

BLOCK_ROWS = 8192
LOG_TIME = "log_time"  # Column of the time at which a message was written to the log
MAX_ELEMENTS = 64  # Elements of an array that a catalogue lists; any other of them can be asked for by its index

TIME_UNITS = ("ns", "us", "ms", "s", "min", "h")
_NANOSECONDS = re.compile(r"(?:.*[./])?(?:%time|rosbagtimestamp|header\.stamp|stamp)")
_CLOCK = re.compile(
    r"(?:.*[./_\s])?(?:t|time|timestamps?|stamp|uptime|utime|elapsed(?:_time)?|(?:epoch|unix)(?:_?time)?|time_?(?:stamp|boot|since_\w+)?)"
    r"(?:[\s_]*[\[(]?(?P<unit>ns|nsec|us|usec|ms|msec|s|sec|secs|seconds|min|h)[\])]?)?"
)

Wanted = Mapping[str, Sequence[str]]
"""For each table the columns to read."""


class NoColumn(InputError):
    """A log has no column of the name that the map gives."""


@dataclass(frozen=True)
class TextLayout:
    """How a log of text is laid out; see `LogSource`."""

    delimiter: str | None = None
    skip_rows: int = 0
    header_rows: int = 1
    names: tuple[str, ...] | None = None
    encoding: str = "utf-8"


@dataclass(frozen=True)
class LogFile:
    """A log on disk: a file, or the folder of a ROS 2 bag."""

    path: Path
    layout: TextLayout = TextLayout()


class ColumnInfo(NamedTuple):
    """One column; `unit` as the log states it, None if it does not."""

    name: str
    unit: str | None = None


@dataclass(frozen=True)
class TableInfo:
    """One table of a log.

    Attributes:
        name: as `LogSource.table` takes it.
        columns: those that can be read.
        clocks: columns that may be time, the best first; each has a unit.
        rows: how many, None if only a full reading would tell.
        kind: type of the messages, for example `nav_msgs/msg/Odometry`.
        trouble: why its columns cannot be read, if they cannot.
        notes: what was passed over in the log, for the user.
        words: columns that hold words, such as the mode; for conditions, not for channels.
        dates: columns of dates and times as text, which are read as nanoseconds since 1970.
        has_sequences: whether an array may have more elements in rows that the catalogue did not look at.
    """

    name: str
    columns: tuple[ColumnInfo, ...]
    clocks: tuple[str, ...] = ()
    rows: int | None = None
    kind: str = ""
    trouble: str = ""
    notes: tuple[str, ...] = ()
    words: tuple[str, ...] = ()
    dates: tuple[str, ...] = ()
    has_sequences: bool = False

    def unit(self, column: str) -> str | None:
        """Return the unit of a column as the log states it."""
        return next((info.unit for info in self.columns if info.name == column), None)

    def has(self, column: str) -> bool:
        """Return whether a column can be read, elements of arrays beyond the listed ones included."""
        names = {*(info.name for info in self.columns), *self.words}
        listed = self.elements(column)
        is_whole = bool(listed) and not self.has_sequences and len(listed) < MAX_ELEMENTS
        return column in names or (not is_whole and re.sub(r"\[\d+\]", "[0]", column) in names)

    def elements(self, column: str) -> list[str]:
        """Return the elements that are listed of the array of which a column is one by its name."""
        array, _, index = column.rpartition("[")
        is_one = bool(array) and index.endswith("]") and index[:-1].isdecimal()
        return [info.name for info in self.columns if is_one and re.fullmatch(rf"{re.escape(array)}\[\d+\]", info.name)]


class Block(NamedTuple):
    """Some rows of one table: int64 or float64 columns, NaN if a value is missing, or words; `done` is the share of the log."""

    table: str
    columns: Mapping[str, np.ndarray]
    done: float = 1.0


@dataclass(frozen=True, eq=False)
class RawTable:
    """Columns of one table as they stand in the log.

    Attributes:
        columns: int64 or float64, or text of stamps that fit neither, shape (n,) each.
        line_of: number of a row (from 0) as the user counts.
        notes: what was left out.
        decimals: for stamps that were decimal numbers, the power of ten by which they are larger here.
    """

    columns: Mapping[str, np.ndarray]
    line_of: Callable[[int], int] = lambda row: row + 1
    notes: tuple[str, ...] = ()
    decimals: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class LogFormat:
    """One format.

    Attributes:
        name: for messages, with its article: "a ROS 1 bag".
        suffixes: lower case, the longest first where one ends another.
        recognises: whether a path and its first 512 bytes can only be of this format.
        catalogue: tables of a log, found without keeping its data.
        blocks: wanted columns as a stream, each table's rows in the order of the log.
        read: one table whole, where that can be done better than by collecting blocks; the last argument is the
            columns of stamps, and those whose cells are words.
        is_text: whether a `TextLayout` means anything.
        memory: bytes that the process of its own may take in which it is read, four times those of the file apart, where a library
            reads it that damaged bytes can bring to abort, to walk in circles or to take gigabytes; 0 if it is read in this one.
    """

    name: str
    suffixes: tuple[str, ...]
    recognises: Callable[[Path, bytes], bool]
    catalogue: Callable[[LogFile], tuple[TableInfo, ...]]
    blocks: Callable[[LogFile, Wanted], Iterator[Block]]
    read: Callable[[LogFile, str, Sequence[str], Sequence[str], Sequence[str]], RawTable] | None = None
    is_text: bool = False
    memory: int = 0


def in_blocks(
    rows: Iterable[tuple[str, Any, float]], block: Callable[[str, list[Any], float], Block]
) -> Iterator[Block]:
    """Collect the rows of each table, and yield them some thousand at a time.

    Args:
        rows: of all tables, each as the name of its table, what is kept of it, and the share of the log that is read.
        block: makes a block of the name of a table, its rows and that share.
    """
    waiting: dict[str, list[Any]] = {}
    for table, row, done in rows:
        mine = waiting.setdefault(table, [])
        mine.append(row)
        if len(mine) == BLOCK_ROWS:
            yield block(table, waiting.pop(table), min(done, 1.0))
    for table, mine in waiting.items():
        yield block(table, mine, 1.0)


def begins_with(magic: bytes) -> Callable[[Path, bytes], bool]:
    """Return what recognises a format whose files all begin with the same bytes."""
    return lambda path, head: head.startswith(magic)


def unreadable(path: Path, cause: OSError) -> InputError:
    """Return the error of a file that is there and cannot be read."""
    return InputError(
        str(path),
        found=f"a file that cannot be read ({cause.strerror})",
        expected="a readable file",
        remedy="check its permissions and the disk",
    )


def optional(extra: str, path: Path) -> AbstractContextManager[None]:
    """Return a block that imports a library of an extra, which reads the log of the path; see `needing_extra`."""
    return needing_extra(extra, str(path), "a log that {} reads, which is not installed")


def as_column(values: np.ndarray) -> np.ndarray:
    """Return numbers, and instants in their unit, as int64 where that is exact, else as float64; NaN for no instant."""
    if values.dtype.kind == "u" and values.dtype.itemsize == 8 and values.size and values.max() >= 2**63:
        return values.astype(float)
    if values.dtype.kind == "b":
        return values.astype(np.int64)
    if values.dtype.kind == "M" and np.isnat(values).any():
        return np.where(np.isnat(values), np.nan, values.astype(np.int64))
    with np.errstate(invalid="ignore"):
        return values.astype(np.int64 if values.dtype.kind in "iuM" else float)


def clock_unit(name: str, stated: str | None = None) -> str | None:
    """Return the unit of a column that may be time by its name or its stated unit; None for one that is no clock."""
    lower = name.lower()
    if stated in TIME_UNITS and (_CLOCK.fullmatch(lower) or _NANOSECONDS.fullmatch(lower)):
        return stated
    if stated is not None:
        return None
    if _NANOSECONDS.fullmatch(lower):
        return "ns"
    match = _CLOCK.fullmatch(lower) or re.fullmatch(r"(?P<unit>secs|seconds|sec)", lower)
    return None if match is None else _of_time(ENDINGS[match["unit"] or "s"])


def unit_in_name(name: str) -> str | None:
    """Return the unit of time that the name of a clock ends in, set off from it as in `t_ms` or `time [ms]`; None if it has none."""
    lower = name.lower()
    return time_unit_at_end(lower) if _CLOCK.fullmatch(lower) else None


def time_unit_at_end(name: str) -> str | None:
    """Return the unit of time that any name ends in, set off from it; None if it has none."""
    return _of_time(name_and_units(re.sub(r"\s+", "_", name.lower())).units)


def _of_time(units: Sequence[str]) -> str | None:
    return next((unit for unit in units if unit in TIME_UNITS), None)


def clocks_among(columns: Sequence[ColumnInfo]) -> tuple[tuple[str, ...], tuple[ColumnInfo, ...]]:
    """Return the columns that may be time, that of the measurement first, then the plainest name; and all columns with their units."""
    units = {column.name: clock_unit(column.name, column.unit) for column in columns}
    clocks = sorted((name for name, unit in units.items() if unit), key=_order)
    return tuple(clocks), tuple(ColumnInfo(name, units[name] or unit) for name, unit in columns)


def _order(name: str) -> tuple[bool, int, int]:
    return not name.lower().endswith("header.stamp"), name.count("."), len(name)
