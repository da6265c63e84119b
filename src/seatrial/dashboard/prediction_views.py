"""Views of predictions of any length, as `record_views` has them of records: what each predicts, and its curves between two times."""

from bisect import bisect_left, bisect_right
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from seatrial.campaign.store.predictions import Predictions
from seatrial.campaign.store.stored_result import read_header
from seatrial.core.dataset_file import stored
from seatrial.core.display_units import shown_unit
from seatrial.core.normal import Z90
from seatrial.dashboard import result_plots
from seatrial.dashboard.downsample import Envelope, Load, rows_of
from seatrial.dashboard.record_views import Index, index_of, view_of
from seatrial.dashboard.view_models import FitAbout
from seatrial.report.figures.fit import autocorrelation

CORRELATED = 10_000
"""Samples of which the autocorrelation is drawn, at most."""


def ready() -> bool:
    """Return True once everything is imported, also what reading a file imports."""
    return result_plots.ready()


def predicted(path: Path) -> Predictions:
    """Read all but the curves.

    Raises:
        InputError: missing or damaged.
    """
    return read_header(Predictions, path, "seatrial run")


def fit_about(path: Path, index: int, channel: int) -> FitAbout:
    """Say what one channel of one predicted record is, and how its residuals are correlated.

    Raises:
        InputError: missing or damaged.
    """
    about = predicted(path)
    name = about.channels[channel]
    with stored(path) as file:
        first, last = _rows_of_record(file, index)
        time: Any = file["time"]
        span, few = (float(time[first]), float(time[last - 1])), min(last - first, CORRELATED)
        rows = _fit_rows(file, channel, 1.0, first)(0, few)
    lag, correlation, count = autocorrelation(rows["time"], rows["residual"])
    white = 2 / np.sqrt(max(count, 1))
    held_back, unit = about.records[index] in about.held_back, shown_unit(name)[1]
    return FitAbout(span, name, unit, held_back, lag, correlation, float(white))


def fit_view(path: Path, index: int, channel: int, low: float, high: float, columns: int) -> dict[str, Envelope]:
    """Read one channel of one predicted record between two times, s: `measured`, `mean`, `band` (90 %) and `residual`, by columns."""
    there = path.stat()
    blocks = _fit_index(path, index, channel, there.st_size, there.st_mtime_ns)
    with stored(path) as file:
        load = _fit_rows(file, channel, _factor(path, channel), _rows_of_record(file, index)[0])
        envelopes = view_of(blocks, load, low, high, columns)
    lower, upper = envelopes.pop("lower"), envelopes.pop("upper")
    return {**envelopes, "band": Envelope(lower.time, lower.least, upper.greatest)}


def read_ahead(path: Path) -> None:
    """Check a file of predictions and index the curve that is shown first, before anybody waits for it.

    Raises:
        InputError: missing or damaged.
    """
    there = path.stat()
    _fit_index(path, 0, 0, there.st_size, there.st_mtime_ns)


def _rows_of_record(file: Any, index: int) -> tuple[int, int]:
    """First row of a record, and the one after its last: records increase, so some twenty looks find both among millions."""
    owner: Any = file["record"]
    return bisect_left(owner, index), bisect_right(owner, index)


@lru_cache(maxsize=32)
def _fit_index(path: Path, index: int, channel: int, size: int, at: int) -> Index:
    """Index of one channel of one predicted record; made again when the file changes."""
    del size, at  # parts of the key only
    with stored(path) as file:
        first, last = _rows_of_record(file, index)
        return index_of(last - first, _fit_rows(file, channel, _factor(path, channel), first))


def _factor(path: Path, channel: int) -> float:
    return shown_unit(predicted(path).channels[channel])[0]


def _fit_rows(file: Any, channel: int, factor: float, begin: int) -> Load:
    """Return what gives some rows of a record that begins at a row of the file."""

    def load(first: int, last: int) -> Mapping[str, np.ndarray]:
        rows = begin + first, begin + last
        measured, mean, sd = (rows_of(file, part, *rows)[:, channel] for part in ("measured", "mean", "sd"))
        return {
            "time": rows_of(file, "time", *rows),
            "measured": measured * factor,
            "mean": mean * factor,
            "lower": (mean - Z90 * sd) * factor,
            "upper": (mean + Z90 * sd) * factor,
            "residual": (measured - mean) / sd,
        }

    return load
