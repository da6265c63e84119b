"""How well each model predicts runs that were left out, and which model of the error does best."""

from typing import Any

from seatrial.campaign.workflow.outcome import Outcome
from seatrial.report.drawing import labels_of
from seatrial.report.labels import sentence_html


def cross_validation_section(outcome: Outcome) -> dict[str, Any]:
    """Return what `leftout.html` prints; nothing where no current result is there."""
    found = outcome.cross_validation
    if found is None:
        return {}
    labels = labels_of(outcome)
    sentences = [line for line in found.headline() if not line.startswith(" ")]
    alarms = found.alarms
    return {
        "findings": [
            {"kind": "alarm" if text in alarms else "finding", "text": sentence_html(text, labels)}
            for text in sentences
        ]
        + [{"kind": "caution", "text": sentence_html(text, labels)} for text in found.complaints()],
        "lines": [] if found.recommended is None else list(found.recommended.lines),
        "heads": found.heads(),
        "rows": found.rows(),
        "runs": len(found.runs),
    }
