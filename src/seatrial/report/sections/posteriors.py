"""The table of parameters of the chosen model, and their posteriors one at a time and together."""

from collections.abc import Mapping
from itertools import combinations
from typing import Any

import numpy as np

from seatrial.campaign.workflow.outcome import Outcome
from seatrial.report.drawing import Drawing, draw, labels_of, truth_of, units_of
from seatrial.report.figures.posterior import PriorShape, correlations, marginal, pair
from seatrial.report.labels import label_html, label_mathtext
from seatrial.report.numbers import plain, rounded, rounded_like, times_ten, unit_html
from seatrial.sampling.diagnostics import MAX_R_HAT, MIN_ESS

STRONG, MOST_PAIRS = 0.7, 6


def coefficients_section(outcome: Outcome) -> dict[str, Any]:
    """Return what `coefficients.html` prints."""
    truth = truth_of(outcome)
    rows = [_row(outcome, item, truth) for item in outcome.summary["coefficients"]]
    terms = set(outcome.chosen.structure.terms)
    groups = [
        ("Vehicle", [row for row in rows if row["name"] in terms]),
        ("Sensors and runs", [row for row in rows if row["name"] not in terms]),
    ]
    unit_mass = outcome.campaign.hull.mass is None
    return {
        "groups": [group for group in groups if group[1]],
        "has_truth": bool(truth),
        "wider_words": outcome.chosen.wider_words,
        "unit_mass": unit_mass,
        "max_r_hat": MAX_R_HAT,
        "min_ess": f"{MIN_ESS:.0f}",
        "structure": outcome.chosen.structure.label,
    }


def prior_of(outcome: Outcome, name: str) -> PriorShape:
    """Return the prior of a parameter of the chosen structure, as stored with its draws."""
    row = outcome.chosen.data.sel(parameter=name)
    return PriorShape(
        lower=float(row["prior_lower"]),
        upper=float(row["prior_upper"]),
        mean=float(row["prior_mean"]),
        sd=float(row["prior_sd"]),
        is_logarithmic=str(row["prior_kind"].item()).startswith("Log"),
        value=row["prior_value"].values,
        height=row["prior_density"].values,
    )


def prior_words(prior: PriorShape, exponent: int = 0) -> str:
    """Say what was believed before the data, the power of ten pulled out."""
    scale = 10.0**-exponent
    if prior.is_bounded:
        words = f"{plain(prior.lower * scale)} to {plain(prior.upper * scale)}"
    else:
        words = " ± ".join(rounded(prior.mean * scale, prior.sd * scale)[:2])
        ends = [
            f"{side} {plain(bound * scale)}"
            for side, bound in (("above", prior.lower), ("below", prior.upper))
            if np.isfinite(bound)
        ]
        words = ", ".join([words, *ends])
    words = f"({words}){times_ten(exponent)}" if exponent else words
    return f"{words}, log" if prior.is_logarithmic else words


def posteriors_section(outcome: Outcome) -> dict[str, Any]:
    """Return what `posteriors.html` prints."""
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
    """Return the correlations of the columns of draws; NaN for a column that does not vary."""
    centred, sd = draws - draws.mean(axis=0), draws.std(axis=0)
    sd = np.where(sd > 1e-9 * np.abs(draws).max(axis=0), sd, np.nan)
    return (centred / sd).T @ (centred / sd) / draws.shape[0]


def _row(outcome: Outcome, item: dict[str, Any], truth: Mapping[str, float]) -> dict[str, Any]:
    name, mean, sd = item["name"], item["mean"], item["sd"]
    value, spread, exponent = rounded(mean, sd)
    ess = min(item["ess_bulk"], item["ess_tail"])
    wider = outcome.chosen.wider(name)
    row = {
        "name": name,
        "label": label_html(item["label"]),
        "value": value,
        "sd": spread,
        "power": times_ten(exponent),
        "lower": rounded_like(item["lower_95"], mean, sd),
        "upper": rounded_like(item["upper_95"], mean, sd),
        "unit": unit_html(item["unit"]),
        "prior": prior_words(prior_of(outcome, name), exponent),
        "r_hat": f"{item['r_hat']:.3f}" if np.isfinite(item["r_hat"]) else "–",
        "ess": f"{ess:.0f}" if np.isfinite(ess) else "–",
        "r_hat_bad": not item["r_hat"] <= MAX_R_HAT,
        "ess_bad": not ess >= MIN_ESS,
        "wider": "" if wider is None else rounded_like(wider, mean, sd),
        "truth": "",
        "truth_inside": True,
    }
    if name in truth:
        inside = item["lower_95"] <= truth[name] <= item["upper_95"]
        row |= {"truth": rounded_like(truth[name], mean, sd), "truth_inside": inside}
    return row


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
