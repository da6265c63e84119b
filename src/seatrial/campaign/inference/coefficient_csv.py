"""Tables of coefficients for other programs: of every structure, and averaged over all of them, as CSV.

Each row names its unit: that in which the prior of its parameter is written, else SI.

The standard deviation and the 95 % interval of a row hold within its model, those of an average within the models: as if their terms and
noise were right. `model_error_sd` is the standard deviation that survives an error of the model; it stays empty where it is not larger by
more than a half.

Averaging counts a coefficient as zero where a structure lacks it: with probabilities P_i, means m_i and standard deviations s_i the mean
is sum P_i m_i and the variance sum P_i (s_i^2 + (m_i - mean)^2) (Hoeting and others, Statistical Science 14, 1999).
With model error the s_i are those with model error.
"""

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from math import isnan, nan
from pathlib import Path
from typing import Any

from seatrial.campaign.store.estimates import Estimate
from seatrial.campaign.store.stored_result import Store
from seatrial.core.display_units import Shown
from seatrial.core.files import write_text
from seatrial.estimation.robust_errors import TELLING
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
    "model_error_cause",
    "r_hat",
    "ess_bulk",
    "ess_tail",
)
AVERAGED = ("name", "unit", "mean", "sd", "model_error_sd", "inclusion")
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
    """Return each parameter averaged over all structures by their probabilities, SI, and the probability of those that have it.

    `model_error_sd` is NaN where it is not larger than `sd` by more than a half.
    """
    within, wide, units = [], [], {}
    for one in estimates:
        means, sds = ({name: float(one.data[key].sel(parameter=name)) for name in one.names} for key in ("mean", "sd"))
        within.append({name: (means[name], sds[name]) for name in one.names})
        wide.append({name: (means[name], one.wider(name) or sds[name]) for name in one.names})
        units |= dict(zip(one.names, map(str, one.data["unit"].values), strict=True))
    with_error = averaged(wide, selection.probability)
    rows = []
    for name, (mean, sd) in averaged(within, selection.probability).items():
        has_it = [name in of for of in within]
        wider = with_error[name][1]
        rows.append(
            {
                "name": name,
                "unit": units[name],
                "mean": mean,
                "sd": sd,
                "model_error_sd": wider if wider > TELLING * sd else nan,
                "inclusion": min(1.0, float(selection.probability @ has_it)),
            }
        )
    return rows


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
