"""How well every record is predicted from its inputs alone, and how the belief about each coefficient narrows along it."""

import json
from typing import Any

import numpy as np

from seatrial.campaign.inference.predict import trial_verdicts
from seatrial.campaign.store.estimates import Fit
from seatrial.campaign.workflow.outcome import Outcome
from seatrial.core.display_units import shown_unit
from seatrial.core.record import Record
from seatrial.estimation.fit_verdict import NARROW, POOR
from seatrial.estimation.pooled_coverage import Pooled
from seatrial.report.drawing import Drawing, draw, labels_of, record_curves, truth_of, units_of
from seatrial.report.figures.fit import record_fit, record_residuals
from seatrial.report.figures.traces import coefficient_trace
from seatrial.report.labels import label_html, label_mathtext, sentence_html
from seatrial.report.numbers import DASH, percent, short, unit_text, with_sd

POINTS = 7000
"""Dots worth their bytes on the whole page."""
LOOKS = {"pass": "finding", "unjudged": "caution", "caution": "caution", "fail": "alarm"}
"""How each verdict looks among the findings of the page."""
NOUNS = {
    "pass": ("trial passes", "trials pass"),
    "unjudged": ("trial cannot be judged alone", "trials cannot be judged alone"),
    "caution": ("trial with a caution", "trials with a caution"),
    "fail": ("trial fails", "trials fail"),
}


def fits_section(outcome: Outcome) -> dict[str, Any]:
    """Return what `fits.html` prints."""
    records = [*outcome.trials.fit, *outcome.trials.predict]
    held_back = {record.label for record in outcome.trials.predict}
    most = int(np.clip(POINTS / (len(records) * len(outcome.campaign.channels)), 350, 1500))
    verdicts = trial_verdicts(outcome.fits)
    cards = [_card(outcome, index, record, record.label in held_back, most) for index, record in enumerate(records)]
    return {
        "cards": cards,
        "rows": [_row(fit) for fit in outcome.fits],
        "nouns": NOUNS,
        "counts": {level: sum(verdict.level == level for verdict in verdicts.values()) for level in LOOKS},
        "has_held_back": bool(held_back),
        "pooled": [_together(one) for one in outcome.pooled],
        "coloured": any(sensor.noise == "coloured" for sensor in outcome.campaign.sensor_models),
        "structure": outcome.chosen.structure.label,
    }


def traces_section(outcome: Outcome) -> dict[str, Any]:
    """Return what `traces.html` prints."""
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


def _card(outcome: Outcome, index: int, record: Record, held_back: bool, most: int) -> dict[str, Any]:
    time, channels, controls = record_curves(outcome, index, record)
    fits = [fit for fit in outcome.fits if fit.record == record.label]
    title = "The trial" if record.label == "trial" else f"Run {record.label}"
    figures = [
        draw(
            record_fit(time, channels, controls, held_back, most),
            f"fit-{index}",
            f"{title}: measured and predicted",
            "",
        ),
        draw(
            record_residuals(time, channels, held_back, most),
            f"residuals-{index}",
            f"{title}: residuals in units of the predicted standard deviation, and their autocorrelation",
            "",
        ),
    ]
    return {
        "title": title,
        "held_back": held_back,
        "verdicts": [_verdict(fit) for fit in fits],
        "figures": figures,
    }


def _verdict(fit: Fit) -> dict[str, Any]:
    return {"level": fit.level, "kind": LOOKS[fit.level], "reason": sentence_html(fit.words, {})}


def _together(one: Pooled) -> dict[str, Any]:
    """Every held-back record of one channel, judged together."""
    number = one.effective > 0
    return {
        "channel": one.channel,
        "level": one.level,
        "kind": LOOKS[one.level],
        "reason": sentence_html(one.reason, {}),
        "runs": one.runs,
        "samples": one.samples,
        "effective": f"{one.effective:.0f}",
        "coverage": f"{percent(one.coverage)} ({percent(one.lower)} to {percent(one.upper)})" if number else DASH,
        "p": _p_value(one.p_value) if number else DASH,
        "explained": (percent(one.explained) if one.explained >= 0 else "worse than their means") if number else DASH,
        "variance": short(one.variance, 2) if number else DASH,
        "widen": f"{one.widen:.1f} ({one.widen_lower:.1f} to {one.widen_upper:.1f})" if number else DASH,
    }


def _row(fit: Fit) -> dict[str, Any]:
    factor, shown = shown_unit(fit.channel)
    unit = unit_text(shown)
    number = fit.samples > 0
    moves = number and not fit.missing
    return {
        "record": fit.record,
        "held_back": fit.held_back,
        "channel": fit.channel,
        "level": fit.level,
        "kind": LOOKS[fit.level],
        "explained": (percent(fit.explained) if fit.explained >= 0 else "worse than its mean") if moves else DASH,
        "nrmse": percent(fit.nrmse) if moves else DASH,
        "share": float(np.clip(fit.explained, 0, 1)),
        "poor": moves and fit.explained < POOR,
        "rmse": f"{short(fit.rmse * factor)} {unit}" if number else DASH,
        "crps": f"{short(fit.crps * factor)} {unit}" if number else DASH,
        "coverage_50": percent(fit.coverage_50) if number else DASH,
        "coverage": percent(fit.coverage) if number else DASH,
        "narrow": number and fit.coverage < NARROW,
        "variance": short(fit.variance, 2) if number else DASH,
        "pit": _spark(fit.pit),
        "pit_distance": short(fit.pit_distance, 2) if number else DASH,
        "correlation": short(fit.correlation, 2) if number else DASH,
        "white": _p_value(fit.white) if number else "",
        "interval": short(fit.interval, 2),
        "samples": fit.samples,
        "effective": f"{fit.effective:.0f}",
    }


def _p_value(p: float) -> str:
    return "p < 0.001" if p < 0.001 else f"p = {p:.2g}"


def _spark(shares: tuple[float, ...]) -> list[float]:
    """Return the heights of the bars of a small histogram, in units of what each should be, cut at three."""
    return [round(min(3.0, share * len(shares)), 2) for share in shares]


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
        f"Final: {with_sd(mean[-1], sd[-1])}; sampler: {with_sd(float(row['mean']), float(row['sd']))}.",
        label_html(label),
    )
