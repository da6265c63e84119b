"""The first screen: the answer in a sentence, the values, which model, what next and what is wrong."""

import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from markupsafe import Markup

from seatrial.campaign.config.taken_as_exact import taken_as_exact
from seatrial.campaign.inference.judge_predictions import held_back_alarms
from seatrial.campaign.workflow.next_trial import propose
from seatrial.campaign.workflow.outcome import Outcome
from seatrial.core.coefficients import base_name, configuration_name
from seatrial.core.display_units import listed
from seatrial.core.findings import Finding
from seatrial.estimation.prediction.baseline_comparison import CLEAR_RATIO
from seatrial.messages.effects import shares_text
from seatrial.messages.predictions import WORSE_THAN_MEAN, explained_text
from seatrial.messages.render import sentence, sentences
from seatrial.messages.structures import QUOTED, condition_of
from seatrial.messages.values import other_kinds
from seatrial.report.drawing import (
    digits_of,
    factors_of,
    labels_of,
    model_html,
    sentence_of,
    truth_of,
    unit_row,
)
from seatrial.report.labels import label_html, name_html
from seatrial.report.numbers import DASH, percent, probability, typeset
from seatrial.report.sections.fits import first_figure
from seatrial.selection.verdict import StoredAverage

RARE = 0.01  # Probability below which a term that the chosen model lacks is not worth a row
MAX_MODELS = 5  # Models that the first screen names
_NUMBER = re.compile(r"(?<![-\w])\d+(\.\d+)?")


def summary_section(outcome: Outcome) -> dict[str, Any]:
    """Return what `summary.html` prints."""
    (rows, others), advice = _rows(outcome), (outcome.first_answer,)
    if not outcome.first_answer:
        proposal = propose(outcome).beside(outcome.summary.cautions)
        advice = (*proposal.first, *proposal.advice)
    return {
        "name": outcome.campaign.name,
        "answer": answer(outcome),
        "alarms": find(outcome, "alarm"),
        "usable": not outcome.own_alarms,
        "cautions": find(outcome, "caution"),
        "passed": "The computation is sound, but the residuals contradict the model or its noise"
        if outcome.disowned
        else "No check of the fit failed; the normal approximation was not checked"
        if outcome.first_answer
        else "No health check failed",
        "verdicts": find(outcome, "finding"),
        "first": first_figure(outcome),
        "first_answer": bool(outcome.first_answer),
        "rows": rows,
        "others": others,
        "other_kinds": other_kinds([row["name"] for row in others]),
        "changes": _changes(outcome),
        "several": len(outcome.estimates) > 1,
        "other_head": _other_values(outcome)[0] if any(row["other"] not in ("", row["value"]) for row in rows) else "",
        "quoted": "" if outcome.own_alarms or outcome.first_answer else QUOTED[outcome.summary.quoted],
        "has_truth": bool(truth_of(outcome)),
        "taken_as_exact": sentence_of(outcome, text) if (text := taken_as_exact(outcome.campaign)) else "",
        "unit_mass": outcome.campaign.hull.mass is None,
        "contains": sentence_of(outcome, outcome.chosen.contains),
        "cause_findings": [sentence_of(outcome, sentence(one)) for one in outcome.cause_findings],
        "models": _models(outcome),
        "advice": [sentence_of(outcome, line) for line in advice],
        "unless": "" if outcome.selection.is_settled else condition_of(outcome.selection),
        "disowned": bool(outcome.disowned),
    }


def answer(outcome: Outcome) -> Markup:
    """Return what was found and how well it predicts, first what simpler model does as well; or that nothing may be used yet."""
    own, elsewhere = outcome.own_alarms, outcome.other_alarms
    failed = outcome.held_back_alarms
    if failed:
        unseen = sentences(held_back_alarms(outcome.fits, outcome.pooled))
        others = len(own) + len(elsewhere) - len(failed)
        more = Markup(" {} failed too.").format(_checks(others)) if others else Markup("")
        what = "The model fails on held-back runs." if unseen else "Do not use this model: another predicts better."
        return Markup("{} {}{}").format(what, sentence_of(outcome, (unseen or failed)[0]), more)
    if own:
        return Markup("Do not use these numbers yet: {} failed.").format(_checks(len(own) + len(elsewhere)))
    parts = [_unbeaten(outcome) + _basis(outcome), _found(outcome), _predicts(outcome)]
    if outcome.disowned:
        and_terms = ", and the needed terms may change" if outcome.selection.inclusion else ""
        parts.append(f"Its ± is not reliable{and_terms}: the residuals are correlated.")
    if elsewhere:
        what = "The choice of the model is not reliable" if outcome.choice_alarms else "Another model is not reliable"
        parts.append(Markup("{}: {} failed.").format(what, _checks(len(elsewhere))))
    return Markup(" ").join(parts)


def find(outcome: Outcome, kind: str) -> list[dict[str, Any]]:
    """Return the sentences of a kind, what is said of the chosen structure first, and once for many parameters."""
    summary = outcome.summary
    texts = list({"alarm": summary.alarms, "finding": summary.verdicts, "caution": summary.cautions}[kind])
    if kind == "alarm":
        texts.sort(key=lambda text: (text not in outcome.held_back_alarms, text not in outcome.own_alarms))
    texts_of_kind = [{"kind": kind, "text": text} for text in _sentences(outcome, texts)]
    findings = outcome.summary.findings
    accepted = sentences(one for one in findings if isinstance(one, Finding) and one.is_accepted)
    return texts_of_kind + [
        {"kind": "finding", "text": text} for text in _sentences(outcome, accepted if kind == "caution" else [])
    ]


def _checks(count: int) -> str:
    return f"{count} health check{'s' * (count != 1)}"


def _basis(outcome: Outcome) -> str:
    runs = outcome.trials.fit
    seconds = sum(float(record.time[-1] - record.time[0]) for record in runs)
    what = "simulated trial" if outcome.campaign.imports is None else "run"
    if len(runs) > 1:
        return f"{len(runs)} {what}s, {seconds:.0f} s together,"
    return f"One {what} of {seconds:.0f} s"


def _unbeaten(outcome: Outcome) -> str:
    """Return which simpler model predicts the held-back runs as well; nothing if the model is better than all."""
    channels: dict[tuple[str, str], list[str]] = {}
    for one in outcome.compared:
        if one.level == "caution":
            best = one.baselines[0]
            much = one.ours.crps > CLEAR_RATIO * best.crps
            how = "better than this model, but chance may explain it" if much else "as well as this model"
            channels.setdefault((best.words, how), []).append(one.channel)
    parts = (
        f"{words[0].upper()}{words[1:]} predicts {listed(names)} of the held-back runs {how}. "
        for (words, how), names in channels.items()
    )
    return "".join(parts)


def _found(outcome: Outcome) -> Markup:
    count, verb = len(outcome.selection.structures), "" if len(outcome.trials.fit) > 1 else "s"
    if outcome.first_answer:
        text = (
            "give{} a first answer: the posterior mode of the most probable model, with ± of a normal approximation. "
            "No chain was sampled, and the need for the terms was not tested."
        )
        return Markup(text).format(verb)
    if count == 1:
        return Markup(
            "give{} the coefficients below; only one model was fitted, so the need for its terms was not tested."
        ).format(verb)
    name = model_html(outcome, outcome.chosen.structure.label)
    if outcome.selection.is_decided:
        return Markup("support{} one model of {}, <strong>{}</strong>.").format(verb, count, name)
    return Markup("favour{} <strong>{}</strong> among {} models, but do{} not decide.").format(
        verb, name, count, "es" if verb else ""
    )


def _predicts(outcome: Outcome) -> str:
    scored = [fit for fit in outcome.fits if fit.samples > 0 and not fit.missing]
    held_back = [fit for fit in scored if fit.held_back]
    if not scored:
        return "No measurement could be compared with it."
    shown = held_back or scored
    runs = len({fit.record for fit in shown})
    what = (
        f"{runs} held-back run{'s' * (runs > 1)}" if held_back else f"the run{'s' * (runs > 1)} that it was fitted to"
    )
    good = [fit.explained for fit in shown if fit.explained >= 0]
    worst = min(fit.explained for fit in shown)
    some = f" where it is not {WORSE_THAN_MEAN} ({worst:.0%} at worst)" if good and worst < 0 else ""
    parts = (
        f"It explains {_span(good, explained_text)} of the variance of {what}{some}"
        if good
        else f"It predicts {what} {explained_text(worst, runs)}"
    )
    end = "" if held_back else "; no held-back run tests it"
    return f"{parts}, and {_span([fit.coverage for fit in shown])} of the samples lie inside its 90 % band{end}."


def _span(shares: list[float], write: Callable[[float], str] = percent) -> str:
    """Return the least and largest as percentages."""
    low, high = (typeset(write(end)) for end in (min(shares), max(shares)))
    return low if low == high else f"{low.removesuffix(' %')}{DASH}{high}"


def _models(outcome: Outcome) -> list[dict[str, Any]]:
    """Return the most probable models with their probabilities."""
    selection = outcome.selection
    order = np.argsort(-selection.probability, kind="stable")
    first = [(selection.structures[index].label, float(selection.probability[index])) for index in order[:MAX_MODELS]]
    named = [(model_html(outcome, label), label, p) for label, p in first]
    if count := max(0, len(order) - MAX_MODELS):
        rest = float(selection.probability[order[MAX_MODELS:]].sum())
        named.append((Markup(f"{count} other model{'s' * (count > 1)}"), "", rest))
    if selection.outside:
        named.append((Markup("models that were screened out"), "", selection.outside))
    rows = [{"name": name, "label": label, "share": p, "probability": probability(p)} for name, label, p in named]
    return rows if len(order) > 1 else []


def _rows(outcome: Outcome) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return a row of each coefficient, and of each other parameter: those of the chosen model, and others that are not improbable."""
    quote = {row.name: row for row in (*outcome.summary.averaged, *outcome.summary.quote)}
    terms, inclusion = outcome.chosen.structure.terms, outcome.selection.inclusion
    own = outcome.chosen.names
    lacking = [name for name in quote if name not in own and inclusion.get(base_name(name), 0.0) >= RARE]
    vehicle = [*(name for name in own if base_name(name) in terms), *lacking]
    others = [name for name in own if name not in vehicle]
    return [_row(outcome, name, quote) for name in vehicle], [_row(outcome, name, quote) for name in others]


def _changes(outcome: Outcome) -> list[dict[str, Any]]:
    """Return a row of each coefficient that differs between configurations, and of each of its configurations but the first."""
    rows = []
    for one in outcome.summary.configuration_differences:
        name = configuration_name(one.name, one.second)
        factor, digits = factors_of(outcome)[name], digits_of(outcome)[name]
        label = label_html(labels_of(outcome)[name].partition("[")[0])
        change = digits.pair(factor * one.change, factor * one.sd)
        rows.append(
            {**unit_row(outcome, name), "label": label, "pair": f"{one.first} to {one.second}", "change": change}
        )
    return rows


def _other_values(outcome: Outcome) -> tuple[str, dict[str, tuple[float, float]]]:
    """Return the heading of the values that are not those to quote, and their means and standard deviations."""
    summary = outcome.summary
    if summary.quoted == "averaged":
        return "Chosen model", {row.name: (row.mean, row.sd) for row in summary.coefficients}
    return "Averaged", {row.name: (row.mean, row.sd) for row in summary.averaged}


def _row(outcome: Outcome, name: str, quote: Mapping[str, StoredAverage]) -> dict[str, Any]:
    """Return a row of the table: the value to quote, what its ± is made of, and the value of the other kind."""
    digits, factor, truth = digits_of(outcome)[name], factors_of(outcome)[name], truth_of(outcome)
    item, other = quote[name], _other_values(outcome)[1].get(name)
    is_quoted = any(row.name == name for row in outcome.summary.quote)
    outside = is_quoted and name in truth and not factor * item.lower_95 <= truth[name] <= factor * item.upper_95
    return {
        "name": name,
        **unit_row(outcome, name),
        "value": digits.pair(factor * item.mean, factor * item.sd) if is_quoted else "",
        "made_of": name_html(shares_text(item.shares, item.cause), labels_of(outcome)) if is_quoted else "",
        "other": digits.pair(factor * other[0], factor * other[1]) if other else "",
        "truth": digits.exact(truth[name]) if name in truth else "",
        "outside": bool(outside),
    }


def _sentences(outcome: Outcome, texts: list[str]) -> list[Markup]:
    """Print sentences, those that differ only in the parameter and its numbers as one, followed by the other names."""
    labels = labels_of(outcome)
    name = re.compile(
        "|".join(rf"(?<![\w.]){re.escape(name)}(?![\w\[])" for name in sorted(labels, key=len, reverse=True))
    )
    groups: dict[str, list[str]] = {}
    for text in texts:
        groups.setdefault(_NUMBER.sub("#", name.sub("§", text)), []).append(text)
    parts = []
    for first, *others in groups.values():
        names = [result for other in others if (result := tuple(dict.fromkeys(name.findall(other))))]
        listed = [Markup(" with ").join(label_html(labels[n]) for n in group) for group in dict.fromkeys(names)]
        likewise = Markup(" Likewise {}.").format(Markup(", ").join(listed)) if names else ""
        parts += (
            [sentence_of(outcome, first) + likewise]
            if len(names) == len(others)
            else [sentence_of(outcome, text) for text in (first, *others)]
        )
    return parts
