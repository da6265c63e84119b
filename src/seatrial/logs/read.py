"""Read the mapped columns of a CSV or TSV log into SI: all of them, or an error that says which cell is at fault."""

from collections.abc import Sequence
from decimal import Decimal, DecimalException

import numpy as np
from jaxtyping import Float

from seatrial.core.errors import InputError, nearest
from seatrial.core.record import Channel
from seatrial.core.signals import signal_unit
from seatrial.logs.cells import as_floats, bad_cell, numbers, parse
from seatrial.logs.clock import check_unit, elapsed, mend_clock
from seatrial.logs.rows import Rows, layout
from seatrial.logs.source import LogSource, LogTable, check_source, si_factor, source_options, time_scale
from seatrial.logs.text import load_text


def read_csv(source: LogSource) -> LogTable:
    """Read one log.

    Empty cells (also `NA`, `nan`, `null`) are gaps; anything else that is not a finite number is an error. Columns
    that the map does not name are not parsed.

    Args:
        source: file, channel map and clock.

    Returns:
        the mapped columns in SI on stamps relative to the exact first one.

    Raises:
        InputError: whatever is wrong with the map or the file, naming file, row and column.
    """
    check_source(source)
    where = str(source.path)
    text, sha256 = load_text(source.path, source.encoding)
    names, rows = layout(text, source)
    position = {
        name: _find(name, names, where)
        for name in (source.time_column, *(column.column for column in source.channels.values()))
    }
    parsed = parse(rows, names, sorted(set(position.values())))

    time_where = f'{where}, column "{source.time_column}"'
    time, epoch = _stamps(parsed[position[source.time_column]], rows, names, source)
    time, kept, notes = mend_clock(time, source.clock, rows.line, time_where)
    check_unit(time, source.time_unit, time_where)
    step = np.diff(time)
    notes.insert(
        0,
        f"{time.size} rows over {time[-1] - time[0]:.6g} s; step {np.median(step):.4g} s at the median, "
        f"{step.max():.4g} s at most",
    )

    if rows.empty:
        notes.append(f"{rows.empty} rows at the end have no cell filled and were left out")

    columns = {}
    for name, column in source.channels.items():
        at = position[column.column]
        values = numbers(parsed[at], rows, at, column.column)[kept]
        columns[name] = (column.scale * values + column.offset) * si_factor(source, name)
        if gaps := int(np.isnan(values).sum()):
            notes.append(f"{name}: {gaps} of {values.size} cells are empty")
        if gaps == values.size:
            raise InputError(
                f'{where}, column "{column.column}"',
                found="no number in any row",
                expected="samples",
                remedy="map another column, or drop the channel",
            )
    channels = tuple(Channel(name, signal_unit(name), column.role) for name, column in source.channels.items())
    return LogTable(time, epoch, columns, channels, source.path.name, sha256, source_options(source), tuple(notes))


def _find(name: str, names: Sequence[str], where: str) -> int:
    """Position of a column."""
    if names.count(name) == 1:
        return names.index(name)
    if name in names:
        places = ", ".join(str(i + 1) for i, other in enumerate(names) if other == name)
        raise InputError(
            f'{where}, column "{name}"',
            found=f"several columns of that name, at positions {places}",
            expected="one",
            remedy="give distinct names with `names` and skip the header",
        )
    other = next((mark for mark in (";", "\t", "|", ",") if mark in names[0]), None) if len(names) == 1 else None
    if other:
        remedy = f"set the delimiter to {other!r}"
    elif np.isfinite(as_floats(np.array(names, object))).all():
        remedy = "the first row holds numbers: if the file has no header, give the column names with `names`"
    else:
        remedy = nearest(name, names)
    raise InputError(
        f'{where}, column "{name}"',
        found="no column of that name",
        expected=f"one of the {len(names)} in the header",
        remedy=remedy,
    )


def _stamps(
    cells: np.ndarray, rows: Rows, names: tuple[str, ...], source: LogSource
) -> tuple[Float[np.ndarray, " n"], Decimal]:
    """Seconds since the first stamp and that stamp, from whole numbers or, as text, from decimal ones."""
    position = names.index(source.time_column)
    values = numbers(cells, rows, position, source.time_column)
    missing = np.flatnonzero(np.isnan(values))
    if missing.size:
        raise bad_cell(rows, int(missing[0]), position, source.time_column, "a time stamp in every row")
    if cells.dtype == np.int64 and np.abs(values).max() < 2.0**62:
        return elapsed(cells, time_scale(source))
    try:
        return elapsed(parse(rows, names, [position], str)[position].tolist(), time_scale(source))
    except DecimalException as cause:
        raise InputError(
            f'{rows.where}, column "{source.time_column}"',
            found="stamps beyond any clock",
            expected="numbers of ordinary size",
            remedy="map the column that holds the time",
        ) from cause
