"""Candidate structures in words: a screening, the two contenders, what is undecided, and which methods agree on an evidence."""

from collections.abc import Mapping, Sequence

import numpy as np

from seatrial.core.display_units import listed, shown_unit
from seatrial.selection.contenders import Contenders
from seatrial.selection.method_agreement import METHOD_LABELS, agrees, value_of
from seatrial.selection.screened import Screened
from seatrial.selection.verdict import DECIDED, Evidence, Selection

# Which value of a coefficient to quote, by `Selection.quoted`: the same words on every surface.
QUOTED = {
    "chosen": "those of the chosen model",
    "averaged": "averages over all models, because the data do not decide between them",
}
# Prior probabilities of structures, by `Selection.structure_prior`.
BEFORE_DATA = {
    "equal": "before the data every structure is equally probable",
    "multiplicity": "before the data every number of optional terms is equally probable",
}
# Remedy for an evidence that is not reliable.
BETTER_EVIDENCE = "raise `particles`, `draws` or `repeats` in [selection], or narrow the priors"
IF_RELIABLE = ", if the evidences were reliable"  # Condition of a probability
SHOWN = 5  # Structures of a screening that are listed
ENOUGH = 3.0  # Expected log Bayes factor, nats, that decides: odds of twenty to one


def screening_lines(screened: Screened) -> list[str]:
    """Return the result of a screening: the probability of each optional term, the best structures, and a verdict for each axis."""
    from seatrial.estimation.regression.row_fit import SCREENING

    data, optional = screened.data, screened.optional
    narrow, wide = (data["inclusion_at"].sel(scale=factor, term=optional).values for factor in (0.3, 3.0))
    settings = "".join(f", {data.attrs[key]}" for key in ("prior", "delay") if data.attrs[key])
    lines = [
        f"screening of {data.attrs['count']} structures in closed form{settings} "
        "(in brackets: with priors a third as wide, three times as wide, as informative as one row):"
    ]
    here = data["inclusion"].sel(term=optional).values
    unit = data["inclusion_by_unit_information"].sel(term=optional).values
    lines += [
        f"  {term:<16} {p:.2f}  ({low:.2f}, {high:.2f}, {other:.2f})"
        for term, p, low, high, other in zip(optional, here, narrow, wide, unit, strict=True)
    ]
    best = range(min(SHOWN, data.sizes["model"]))
    lines += [f"  {float(data['probability'][rank]):.3f}  {' '.join(screened.terms(rank))}" for rank in best]
    return [*lines, *verdicts_by_axis(dict(zip(optional, here, strict=True))), SCREENING]


def verdicts_by_axis(inclusion: Mapping[str, float]) -> list[str]:
    """Return a line for each axis of several: terms that it needs, terms that it does not, and undecided ones.

    Args:
        inclusion: probability of each optional term.
    """
    from seatrial.core.coefficients import CoefficientName

    axes: dict[str, dict[str, list[str]]] = {}
    for term, p in inclusion.items():
        verdict = "needed" if p >= DECIDED else "not needed" if p <= 1 - DECIDED else "open"
        axes.setdefault(CoefficientName.parse(term).axis, {}).setdefault(verdict, []).append(term)
    if len(axes) < 2:
        return []
    order = ("needed", "not needed", "open")
    return [
        f"  axis {axis}: "
        + "; ".join(f"{verdict}: {', '.join(verdicts[verdict])}" for verdict in order if verdict in verdicts)
        for axis, verdicts in axes.items()
    ]


def contenders_lines(contenders: Contenders, selection: Selection) -> list[str]:
    """Return the effect of the runner-up, the undecided terms, and the trial that would decide."""
    return [difference_words(contenders), undecided_words(selection), trial_words(contenders, selection)]


def change_words(best: Sequence[str], other: Sequence[str]) -> str:
    """Return how another set of terms differs: `with X_u, without X_du3`."""
    more, fewer = ([term for term in a if term not in b] for a, b in ((other, best), (best, other)))
    return ", ".join(f"{word} {' and '.join(terms)}" for word, terms in (("with", more), ("without", fewer)) if terms)


def difference_words(contenders: Contenders) -> str:
    """Return the change in motion, or in force, if the runner-up were chosen."""
    channel, best, runner = contenders.channel, contenders.best, contenders.runner_up
    (factor, unit), name = shown_unit(channel), "the speed" if channel == "u" else channel
    parts = [
        f"{one.largest * factor:.2g} {unit} (rms {one.rms * factor:.2g}) in {one.words}"
        for one in reversed(contenders.shown)
    ]
    end = (
        f"the residuals of the fit are {contenders.noise * factor:.2g} {unit}"
        if np.isfinite(contenders.noise)
        else f"{name} is not measured"
    )
    change = f"{runner.label}, {change_words(best.terms, runner.terms)}"
    return f"the runner-up ({change}) would change {name} by at most {' and '.join(parts)}; {end}"


def trial_words(contenders: Contenders, selection: Selection) -> str:
    """Return which design of the best family would decide between the two, or that none would."""
    best, runner = contenders.labels
    if selection.is_settled:
        return f"these data decide between {best} and {runner}; no further trial is needed for that"
    if not selection.is_reliable:
        return f"first make the evidence reliable, to decide between {best} and {runner}: {BETTER_EVIDENCE}"
    gain = f"{contenders.nats:.2g} nat of evidence expected, {ENOUGH:g} decide"
    if contenders.nats > ENOUGH:
        return f"to decide between {best} and {runner}, run {one_design(contenders.trial)}: {gain}"
    return (
        f"no design of this family would decide between {best} and {runner}; the best would be {one_design(contenders.trial)}: {gain}. "
        "Widen the limits, run for longer, or use a better sensor"
    )


def one_design(words: str) -> str:
    """Return the words of a design with their article: `a step of +200 rpm`, but `random steps of ±20 N`."""
    return words if words.startswith("random steps") else f"a {words}"


def condition_of(selection: Selection) -> str:
    """Return the condition of the probabilities; empty if the evidence is reliable."""
    return "" if selection.is_reliable else IF_RELIABLE


def undecided_words(selection: Selection) -> str:
    """Return the undecided terms."""
    doubtful = [f"{term} ({p:.2f})" for term, p in selection.undecided.items()]
    unless = condition_of(selection)
    if not doubtful:
        return f"these data decide about every optional term{unless}"
    return f"not decided (with the probability that the term is needed{unless}): {', '.join(doubtful)}"


def agreement_words(evidence: Evidence, needed: float | None = None) -> str:
    """Return the methods of an evidence, those that agree, notes on the others, and the difference, nats, that changes a decision."""
    table = evidence.diagnostics["methods"]
    needs = [] if needed is None else [f"a decision on a term changes if it is wrong by {needed:.2g} nat"]
    if len(table) == 1 and not evidence.status:
        return "; ".join([f"by {METHOD_LABELS[next(iter(table))]}, without another method", *needs])
    value = value_of(table)
    others = {name: one for name, one in table.items() if name != value and not one["status"]}
    agree = [
        f"{METHOD_LABELS[name]} ({abs(one['joint_errors']):.1f} σ away)" for name, one in others.items() if agrees(one)
    ]
    sentence = f"by {METHOD_LABELS[value]}" + (
        f"; {' and '.join(agree)} agree{'s' * (len(agree) == 1)}; {evidence.check_words}"
        if agree
        else ", which no other method confirms"
    )
    return "; ".join(
        [sentence, *needs, *evidence.diagnostics["notes"], *([evidence.status] if evidence.status else [])]
    )


def agreement_counts(labels: Sequence[str], evidences: Sequence[Evidence]) -> str:
    """Return on how many evidences two methods agree, which nested sampling decided, and on how many no decision depends.

    Empty if none is sound.
    """
    tables = {label: one.diagnostics["methods"] for label, one in zip(labels, evidences, strict=True) if not one.status}
    sound = {label: table for label, table in tables.items() if len(table) > 1}
    decided = [label for label, table in sound.items() if "nested" in table]
    agreed, count, alone = len(sound) - len(decided), len(evidences), len(tables) - len(sound)
    if alone == count:
        return "Importance sampling gave every evidence. No other method was needed, because no decision depends on one evidence."
    if agreed == count:
        return "Every evidence was computed by importance sampling and by tempered SMC, and the two agree."
    parts = [f"Importance sampling and tempered SMC agree on {agreed} of {count} evidences"] if sound else []
    parts += [f"nested sampling decided that of {listed(decided)}"] if decided else []
    if alone:
        parts.append(
            f"no decision depends on {'the other' if alone == 1 else f'{alone} others'}, by importance sampling only"
        )
    return f"{'; '.join(parts)}." if parts else ""
