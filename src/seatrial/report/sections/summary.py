"""Title, the answer in one sentence, the numbers at a glance, what the data say; and how it was computed."""

import json
import re
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup

from seatrial.campaign.inference.baselines import comparison_alarms
from seatrial.campaign.inference.predict import held_back_alarms
from seatrial.campaign.store.stored_result import FILE_NAME, Store
from seatrial.campaign.workflow.next_trial import ENOUGH
from seatrial.campaign.workflow.outcome import Outcome
from seatrial.core.display_units import shown_unit
from seatrial.core.files import is_there
from seatrial.manoeuvres.shapes import SHAPES
from seatrial.report.drawing import labels_of
from seatrial.report.labels import label_html, sentence_html
from seatrial.report.numbers import DASH, percent, probability, short, unit_html, with_sd
from seatrial.sampling.diagnostics import MAX_R_HAT, MIN_ESS
from seatrial.selection.verdict import DECIDED

MOST_NAMED = 4
MOST_SAID = 5
_NUMBER = re.compile(r"(?<![-\w])\d+(\.\d+)?")
LIKELIHOODS = {
    "output-error": "free simulation (output error)",
    "filter-error": "simulation corrected by a filter at every sample (filter error)",
}
SAMPLERS = {
    "independence-metropolis": "fresh draws and a random walk, as they are accepted (independence Metropolis)",
    "adaptive-metropolis": "adaptive Metropolis",
    "metropolis": "Metropolis, one parameter at a time",
    "de-metropolis": "differential evolution Metropolis",
    "nuts": "No-U-Turn sampler",
}


class Conclusion(NamedTuple):
    """One sentence of the summary; `kind` is alarm, finding or caution."""

    kind: str
    text: Markup


def summary_section(outcome: Outcome) -> dict[str, Any]:
    """Return what `summary.html` prints."""
    findings = find(outcome)
    alarms = [item for item in findings if item.kind == "alarm"]
    return {
        "name": outcome.campaign.name,
        "answer": answer(outcome),
        "glance": glance(outcome),
        "alarms": alarms[:MOST_SAID],
        "more_alarms": alarms[MOST_SAID:],
        "findings": [item for item in findings if item.kind == "finding"],
        "cautions": [item for item in findings if item.kind == "caution"],
    }


def answer(outcome: Outcome) -> Markup:
    """Say in one sentence what was found, or that nothing may be used yet."""
    alarms = outcome.summary["alarms"]
    unseen = comparison_alarms(outcome.compared) + held_back_alarms(outcome.fits, outcome.pooled)
    if unseen:
        others = len(alarms) - len(unseen)
        more = Markup(" {} failed too.").format(f"{others} health check{'s' * (others != 1)}") if others else Markup("")
        first = sentence_html(unseen[0], labels_of(outcome))
        return Markup("The model fails on runs that it was not fitted to. {}.{}").format(first, more)
    if alarms:
        checks = "health check" if len(alarms) == 1 else "health checks"
        return Markup("Do not use these numbers yet: {} {} failed, as said below.").format(len(alarms), checks)
    rows = [row for row in outcome.summary["coefficients"] if row["name"] in outcome.chosen.structure.terms]
    if len(rows) > MOST_NAMED:
        share, label = max((row["sd"] / max(abs(row["mean"]), 1e-300), row["label"]) for row in rows)
        said = Markup("{} coefficients, the least certain of which, {}, is known to {}").format(
            len(rows), label_html(label), percent(share)
        )
    else:
        said = _enumerate([coefficient(row) for row in rows])
    return Markup("{} {} {}{}.").format(
        _basis(outcome), "give" if _basis(outcome)[0].isdigit() else "gives", said, _certainty(outcome)
    )


def coefficient(row: dict[str, Any]) -> Markup:
    """Write one coefficient as an equation: symbol, value, standard deviation and unit."""
    number = with_sd(row["mean"], row["sd"])
    unit = "" if row["unit"] in ("", "1") else Markup("\u202f") + unit_html(row["unit"])
    return Markup('<span class="together">{} = {}{}</span>').format(label_html(row["label"]), number, unit)


def find(outcome: Outcome) -> list[Conclusion]:
    """Alarms, then verdicts, then cautions; what is said of the chosen structure first, and once for many parameters."""
    labels, summary = labels_of(outcome), outcome.summary
    chosen = outcome.chosen.structure.label
    alarms = sorted(
        summary["alarms"],
        key=lambda text: (
            not text.startswith("held-back"),
            not text.startswith("the evidence"),
            f"{chosen}: " not in text,
        ),
    )
    verdicts = list(summary["verdicts"])
    if len(outcome.campaign.structures) == 1:
        verdicts.append("only one model was compared: whether its terms are needed was not asked")
    said = [("alarm", alarms), ("finding", verdicts), ("caution", summary["cautions"])]
    return [Conclusion(kind, text) for kind, texts in said for text in _sentences(texts, labels)]


def glance(outcome: Outcome) -> list[dict[str, Any]]:
    """Return a few numbers with their names, each with a link to where they come from."""
    selection, trials = outcome.selection, outcome.trials
    scored = [fit for fit in outcome.fits if fit.samples > 0 and not fit.missing]
    held_back = [fit for fit in scored if fit.held_back]
    seconds = sum(float(record.time[-1] - record.time[0]) for record in trials.fit)
    simulated = outcome.campaign.imports is None
    at = selection.chosen
    certainty = probability(selection.probability[at], selection.probability_error[at])
    return [
        {
            "name": "Data",
            "value": f"{len(trials.fit)} run{'s' * (len(trials.fit) != 1)}, {seconds:.0f} s",
            "href": "#fit",
            "note": "simulated" if simulated else f"{len(trials.predict) or 'none'} held back for testing",
        },
        {
            "name": "Model",
            "value": outcome.chosen.structure.label,
            "href": "#models",
            "note": f"probability {certainty} among {len(selection.structures)} models",
        },
        {
            "name": "Held-back motion explained" if held_back else "Fitted motion explained",
            "href": "#fit",
            "value": _explained([fit.explained for fit in held_back or scored]),
            "note": f"{_span([fit.coverage for fit in held_back or scored])} of samples inside the 90 % band"
            if scored
            else "nothing was measured that could be compared",
        },
        _next(outcome),
    ]


def method_section(outcome: Outcome) -> dict[str, Any]:
    """What `method.html` prints."""
    campaign = outcome.campaign
    estimation, selection = campaign.estimation, campaign.selection
    measured = outcome.filter["n_measured"].values
    ratio = float(outcome.filter["nis"].values[measured > 0].sum() / max(measured.sum(), 1))
    return {
        "seed": campaign.seed,
        "vehicle": campaign.hull.name,
        "methods": _methods(outcome),
        "health": [_health(outcome, index) for index in range(len(outcome.estimates))],
        "likelihood": LIKELIHOODS[estimation.likelihood],
        "sampler": SAMPLERS[estimation.sampler],
        "chains": estimation.chains,
        "warmup": estimation.warmup,
        "draws": estimation.draws,
        "residuals": estimation.residuals,
        "initial": estimation.initial,
        "particles": selection.particles,
        "repeats": selection.repeats,
        "importance_draws": selection.draws,
        "filter": outcome.filter.attrs["filter"],
        "failures": int(outcome.filter.attrs["failures"]),
        "nis": short(ratio),
        "max_r_hat": MAX_R_HAT,
        "min_ess": f"{MIN_ESS:.0f}",
        "records": [_provenance(record) for record in (*outcome.trials.fit, *outcome.trials.predict)],
        "files": _files(outcome),
        "mass": campaign.hull.mass,
    }


def _next(outcome: Outcome) -> dict[str, Any]:
    trial = outcome.summary["next_trial"]
    if held_back_alarms(outcome.fits, outcome.pooled):
        note = "the model fails on runs that it was not fitted to: mend it first"
        return {"name": "Next trial", "value": "none yet", "href": "#next", "note": note}
    if trial["gain_nat"] < ENOUGH:
        return {
            "name": "Next trial",
            "value": "another kind",
            "href": "#next",
            "note": "this family of designs would teach little",
        }
    factor, unit = shown_unit(trial["control"])
    left = [
        after / before for after, before in zip(trial["sd_after"].values(), trial["sd_before"].values(), strict=True)
    ]
    return {
        "name": "Next trial",
        "value": f"{SHAPES[trial['family']].sides}{trial['amplitude'] * factor:.4g} {unit}, {trial['period']:.3g} s",
        "href": "#next",
        "note": f"{trial['family'].replace('-', ' ')}; standard deviations shrink to {_span(left)} of now",
    }


def _span(shares: list[float]) -> str:
    """Return the least and largest as percentages; a dash where there are none."""
    if not shares:
        return DASH
    low, high = percent(min(shares)), percent(max(shares))
    return low if low == high else f"{low.removesuffix(' %')}{DASH}{high}"


def _explained(shares: list[float]) -> str:
    """Return the least and largest share explained; runs below nothing are counted, since a percentage of theirs misleads."""
    worse = sum(share < 0 for share in shares)
    if not worse:
        return _span(shares)
    if worse == len(shares):
        return "worse than their own mean"
    return f"{_span([share for share in shares if share >= 0])}; {worse} worse than {'their' if worse > 1 else 'its'} own mean"


def _basis(outcome: Outcome) -> str:
    trials = outcome.trials
    seconds = sum(float(record.time[-1] - record.time[0]) for record in trials.fit)
    if outcome.campaign.imports is None:
        return f"One simulated trial of {seconds:.0f} s"
    return f"{len(trials.fit)} runs of {seconds:.0f} s in all" if len(trials.fit) > 1 else f"One run of {seconds:.0f} s"


def _certainty(outcome: Outcome) -> Markup:
    selection = outcome.selection
    if len(selection.structures) == 1:
        return Markup("")
    p, error = (float(column[selection.chosen]) for column in (selection.probability, selection.probability_error))
    if p >= DECIDED:
        return Markup("; the data support this model with probability {}").format(probability(p, error))
    return Markup("; this model is the most probable of {}, but at {} not settled").format(
        len(selection.structures), probability(p, error)
    )


def _enumerate(parts: list[Markup]) -> Markup:
    return parts[0] if len(parts) == 1 else Markup(", ").join(parts[:-1]) + Markup(" and ") + parts[-1]


def _sentences(texts: list[str], labels: dict[str, str]) -> list[Markup]:
    """Print sentences, those that differ only in the parameter and its numbers as one, followed by the other names."""
    name = re.compile(
        "|".join(rf"(?<![\w.]){re.escape(name)}(?![\w\[])" for name in sorted(labels, key=len, reverse=True))
    )
    groups: dict[str, list[str]] = {}
    for text in texts:
        groups.setdefault(_NUMBER.sub("#", name.sub("§", text)), []).append(text)
    said = []
    for first, *others in groups.values():
        names = [result for other in others if (result := tuple(dict.fromkeys(name.findall(other))))]
        listed = [Markup(" with ").join(label_html(labels[n]) for n in group) for group in dict.fromkeys(names)]
        likewise = Markup(" Likewise {}.").format(Markup(", ").join(listed)) if names else ""
        said += (
            [sentence_html(first, labels) + likewise]
            if len(names) == len(others)
            else [sentence_html(text, labels) for text in (first, *others)]
        )
    return said


def _health(outcome: Outcome, index: int) -> dict[str, Any]:
    estimate, evidence = outcome.estimates[index], outcome.selection.evidences[index]
    data, result = estimate.data, evidence.diagnostics["methods"]
    worst = int(np.argmax(np.nan_to_num(data["r_hat"].values, nan=np.inf)))
    r_hat, ess = (
        float(data["r_hat"].values[worst]),
        float(min(data["ess_bulk"].values.min(), data["ess_tail"].values.min())),
    )
    return {
        "label": estimate.structure.label,
        "chosen": index == outcome.selection.chosen,
        "r_hat": f"{r_hat:.3f}",
        "worst": estimate.names[worst],
        "r_hat_bad": not r_hat <= MAX_R_HAT,
        "ess": f"{ess:.0f}",
        "ess_bad": not ess >= MIN_ESS,
        "geweke": f"{float(np.max(data['geweke'].values)):.2f}",
        "acceptance": percent(float(data.attrs["acceptance"])),
        "laplace": f"{float(data.attrs['laplace_log_evidence']):.1f}",
        "evidences": [
            f"{one['log_value']:.2f} ± {one['std_error']:.2f}" if (one := result.get(name)) else "–"
            for name in _methods(outcome)
        ],
        "apart": short(max(abs(one["joint_errors"]) for one in result.values()), 2),
        "evidence_bad": bool(evidence.status),
    }


def _methods(outcome: Outcome) -> list[str]:
    """Return every method that gave an evidence of some structure."""
    tables = [evidence.diagnostics["methods"] for evidence in outcome.selection.evidences]
    return list(dict.fromkeys(name for table in tables for name in table))


def _provenance(record: Any) -> dict[str, Any]:
    provenance = record.provenance
    return {
        "label": record.label,
        "source": provenance.source,
        "sha256": provenance.sha256,
        "options": json.dumps(dict(provenance.options), indent=2, sort_keys=True, ensure_ascii=False, default=str),
    }


def _runs(outcome: Outcome) -> list[str]:
    """Return the labels of the records as they are stored, of which trials may be pieces."""
    trials = (*outcome.trials.fit, *outcome.trials.predict)
    cut = [
        record.label.rpartition(".")[0] if "piece" in record.provenance.options else record.label for record in trials
    ]
    return list(dict.fromkeys(cut))


def _files(outcome: Outcome) -> list[tuple[str, str]]:
    """Return the files that exist, relative to the campaign's folder, and what they hold."""
    store = Store(outcome.campaign.folder)
    folder = outcome.campaign.folder
    listed = [
        (folder / FILE_NAME, "what was known, asked and allowed"),
        *((store.record(run), f"record {run}") for run in _runs(outcome)),
        (store.design, "designs swept for the trial"),
        (store.schedule(store.design), "control of the trial over time, its unit in the header"),
        *(
            (store.posterior(estimate.structure.label), f"draws of {estimate.structure.label}")
            for estimate in outcome.estimates
        ),
        *(
            (store.known(estimate.structure.label), f"what is known of {estimate.structure.label}, alone and together")
            for estimate in outcome.estimates
        ),
        (store.selection, "evidences, probabilities and verdicts"),
        (store.filter, "filter traces"),
        (store.predictions, "fitted and predicted records"),
        (store.next_design, "designs swept for the next trial"),
        (store.schedule(store.next_design), "control of the next trial over time, its unit in the header"),
        (store.summary, "everything above in numbers, SI"),
    ]
    return [(path.relative_to(folder).as_posix(), words) for path, words in listed if is_there(path)]
