"""How it was computed: settings, the health of every posterior and evidence, where the data came from, and the files."""

import json
from typing import Any

import numpy as np

from seatrial.campaign.store.stored_result import FILE_NAME, Store
from seatrial.campaign.workflow.outcome import Outcome
from seatrial.core.files import is_there
from seatrial.report.drawing import model_html
from seatrial.report.numbers import percent, short
from seatrial.sampling.diagnostics import MAX_R_HAT, MIN_ESS
from seatrial.selection.method_agreement import METHOD_LABELS, value_of

LIKELIHOODS = {
    "output-error": "free simulation (output error)",
    "filter-error": "simulation corrected by a filter at every sample (filter error)",
}
SAMPLERS = {
    "independence-metropolis": "independence Metropolis: independent draws and a random walk in turn",
    "adaptive-metropolis": "adaptive Metropolis",
    "metropolis": "Metropolis, one parameter at a time",
    "de-metropolis": "differential evolution Metropolis",
    "nuts": "No-U-Turn sampler",
}


def method_section(outcome: Outcome) -> dict[str, Any]:
    """What `method.html` prints."""
    campaign = outcome.campaign
    estimation = campaign.estimation
    measured = outcome.filter["n_measured"].values
    ratio = float(outcome.filter["nis"].values[measured > 0].sum() / max(measured.sum(), 1))
    return {
        "seed": campaign.seed,
        "vehicle": campaign.hull.name,
        "methods": [METHOD_LABELS[name] for name in _methods(outcome)],
        "health": [_health(outcome, index) for index in range(len(outcome.estimates))],
        "likelihood": LIKELIHOODS[estimation.likelihood],
        "sampler": SAMPLERS[estimation.sampler],
        "estimation": estimation,
        "selection": campaign.selection,
        "filter": outcome.filter.attrs["filter"],
        "failures": int(outcome.filter.attrs["failures"]),
        "nis": short(ratio),
        "max_r_hat": MAX_R_HAT,
        "min_ess": f"{MIN_ESS:.0f}",
        "records": [_provenance(record) for record in (*outcome.trials.fit, *outcome.trials.predict)],
        "files": _files(outcome),
        "mass": campaign.hull.mass,
    }


def _health(outcome: Outcome, index: int) -> dict[str, Any]:
    estimate, evidence = outcome.estimates[index], outcome.selection.evidences[index]
    data, result = estimate.data, evidence.diagnostics["methods"]
    worst = int(np.argmax(np.nan_to_num(data["r_hat"].values, nan=np.inf)))
    r_hat, ess = (
        float(data["r_hat"].values[worst]),
        float(min(data["ess_bulk"].values.min(), data["ess_tail"].values.min())),
    )
    # In joint errors; a dash where no other method is healthy.
    value = value_of(result)
    others = [abs(one["joint_errors"]) for name, one in result.items() if name != value and not one["status"]]
    return {
        "model": model_html(outcome, estimate.structure.label),
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
        "apart": (short(min(others), 2) if others else "–"),
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


def _files(outcome: Outcome) -> list[tuple[str, str]]:
    """Return the files that exist, relative to the campaign's folder, and what they hold."""
    store = Store(outcome.campaign.folder)
    folder, labels = outcome.campaign.folder, [estimate.structure.label for estimate in outcome.estimates]
    # Trials may be pieces of a record.
    trials = (*outcome.trials.fit, *outcome.trials.predict)
    cut = [
        record.label.rpartition(".")[0] if "piece" in record.provenance.options else record.label for record in trials
    ]
    listed = [
        (folder / FILE_NAME, "the campaign file: vehicle, priors, goals and limits"),
        *((store.record(run), f"record {run}") for run in list(dict.fromkeys(cut))),
        (store.design, "compared designs of the trial"),
        (store.schedule(store.design), "control of the trial over time, its unit in the header"),
        *((store.posterior(label), f"draws of {label}") for label in labels),
        *((store.known(label), f"standard deviations and known combinations of {label}") for label in labels),
        (store.selection, "evidences, probabilities and verdicts"),
        (store.filter, "filter traces"),
        (store.predictions, "fitted and predicted records"),
        (store.next_design, "compared designs of the next trial"),
        (store.schedule(store.next_design), "control of the next trial over time, its unit in the header"),
        (store.summary, "everything above in numbers, SI"),
    ]
    return [(path.relative_to(folder).as_posix(), words) for path, words in listed if is_there(path)]
