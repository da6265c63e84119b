"""The table of parameters of the chosen model: coefficients first, then what belongs to sensors and runs."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from seatrial.campaign.workflow.run import Outcome
from seatrial.report.drawing import truth_of
from seatrial.report.figures.posterior import PriorShape
from seatrial.report.labels import label_html
from seatrial.report.numbers import plain, rounded, rounded_like, times_ten, unit_html
from seatrial.sampling.diagnostics import MAX_R_HAT, MIN_ESS


def section(outcome: Outcome) -> dict[str, Any]:
    """What `coefficients.html` prints."""
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
        "unit_mass": unit_mass,
        "max_r_hat": MAX_R_HAT,
        "min_ess": f"{MIN_ESS:.0f}",
        "structure": outcome.chosen.structure.label,
    }


def prior_of(outcome: Outcome, name: str) -> PriorShape:
    """Prior of a parameter of the chosen structure, as stored with its draws."""
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


def _row(outcome: Outcome, item: dict[str, Any], truth: Mapping[str, float]) -> dict[str, Any]:
    name, mean, sd = item["name"], item["mean"], item["sd"]
    value, spread, exponent = rounded(mean, sd)
    ess = min(item["ess_bulk"], item["ess_tail"])
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
        "truth": "",
        "truth_inside": True,
    }
    if name in truth:
        inside = item["lower_95"] <= truth[name] <= item["upper_95"]
        row |= {"truth": rounded_like(truth[name], mean, sd), "truth_inside": inside}
    return row


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
