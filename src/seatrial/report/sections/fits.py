"""How well every record is predicted from its inputs alone, and how the model stands beside simple predictors."""

from typing import Any

import numpy as np

from seatrial.campaign.inference.baselines import NOTHING_HELD_BACK, refused_words
from seatrial.campaign.inference.judge_predictions import trial_verdicts
from seatrial.campaign.inference.structure_average import StructureAverage, average_of
from seatrial.campaign.store.estimates import TINY
from seatrial.campaign.store.predictions import Fit
from seatrial.campaign.workflow.outcome import Outcome
from seatrial.core.display_units import count_below, shown_unit
from seatrial.core.findings import Finding
from seatrial.core.record import Record
from seatrial.estimation.prediction.baseline_comparison import Comparison, PooledScore
from seatrial.estimation.prediction.fit_verdict import (
    FIT_LEVELS,
    LEVELS,
    MIN_EFFECTIVE_SAMPLES,
    NARROW,
    POOR,
    Pooled,
)
from seatrial.messages.predictions import comparison_text, explained_text
from seatrial.messages.render import statement
from seatrial.report.drawing import draw, model_said, record_curves
from seatrial.report.figures.fit import DrawnChannel, Driven, record_fit, record_residuals
from seatrial.report.labels import sentence_html
from seatrial.report.numbers import DASH, percent, short, typeset, unit_text

# Dots and panels worth their bytes and their time on the whole page, and rows of a table before the others fold.
POINTS, PANELS, MAX_ROWS = 5000, 24, 6
# Dots, channels and controls in the figure of the first screen.
MAX_POINTS, MAX_CHANNELS, MAX_CONTROLS = 1000, 3, 2
# How each verdict looks among the findings of the page.
LOOKS = {"pass": "finding", "unjudged": "caution", "caution": "caution", "fail": "alarm"}
NOUNS = {
    "pass": ("run passes", "runs pass"),
    "unjudged": ("run cannot be judged separately", "runs cannot be judged separately"),
    "caution": ("run has a caution", "runs have a caution"),
    "fail": ("run fails", "runs fail"),
}


def fits_section(outcome: Outcome) -> dict[str, Any]:
    """Return what `fit.html` prints; the run that says most against the model is drawn first."""
    records = [*outcome.trials.fit, *outcome.trials.predict]
    held_back = {record.label for record in outcome.trials.predict}
    verdicts = trial_verdicts(outcome.fits)
    order = sorted(
        range(len(records)), key=lambda at: _weight(outcome, records[at].label, verdicts, held_back), reverse=True
    )
    channels = len(outcome.campaign.channels)
    drawn = order[: max(1, PANELS // (3 * channels + len(records[0].controls)))]
    most = int(np.clip(POINTS / (len(drawn) * channels), 250, 1000))
    first = first_run(outcome)
    cards = [_card(outcome, at, records[at], records[at].label in held_back, most, at == first) for at in drawn]
    rows = [_row(fit) for fit in outcome.fits]
    average = average_of(outcome.campaign, outcome.estimates, outcome.selection)
    return {
        "averaged": [model_said(outcome, label) for label in average.labels]
        if isinstance(average, StructureAverage)
        else [],
        "basis": _basis(outcome),
        "shown": cards[:1],
        "cards": cards[1:],
        "undrawn": [records[at].label for at in order[len(drawn) :]],
        "rows": rows[:MAX_ROWS],
        "more": rows[MAX_ROWS:],
        "every": rows,
        "counts": [
            f"{count} {NOUNS[level][count != 1]}"
            for level in LOOKS
            if (count := sum(FIT_LEVELS[verdict.level] == level for verdict in verdicts.values()))
        ],
        "has_held_back": bool(held_back),
        "pooled": [_together(one) for one in outcome.pooled],
        "baselines": _baselines(outcome),
        "slow": _is_slow(outcome),
        "model": "The model" if len(outcome.estimates) == 1 else model_said(outcome, outcome.chosen.structure.label),
    }


def first_run(outcome: Outcome) -> int:
    """Return the index of the run that the first screen shows: of the held-back runs, or else the fitted ones, that which moves most.

    Its motion is the standard deviation of each channel over the largest among these runs, averaged over the channels.
    """
    data, fitted = outcome.predictions, len(outcome.trials.fit)
    runs = range(fitted, fitted + len(outcome.trials.predict)) if outcome.trials.predict else range(fitted)
    measured = (data["measured"].values[data["record"].values == index] for index in runs)
    spread = np.array(
        [
            [np.std(column[np.isfinite(column)] if np.isfinite(column).any() else 0.0) for column in one.T]
            for one in measured
        ]
    )
    return runs[int(np.argmax((spread / np.maximum(spread.max(0), TINY)).mean(1)))]


def first_figure(outcome: Outcome) -> dict[str, Any]:
    """Return the picture of that run for the first screen: `MAX_CHANNELS` at most, and the controls if they are few."""
    index = first_run(outcome)
    record = [*outcome.trials.fit, *outcome.trials.predict][index]
    held_back = index >= len(outcome.trials.fit)
    time, channels, controls = record_curves(outcome, index, record)
    few, _ = _split(channels, controls)
    title = f"{_title(record)}{', held back' if held_back else ''}: measured and predicted"
    return {
        "figure": draw(record_fit(time, *few, held_back, MAX_POINTS), "first", title, heading=title),
        "basis": _basis(outcome),
        "held_back": held_back,
        "has_controls": bool(few[1]),
    }


def _split(channels: list[DrawnChannel], controls: list[Driven]) -> tuple[tuple[list[DrawnChannel], list[Driven]], ...]:
    """Return which channels and controls of its run the first screen shows, and which are left."""
    seen = controls if len(controls) <= MAX_CONTROLS else []
    return (channels[:MAX_CHANNELS], seen), (channels[MAX_CHANNELS:], [] if seen else controls)


def _title(record: Record) -> str:
    return "The trial" if record.label == "trial" else f"Run {record.label}"


def _weight(outcome: Outcome, label: str, verdicts: dict[str, Finding], held_back: set[str]) -> tuple[int, bool, float]:
    """Order runs by how much they say against the model: by verdict, held-back ones first, and the worst predicted of these."""
    explained = [fit.explained for fit in outcome.fits if fit.record == label and fit.samples and not fit.missing]
    level = LEVELS.index(FIT_LEVELS[verdicts[label].level]) if label in verdicts else -1
    return level, label in held_back, -min(explained, default=1.0)


def _is_slow(outcome: Outcome) -> bool:
    """Return whether the noise of a sensor is modelled as correlated in time."""
    return any(sensor.noise in ("coloured", "drifting") for sensor in outcome.campaign.sensor_models)


def _card(outcome: Outcome, index: int, record: Record, held_back: bool, most: int, is_first: bool) -> dict[str, Any]:
    """Return the verdicts and figures of a run, without what the first screen shows of it."""
    time, channels, controls = record_curves(outcome, index, record)
    title = _title(record)
    left = _split(channels, controls)[1] if is_first else (channels, controls)
    residuals = record_residuals(time, channels, held_back, most, _is_slow(outcome))
    before = " before the fitted correlation is removed" if _is_slow(outcome) else ""
    return {
        "title": title,
        "held_back": held_back,
        "is_first": is_first,
        "verdicts": [
            {"level": fit.level, "kind": LOOKS[fit.level], "reason": sentence_html(fit.finding, {})}
            for fit in outcome.fits
            if fit.record == record.label
        ],
        "figures": [
            *(
                [draw(record_fit(time, *left, held_back, most), f"fit-{index}", f"{title}: measured and predicted")]
                if any(left)
                else []
            ),
            draw(
                residuals,
                f"residuals-{index}",
                f"{title}: residuals divided by the predicted standard deviation, and their autocorrelation{before}",
            ),
        ],
    }


def _basis(outcome: Outcome) -> str:
    """Say from what the motion of a run is predicted."""
    estimation = outcome.campaign.estimation
    if estimation.initial == "trim":
        return "only its control, from the trim"
    if not estimation.free_initial:
        return "only its control and its first sample"
    held_back = ", that of a held-back run only to its first sample" if outcome.trials.predict else ""
    return f"its control and its start; the start of a fitted run is fitted to the whole of that run{held_back}"


def _together(one: Pooled) -> dict[str, Any]:
    """Every held-back record of one channel, judged together."""
    number = one.effective > 0
    return {
        "channel": one.channel,
        "level": one.level,
        "kind": LOOKS[one.level],
        "reason": sentence_html(statement(one.verdict), {}),
        "runs": one.runs,
        "samples": one.samples,
        "p": _p_value(one.p_value) if number else DASH,
        "variance": short(one.variance, 2) if number else DASH,
        "widen": f"{one.widen:.1f} ({one.widen_lower:.1f} to {one.widen_upper:.1f})" if number else DASH,
    }


def _baselines(outcome: Outcome) -> dict[str, Any]:
    """Return how simple predictors do on the held-back records."""
    if outcome.baselines is None:
        return {"nothing": sentence_html(NOTHING_HELD_BACK, {}), "findings": [], "rows": [], "refused": []}
    return {
        "nothing": "",
        "findings": [
            {"kind": "finding", "text": sentence_html(comparison_text(one), {})}
            for one in outcome.compared
            if one.level == "pass"
        ],
        "rows": [_score(one, score) for one in outcome.compared for score in (one.ours, *one.baselines)],
        "refused": [sentence_html(text, {}) for text in refused_words(outcome.baselines)],
    }


def _score(one: Comparison, score: PooledScore) -> dict[str, Any]:
    factor, unit = shown_unit(one.channel)
    return {
        "channel": one.channel,
        "words": score.words,
        "ours": score is one.ours,
        "diverges": score.diverges,
        "explained": typeset(explained_text(score.explained, 2, digits=1)),
        "crps": f"{short(score.crps * factor)} {unit_text(unit)}",
        "log_score": f"{score.log_score:.2f}",
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
        "explained": typeset(explained_text(fit.explained)) if moves else DASH,
        "share": float(np.clip(fit.explained, 0, 1)),
        "poor": moves and fit.explained < POOR,
        "rmse": f"{short(fit.rmse * factor)} {unit}" if number else DASH,
        "crps": f"{short(fit.crps * factor)} {unit}" if number else DASH,
        "coverage_50": percent(fit.coverage_50) if number else DASH,
        "coverage": percent(fit.coverage) if number else DASH,
        "narrow": number and fit.coverage < NARROW,
        "variance": short(fit.variance, 2) if number else DASH,
        "pit": [round(min(3.0, share * len(fit.pit)), 2) for share in fit.pit],
        "factor": short(fit.sd_factor, 2) if number else DASH,
        "white": _p_value(fit.white) if number else "",
        "samples": fit.samples,
        "effective": count_below(fit.effective, MIN_EFFECTIVE_SAMPLES),
    }


def _p_value(p: float) -> str:
    return "p < 0.001" if p < 0.001 else f"p = {p:.2g}"
