"""Posteriors of the chosen model: one parameter at a time, then those that are known together."""

from itertools import combinations
from typing import Any

import numpy as np

from seatrial.campaign.workflow.run import Outcome
from seatrial.report.drawing import Drawing, draw, labels_of, truth_of, units_of
from seatrial.report.figures.pairs import correlations, pair
from seatrial.report.figures.posterior import marginal
from seatrial.report.labels import label_html, label_mathtext
from seatrial.report.sections.coefficients import prior_of

STRONG, MOST_PAIRS = 0.7, 6


def section(outcome: Outcome) -> dict[str, Any]:
    """What `posteriors.html` prints."""
    names = outcome.chosen.names
    matrix = correlation(outcome.chosen.draws())
    strong = sorted(
        (pair for pair in combinations(range(len(names)), 2) if abs(matrix[pair]) >= STRONG),
        key=lambda at: -abs(matrix[at]),
    )
    return {
        "figures": [_marginal(outcome, index) for index in range(len(names))],
        "pairs": [_pair(outcome, index, at, matrix[at]) for index, at in enumerate(strong[:MOST_PAIRS])],
        "left_out": max(0, len(strong) - MOST_PAIRS),
        "matrix": _matrix(outcome, matrix) if len(names) > 2 else None,
        "has_truth": bool(truth_of(outcome)),
        "structure": outcome.chosen.structure.label,
        "strong": f"{STRONG:g}",
    }


def correlation(draws: np.ndarray) -> np.ndarray:
    """Correlations of the columns of draws; NaN for a column that does not vary."""
    centred, sd = draws - draws.mean(axis=0), draws.std(axis=0)
    sd = np.where(sd > 1e-9 * np.abs(draws).max(axis=0), sd, np.nan)
    return (centred / sd).T @ (centred / sd) / draws.shape[0]


def _marginal(outcome: Outcome, index: int) -> Drawing:
    chosen = outcome.chosen
    name = chosen.names[index]
    row = chosen.data.sel(parameter=name)
    item = next(item for item in outcome.summary["coefficients"] if item["name"] == name)
    figure = marginal(
        chosen.draws([name])[:, 0],
        label_mathtext(item["label"]),
        item["unit"],
        prior=prior_of(outcome, name),
        interval=(item["lower_95"], item["upper_95"]),
        normal=(float(row["mode"]), float(row["laplace_sd"])),
        truth=truth_of(outcome).get(name),
    )
    return draw(figure, f"posterior-{index}", f"Posterior of {name}")


def _pair(outcome: Outcome, index: int, at: tuple[int, int], correlation: float) -> Drawing:
    chosen, labels, units, truth = outcome.chosen, labels_of(outcome), units_of(outcome), truth_of(outcome)
    first, second = (chosen.names[i] for i in at)
    draws = chosen.draws([first, second])
    known = (truth[first], truth[second]) if first in truth and second in truth else None
    symbols = label_mathtext(labels[first]), label_mathtext(labels[second])
    figure = pair(draws[:, 0], draws[:, 1], symbols, (units[first], units[second]), known)
    return draw(
        figure,
        f"pair-{index}",
        f"Joint posterior of {first} and {second}",
        f"Correlation {correlation:+.3f}.".replace("-", "−"),
        label_html(labels[first]) + " and " + label_html(labels[second]),
    )


def _matrix(outcome: Outcome, matrix: np.ndarray) -> Drawing:
    symbols = [label_mathtext(labels_of(outcome)[name]) for name in outcome.chosen.names]
    return draw(
        correlations(matrix, symbols),
        "correlations",
        "Correlations of all pairs of parameters",
        "Correlations: blue positive, orange negative, larger squares stronger.",
        "All correlations",
    )
