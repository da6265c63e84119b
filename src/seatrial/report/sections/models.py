"""Which terms the data support: probabilities of models and terms, the evidence behind them, and all structures in closed form."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from seatrial.campaign.store.structures import ENOUGH, undecided_words
from seatrial.campaign.workflow.outcome import Outcome
from seatrial.estimation.row_fit import SCREENING
from seatrial.report.drawing import Drawing, draw, labels_of
from seatrial.report.figures.structures import probability_bars
from seatrial.report.labels import label_html, label_mathtext, sentence_html
from seatrial.report.numbers import decimals, probability
from seatrial.report.term_figures import term_figures

MOST = 12


def models_section(outcome: Outcome) -> dict[str, Any]:
    """Return what `models.html` prints."""
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


def terms_section(outcome: Outcome) -> dict[str, Any]:
    """Return what `terms.html` prints."""
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
