"""Curves of stored results for charts, from the files alone: nothing here knows a vehicle, so nothing heavy is imported."""

import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from seatrial.campaign.store.designs import SweptDesigns
from seatrial.campaign.store.estimates import Estimate
from seatrial.campaign.store.stored_result import decoding, read_result
from seatrial.core.dataset import Dataset
from seatrial.core.dataset_file import open_dataset, write_dataset
from seatrial.core.display_units import Shown, shown_as_written, shown_unit
from seatrial.core.normal import normal_density
from seatrial.dashboard.view_models import EstimatedStructure, EstimatedValue, Marginal, Swept
from seatrial.report.figures.style import power_of_ten

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
    stored = read_result(SweptDesigns, path, "seatrial design")
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
        tuple(name for name, _ in stored.trim if name != stored.control),
    )


def estimated(paths: tuple[Path, ...], written: tuple[tuple[str, str], ...]) -> tuple[EstimatedStructure, ...]:
    """Read the coefficients of stored posteriors.

    Args:
        paths: posterior of each structure.
        written: units in which priors are written, by name.

    Raises:
        InputError: missing or damaged.
    """
    shown, structures = shown_as_written(dict(written)), []
    for path in paths:
        with decoding(path, "seatrial run"):
            structures.append(_estimated(read_result(Estimate, path, "seatrial estimate"), shown))
    return tuple(structures)


def _estimated(estimate: Estimate, shown: Shown) -> EstimatedStructure:
    values = []
    for name in estimate.names:
        row, wider = estimate.data.sel(parameter=name), estimate.wider(name)
        factor, unit = shown(name, str(row["unit"].item()))
        mean, sd = factor * float(row["mean"]), factor * float(row["sd"])
        more = None if wider is None else factor * wider
        values.append(EstimatedValue(name, str(row["label"].item()), unit, mean, sd, more, estimate.wider_cause(name)))
    return EstimatedStructure(
        estimate.structure.label,
        estimate.structure.terms,
        tuple(values),
        estimate.model_error_findings,
        tuple(estimate.alarms),
    )


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
    data = {label: read_result(Estimate, path, "seatrial estimate").data for label, path in paths}
    chosen, *_ = data.values()
    shown = shown_as_written(dict(written))
    with decoding(paths[0][1].parent, "seatrial run"):
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
