"""Curves of stored results for charts, from the files alone: nothing here knows a vehicle, so nothing heavy is imported."""

import tempfile
from bisect import bisect_left, bisect_right
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from seatrial.apps.dashboard.downsample import Envelope, Load, rows_of
from seatrial.apps.dashboard.record_views import Index, index_of, view_of
from seatrial.apps.dashboard.view_models import FitAbout, Marginal, Swept
from seatrial.campaign.store.designs import read_sweeps
from seatrial.campaign.store.estimates import Predictions, read_estimate, read_predictions
from seatrial.core.dataset import Dataset
from seatrial.core.dataset_file import open_dataset, stored, write_dataset
from seatrial.core.display_units import Shown, shown_as_written, shown_unit
from seatrial.core.gaussian import Z90
from seatrial.report.figures.fit import autocorrelation
from seatrial.report.figures.posterior import normal_density
from seatrial.report.figures.style import power_of_ten

CORRELATED = 10_000
"""Samples of which the autocorrelation is drawn, at most."""
MOST_LISTED = 12
BINS, POINTS = 60, 161
"""Bins of a histogram of draws, and points of the curves beside it."""


def ready() -> bool:
    """Return True once everything is imported, also what reading a file imports."""
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "nothing.nc"
        write_dataset(path, Dataset({"nothing": ("name", np.zeros(1))}, {"name": ["nothing"]}))
        open_dataset(path)
    return True


def swept(path: Path) -> Swept:
    """Read a sweep.

    Raises:
        InputError: missing or damaged.
    """
    stored = read_sweeps(path)
    factor, unit = shown_unit(stored.control)
    best = np.unravel_index(np.nanargmax(stored.worth), stored.worth.shape)
    return Swept(
        stored.families,
        stored.control,
        unit,
        tuple((stored.amplitude * factor).tolist()),
        tuple(stored.period.tolist()),
        stored.gain,
        stored.worth,
        (int(best[0]), int(best[1]), int(best[2])),
        stored.names,
        tuple(stored.sd_before.tolist()),
        stored.final_sd,
        stored.peak_speed,
        stored.length,
        stored.basis,
        stored.refused,
        stored.safety,
        stored.prediction,
    )


def predicted(path: Path) -> Predictions:
    """Read all but the curves.

    Raises:
        InputError: missing or damaged.
    """
    return read_predictions(path)


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
        found = view_of(blocks, load, low, high, columns)
    lower, upper = found.pop("lower"), found.pop("upper")
    return {**found, "band": Envelope(lower.time, lower.least, upper.greatest)}


def read_ahead(path: Path) -> None:
    """Check a file of predictions and index the curve that is shown first, before anybody waits for it.

    Raises:
        InputError: missing or damaged.
    """
    there = path.stat()
    _fit_index(path, 0, 0, there.st_size, there.st_mtime_ns)


def marginals(
    paths: tuple[tuple[str, Path], ...],
    truth: tuple[tuple[str, float], ...],
    written: tuple[tuple[str, str], ...],
    most: int = MOST_LISTED,
) -> tuple[Marginal, ...]:
    """Read the posterior of each parameter of the first structure, beside those of the other structures that have it.

    Args:
        paths: label and posterior of each structure, the chosen one first.
        truth: of a simulated vehicle, by name, SI.
        written: units in which priors are written, by name.
        most: parameters.

    Raises:
        InputError: missing or damaged.
    """
    data = {label: read_estimate(path).data for label, path in paths}
    chosen, *_ = data.values()
    shown = shown_as_written(dict(written))
    return tuple(_marginal(str(name), data, dict(truth), shown) for name in chosen["parameter"].values[:most])


def _marginal(name: str, data: Mapping[str, Dataset], truth: Mapping[str, float], shown: Shown) -> Marginal:
    rows = {label: one.sel(parameter=name) for label, one in data.items() if name in one["parameter"].values}
    row = next(iter(rows.values()))
    draws = {label: one["draws"].values.ravel() for label, one in rows.items()}
    ends = [np.quantile(one, [0.0005, 0.9995]) for one in draws.values()]
    low, high = min(float(one[0]) for one in ends), max(float(one[1]) for one in ends)
    if (true := truth.get(name)) is not None:
        low, high = min(low, true), max(high, true)
    low, high = low - 0.05 * (high - low), high + 0.05 * (high - low)
    factor, unit = shown(name, str(row["unit"].item()))
    exponent = power_of_ten(factor * low, factor * high)
    scale = 10.0**exponent / factor
    edges, grid = np.linspace(low, high, BINS + 1), np.linspace(low, high, POINTS)
    inside = (grid >= float(row["prior_lower"])) & (grid <= float(row["prior_upper"]))
    prior = np.where(inside, np.interp(grid, row["prior_value"].values, row["prior_density"].values), 0.0)
    interval = np.quantile(next(iter(draws.values())), [0.025, 0.975]) / scale
    return Marginal(
        name,
        str(row["label"].item()),
        unit,
        exponent,
        edges / scale,
        {
            label: np.histogram(one, edges)[0] / (one.size * (edges[1] - edges[0])) * scale
            for label, one in draws.items()
        },
        grid / scale,
        prior * scale,
        normal_density(grid, float(row["mode"]), float(row["laplace_sd"])) * scale,
        float(row["mean"]) / scale,
        (float(interval[0]), float(interval[1])),
        None if true is None else true / scale,
    )


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
