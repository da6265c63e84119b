"""CSV and TSV: one table, its columns named by the header; a cell that is neither empty nor a number is an error."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from seatrial.core.errors import InputError, nearest
from seatrial.logs.formats.clock_names import clock_unit, clocks_among
from seatrial.logs.formats.protocol import Block, ColumnInfo, LogFile, LogFormat, RawTable, TableInfo, Wanted
from seatrial.logs.formats.text_cells import as_floats, bad_cell, numbers, parse
from seatrial.logs.formats.text_rows import Rows, pieces
from seatrial.logs.formats.text_stamps import LARGEST_STAMP, Stamps, decimal_stamps, joined_stamps, short_stamps

TABLE = "rows"
_ENOUGH = 10_000


def _recognises(path: Path, head: bytes) -> bool:
    """Any text may be a table, so none is certain to be one."""
    return False


def _catalogue(log: LogFile) -> tuple[TableInfo, ...]:
    """List the columns that hold a number in the first rows."""
    names, rows = next(pieces(log))
    single = [position for position, name in enumerate(names) if names.count(name) == 1]
    parsed = parse(rows, names, single) if single and rows.starts.size else {}
    numeric = [names[at] for at, cells in parsed.items() if not np.isnan(as_floats(cells[:_ENOUGH])).all()]
    at = dict(zip(names, range(len(names)), strict=True))
    clocks, columns = clocks_among([ColumnInfo(name, _unit_of_stamps(name, parsed[at[name]])) for name in numeric])
    return (TableInfo(TABLE, columns, clocks),)


def _unit_of_stamps(name: str, cells: Any) -> str | None:
    """Seconds for a column whose name alone says nanoseconds, of which there are no fractions."""
    values = as_floats(cells[:_ENOUGH])
    fractions = (values[np.isfinite(values)] % 1).any()
    return "s" if clock_unit(name) == "ns" and fractions else None


def _blocks(log: LogFile, wanted: Wanted) -> Iterator[Block]:
    """Stream columns; cells that are not numbers come as NaN."""
    size, read = max(log.path.stat().st_size, 1), 0
    for names, rows in pieces(log):
        read += len(rows.text)
        if rows.starts.size and wanted.get(TABLE):
            at = {name: _find(name, names, rows.where) for name in wanted[TABLE]}
            parsed = parse(rows, names, sorted(set(at.values())))
            yield Block(TABLE, {name: _plain(parsed[place]) for name, place in at.items()}, min(read / size, 1.0))


def _read(log: LogFile, table: str, columns: Sequence[str], stamps: Sequence[str]) -> RawTable:
    """Read columns, refusing cells that are not numbers; stamps stay whole numbers, or decimal ones as text."""
    parts: dict[str, list[Any]] = {name: [] for name in columns}
    counts, empty = [], 0
    for names, rows in pieces(log):
        at = {name: _find(name, names, rows.where) for name in columns}
        empty += rows.empty
        if not rows.starts.size:
            continue
        counts.append(rows.starts.size)
        parsed = parse(rows, names, sorted(set(at.values())))
        for name, place in at.items():
            read = _stamps if name in stamps else numbers
            parts[name].append(read(parsed[place], rows, place, name))
    notes = (f"{empty} rows at the end have no cell filled and were left out",) if empty else ()
    whole, decimals = {}, {}
    for name, part in parts.items():
        if name in stamps:
            whole[name], decimals[name] = joined_stamps(part)
        else:
            whole[name] = np.concatenate(part) if part else np.empty(0)
    return RawTable(whole, lambda row: _line(log, counts, row), notes, decimals)


def _plain(cells: np.ndarray) -> np.ndarray:
    return cells if cells.dtype in (np.int64, np.float64) else as_floats(cells)


def _stamps(cells: np.ndarray, rows: Rows, position: int, name: str) -> Stamps:
    """Stamps of a piece, having checked that every row has one."""
    values = numbers(cells, rows, position, name)
    missing = np.flatnonzero(np.isnan(values))
    if missing.size:
        raise bad_cell(rows, int(missing[0]), position, name, "a time stamp in every row")
    if cells.dtype == np.int64 and np.abs(values).max() < LARGEST_STAMP:
        return Stamps(cells, 0)
    if (short := short_stamps(values)) is not None:
        return short
    names = tuple(str(at) for at in range(rows.widths[0]))
    return decimal_stamps(parse(rows, names, [position], str)[position].tolist())


def _line(log: LogFile, counts: Sequence[int], row: int) -> int:
    """Line of a row, found by reading the file once more: only an error asks for it."""
    filled = (rows for _, rows in pieces(log) if rows.starts.size)
    for rows, count in zip(filled, counts, strict=False):
        if row < count:
            return rows.line(row)
        row -= count
    return row + 1


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


FORMAT = LogFormat(
    "a table of text", (".csv", ".tsv", ".csv.gz", ".tsv.gz"), _recognises, _catalogue, _blocks, _read, is_text=True
)
