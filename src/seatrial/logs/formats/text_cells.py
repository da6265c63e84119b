"""Cells to numbers: pandas' C parser for speed, and an error that names the first cell that is not one."""

import io

import numpy as np
import pandas as pd
from jaxtyping import Float

from seatrial.core.errors import InputError
from seatrial.logs.formats.text_rows import WHITESPACE, Rows


def parse(
    rows: Rows, names: tuple[str, ...], wanted: list[int], dtype: type[str] | None = None
) -> dict[int, np.ndarray]:
    """Parse some columns of rows that all have the same width.

    Args:
        rows: the data.
        names: of all columns.
        wanted: positions of the columns to parse.
        dtype: `str` to keep the cells as text; by default what the cells look like.

    Returns:
        for each position its column: int64 or float64 where every cell is such a number, objects otherwise.

    Raises:
        InputError: quotation marks that leave it open where a row ends.
    """
    stream = io.BytesIO(rows.text)
    stream.seek(int(rows.starts[0]))
    count = rows.starts.size
    try:
        frame = pd.read_csv(
            stream,
            sep=r"\s+" if rows.delimiter == WHITESPACE else rows.delimiter,
            header=None,
            names=list(range(len(names))),
            usecols=wanted,
            dtype=dtype,
            index_col=False,
            engine="c",
            lineterminator="\n",
            low_memory=False,
        )
    except (ValueError, OverflowError) as cause:
        raise InputError(
            rows.where,
            found=f"rows that cannot be divided into cells ({cause})",
            expected=f"{count} rows of {len(names)} cells",
            remedy=f"look for a stray quotation mark in row {rows.line(count - 1)} or above",
        ) from cause
    if len(frame) != count:
        raise InputError(
            rows.where,
            found=f"{len(frame)} rows or {count}, depending on how quotation marks are read",
            expected="rows that can be told apart",
            remedy="remove stray quotation marks",
        )
    return {position: frame[position].to_numpy() for position in wanted}


def numbers(cells: np.ndarray, rows: Rows, position: int, name: str) -> Float[np.ndarray, " n"]:
    """Return a parsed column as float64, NaN where a cell is empty.

    Raises:
        InputError: the first cell that is neither empty nor a finite number.
    """
    values = as_floats(cells)
    bad = np.flatnonzero(np.isnan(values) & np.asarray(pd.notna(cells)))
    if bad.size:
        raise bad_cell(rows, int(bad[0]), position, name, "a number")
    infinite = np.flatnonzero(np.isinf(values))
    if infinite.size:
        raise bad_cell(rows, int(infinite[0]), position, name, "a finite number")
    return values


def as_floats(cells: np.ndarray) -> Float[np.ndarray, " n"]:
    """Convert a parsed column; NaN where a cell is not a number."""
    if cells.dtype.kind in "iuf":
        return cells.astype(float)
    return np.asarray(pd.to_numeric(np.array([str(cell) for cell in cells], object), errors="coerce"), float)


def bad_cell(rows: Rows, row: int, position: int, name: str, expected: str) -> InputError:
    """Return the error about one cell, with its line and text."""
    cell = "".join(rows.cells(row)[position : position + 1])
    whole, comma, part = cell.lstrip("+-").partition(",")
    remedy = (
        "write decimals with a point, not with a comma"
        if comma and whole.isdigit() and part.isdigit()
        else "correct the cell, leave it empty where nothing was measured, or map another column"
    )
    return InputError(
        f'{rows.where}, row {rows.line(row)}, column "{name}"',
        found=repr(cell[:60]) if cell else "an empty cell",
        expected=expected,
        remedy=remedy,
    )
