"""Read the mapped columns of a log into SI: all of them, or an error that says what is at fault, whatever the format."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from decimal import Decimal, DecimalException

import numpy as np
from jaxtyping import Bool, Float, Int

from seatrial.core.errors import InputError, nearest
from seatrial.core.record import Channel
from seatrial.core.signals import signal_unit
from seatrial.core.units import to_si
from seatrial.logs.axes import from_axes
from seatrial.logs.formats.protocol import LogFormat, NoColumn, RawTable, TableInfo, TextLayout, unit_in_name
from seatrial.logs.formats.registry import catalogue, format_of, hash_of_log, pick, read_columns, stream
from seatrial.logs.formats.text_layout import signs_of
from seatrial.logs.guess import known_unit, unit_by_name
from seatrial.logs.measured_control import half_a_step_matters, looks_measured, mean_to_next
from seatrial.logs.source import (
    ColumnMap,
    CurvedCells,
    LogSource,
    LogTable,
    check_source,
    log_file,
    si_factor,
    source_options,
    text_options,
    time_scale,
)
from seatrial.logs.summary import clock_summary, disagreement
from seatrial.logs.time_stamps import check_unit, checked_time, elapsed, unit_doubt

# What is said of a control that may be measured
LOOKS_MEASURED = "it looks measured, not commanded (it changes at nearly every sample)"
# Share by which the unit of a map, or unit times scale, may differ from the one that the log or the name of the column
# states
SAME_UNIT = 0.02


def read_log_table(source: LogSource) -> LogTable:
    """Read one table of one log.

    Empty cells of text (also `NA`, `nan`, `null`) and NaN are gaps; anything else that is not a finite number is an
    error. Columns that the map does not name are neither parsed nor kept.

    Args:
        source: log, table, channel map and clock.

    Returns:
        the mapped columns in SI on stamps relative to the exact first one, shifted as the source says. The options say of how many rows
        a channel's cell is empty: `empty`, channel to that count and the count of all rows.

    Raises:
        InputError: whatever is wrong with the map or the log, naming file, table, column and row.
    """
    check_source(source)
    columns = [part for column in source.channels.values() for _, part in column.columns]
    read = read_stamped(source, columns)
    info, where, notes = read.info, read.where, list(read.notes)
    mapped, curved, empties = {}, {}, {}
    for name, column in source.channels.items():
        cells = {part: read.numbers(part) for _, part in column.columns}
        empty = np.any([np.isnan(one) for one in cells.values()], axis=0)
        if cells_of_curve := curved_cells(column, cells.__getitem__, where):
            curved[name] = cells_of_curve
        values = _reached(in_si(source, name, cells.__getitem__), empty, read.time, cells_of_curve)
        mapped[name] = mean_to_next(values) if column.between == "line" else values
        if gaps := int(empty.sum()):
            empties[name] = [gaps, values.size]
            notes.append(f"{name}: {gaps} of {values.size} cells are empty")
        if gaps == values.size:
            raise _no_number(
                next((part for part, one in cells.items() if np.isnan(one).all()), ""), column, info, where
            )
    mapped = from_axes(mapped, source.axes, str(source.path))
    channels = tuple(Channel(name, signal_unit(name), column.role) for name, column in source.channels.items())
    used = replace(source, table=info.name if info else None, time_column=read.clock, time_unit=read.clock_unit)
    options = source_options(used) | (text_options(source) if format_of(source.path).is_text else {})
    options |= {"empty": empties} if empties else {}
    epoch = read.epoch + Decimal(f"{source.shift:.9f}")
    cautions = (*_other_unit(read, source.path.name), *_other_units(source, info), *_other_clocks(read, source))
    table = LogTable(
        read.time,
        epoch,
        mapped,
        channels,
        source.path.name,
        hash_of_log(source.path),
        options,
        tuple(notes),
        cautions,
        curved,
    )
    return replace(table, cautions=(*cautions, *_measured(source, table)))


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
        """Return a column of words, empty if a row has none; of numbers as they are."""
        return self.raw.columns[column][self.kept]


def read_stamped(source: LogSource, columns: Sequence[str], words: Sequence[str] = ()) -> Stamped:
    """Read some columns of one table with their time; the channels of the source are not looked at.

    Args:
        source: log, table and clock.
        columns: that hold numbers.
        words: columns that may hold words.

    Raises:
        InputError: as `read_log_table`.
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
                remedy="only conditions of [[import.keep]] may use words; map another column",
            )
    table, every = info.name if info else "", list(dict.fromkeys((*clocks, *columns, *words)))
    others = () if info is None or form.is_text else info.clocks
    raw = read_columns(log_file(source), table, list(dict.fromkeys((*every, *others))), tuple(clocks), words)
    # Some drivers leave their stamp at zero: a clock that never moves was never set.
    moving = (name for name in clocks if (stamps := raw.columns[name]).size and (stamps != stamps[0]).any())
    clock = next(moving, next(iter(clocks)))

    time_where = f'{where}, column "{clock}"'
    time, epoch = _elapsed(raw, clock, source, clocks[clock], time_where)
    time, kept, notes = checked_time(time, source.clock, raw.line_of, time_where)
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


def _measured(source: LogSource, table: LogTable) -> Iterator[str]:
    """Return which controls look measured, and are held from sample to sample because nothing else is said."""
    for name, column in source.channels.items():
        if column.role != "control" or column.between is not None:
            continue
        if half_a_step_matters(table.columns[name]) and looks_measured(table.time, table.columns[name]):
            yield (
                f'channel "{name}" of {table.place}: {LOOKS_MEASURED}. As a step input it is half a sample late: add between = "line" to '
                f'this channel, or between = "held" if it is a command'
            )


def _reached(
    values: Float[np.ndarray, " n"],
    empty: Bool[np.ndarray, " n"],
    time: Float[np.ndarray, " n"],
    curved: Sequence[CurvedCells],
) -> Float[np.ndarray, " n"]:
    """Return a channel in which numbers that no curve reaches have the value before them, or the first one.

    Raises:
        InputError: a curve that reaches no number.
    """
    beyond, known = np.flatnonzero(np.isnan(values) & ~empty), np.flatnonzero(np.isfinite(values))
    if beyond.size and not known.size:
        for one in curved:
            one.curve.check(one.cells, time, one.where)
    filled = values.copy()
    filled[beyond] = values[known[np.maximum(np.searchsorted(known, beyond) - 1, 0)]]
    return filled


def in_si(source: LogSource, name: str, cells_of: Callable[[str], Float[np.ndarray, " n"]]) -> Float[np.ndarray, " n"]:
    """Return a channel as the map makes it of its columns, see `ColumnMap`, in SI.

    It is NaN if one of them is a gap, or a number that the curve or the law does not reach.

    Args:
        source: whose map it is.
        name: of the channel.
        cells_of: returns the numbers of a column.
    """
    column = source.channels[name]
    with np.errstate(invalid="ignore", over="ignore"):
        if column.law is not None:
            return column.scale * column.law(_command(column, cells_of)) * si_factor(source, name)
        total = np.zeros(())
        for factor, part in column.columns:
            cells = cells_of(part)
            total = total + factor * (cells if column.curve is None else column.curve(cells))
        return (column.scale * total + column.offset) * si_factor(source, name)


def curved_cells(
    column: ColumnMap, cells_of: Callable[[str], Float[np.ndarray, " n"]], where: str
) -> tuple[CurvedCells, ...]:
    """Return the numbers that the curve or the law of a channel explains; none of a channel without.

    Args:
        column: map of the channel.
        cells_of: returns the numbers of a column.
        where: log and table, for errors.
    """
    if column.law is not None:
        return (CurvedCells(column.law, _command(column, cells_of), f'{where}, column "{column.column}"'),)
    if column.curve is None:
        return ()
    return tuple(CurvedCells(column.curve, cells_of(part), f'{where}, column "{part}"') for _, part in column.columns)


def _command(column: ColumnMap, cells_of: Callable[[str], Float[np.ndarray, " n"]]) -> Float[np.ndarray, " n"]:
    """Return the command that a law makes a force of."""
    return sum((factor * cells_of(part) for factor, part in column.columns), np.zeros(())) + column.offset


def _other_unit(read: "Stamped", log: str) -> tuple[str, ...]:
    """Say that the name of the clock ends in another unit than it was read in, or that in this unit rows are not as frequent as usual."""
    named = unit_in_name(read.clock)
    if named is None or to_si(1.0, named, "s", log) == to_si(1.0, read.clock_unit, "s", log):
        doubt = unit_doubt(read.time, read.clock_unit)
        return (f'{log}, time: column "{read.clock}" has {doubt}',) if doubt else ()
    return (f'{log}, time: the unit of column "{read.clock}" is "{read.clock_unit}" in the map; is it "{named}"?',)


def _other_clocks(read: "Stamped", source: LogSource) -> tuple[str, ...]:
    """Report that another clock of the table runs over another time than the one that is used."""
    log = log_file(source)
    info = read.info or pick(catalogue(log), source.table, str(source.path))
    units = {name: info.unit(name) or "s" for name in info.clocks} | {read.clock: read.clock_unit}
    if len(units) < 2:
        return ()
    raw = read.raw
    if all(name in raw.columns and raw.columns[name].dtype.kind != "O" for name in units):
        stamps = {name: raw.columns[name] * 10.0 ** -raw.decimals.get(name, 0) for name in units}
    else:  # of a text, columns that nothing else needs were not read
        blocks = list(stream(log, {info.name: list(units)}))
        stamps = {name: np.concatenate([block.columns[name] for block in blocks]) for name in units}
    doubt = disagreement([clock_summary(name, unit, stamps[name]) for name, unit in units.items()])
    if not doubt:
        return ()
    remedy = 'name the right one by time = { column = "…" } under [[import.files]]'
    return (f"{read.where}: {doubt}; the time is {read.clock}: {remedy}",)


def _other_units(source: LogSource, info: TableInfo | None) -> Iterator[str]:
    """Return which columns have another unit by what the log states, or by their names, than by the map."""
    for name, column in source.channels.items():
        if column.parts or column.curve is not None:
            continue
        stated = info.unit(column.column) if info else None
        other = known_unit(stated, name) if stated else unit_by_name(column.column, name)
        if other is None:
            continue
        unit, factor = other
        mapped, right = si_factor(source, name), factor * to_si(1.0, unit, signal_unit(name), source.path.name)
        if not any(math.isclose(one, right, rel_tol=SAME_UNIT) for one in (mapped, mapped * abs(column.scale))):
            says = "the log states" if stated else "its name says"
            scale = f" and scale = {math.copysign(factor, column.scale):g}" if factor != 1.0 else ""
            yield (
                f'channel "{name}" of {source.path.name}: the unit of column "{column.column}" is "{column.unit}" in the map, and {says} '
                f'"{stated or unit}": set unit = "{unit}"{scale} there, unless the log is wrong'
            )


def _check_layout(source: LogSource, form: LogFormat) -> None:
    """Refuse the layout of a text where the log is none."""
    if form.is_text:
        signs_of(log_file(source))
        return
    for key, default in asdict(TextLayout()).items():
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
            found="nothing, and no column has the name of a time",
            expected="the column of the time stamps",
            remedy="name it and its unit; `seatrial inspect` lists the columns",
        )
    return clocks


def _elapsed(
    raw: RawTable, clock: str, source: LogSource, unit: str, where: str
) -> tuple[Float[np.ndarray, " n"], Decimal]:
    """Return the seconds since the first stamp, and that stamp."""
    stamps = raw.columns[clock]
    is_float, is_whole = stamps.dtype.kind == "f", stamps.dtype.kind == "i"
    none = ~np.isfinite(stamps) if is_float else stamps == np.iinfo(np.int64).min if is_whole else np.zeros(0, bool)
    if none.any():
        row = int(none.argmax())
        raise InputError(
            f"{where}, row {raw.line_of(row)}",
            found=f"time {float(stamps[row])!r}" if is_float else "no instant (NaT)",
            expected="a time stamp in every row",
            remedy="use another time column, or remove the row",
        )
    if is_whole and stamps.size and not -(2**62) < stamps.min() <= stamps.max() < 2**62:
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


def _no_number(empty: str, column: ColumnMap, info: TableInfo | None, where: str) -> InputError:
    """Report that a channel has no number, and of an element beyond the end of its array that there is none.

    Args:
        empty: the column without a number; no name where only a sum has none.
        column: of the channel.
        info: what the log says of its table.
        where: log and table.
    """
    if info is not None and empty not in (elements := info.elements(empty)) and elements:
        return _no_element(empty, elements, where)
    return InputError(
        f'{where}, column "{column.column}"',
        found="no number in any row",
        expected="samples",
        remedy="map another column, or drop the channel",
    )


def _no_element(name: str, elements: Sequence[str], where: str) -> InputError:
    """Return how many elements an array has, and how they are counted."""
    return InputError(
        f'{where}, column "{name}"',
        found=f"no such element: {name.rpartition('[')[0]} has {len(elements)}",
        expected=f"{elements[0]} to {elements[-1]}",
        remedy="count from 0; `seatrial inspect` shows the range of each element",
    )


def _no_column(name: str, info: TableInfo, where: str) -> InputError:
    if elements := info.elements(name):
        return _no_element(name, elements, where)
    names: Sequence[str] = [column.name for column in info.columns]
    return NoColumn(
        f'{where}, column "{name}"',
        found="no column of that name",
        expected=f"one of the {len(names)} numbers in the table",
        remedy=nearest(name, names, "" if len(names) <= 20 else "`seatrial inspect` lists them"),
    )
