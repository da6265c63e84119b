"""Tables of coefficients for other programs: of every structure, and averaged over all of them, as CSV.

Each row names its unit: that in which the prior of its parameter is written, else SI.

Averaging counts a coefficient as zero where a structure lacks it: with probabilities P_i, means m_i and standard deviations s_i the mean
is sum P_i m_i and the variance sum P_i (s_i^2 + (m_i - mean)^2) (Hoeting and others, Statistical Science 14, 1999).
"""

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from math import isnan
from pathlib import Path
from typing import Any

from seatrial.campaign.store.estimates import Estimate
from seatrial.campaign.store.stored_result import Store
from seatrial.core.display_units import Shown
from seatrial.core.files import write_text
from seatrial.selection.verdict import Selection, averaged

OF_STRUCTURES = (
    "structure",
    "name",
    "unit",
    "mean",
    "sd",
    "lower_95",
    "upper_95",
    "mode",
    "model_error_sd",
    "r_hat",
    "ess_bulk",
    "ess_tail",
)
AVERAGED = ("name", "unit", "mean", "sd", "inclusion")
"""Columns of the two tables."""
QUANTITIES = ("mean", "sd", "lower_95", "upper_95", "mode", "model_error_sd")
"""Those in the unit of the row."""


def write_coefficients(folder: Path, estimates: Sequence[Estimate], shown: Shown) -> Path:
    """Write `results/coefficients.csv`, a row for each parameter of each structure, atomically; returns its path."""
    rows = [
        {"structure": one.structure.label, **row}
        for one in estimates
        for row in one.summary().reset_index(names="name").to_dict("records")
    ]
    return _write(Store(folder).coefficients, OF_STRUCTURES, rows, shown)


def write_averaged(folder: Path, rows: Sequence[Mapping[str, Any]], shown: Shown) -> Path:
    """Write `results/averaged.csv`, the rows of `averaged_rows`, atomically; returns its path."""
    return _write(Store(folder).averaged, AVERAGED, rows, shown)


def averaged_rows(estimates: Sequence[Estimate], selection: Selection) -> list[dict[str, Any]]:
    """Return each parameter averaged over all structures by their probabilities, SI, and the probability of those that have it."""
    moments, units = [], {}
    for one in estimates:
        data = one.data
        moments.append(dict(zip(one.names, zip(data["mean"].values, data["sd"].values, strict=True), strict=True)))
        units |= dict(zip(one.names, map(str, data["unit"].values), strict=True))
    inclusion = {
        name: min(1.0, float(sum(p for p, of in zip(selection.probability, moments, strict=True) if name in of)))
        for name in units
    }
    return [
        {"name": name, "unit": units[name], "mean": mean, "sd": sd, "inclusion": inclusion[name]}
        for name, (mean, sd) in averaged(moments, selection.probability).items()
    ]


def _write(path: Path, columns: Sequence[str], rows: Iterable[Mapping[str, Any]], shown: Shown) -> Path:
    """Write rows with a header, each in the unit in which its parameter is shown; what is no number stays empty."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(columns)
    for row in rows:
        factor, unit = shown(row["name"], row["unit"])
        said = {**row, "unit": unit} | {key: factor * row[key] for key in QUANTITIES if key in row}
        writer.writerow(["" if isinstance(said[key], float) and isnan(said[key]) else said[key] for key in columns])
    write_text(path, stream.getvalue())
    return path
