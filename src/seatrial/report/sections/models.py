"""Which terms the data support: probabilities of models and of terms, and the evidence behind them."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from seatrial.campaign.workflow.run import Outcome
from seatrial.report.drawing import Drawing, draw, labels_of
from seatrial.report.figures.structures import probability_bars
from seatrial.report.labels import label_html, label_mathtext
from seatrial.report.numbers import decimals, probability

MOST = 12


def section(outcome: Outcome) -> dict[str, Any]:
    """What `models.html` prints."""
    selection, labels = outcome.selection, labels_of(outcome)
    order = np.argsort(-selection.probability, kind="stable")
    always = outcome.campaign.structure.always
    optional = outcome.campaign.structure.optional
    best = selection.evidences[selection.chosen].log_value
    rows = [_row(outcome, int(index), optional, best) for index in order]
    return {
        "rows": rows[:MOST],
        "more": rows[MOST:],
        "always": [label_html(labels.get(term, term)) for term in always],
        "optional": [(term, label_html(labels.get(term, term))) for term in optional],
        "figures": _figures(outcome, order),
        "alone": len(selection.structures) == 1,
    }


def _row(outcome: Outcome, index: int, optional: Sequence[str], best: float) -> dict[str, Any]:
    selection = outcome.selection
    structure, evidence = selection.structures[index], selection.evidences[index]
    p, p_error = float(selection.probability[index]), float(selection.probability_error[index])
    return {
        "label": structure.label,
        "chosen": index == selection.chosen,
        "has": [term in structure.terms for term in optional],
        "log_evidence": decimals(evidence.log_value, 2),
        "error": decimals(evidence.std_error, 2),
        "difference": "" if index == selection.chosen else decimals(evidence.log_value - best, 2),
        "probability": probability(p, p_error),
        "probability_error": f"{p_error:.2g}" if p_error >= 0.0005 else "",
        "status": evidence.status,
    }


def _figures(outcome: Outcome, order: np.ndarray) -> list[Drawing]:
    selection, labels = outcome.selection, labels_of(outcome)
    if len(selection.structures) == 1:
        return []
    shown = order[:MOST]
    figures = [
        draw(
            probability_bars(
                [selection.structures[i].label for i in shown],
                selection.probability[shown],
                selection.probability_error[shown],
                0,
            ),
            "models",
            "Probability of each model",
            "Probability of each model; bars with ends show one standard error of its computation. "
            "All models were equally probable before the data.",
            "Models",
        )
    ]
    if selection.inclusion:
        terms = sorted(selection.inclusion, key=lambda term: -selection.inclusion[term])
        figures.append(
            draw(
                probability_bars(
                    [label_mathtext(labels.get(term, term)) for term in terms],
                    [selection.inclusion[term] for term in terms],
                    [selection.inclusion_error[term] for term in terms],
                ),
                "terms",
                "Probability that each optional term is needed",
                "Probability that the vehicle needs the term: the sum over all models that contain it. "
                "Near 1 it is needed, near 0 it is not, near 0.5 these data cannot say.",
                "Optional terms",
            )
        )
    return figures
