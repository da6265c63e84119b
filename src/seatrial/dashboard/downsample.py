"""Long curves as a screen can show them: the least and greatest value of each column of pixels."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import h5py
import numpy as np
from jaxtyping import Float, Int

COLUMNS = 720
"""Columns of pixels that a figure has at most."""
FEW = 4
"""Samples for each column up to which every one of them is drawn."""

Load = Callable[[int, int], Mapping[str, np.ndarray]]
"""Rows from one to before another, by name."""


class Envelope(NamedTuple):
    """A curve by columns: the middle of each in time, the least and greatest value there, NaN if nothing was measured."""

    time: Float[np.ndarray, " c"]
    least: Float[np.ndarray, " c"]
    greatest: Float[np.ndarray, " c"]


def edges_of(time: Float[np.ndarray, " n"], columns: int = COLUMNS) -> Int[np.ndarray, " c+1"]:
    """First row of each column of pixels that holds any, and the number of rows; every row alone where there are few."""
    if time.size <= FEW * columns:
        return np.arange(time.size + 1)
    edges = np.searchsorted(time, np.linspace(time[0], time[-1], columns + 1)[:-1])
    return np.unique(np.append(edges, time.size))


def envelopes(
    time: Float[np.ndarray, " n"],
    least: Mapping[str, Float[np.ndarray, " n"]],
    greatest: Mapping[str, Float[np.ndarray, " n"]],
    columns: int = COLUMNS,
) -> dict[str, Envelope]:
    """Least and greatest of every curve in each column of pixels.

    Args:
        time: s, increasing.
        least: of every curve at each time.
        greatest: likewise; the same where each time has one value.
        columns: of pixels.
    """
    edges = edges_of(time, columns)
    starts, middle = edges[:-1], 0.5 * (time[edges[:-1]] + time[edges[1:] - 1])
    return {
        name: Envelope(middle, np.fmin.reduceat(values, starts), np.fmax.reduceat(greatest[name], starts))
        for name, values in least.items()
    }


def load_of(columns: Mapping[str, np.ndarray]) -> Load:
    """Return what gives some rows of columns."""
    return lambda first, last: {name: values[first:last] for name, values in columns.items()}


def rows_view(
    rows: Mapping[str, Float[np.ndarray, " n"]], start: float, end: float, columns: int = COLUMNS
) -> dict[str, Envelope]:
    """Curves between two times, s, and one row beyond each end if there is one.

    Args:
        rows: of every curve, `time` among them.
        start: s.
        end: s.
        columns: of pixels.
    """
    time = rows["time"]
    first = max(int(np.searchsorted(time, start)) - 1, 0)
    last = max(min(int(np.searchsorted(time, end, side="right")) + 1, time.size), first + 1)
    kept = {name: values[first:last] for name, values in rows.items() if name != "time"}
    return envelopes(time[first:last], kept, kept, columns)


def rows_of(file: h5py.File, name: str, first: int, last: int) -> np.ndarray:
    """Rows of one variable, whole: columns picked out one by one would be read an element at a time."""
    return np.asarray(file[name][first:last], float)  # pyright: ignore[reportIndexIssue]
