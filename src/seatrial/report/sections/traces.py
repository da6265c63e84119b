"""Filter traces: how the belief about each coefficient narrows along the fitted records."""

import json
from typing import Any

import numpy as np

from seatrial.campaign.workflow.run import Outcome
from seatrial.report.drawing import Drawing, draw, labels_of, truth_of, units_of
from seatrial.report.figures.traces import coefficient_trace
from seatrial.report.labels import label_html, label_mathtext
from seatrial.report.numbers import rounded, times_ten


def section(outcome: Outcome) -> dict[str, Any]:
    """What `traces.html` prints."""
    names = [str(name) for name in outcome.filter["coefficient"].values]
    return {
        "figures": [_trace(outcome, index, name) for index, name in enumerate(names)],
        "filter": outcome.filter.attrs["filter"],
        "structure": outcome.estimates[0].structure.label,
        "records": json.loads(outcome.filter.attrs["records"]),
        "has_truth": bool(truth_of(outcome)),
        "coloured": any(sensor.noise == "coloured" for sensor in outcome.campaign.sensor_models),
        "failures": int(outcome.filter.attrs["failures"]),
    }


def joined_time(time: np.ndarray, record: np.ndarray) -> tuple[np.ndarray, list[float]]:
    """Lay records one after another: time that never runs back, and where each record but the first begins."""
    joined, starts, offset = np.empty(time.size), [], 0.0
    for index in np.unique(record):
        rows = record == index
        own = time[rows] - time[rows][0]
        joined[rows] = own + offset
        if index:
            starts.append(offset)
        offset += own[-1] + (own[-1] - own[-2] if own.size > 1 else 0.0)
    return joined, starts


def _trace(outcome: Outcome, index: int, name: str) -> Drawing:
    data, full = outcome.filter, outcome.estimates[0]
    label, unit = labels_of(outcome)[name], units_of(outcome)[name]
    time, starts = joined_time(data["time"].values, data["record"].values)
    mean, sd = data["mean"].values[:, index], data["sd"].values[:, index]
    row = full.data.sel(parameter=name)
    figure = coefficient_trace(
        time,
        mean,
        sd,
        label_mathtext(label),
        unit,
        starts=starts,
        prior_mean=float(row["prior_mean"]),
        posterior_mean=float(row["mean"]),
        truth=truth_of(outcome).get(name),
    )
    return draw(
        figure,
        f"trace-{index}",
        f"Filter's belief about {name} over time",
        f"Final: {_both(mean[-1], sd[-1])}; sampler: {_both(float(row['mean']), float(row['sd']))}.",
        label_html(label),
    )


def _both(mean: float, sd: float) -> str:
    value, spread, exponent = rounded(mean, sd)
    return f"({value} ± {spread}){times_ten(exponent)}" if exponent else f"{value} ± {spread}"
