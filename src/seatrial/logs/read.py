"""Read the mapped columns of a log into SI: all of them, or an error that says what is at fault, whatever the format."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal, DecimalException

import numpy as np
from jaxtyping import Float, Int

from seatrial.core.errors import InputError, nearest
from seatrial.core.record import Channel, check_time
from seatrial.core.signals import signal_unit
from seatrial.core.units import to_si
from seatrial.logs.axes import from_axes
from seatrial.logs.formats.protocol import LogFormat, RawTable, TableInfo
from seatrial.logs.formats.registry import catalogue, format_of, hash_of_log, pick, read_columns
from seatrial.logs.formats.text_layout import signs_of
from seatrial.logs.source import (
    Clock,
    LogSource,
    LogTable,
    check_source,
    log_file,
    si_factor,
    source_options,
    text_options,
    time_scale,
)

# Time stamps of a log: read exactly, then trusted, thinned, or rebuilt from arrivals in bursts.
#
# Rows that leave a source evenly, at a + b k, arrive at t_k = a + b k + d_k with delays d_k >= 0. The clock is the
# line below every arrival with the least total delay: min sum_k (t_k - a - b k) subject to t_k >= a + b k, a linear
# programme solved by the edge of the lower convex hull that spans the middle row.

_PLAUSIBLE_STEP = (1e-5, 1e3)
_USUAL_STEP = 0.03
_COMMON_UNITS = ("ns", "us", "ms", "s", "min")


def elapsed(
    stamps: Int[np.ndarray, " n"] | Float[np.ndarray, " n"] | list[str], scale: Decimal
) -> tuple[Float[np.ndarray, " n"], Decimal]:
    """Return the time since the first stamp, subtracted before anything is rounded.

    Args:
        stamps: whole numbers as int64, floats of a binary log, or decimal numbers as text.
        scale: seconds in one unit.

    Returns:
        seconds since the first stamp, shape (n,), and that stamp in seconds, exactly.
    """
    if isinstance(stamps, np.ndarray):
        whole = stamps.dtype.kind == "i"
        count, first = (stamps - stamps[0]).astype(float), Decimal(int(stamps[0]) if whole else repr(float(stamps[0])))
    else:
        decimals = [Decimal(text) for text in stamps]
        first = decimals[0]
        count = np.array([float(value - first) for value in decimals])
    # Dividing by a whole number of units per second rounds once; multiplying by 1e-9 would round twice.
    return (count / float(1 / scale) if scale < 1 else count * float(scale)), first * scale


def mend_clock(
    time: Float[np.ndarray, " n"], clock: Clock, line_of: Callable[[int], int], where: str
) -> tuple[Float[np.ndarray, " m"], Int[np.ndarray, " m"], list[str]]:
    """Apply the chosen clock.

    Args:
        time: stamps, s.
        clock: which.
        line_of: line of a row in the file, for errors.
        where: file and column, for errors.

    Returns:
        strictly increasing time, s; the rows kept; and notes.

    Raises:
        InputError: time running backwards, or repeated stamps where the clock is `as_stamped`.
    """
    rows = np.arange(time.size)
    moving = rows if clock == "as_stamped" else np.flatnonzero(np.diff(time, prepend=-np.inf) != 0)
    _check_increasing(time[moving], moving, line_of, where)
    if clock == "even":
        mended, notes = even_clock(time)
        return mended, rows, notes
    dropped = time.size - moving.size
    return time[moving], moving, [f"{dropped} of {time.size} rows repeated a stamp and were dropped"] if dropped else []


def even_clock(arrival: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, " n"], list[str]]:
    """Rebuild the evenly spaced clock a + b k below arrival times that come in bursts.

    The line rests on two rows and shares their delays: between them no rebuilt time is later than the truth by more
    than the greater of the two. A delay common to all rows cannot be told from a later clock; rows that were lost
    shift the clock, which shows in the last note.

    Args:
        arrival: s, not decreasing.

    Returns:
        rebuilt time, s, and notes with the period and the delays.
    """
    index = np.arange(arrival.size)
    middle = (arrival.size - 1) / 2
    left, right = 0, arrival.size - 1
    while True:
        period = (arrival[right] - arrival[left]) / (right - left)
        below = int(np.argmin(arrival - period * index))
        drop = arrival[below] - arrival[left] - period * (below - left)
        if drop >= -1e-12 * max(abs(arrival[-1]), 1.0) or below in (left, right):
            break
        left, right = (below, right) if below <= middle else (left, below)
    time = arrival[left] + period * (index - left)
    delay = np.maximum(arrival - time, 0.0)
    quiet = max(part.min() for part in np.array_split(delay, min(10, delay.size)))
    return time, [
        f"clock rebuilt: period {period:.6g} s; rows arrived {np.median(delay):.3g} s late at the median and "
        f"{delay.max():.3g} s at most; in every tenth of the rows one was at most {quiet:.2g} s late"
    ]


def is_plausible(time: Float[np.ndarray, " n"]) -> bool:
    """Return whether the median or the mean step of stamps, s, is one that a log can have."""
    low, high = _PLAUSIBLE_STEP
    return any(
        low <= abs(float(step)) <= high for step in (np.median(np.diff(time)), (time[-1] - time[0]) / (time.size - 1))
    )


def fitting_unit(step: float) -> str:
    """Return the unit in which a step, as it stands in a log, is nearest to a usual one."""
    far = {name: math.log(max(step * to_si(1.0, name, "s", name), 1e-300) / _USUAL_STEP) for name in _COMMON_UNITS}
    return min(far, key=lambda name: abs(far[name]))


def check_unit(time: Float[np.ndarray, " n"], unit: str, where: str) -> None:
    """Refuse a time unit that makes the rows implausibly dense or sparse.

    Args:
        time: s, as the unit says, rising, shape (n,).
        unit: as stated.
        where: file and column, for the error.

    Raises:
        InputError: median and mean step both outside 1e-5 s to 1e3 s; suggests the unit that would fit.
    """
    if is_plausible(time):
        return
    low, high = _PLAUSIBLE_STEP
    step = float(np.median(np.diff(time)))
    in_file = step / to_si(1.0, unit, "s", where)
    best = fitting_unit(in_file)
    raise InputError(
        where,
        found=f'a median step of {step:.3g} s with the time unit "{unit}"',
        expected=f"between {low:g} s and {high:g} s",
        remedy=f'is the unit "{best}"? Then the step would be {in_file * to_si(1.0, best, "s", where):.3g} s',
    )


def _check_increasing(time: np.ndarray, rows: np.ndarray, line_of: Callable[[int], int], where: str) -> None:
    """Check as `check_time`, with the offending row numbered as a text editor shows it, blank lines counted."""
    bad = np.flatnonzero(~(np.diff(time) > 0))
    sample = int(bad[0]) + 1 if bad.size else 0
    check_time(time, where, line_of(int(rows[sample])) - sample)


_LAYOUT = {"delimiter": None, "skip_rows": 0, "header_rows": 1, "names": None, "encoding": "utf-8"}


def read_log(source: LogSource) -> LogTable:
    """Read one table of one log.

    Empty cells of text (also `NA`, `nan`, `null`) and NaN are gaps; anything else that is not a finite number is an
    error. Columns that the map does not name are neither parsed nor kept.

    Args:
        source: log, table, channel map and clock.

    Returns:
        the mapped columns in SI on stamps relative to the exact first one, shifted as the source says.

    Raises:
        InputError: whatever is wrong with the map or the log, naming file, table, column and row.
    """
    check_source(source)
    columns = [part for column in source.channels.values() for _, part in column.columns]
    read = read_stamped(source, columns)
    info, where, notes = read.info, read.where, list(read.notes)
    mapped = {}
    for name, column in source.channels.items():
        values = mapped[name] = in_si(source, name, read.numbers, where)
        if gaps := int(np.isnan(values).sum()):
            notes.append(f"{name}: {gaps} of {values.size} cells are empty")
        if gaps == values.size:
            raise InputError(
                f'{where}, column "{column.column}"',
                found="no number in any row",
                expected="samples",
                remedy="map another column, or drop the channel",
            )
        stated = info.unit(column.column) if info and not column.parts else None
        if stated not in (None, column.unit):
            notes.append(f'{name}: the log states the unit "{stated}", the map says "{column.unit}"')
    mapped = from_axes(mapped, source.axes, str(source.path))
    channels = tuple(Channel(name, signal_unit(name), column.role) for name, column in source.channels.items())
    used = replace(source, table=info.name if info else None, time_column=read.clock, time_unit=read.clock_unit)
    options = source_options(used) | (text_options(source) if format_of(source.path).is_text else {})
    epoch = read.epoch + Decimal(f"{source.shift:.9f}")
    return LogTable(
        read.time, epoch, mapped, channels, source.path.name, hash_of_log(source.path), options, tuple(notes)
    )


@dataclass(frozen=True, eq=False)
class Stamped:
    """Columns of one table as they stand in the log, and when each row was.

    Attributes:
        raw: the columns.
        kept: rows that have a time, shape (n,).
        time: of these, s since `epoch`, strictly increasing, shape (n,).
        epoch: exact stamp of the first, s.
        clock: column of the stamps.
        clock_unit: its unit.
        info: the table, None for a text whose columns are found while it is read.
        where: log and table, for errors.
        notes: what was found and mended, for the user.
    """

    raw: RawTable
    kept: Int[np.ndarray, " n"]
    time: Float[np.ndarray, " n"]
    epoch: Decimal
    clock: str
    clock_unit: str
    info: TableInfo | None
    where: str
    notes: tuple[str, ...]

    def numbers(self, column: str) -> Float[np.ndarray, " n"]:
        """Return a column of the rows, NaN for gaps.

        Raises:
            InputError: a number that is not finite.
        """
        return _finite(self.raw, column, self.where)[self.kept]

    def words(self, column: str) -> np.ndarray:
        """Return a column of words, empty where a row has none; of numbers as they are."""
        return self.raw.columns[column][self.kept]


def read_stamped(source: LogSource, columns: Sequence[str], words: Sequence[str] = ()) -> Stamped:
    """Read some columns of one table with their time; the channels of the source are not looked at.

    Args:
        source: log, table and clock.
        columns: that hold numbers.
        words: columns that may hold words.

    Raises:
        InputError: as `read_log`.
    """
    form = format_of(source.path)
    _check_layout(source, form)
    info = _table(source, form)
    where = str(source.path) if form.is_text or info is None else f'{source.path}, table "{info.name}"'
    clocks = _clocks(source, info, where)
    for name in (*clocks, *columns, *words):
        if info is not None and not form.is_text and not info.has(name):
            raise _no_column(name, info, where)
        if info is not None and name in info.words and name in columns:
            raise InputError(
                f'{where}, column "{name}"',
                found="words",
                expected="a column of numbers",
                remedy="words may stand in conditions of [[import.keep]] only; map another column",
            )
    table, every = info.name if info else "", list(dict.fromkeys((*clocks, *columns, *words)))
    raw = read_columns(log_file(source), table, every, tuple(clocks), words)
    clock = next((name for name in clocks if _moves(raw.columns[name])), next(iter(clocks)))

    time_where = f'{where}, column "{clock}"'
    time, epoch = _elapsed(raw, clock, source, clocks[clock], time_where)
    time, kept, notes = mend_clock(time, source.clock, raw.line_of, time_where)
    check_unit(time, clocks[clock], time_where)
    step = np.diff(time)
    notes.insert(
        0,
        f"{time.size} rows over {time[-1] - time[0]:.6g} s; step {np.median(step):.4g} s at the median, "
        f"{step.max():.4g} s at most",
    )
    notes += [*raw.notes, *(info.notes if info else ())]
    if source.time_column is None:
        notes.append(f"time is the column {clock}, in {clocks[clock]}")
    return Stamped(raw, kept, time, epoch, clock, clocks[clock], info, where, tuple(notes))


def in_si(
    source: LogSource, name: str, cells_of: Callable[[str], Float[np.ndarray, " n"]], where: str
) -> Float[np.ndarray, " n"]:
    """Return a channel as the map makes it of its columns: each through the curve, summed, scaled, offset, in SI; NaN where one is a gap.

    Args:
        source: whose map it is.
        name: of the channel.
        cells_of: returns the numbers of a column.
        where: log, for errors.

    Raises:
        InputError: a number beyond the ends of the curve.
    """
    column, total = source.channels[name], np.zeros(())
    with np.errstate(invalid="ignore", over="ignore"):
        for factor, part in column.columns:
            cells = cells_of(part)
            total = total + factor * (
                cells if column.curve is None else column.curve(cells, f'{where}, column "{part}"')
            )
        return (column.scale * total + column.offset) * si_factor(source, name)


def _check_layout(source: LogSource, form: LogFormat) -> None:
    """Refuse the layout of a text where the log is none."""
    if form.is_text:
        signs_of(log_file(source))
        return
    for key, default in _LAYOUT.items():
        if getattr(source, key) != default:
            raise InputError(
                f"{source.path}, {key}",
                found=repr(getattr(source, key)),
                expected=f"nothing: {form.name} is no text in rows and cells",
                remedy="remove it",
            )


def _table(source: LogSource, form: LogFormat) -> TableInfo | None:
    """Describe the table; None for a text whose columns are found while it is read."""
    if form.is_text and source.table is None and source.time_column is not None and source.time_unit is not None:
        return None
    return pick(catalogue(log_file(source)), source.table, str(source.path))


def _clocks(source: LogSource, info: TableInfo | None, where: str) -> dict[str, str]:
    """Return the columns that may be the time, best first, with their units."""
    if source.time_column is not None:
        unit = source.time_unit or (info.unit(source.time_column) if info else None)
        if unit is None:
            raise InputError(
                f"{where}, time_unit",
                found=f'nothing, and the log states no unit for "{source.time_column}"',
                expected="a unit of time",
                remedy='give it, for example "s" or "ns"',
            )
        time_scale(source, unit)
        return {source.time_column: unit}
    clocks = {name: source.time_unit or info.unit(name) or "s" for name in info.clocks} if info else {}
    if not clocks:
        raise InputError(
            f"{where}, time_column",
            found="nothing, and no column that is the time by its name",
            expected="the column of the time stamps",
            remedy="name it and its unit; `seatrial inspect` lists the columns",
        )
    return clocks


def _moves(stamps: np.ndarray) -> bool:
    """Return whether a clock was set at all: some drivers leave their stamp at zero."""
    return stamps.size > 0 and bool((stamps != stamps[0]).any())


def _elapsed(
    raw: RawTable, clock: str, source: LogSource, unit: str, where: str
) -> tuple[Float[np.ndarray, " n"], Decimal]:
    """Return the seconds since the first stamp, and that stamp."""
    stamps = raw.columns[clock]
    if stamps.dtype.kind == "f":
        bad = np.flatnonzero(~np.isfinite(stamps))
        if bad.size:
            raise InputError(
                f"{where}, row {raw.line_of(int(bad[0]))}",
                found=f"time {float(stamps[bad[0]])!r}",
                expected="a time stamp in every row",
                remedy="use another time column, or remove the row",
            )
    elif stamps.dtype.kind == "i" and stamps.size and not -(2**62) < stamps.min() <= stamps.max() < 2**62:
        raise _beyond(where)
    if stamps.size == 0:
        raise InputError(
            where, found="no row", expected="at least 3 samples", remedy="choose a table that was recorded"
        )
    try:
        scale = time_scale(source, unit).scaleb(-raw.decimals.get(clock, 0))
        return elapsed(stamps.tolist() if stamps.dtype.kind == "O" else stamps, scale)
    except DecimalException as cause:
        raise _beyond(where) from cause


def _beyond(where: str) -> InputError:
    return InputError(
        where,
        found="stamps beyond any clock",
        expected="numbers of ordinary size",
        remedy="map the column that holds the time",
    )


def _finite(raw: RawTable, name: str, where: str) -> Float[np.ndarray, " n"]:
    """Return a column as floats, NaN for gaps."""
    cells = raw.columns[name]
    values = cells.astype(float)
    infinite = np.flatnonzero(np.isinf(values))
    if infinite.size:
        raise InputError(
            f'{where}, column "{name}", row {raw.line_of(int(infinite[0]))}',
            found=repr(float(values[infinite[0]])),
            expected="a finite number",
            remedy="correct the log, or map another column",
        )
    return values


def _no_column(name: str, info: TableInfo, where: str) -> InputError:
    names: Sequence[str] = [column.name for column in info.columns]
    text = nearest(name, names)
    return InputError(
        f'{where}, column "{name}"',
        found="no column of that name",
        expected=f"one of the {len(names)} numbers in the table",
        remedy=text if len(names) <= 20 or text.startswith("did you") else "`seatrial inspect` lists them",
    )
