"""How well every record is predicted from its inputs alone."""

from typing import Any

import numpy as np

from seatrial.campaign.loop import Outcome
from seatrial.campaign.predict import Fit
from seatrial.campaign.shown import shown_unit
from seatrial.core.record import Record
from seatrial.report.drawing import draw, record_curves
from seatrial.report.figures.fit import record_fit
from seatrial.report.figures.residuals import record_residuals
from seatrial.report.numbers import percent, short

POINTS = 7000
"""Dots worth their bytes on the whole page."""
POOR, NARROW_BAND = 0.5, 0.8


def section(outcome: Outcome) -> dict[str, Any]:
    """What `fits.html` prints."""
    records = [*outcome.trials.fit, *outcome.trials.predict]
    held_back = {record.label for record in outcome.trials.predict}
    most = int(np.clip(POINTS / (len(records) * len(outcome.campaign.channels)), 350, 1500))
    cards = [_card(outcome, index, record, record.label in held_back, most) for index, record in enumerate(records)]
    return {
        "cards": cards,
        "rows": [_row(fit) for fit in outcome.fits],
        "has_held_back": bool(held_back),
        "coloured": outcome.campaign.source.estimation.residuals == "coloured",
        "structure": outcome.chosen.structure.label,
    }


def _card(outcome: Outcome, index: int, record: Record, held_back: bool, most: int) -> dict[str, Any]:
    time, channels, controls = record_curves(outcome, index, record)
    rows = [_row(fit) for fit in outcome.fits if fit.record == record.label]
    title = "The trial" if record.label == "trial" else f"Run {record.label}"
    said = "; ".join(
        f"{row['channel']}: {row['explained']} explained, {row['coverage']} inside the band" for row in rows
    )
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
        "said": said,
        "figures": figures,
    }


def _row(fit: Fit) -> dict[str, Any]:
    factor, unit = shown_unit(fit.channel)
    return {
        "record": fit.record,
        "held_back": fit.held_back,
        "channel": fit.channel,
        "explained": percent(fit.explained),
        "share": float(np.clip(fit.explained, 0, 1)) if np.isfinite(fit.explained) else 0.0,
        "poor": not fit.explained >= POOR,
        "rmse": f"{short(fit.rmse * factor)} {unit}",
        "coverage": percent(fit.coverage),
        "narrow": not fit.coverage >= NARROW_BAND,
        "correlation": short(fit.correlation, 2),
        "interval": short(fit.interval, 2),
        "samples": fit.samples,
    }
