"""Logs inside a campaign's folder: what they hold, asked in a separate process, and what an upload may be called."""

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator, Mapping, Sequence
from decimal import Decimal
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from seatrial.cli.campaign_text import CAMPAIGN, read_file
from seatrial.core.errors import InputError, SeatrialError
from seatrial.core.files import atomic_path
from seatrial.core.processes import apart
from seatrial.dashboard.campaign_paths import upload_name
from seatrial.dashboard.channel_map import is_named, typed_map
from seatrial.dashboard.view_models import DATE, plain_error
from seatrial.logs.clock_shift import ClockShift, Samples, shift_between
from seatrial.logs.formats.registry import FORMATS, stream
from seatrial.logs.guess import Guess, best
from seatrial.logs.inspect import LogSummary, clock_doubt, inspect_log
from seatrial.logs.log_table import read_stamped
from seatrial.logs.source import LogSource
from seatrial.logs.summary import TableSummary

# A look at a file that somebody sent, in a process of its own: what takes too much memory or time ends there and
# nowhere else.

MEMORY = 6 << 30
"""Bytes of address space."""
SECONDS = 300.0
"""Of waiting."""


def isolated(
    what: str, question: Callable[..., Any], *about: Any, memory: int = MEMORY, seconds: float = SECONDS
) -> Any:
    """Answer a question in a process that ends with it.

    Args:
        what: the file, for errors.
        question: function of a module.
        about: its arguments.
        memory: bytes it may use.
        seconds: it may take.

    Raises:
        SeatrialError: an error of the question, with its fields.
        InputError: it took too much.
    """
    (answer,) = apart(what, _worded, question, about, memory=memory, seconds=seconds)
    return answer


def _worded(question: Callable[..., Any], about: tuple) -> Iterator[Any]:
    try:
        yield question(*about)
    except (SeatrialError, OSError) as error:
        raise plain_error(error) from None


# A log that is sent to a campaign: counted while it arrives, looked through, and kept under `logs/` whole or not at all.

FOLDER = "logs"


async def receive(
    body: AsyncIterator[bytes], folder: Path, given: str, suffixes: tuple[str, ...], most: int
) -> tuple[str, bool]:
    """Keep an uploaded log that can be read, in the place of one of that name which the campaign file does not name.

    Args:
        body: its bytes, as they arrive.
        folder: of the campaign.
        given: its name, as the sender says.
        suffixes: that a log may have.
        most: bytes, at most.

    Returns:
        its path from the campaign's folder, and whether it takes the place of another.

    Raises:
        InputError: a name that cannot be used, or one that the campaign file names; nothing sent, or too much.
        InputError: a log that cannot be read.
        OSError: it cannot be written.
    """
    name = upload_name(given, suffixes)
    place = folder / FOLDER
    place.mkdir(exist_ok=True)
    if place.resolve() != folder.resolve() / FOLDER:
        raise InputError(str(place), found="a link", expected="a folder of the campaign", remedy="make it a folder")
    path, relative = place / name, f"{FOLDER}/{name}"
    is_there = path.exists() or path.is_symlink()
    is_campaign = (folder / CAMPAIGN).is_file()  # else the folder of all, in which a log waits for its campaign
    if is_there and (path.is_symlink() or not is_campaign or is_named(read_file(folder), relative)):
        found = "a log of that name" + (", which the campaign reads" if is_campaign else "")
        raise InputError(
            f'file "{relative}"',
            found="a link of that name" if path.is_symlink() else found,
            expected="a new name",
            remedy="rename the file, or use the one there",
        )
    size = 0
    with atomic_path(path) as temporary:
        with temporary.open("wb") as stream:
            async for chunk in body:
                size += len(chunk)
                if size > most:
                    raise InputError(
                        f'file "{name}"',
                        found=f"more than {most >> 20:,} MiB",
                        expected="less",
                        remedy="copy it into the campaign's folder instead",
                    )
                stream.write(chunk)
        if not size:
            raise InputError(f'file "{name}"', found="nothing", expected="a log", remedy="choose another file")
        await asyncio.to_thread(_check, temporary, name)
    return relative, is_there


def _check(path: Path, name: str) -> None:
    """Look through a file that has a temporary name as a log of its own name.

    Raises:
        InputError: it cannot be read, or takes too much memory or time.
    """
    with TemporaryDirectory() as beside:
        named = Path(beside, name)
        named.symlink_to(path)
        try:
            isolated(name, _is_log, named)
        except InputError as error:
            where, found, expected, remedy = (
                text.replace(str(named), name) for text in (error.where, error.found, error.expected, error.remedy)
            )
            raise InputError(where, found=found, expected=expected, remedy=remedy) from None


def _is_log(path: Path) -> bool:
    """Return whether a log can be looked through, which an error says otherwise."""
    return bool(inspect_log(path))


SUFFIXES = tuple(sorted({suffix for form in FORMATS for suffix in form.suffixes if suffix.startswith(".")}))
"""Suffixes that a log may have."""


LAYOUT = ("table", "clock", "delimiter", "encoding", "skip_rows")
"""Keys by which a preview says how a log is read."""
POINTS = 60
"""Stretches of a column of which its small picture shows the least and greatest."""
MOST_COLUMNS = 400


class Column(NamedTuple):
    """A column of a table, in words; `picture` is the path of an SVG of 100 by 24."""

    table: str
    name: str
    unit: str
    spread: str
    trouble: str
    picture: str = ""


class PictureAxis(NamedTuple):
    """What the small pictures of a table are drawn over: its rows, or its clock where one is known.

    Attributes:
        rows: of the table.
        clock: column of the stamps; empty if the pictures are over the rows.
        length: from the least stamp to the greatest, in the unit of the clock.
    """

    rows: int
    clock: str = ""
    length: float = 0.0


class Looked(NamedTuple):
    """A log: its kind, what it holds, which column may be which channel, and what needs more than a map.

    Attributes:
        heads: of each table, its `[[import.files]]` without channels; the column of time is empty if none is known.
        axes: of each table, what the small pictures of its columns are drawn over.
        quantities: channel that a column seems to be, by table and column, whether the campaign has it or not.
    """

    kind: str
    tables: tuple[str, ...]
    columns: tuple[Column, ...]
    guesses: tuple[Guess, ...]
    heads: dict[str, dict[str, Any]]
    remarks: tuple[str, ...]
    axes: dict[str, PictureAxis]
    quantities: dict[tuple[str, str], str]


def look_into(
    path: str, relative: str, only: tuple[str, ...], clocks: Mapping[str | None, str] | None = None
) -> Looked:
    """Look through a log without letting it do harm.

    Args:
        path: of the log.
        relative: the same from the campaign's folder, for the map.
        only: channels of the campaign, which guesses are limited to; all if none are named.
        clocks: column of time by table, None for that of a log with one table; if none is named, what looks like a clock is taken.

    Raises:
        InputError: a log that cannot be read.
        InputError: one that takes too much memory or time.
    """
    return isolated(relative, _look, path, relative, only, clocks or {})


class StampedColumn(NamedTuple):
    """A column of a log, and how it is read.

    Attributes:
        path: of the log.
        name: of the column.
        time: column and unit of the time stamps.
        layout: values of those keys of `LAYOUT` that are given, with the keys.
        shift: added to the stamps, s.
    """

    path: str
    name: str
    time: tuple[str, str]
    layout: tuple[tuple[str, Any], ...] = ()
    shift: float = 0.0


def column_of(path: str, name: str, file: Mapping[str, Any], shift: float) -> StampedColumn:
    """Return a column of a log as its `[[import.files]]` says how to read it, with a shift in s."""
    time = file["time"]
    return StampedColumn(
        path, name, (time["column"], time["unit"]), tuple((key, file[key]) for key in LAYOUT if key in file), shift
    )


def line_up(first: StampedColumn, second: StampedColumn) -> ClockShift:
    """Find the shift of the second log's clock at which two columns correlate best, without letting the logs do harm.

    The shift that the first has stays, and that of the second is found again.

    Raises:
        InputError: a column that cannot be read or never moves.
    """
    return isolated(f"{Path(first.path).name}, {Path(second.path).name}", _lined_up, first, second)


def _lined_up(first: StampedColumn, second: StampedColumn) -> ClockShift:
    (epoch, one), (later, two) = samples_of(first), samples_of(second._replace(shift=0.0))
    return shift_between(one, two).later(float(epoch - later))


def samples_of(column: StampedColumn) -> tuple[Decimal, Samples]:
    """Read a column of a log: its first stamp, shifted, and its samples, s from there.

    Raises:
        InputError: a column that cannot be read.
    """
    read = read_stamped(LogSource(Path(column.path), *column.time, {}, **dict(column.layout)), [column.name])
    return read.epoch + Decimal(f"{column.shift:.9f}"), Samples(read.time, read.numbers(column.name))


def _look(path: str, relative: str, only: tuple[str, ...], clocks: Mapping[str | None, str]) -> Looked:
    summary = inspect_log(Path(path))
    tables = [one for one in summary.tables if not one.info.trouble]
    heads = {one.info.name: typed_map(summary.head_toml(one, relative))[0] for one in tables}
    tables = tuple(_table_words(table) for table in summary.tables)
    columns = tuple(column for table in summary.tables for column in _columns(table))[:MOST_COLUMNS]
    if None in clocks and len(summary.tables) == 1:
        clocks = {summary.tables[0].info.name: clocks[None]}
    axes = {one.info.name: _axis(one, clocks.get(one.info.name)) for one in summary.tables}
    drawn = _pictures(summary, columns, axes)
    columns = tuple(one._replace(picture=drawn.get((one.table, one.name), "")) for one in columns)
    quantities = {(one.table, one.column): one.channel for one in best(summary.guesses)}
    guesses = best(summary.guesses, only)
    return Looked(summary.kind, tables, columns, guesses, heads, tuple(summary.remarks), axes, quantities)


def _axis(table: TableSummary, named: str | None) -> PictureAxis:
    """Return what pictures are drawn over: the named clock, else that of the table; the rows where that is none, or stands still."""
    clock = (table.clock.name if table.clock else "") if named is None else named
    stamps = next((one for one in table.columns if one.name == clock and one.count and not one.constant), None)
    return PictureAxis(table.rows) if stamps is None else PictureAxis(table.rows, clock, stamps.greatest - stamps.least)


def _pictures(
    summary: LogSummary, columns: Sequence[Column], axes: Mapping[str, PictureAxis]
) -> dict[tuple[str, str], str]:
    """Paths of small pictures: the least and greatest of each stretch of the axis, one stroke after another."""
    begin = {
        table.info.name: one.least
        for table in summary.tables
        for one in table.columns
        if one.name == axes[table.info.name].clock
    }
    wanted: dict[str, list[str]] = {}
    for one in columns:
        if one.spread:
            wanted.setdefault(one.table, []).append(one.name)
    ends = {(table, name): np.full((POINTS, 2), np.nan) for table, names in wanted.items() for name in names}
    asked = {
        table: list(dict.fromkeys([*names, *filter(None, [axes[table].clock])])) for table, names in wanted.items()
    }
    begun = dict.fromkeys(wanted, 0)
    for block in stream(summary.log, asked) if asked else ():
        axis, count = axes[block.table], max((values.size for values in block.columns.values()), default=0)
        if axis.clock:
            along = (block.columns[axis.clock].astype(float) - begin[block.table]) / axis.length
        else:
            along = (begun[block.table] + np.arange(count)) / axis.rows
        begun[block.table] += count
        timed = np.flatnonzero(np.isfinite(along))
        place = np.clip((along[timed] * POINTS).astype(int), 0, POINTS - 1)
        starts = np.flatnonzero(np.diff(place, prepend=-1))
        for name, values in block.columns.items():
            if (block.table, name) in ends and values.dtype.kind in "if" and timed.size:
                kept, numbers = ends[block.table, name], values[timed].astype(float)
                np.fmin.at(kept[:, 0], place[starts], np.fmin.reduceat(numbers, starts))
                np.fmax.at(kept[:, 1], place[starts], np.fmax.reduceat(numbers, starts))
    return {name: _path(both) for name, both in ends.items()}


def _path(ends: np.ndarray) -> str:
    """Path of an SVG of 100 by 24 through the ends of each stretch."""
    there = np.isfinite(ends).all(axis=1)
    if not there.any():
        return ""
    low, high = ends[there].min(), ends[there].max()
    x = np.repeat((np.flatnonzero(there) + 0.5) * 100 / POINTS, 2)
    y = 22 - 20 * (ends[there].ravel() - low) / ((high - low) or 1.0)
    return "M" + "L".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))


def _table_words(table: TableSummary) -> str:
    clock = table.clock
    if clock is None:
        return f"{table.info.name}: {table.rows} rows, no clock"
    faults = [f"{clock.repeated} stamps repeat"] * bool(clock.repeated) + [f"{clock.backward} run back"] * bool(
        clock.backward
    )
    about = f"{clock.rate:.4g} Hz, longest gap {clock.gap:.3g} s"
    doubt = [f"{clock.name} {text}"] if (text := clock_doubt(clock)) else []
    return "; ".join([f"{table.info.name}: {table.rows} rows over {clock.duration:.6g} s, {about}", *doubt, *faults])


def _columns(table: TableSummary) -> list[Column]:
    return [
        Column(
            table.info.name,
            one.name,
            DATE if one.name in table.info.dates else one.unit or "",
            f"{one.least:.6g} to {one.greatest:.6g}" if one.count else "",
            one.trouble or (f"{one.missing:.1%} missing" if one.missing else ""),
        )
        for one in table.columns
    ]
