"""Which terms are real: all structures in closed form, what choosing the runner-up would change, and which trial would decide."""

from typing import Any

from seatrial.campaign.store.structures import ENOUGH, undecided_words
from seatrial.campaign.workflow.run import Outcome
from seatrial.estimation.row_fit import SCREENING
from seatrial.report.drawing import draw, labels_of
from seatrial.report.labels import sentence_html
from seatrial.report.term_figures import term_figures


def section(outcome: Outcome) -> dict[str, Any]:
    """What `terms.html` prints."""
    screened, contenders, labels = outcome.screened, outcome.contenders, labels_of(outcome)
    selection, said = outcome.selection, []
    if contenders is not None:
        told = contenders.nats > ENOUGH
        said = [
            {"kind": "finding", "text": sentence_html(contenders.difference_words(), labels)},
            {"kind": "finding", "text": sentence_html(undecided_words(selection), labels)},
            {
                "kind": "finding" if told else "caution",
                "text": sentence_html(contenders.trial_words(selection), labels),
            },
        ]
    cautions = [] if screened is None else screened.cautions
    return {
        "findings": [*said, *({"kind": "caution", "text": sentence_html(text, labels)} for text in cautions)],
        "screened": screened is not None,
        "note": sentence_html(SCREENING, labels),
        "figures": [
            draw(item.figure, f"terms-{item.name}", item.heading, item.caption, item.heading)
            for item in term_figures(outcome.campaign.units, selection, screened, contenders)
        ],
    }
