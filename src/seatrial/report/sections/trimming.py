"""Where each imported record begins and ends: its raw plot with two handles, and the command that would cut it there."""

from typing import Any

import numpy as np

from seatrial.campaign.loop import Outcome
from seatrial.core.record import Record
from seatrial.core.shown import shown_unit
from seatrial.report.drawing import draw, signal_axis
from seatrial.report.figures.raw import raw_record
from seatrial.report.svg import axes_box

MOST = 500
"""Samples drawn of each channel."""
_STEPS = 500


def trimmed_records(outcome: Outcome) -> list[dict[str, Any]]:
    """What `trimming.html` prints of each record that a log was imported to as a whole."""
    records = (*outcome.trials.fit, *outcome.trials.predict)
    return [_one(index, record) for index, record in enumerate(records) if _is_whole(record)]


def _is_whole(record: Record) -> bool:
    options = record.provenance.options
    return {"start", "end", "available"} <= set(options) and "piece" not in options


def _one(index: int, record: Record) -> dict[str, Any]:
    options = record.provenance.options
    begin = float(options["start"])
    time = record.time + begin
    columns = [(signal_axis(name), _shown(record, name)) for name in (*record.measured, *record.controls)]
    figure = raw_record(time, columns, len(record.measured), MOST)
    left, top, right, bottom = (100 * share for share in axes_box(figure))
    step = float(f"{(time[-1] - begin) / _STEPS:.0e}")
    return {
        "run": record.label,
        "drawing": draw(figure, f"raw-{index}", f"Record {record.label} as it is, control and every channel over time"),
        "place": f"left: {left:.2f}%; width: {right - left:.2f}%; top: {top:.2f}%; height: {bottom - top:.2f}%",
        "first": f"{begin:.6g}",
        "last": f"{time[-1]:.6g}",
        "available": f"{float(options['available']):.6g}",
        "step": f"{step:g}",
    }


def _shown(record: Record, name: str) -> np.ndarray:
    return record.channel(name) * shown_unit(name)[0]
