"""The models beside each other: what choosing between them changes, all structures in closed form, and runs that were left out."""

from typing import Any

import numpy as np

from seatrial.campaign.store.estimates import Estimate
from seatrial.campaign.workflow.outcome import Outcome
from seatrial.estimation.regression.row_fit import SCREENING
from seatrial.messages.cross_validation import complaints, disagreement, headline, heads, new_lines, rows
from seatrial.messages.structures import BEFORE_DATA, agreement_counts, difference_words, trial_words
from seatrial.report.drawing import (
    digits_of,
    draw,
    finding_of,
    labels_of,
    model_html,
    moments_of,
    names_of,
    sentence_of,
    unit_row,
)
from seatrial.report.labels import label_html, name_html
from seatrial.report.numbers import decimals
from seatrial.report.term_figures import contenders_figure, screening_figures

# Models that are listed before the others fold, and models whose coefficients stand beside each other.
MAX_MODELS, BESIDE = 8, 4


def models_section(outcome: Outcome) -> dict[str, Any]:
    """Return what `models.html` prints; nothing of one model that nothing was compared with."""
    selection = outcome.selection
    if len(selection.structures) == 1 and outcome.screened is None and outcome.cross_validation is None:
        return {}
    worse = [-one.weighed for one in selection.evidences]
    order = [int(index) for index in np.lexsort((worse, -selection.probability))]
    best = selection.evidences[selection.chosen].weighed
    rows = [_row(outcome, index, best) for index in order]
    return {
        "sound": not any(row["status"] for row in rows),
        "agreement": agreement_counts([one.label for one in selection.structures], selection.evidences),
        "before": sentence_of(outcome, BEFORE_DATA[selection.structure_prior]),
        "alike": selection.structure_prior == "equal",
        "rows": rows[:MAX_MODELS],
        "more": rows[MAX_MODELS:],
        "always": [label_html(labels_of(outcome).get(term, term)) for term in outcome.campaign.structure.always],
        "beside": _beside(outcome, order[:BESIDE]),
        "contenders": _contenders(outcome),
        "screening": _screening(outcome),
        "left_out": _left_out(outcome),
    }


def _row(outcome: Outcome, index: int, best: float) -> dict[str, Any]:
    selection = outcome.selection
    structure, evidence = selection.structures[index], selection.evidences[index]
    return {
        "name": model_html(outcome, structure.label),
        "label": structure.label,
        "chosen": index == selection.chosen,
        "behind": decimals(best - evidence.weighed, 2),
        "error": decimals(evidence.std_error, 2) if evidence.std_error >= 0.005 else "",
        "status": evidence.status,
    }


def _beside(outcome: Outcome, order: list[int]) -> dict[str, Any]:
    """Return the coefficients of the most probable models, a column each."""
    estimates = [outcome.estimates[index] for index in order]
    names = dict.fromkeys(name for estimate in estimates for name in estimate.structure.terms)
    rows = [
        {**unit_row(outcome, name), "values": [_value(outcome, estimate, name) for estimate in estimates[1:]]}
        for name in names
    ]
    return {"heads": [model_html(outcome, estimate.structure.label) for estimate in estimates[1:]], "rows": rows}


def _value(outcome: Outcome, estimate: Estimate, name: str) -> str:
    """Return a coefficient of one model with its standard deviation; empty if there is none."""
    return digits_of(outcome)[name].pair(*moments_of(outcome, estimate)[name]) if name in estimate.names else ""


def _contenders(outcome: Outcome) -> dict[str, Any]:
    result = outcome.contenders
    if result is None:
        return {}
    item = contenders_figure(result, names_of(outcome), outcome.trials.fit)
    texts = difference_words(result), trial_words(result, outcome.selection)
    return {
        "decided": outcome.selection.is_settled,
        "findings": [finding_of(outcome, text) for text in texts],
        "figure": draw(
            item.figure, f"terms-{item.name}", item.heading, name_html(item.caption, labels_of(outcome)), item.heading
        ),
    }


def _screening(outcome: Outcome) -> dict[str, Any]:
    screened = outcome.screened
    if screened is None:
        return {}
    return {
        "count": screened.data.attrs["count"],
        "cautions": [finding_of(outcome, text) for text in screened.cautions],
        "note": sentence_of(outcome, SCREENING),
        "figures": [
            draw(item.figure, f"terms-{item.name}", item.heading, item.caption, item.heading)
            for item in screening_figures(outcome.campaign, screened)
        ],
    }


def _left_out(outcome: Outcome) -> dict[str, Any]:
    """Return how well each model predicts runs that were left out; nothing if no current result is there."""
    result = outcome.cross_validation
    if result is None:
        return {}
    texts, alarm = (*headline(result), *complaints(result)), disagreement(result)
    return {
        "findings": [finding_of(outcome, text) | ({"kind": "alarm"} if text == alarm else {}) for text in texts],
        "lines": new_lines(result),
        "heads": heads(result),
        "rows": [[sentence_of(outcome, row[0]).rstrip("."), *row[1:]] for row in rows(result)],
        "runs": len(result.runs),
    }
