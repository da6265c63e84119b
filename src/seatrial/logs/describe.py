"""A first look at a log before its channels are mapped: what each column holds."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from seatrial.logs.cells import as_floats, parse
from seatrial.logs.rows import layout
from seatrial.logs.source import LogSource
from seatrial.logs.text import load_text


@dataclass(frozen=True)
class ColumnSummary:
    """One column as it stands in the file, in its own unit; NaN where it holds no numbers.

    Attributes:
        name: in the header.
        count: cells that are numbers.
        rows: cells in all.
        least: smallest number.
        greatest: largest number.
        step: median change from row to row; positive for a clock.
    """

    name: str
    count: int
    rows: int
    least: float
    greatest: float
    step: float


def describe(
    path: Path,
    *,
    delimiter: str | None = None,
    skip_rows: int = 0,
    header_rows: int = 1,
    names: tuple[str, ...] | None = None,
    encoding: str = "utf-8",
) -> tuple[ColumnSummary, ...]:
    """Summarise every column of a log; the arguments are those of `LogSource`.

    Raises:
        InputError: a file that is not a table of text.
    """
    source = LogSource(path, "", "s", {}, "as_stamped", delimiter, skip_rows, header_rows, names, encoding)
    text, _ = load_text(path, encoding)
    header, rows = layout(text, source)
    columns = parse(rows, header, list(range(len(header))))
    return tuple(_summary(name, columns[position]) for position, name in enumerate(header))


def _summary(name: str, cells: np.ndarray) -> ColumnSummary:
    exact = cells if cells.dtype.kind in "iuf" else as_floats(cells)
    values = exact[np.isfinite(exact)]
    if not values.size:
        return ColumnSummary(name, 0, cells.size, np.nan, np.nan, np.nan)
    step = float(np.median(np.diff(values))) if values.size > 1 else np.nan
    return ColumnSummary(name, values.size, cells.size, float(values.min()), float(values.max()), step)
