"""Every parameter of the chosen model in detail: before and after the data, alone and together, and whether to trust its draws."""

import json
from typing import Any

import numpy as np
from markupsafe import Markup

from seatrial.campaign.store.estimates import StoredCoefficient
from seatrial.campaign.workflow.outcome import Outcome
from seatrial.core.coefficients import CoefficientName, base_name, is_coefficient
from seatrial.estimation.diagnostics.known import Direction, Known, KnownParameter
from seatrial.messages.known import parts_of, verdict_of
from seatrial.messages.render import sentence
from seatrial.messages.values import other_kinds
from seatrial.report.drawing import (
    Drawing,
    digits_of,
    draw,
    factors_of,
    finding_of,
    labels_of,
    model_said,
    truth_of,
    unit_row,
    units_of,
)
from seatrial.report.figures.parameters import Traced, belief_rows, chain_rows, corner
from seatrial.report.figures.posterior import PriorShape
from seatrial.report.labels import label_html, label_mathtext, name_html
from seatrial.report.numbers import DASH, decimals, plain, short, typeset, with_sd
from seatrial.sampling.diagnostics import MAX_R_HAT, MIN_ESS

# Share of the prior's standard deviation left, and correlation, beyond which a number is flagged.
LITTLE_REDUCTION, STRONG_CORRELATION = 0.9, 0.9
UNKNOWN = KnownParameter("", "", np.nan, np.nan, np.nan, np.nan, "", np.nan)
MAX_PAIRS, MAX_ROWS = 10, 24  # Parameters in the plot of all pairs, and rows of traces


def parameters_section(outcome: Outcome) -> dict[str, Any]:
    """Return what `parameters.html` prints."""
    chosen, known = outcome.chosen, outcome.known
    items = {item.name: item for item in known.parameters}
    rows = [_row(outcome, row, items.get(row.name, UNKNOWN)) for row in outcome.summary.coefficients]
    matrix = correlation(chosen.draws())
    strength = np.nan_to_num(np.abs(matrix - np.diag(np.diag(matrix)))).max(axis=0)
    paired = sorted(np.argsort(-strength, kind="stable")[:MAX_PAIRS].tolist())
    several = len(known.parameters) > 1
    terms = chosen.structure.terms
    shown = [row for row in rows if base_name(row["name"]) in terms or row["flagged"]]
    # Forces by their symbols, other effects in words.
    effects = outcome.chosen.tried_effects
    forces = {word for effect in effects for word in effect.split() if is_coefficient(word)}
    labels = labels_of(outcome) | {force: CoefficientName.parse(force).label for force in forces}
    names = outcome.chosen.names[:MAX_ROWS]
    draws = outcome.chosen.data["draws"].sel(parameter=list(names)).values
    symbols = [label_mathtext(labels_of(outcome)[name]) for name in names]
    return {
        "model": model_said(outcome, chosen.structure.label),
        "rows": shown,
        "more": (more := [row for row in rows if row not in shown]),
        "more_kinds": other_kinds([row["name"] for row in more]),
        "tried_effects": [name_html(effect, labels) for effect in effects],
        "verdict": []
        if set(known.verdict) <= set(outcome.summary.cautions) and known.verdict
        else verdict_findings(outcome, known),
        "directions": [_direction(item, labels_of(outcome)) for item in known.directions] if several else [],
        "corner": _corner(outcome, paired),
        "pairs_left_out": len(chosen.names) - len(paired),
        "chains": draw(chain_rows(draws, symbols), "chains", "Traces of the chains, a row for each parameter"),
        "chain_count": chosen.data.sizes["chain"],
        "filter": _filter(outcome),
        "has_truth": bool(truth_of(outcome)),
        "max_r_hat": MAX_R_HAT,
        "min_ess": f"{MIN_ESS:.0f}",
    }


def prior_of(outcome: Outcome, name: str) -> PriorShape:
    """Return the prior of a parameter of the chosen structure, as stored with its draws, in the unit in which it is shown."""
    row, factor = outcome.chosen.data.sel(parameter=name), factors_of(outcome)[name]
    return PriorShape(
        lower=factor * float(row["prior_lower"]),
        upper=factor * float(row["prior_upper"]),
        mean=factor * float(row["prior_mean"]),
        sd=factor * float(row["prior_sd"]),
        is_logarithmic=str(row["prior_kind"].item()).startswith("Log"),
        value=factor * row["prior_value"].values,
        height=row["prior_density"].values / factor,
    )


def prior_words(prior: PriorShape, exponent: int = 0) -> str:
    """Return what was believed before the data, without the power of ten."""
    scale = 10.0**-exponent
    if prior.is_bounded:
        words = f"{plain(prior.lower * scale)} to {plain(prior.upper * scale)}"
    else:
        ends = [
            f"{side} {plain(bound * scale)}"
            for side, bound in (("above", prior.lower), ("below", prior.upper))
            if np.isfinite(bound)
        ]
        words = ", ".join([with_sd(prior.mean * scale, prior.sd * scale), *ends])
    return f"{words}, log" if prior.is_logarithmic else words


def correlation(draws: np.ndarray) -> np.ndarray:
    """Return the correlations of the columns of draws; NaN for a column that does not vary."""
    centred, sd = draws - draws.mean(axis=0), draws.std(axis=0)
    sd = np.where(sd > 1e-9 * np.abs(draws).max(axis=0), sd, np.nan)
    return (centred / sd).T @ (centred / sd) / draws.shape[0]


def verdict_findings(outcome: Outcome, known: Known) -> list[dict[str, Any]]:
    """Sentences as findings of the page; one that all is well if there are none. Those of a design are no cautions: data followed it."""
    return [
        finding_of(outcome, text) for text in (*verdict_of(known), *map(sentence, known.speed_pairs), *known.symmetry)
    ]


def _row(outcome: Outcome, item: StoredCoefficient, known: KnownParameter) -> dict[str, Any]:
    name, digits = item.name, digits_of(outcome)[item.name]
    factor = factors_of(outcome)[name]
    ess, partner = min(item.ess_bulk, item.ess_tail), known.partner
    flags = {
        "r_hat_bad": not item.r_hat <= MAX_R_HAT,
        "ess_bad": not ess >= MIN_ESS,
        "little": known.left > LITTLE_REDUCTION,
        "strong": abs(known.correlation) > STRONG_CORRELATION,
    }
    return {
        "name": name,
        **unit_row(outcome, name),
        "interval": f"{digits.bare(factor * item.lower_95)} to {digits.bare(factor * item.upper_95)}",
        "prior": prior_words(prior_of(outcome, name), digits.exponent),
        "r_hat": f"{item.r_hat:.3f}" if np.isfinite(item.r_hat) else DASH,
        "ess": f"{ess:.0f}" if np.isfinite(ess) else DASH,
        "left": f"{short(100 * known.left, 2)} %" if np.isfinite(known.left) else DASH,
        "correlation": decimals(known.correlation, 3) if partner else DASH,
        "partner": label_html(labels_of(outcome).get(partner, partner)) if partner else "",
        **flags,
        "flagged": any(flags.values()),
    }


def _direction(item: Direction, labels: dict[str, str]) -> Markup:
    """Return the change of one standard error: symbols with what each changes by."""
    parts = [
        Markup('<span class="whole">{} {}</span>').format(
            label_html(labels.get(name, name)), typeset(f" {size}").strip()
        )
        for name, size in parts_of(item)
    ]
    return Markup(", ").join(parts)


def _corner(outcome: Outcome, paired: list[int]) -> Drawing:
    names = [outcome.chosen.names[at] for at in paired]
    truth, units = truth_of(outcome), units_of(outcome)
    figure = corner(
        outcome.chosen.draws(names) * [factors_of(outcome)[name] for name in names],
        [label_mathtext(labels_of(outcome)[name]) for name in names],
        [units[name] for name in names],
        [digits_of(outcome)[name] for name in names],
        [prior_of(outcome, name) for name in names],
        [truth.get(name) for name in names],
    )
    return draw(figure, "pairs", "Posteriors: one parameter on the diagonal, every pair below it")


def _filter(outcome: Outcome) -> dict[str, Any]:
    data, full, truth = outcome.filter, outcome.estimates[0], truth_of(outcome)
    names = [str(name) for name in data["coefficient"].values][:MAX_ROWS]
    time, starts = joined_time(data["time"].values, data["record"].values)
    rows = []
    for index, name in enumerate(names):
        row, mean, sd = full.data.sel(parameter=name), data["mean"].values[:, index], data["sd"].values[:, index]
        symbol, factor = label_mathtext(labels_of(outcome)[name]), factors_of(outcome)[name]
        before, after = factor * float(row["prior_mean"]), factor * float(row["mean"])
        rows.append(Traced(symbol, factor * mean, factor * sd, before, after, truth.get(name)))
    return {
        "figure": draw(
            belief_rows(time, rows, starts), "filter", "The filter's estimate of each coefficient over time"
        ),
        "name": data.attrs["filter"],
        "model": model_said(outcome, full.structure.label),
        "records": json.loads(data.attrs["records"]),
        "failures": int(data.attrs["failures"]),
        "coloured": any(sensor.noise == "coloured" for sensor in outcome.campaign.sensor_models),
    }


def joined_time(time: np.ndarray, record: np.ndarray) -> tuple[np.ndarray, list[float]]:
    """Lay records one after another: time that never runs back, and where each record but the first begins."""
    joined, starts, offset = np.empty(time.size), [], 0.0
    for index in np.unique(record):
        rows = record == index
        own = time[rows] - time[rows][0]
        joined[rows] = own + offset
        if index:
            starts.append(offset)
        offset += own[-1] + (own[-1] - own[-2] if own.size > 1 else 0.0)
    return joined, starts
