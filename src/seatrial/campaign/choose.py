"""Selection among the candidate structures: evidences with checkpointed repeats, probabilities, verdicts."""

from functools import partial
from typing import Any

import jax

from seatrial.campaign.config import Campaign
from seatrial.campaign.estimate import estimate_key
from seatrial.campaign.problem import build_posterior, random_key
from seatrial.campaign.screen import shortlist_of
from seatrial.campaign.store import (
    Store,
    is_current,
    key_of,
    load_checkpoint,
    read_json,
    save_checkpoint,
    write_stamped_json,
)
from seatrial.campaign.trials import Trials
from seatrial.campaign.watch import SILENT, Watch, run_side_by_side
from seatrial.core.errors import NumericalError
from seatrial.estimation.posterior import Posterior
from seatrial.sampling.target import Progress
from seatrial.sampling.tempered_smc import SMCResult, SMCSettings, sample_tempered_smc
from seatrial.selection.agreement import ALARM, FLOOR, SMALL, judge
from seatrial.selection.evidence import Evidence, combine_runs
from seatrial.selection.importance import importance_evidence
from seatrial.selection.structures import Structure
from seatrial.selection.verdict import Selection, select

CALLED = {"importance": "importance sampling", "smc": "tempered SMC"}
"""Methods of evidence as a sentence names them."""
BLUNT = 0.5
"""Joint error, nats, of a check: what it then still finds, 1.5 nats, moves odds between structures by a factor of four."""
MOST_REPEATS = 4
"""Repeats of tempered SMC at most, in those asked for."""


def select_structure(campaign: Campaign, trials: Trials, watch: Watch = SILENT) -> Selection:
    """Compute the evidence of every structure, side by side, and compare them; a current result is read."""
    store = Store(campaign.folder)
    keys, key = _keys(campaign, trials)
    if not is_current(store.selection, key):
        evidences = run_side_by_side(
            [
                partial(
                    _evidence,
                    campaign,
                    structure,
                    trials,
                    keys[structure.label],
                    watch.progress(f"evidence {structure.label}: {' '.join(structure.terms)}"),
                )
                for structure in campaign.structures
            ]
        )
        write_stamped_json(
            store.selection,
            _as_json(campaign, _select(campaign, trials, evidences)),
            key,
        )
        for path in store.checkpoint("evidence").parent.glob("evidence-*.npz"):
            path.unlink()
    return _read(campaign, trials)


def current_selection(campaign: Campaign, trials: Trials) -> Selection | None:
    """The selection if it has been made and is current; nothing is computed."""
    return _read(campaign, trials) if is_current(Store(campaign.folder).selection, _keys(campaign, trials)[1]) else None


def agreement_words(evidence: Evidence) -> str:
    """Which methods gave this evidence, and which of them agree."""
    table = evidence.diagnostics["methods"]
    value = next((name for name, one in table.items() if not one["status"]), next(iter(table)))
    others = {name: one for name, one in table.items() if name != value and not one["status"]}
    agree = [
        f"{CALLED.get(name, name)} ({abs(one['joint_errors']):.1f} joint errors away)"
        for name, one in others.items()
        if abs(one["joint_errors"]) <= ALARM or abs(one["difference"]) <= FLOOR
    ]
    said = f"by {CALLED.get(value, value)}, " + (
        f"with which {' and '.join(agree)} agree{'s' * (len(agree) == 1)}"
        if agree
        else "which no other method confirms"
    )
    return f"{said}; {evidence.status}" if evidence.status else said


def evidence_key(campaign: Campaign, structure: Structure, trials: Trials) -> str:
    """Key of one structure's evidence."""
    return key_of("evidence", estimate_key(campaign, structure, trials), campaign.source.selection.model_dump())


def _keys(campaign: Campaign, trials: Trials) -> tuple[dict[str, str], str]:
    """Keys of the evidences by structure, and of them all."""
    keys = {structure.label: evidence_key(campaign, structure, trials) for structure in campaign.structures}
    return keys, key_of("selection", keys)


def _read(campaign: Campaign, trials: Trials) -> Selection:
    stored = read_json(Store(campaign.folder).selection, f"seatrial select {campaign.folder}")
    evidences = [Evidence(**item["evidence"]) for item in stored["structures"]]
    return _select(campaign, trials, evidences)


def _select(campaign: Campaign, trials: Trials, evidences: list[Evidence]) -> Selection:
    shortlist = shortlist_of(campaign, trials)
    return select(campaign.structures, evidences, campaign.source.structure.optional, shortlist)


def _evidence(campaign: Campaign, structure: Structure, trials: Trials, key: str, progress: Progress) -> Evidence:
    """By importance sampling about the mode, checked by tempered SMC from the prior: they share no code."""
    posterior = build_posterior(campaign, structure, trials.fit)
    runs = _smc_runs(campaign, structure, posterior, key, progress)
    evidences, failed = {"smc": combine_runs(runs)}, {}
    if posterior.dim <= SMALL:
        try:
            weighed = importance_evidence(posterior, random_key(campaign, f"importance {structure.terms}"))
            evidences = {"importance": weighed} | evidences
        except NumericalError as error:
            failed["importance"] = str(error)
    return judge(evidences, failed, blunt=BLUNT)


def _smc_runs(
    campaign: Campaign, structure: Structure, posterior: Posterior, key: str, progress: Progress
) -> list[SMCResult]:
    """Independent repeats, each kept on disk until the selection is written; more than asked for while they check too bluntly."""
    table, runs = campaign.source.selection, []
    settings = SMCSettings(particles=table.particles)
    for repeat in range(MOST_REPEATS * table.repeats):
        if repeat >= table.repeats and combine_runs(runs).std_error <= BLUNT:
            break
        total_runs = max(table.repeats, repeat + 1)
        checkpoint = Store(campaign.folder).checkpoint(f"evidence-{structure.label}-{repeat}")
        stored = load_checkpoint(checkpoint, key)
        if stored is None:
            run = sample_tempered_smc(
                posterior,
                jax.random.fold_in(random_key(campaign, f"evidence {structure.terms}"), repeat),
                settings,
                lambda done, total, r=repeat, n=total_runs: progress(r * total + done, n * total),
            )
            save_checkpoint(checkpoint, key, run._asdict())
        else:
            run = SMCResult(**{name: value if value.ndim else float(value) for name, value in stored.items()})
        runs.append(run)
        progress(repeat + 1, total_runs)
    return runs


def structure_rows(selection: Selection) -> list[dict[str, Any]]:
    """Each structure with its terms, evidence and probability."""
    return [
        {
            "label": structure.label,
            "terms": list(structure.terms),
            "evidence": evidence.__dict__,
            "probability": float(probability),
            "probability_error": float(error),
        }
        for structure, evidence, probability, error in zip(
            selection.structures, selection.evidences, selection.probability, selection.probability_error, strict=True
        )
    ]


def _as_json(campaign: Campaign, selection: Selection) -> dict:
    return {
        "structures": structure_rows(selection),
        "inclusion": dict(selection.inclusion),
        "inclusion_error": dict(selection.inclusion_error),
        "chosen": selection.structures[selection.chosen].label,
        "verdicts": list(selection.verdicts),
    }
