"""Tables of coefficients for other programs: of every structure, and the values to quote, as CSV.

Each row names its unit: that in which the prior of its parameter is written, else SI.

The standard deviation and the 95 % interval of a row hold more than the noise; `noise`, `stated`, `runs`, `model` and, of an average,
`terms` are the shares of its variance, and `cause` names what adds most to it if that is not the noise.

Averaging counts a coefficient as zero if a structure lacks it: with probabilities P_i, means m_i and standard deviations s_i the mean
is sum P_i m_i and the variance sum P_i (s_i^2 + (m_i - mean)^2) (Hoeting and others, Statistical Science 14, 1999); the second part is
the share `terms`.
The 95 % interval is the shortest that holds 95 % of the draws of all structures, each widened to its s_i and
weighing P_i, and zero weighing as much as the structures without the coefficient.
"""

import csv
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, astuple, fields
from math import isnan, nan
from pathlib import Path
from typing import Any, Literal

import numpy as np

from seatrial.campaign.store.estimates import TINY, Estimate, StoredCoefficient
from seatrial.campaign.store.stored_result import Store
from seatrial.core.display_units import Shown
from seatrial.core.files import write_text
from seatrial.estimation.diagnostics.known import ErrorShares
from seatrial.selection.verdict import Selection, StoredAverage, averaged

OF_STRUCTURES = (
    "structure",
    "probability",
    "name",
    "unit",
    "mean",
    "sd",
    "lower_95",
    "upper_95",
    "mode",
    "noise",
    "stated",
    "runs",
    "model",
    "cause",
    "r_hat",
    "ess_bulk",
    "ess_tail",
)
# Columns of the two tables.
SHARES = tuple(one.name for one in fields(ErrorShares))
QUOTE = ("name", "unit", "mean", "sd", "lower_95", "upper_95", *SHARES, "cause", "inclusion")
COVERED, ROUNDING = 0.95, 1e-12  # Share of the draws that an interval holds, and by how much sums of weights may be off
QUANTITIES = ("mean", "sd", "lower_95", "upper_95", "mode")  # Those in the unit of the row


def write_coefficients(
    folder: Path, estimates: Sequence[Estimate], shown: Shown, selection: Selection | None = None
) -> Path:
    """Write `results/coefficients.csv`, a row for each parameter of each structure, atomically; returns its path.

    Args:
        folder: of the campaign.
        estimates: of the structures.
        shown: units of the parameters.
        selection: from which the probabilities of the structures are; None before they are known, which leaves their cells empty.
    """
    probability = np.full(len(estimates), nan) if selection is None else selection.probability
    rows = [
        {"structure": one.structure.label, "probability": float(weight), "name": name, **row}
        for one, weight in zip(estimates, probability, strict=True)
        for name, row in zip(one.names, _rows(one.summary_columns()), strict=True)
    ]
    return _write(Store(folder).coefficients, OF_STRUCTURES, rows, shown)


def _rows(columns: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the rows of a table as plain numbers and texts."""
    plain = [np.asarray(column).tolist() for column in columns.values()]
    return (dict(zip(columns, row, strict=True)) for row in zip(*plain, strict=True))


def write_quote(folder: Path, rows: Sequence[StoredAverage], shown: Shown) -> Path:
    """Write `results/quote.csv`, the rows of `quote_rows`, atomically; returns its path."""
    return _write(Store(folder).quote, QUOTE, ({**asdict(row), **asdict(row.shares)} for row in rows), shown)


def quote_rows(
    source: Literal["chosen", "averaged"], chosen: Sequence[StoredCoefficient], averages: Sequence[StoredAverage]
) -> tuple[StoredAverage, ...]:
    """Return the one value to quote of each parameter.

    Args:
        source: whose values these are, by `Selection.quoted`.
        chosen: parameters of the most probable structure.
        averages: rows of `averaged_rows`.
    """
    if source == "averaged":
        return tuple(averages)
    inclusion = {row.name: row.inclusion for row in averages}
    kept = [one.name for one in fields(StoredAverage) if one.name != "inclusion"]
    return tuple(
        StoredAverage(**{name: getattr(row, name) for name in kept}, inclusion=inclusion[row.name]) for row in chosen
    )


def averaged_rows(estimates: Sequence[Estimate], selection: Selection) -> tuple[StoredAverage, ...]:
    """Return each parameter averaged over all structures by their probabilities, SI, and the probability of those that have it.

    The cause of a standard deviation is that of the structure that adds most to it, if the choice of terms does not add more.
    """
    moments = [
        {name: (float(one.data["mean"].sel(parameter=name)), one.sd(name)) for name in one.names} for one in estimates
    ]
    share = selection.probability / selection.probability.sum()  # of what was simulated
    rows = []
    for name, (mean, sd) in averaged(moments, share).items():
        have_it = [(one, p) for one, p in zip(estimates, share, strict=True) if name in one.names]
        inclusion = min(1.0, sum(float(p) for _, p in have_it))
        lower, upper = _interval([(one.widened_draws(name), float(p)) for one, p in have_it], 1.0 - inclusion)
        parts = [(p * one.sd(name) ** 2, one) for one, p in have_it]
        most = max(parts, key=lambda pair: pair[0])[1]
        within = np.array([float(variance) * np.array(astuple(one.shares(name))) for variance, one in parts])
        shares = within.sum(0) / max(sd**2, TINY)
        shares[-1] = max(0.0, 1.0 - shares.sum())
        about = have_it[0][0].data.sel(parameter=name)
        rows.append(
            StoredAverage(
                name=name,
                unit=str(about["unit"].values),
                label=str(about["label"].values),
                mean=mean,
                sd=sd,
                lower_95=lower,
                upper_95=upper,
                cause=most.causes.get(name, "") if shares[-1] < shares[:-1].max() else "",
                inclusion=inclusion,
                shares=ErrorShares(*map(float, shares)),
            )
        )
    return tuple(rows)


def _interval(draws: Sequence[tuple[np.ndarray, float]], absent: float) -> tuple[float, float]:
    """Return the shortest interval that holds 95 % of a mixture.

    Args:
        draws: of each structure, and their weight all together.
        absent: weight of zero.
    """
    parts = [(values, np.full(values.size, weight / values.size)) for values, weight in draws] + [
        (np.zeros(1), np.array([absent]))
    ]
    values, weights = (np.concatenate(part) for part in zip(*parts, strict=True))
    order = np.argsort(values, kind="stable")
    values, weights = values[order], weights[order]
    upto = np.cumsum(weights)
    last = np.searchsorted(upto, upto - weights + COVERED * upto[-1] - ROUNDING)
    ends = values[last[last < values.size]]
    first = int(np.argmin(ends - values[: ends.size]))
    return float(values[first]), float(ends[first])


def _write(path: Path, columns: Sequence[str], rows: Iterable[Mapping[str, Any]], shown: Shown) -> Path:
    """Write rows with a header, each in the unit in which its parameter is shown; what is no number stays empty."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(columns)
    for row in rows:
        factor, unit = shown(row["name"], row["unit"])
        numbers = {key: factor * row[key] for key in QUANTITIES if row.get(key) is not None}
        shown_row = {key: value for key, value in {**row, "unit": unit, **numbers}.items() if value is not None}
        cells = (shown_row.get(key, "") for key in columns)
        writer.writerow(["" if isinstance(cell, float) and isnan(cell) else cell for cell in cells])
    write_text(path, stream.getvalue())
    return path
