"""Selection among the candidate structures: evidences with checkpointed repeats, probabilities, verdicts."""

from functools import partial
from typing import Any

import jax

from seatrial.campaign.config import Campaign
from seatrial.campaign.estimate import estimate_key
from seatrial.campaign.problem import build_posterior, random_key
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
from seatrial.selection.agreement import SMALL, judge
from seatrial.selection.evidence import Evidence, combine_runs
from seatrial.selection.importance import importance_evidence
from seatrial.selection.structures import Structure
from seatrial.selection.verdict import Selection, select

BLUNT = 0.5
"""Joint error, nats, of a check: what it then still finds, 1.5 nats, moves odds between structures by a factor of four."""


def select_structure(campaign: Campaign, trials: Trials, watch: Watch = SILENT) -> Selection:
    """Compute the evidence of every structure, side by side, and compare them; a current result is read."""
    store = Store(campaign.folder)
    keys = {structure.label: evidence_key(campaign, structure, trials) for structure in campaign.structures}
    key = key_of("selection", keys)
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
            _as_json(campaign, select(campaign.structures, evidences, campaign.source.structure.optional)),
            key,
        )
        for path in store.checkpoint("evidence").parent.glob("evidence-*.npz"):
            path.unlink()
    stored = read_json(store.selection, f"seatrial select {campaign.folder}")
    evidences = [Evidence(**item["evidence"]) for item in stored["structures"]]
    return select(campaign.structures, evidences, campaign.source.structure.optional)


def evidence_key(campaign: Campaign, structure: Structure, trials: Trials) -> str:
    """Key of one structure's evidence."""
    return key_of("evidence", estimate_key(campaign, structure, trials), campaign.source.selection.model_dump())


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
    """Independent repeats, each kept on disk until the selection is written."""
    table, runs = campaign.source.selection, []
    settings = SMCSettings(particles=table.particles)
    for repeat in range(table.repeats):
        checkpoint = Store(campaign.folder).checkpoint(f"evidence-{structure.label}-{repeat}")
        stored = load_checkpoint(checkpoint, key)
        if stored is None:
            run = sample_tempered_smc(
                posterior,
                jax.random.fold_in(random_key(campaign, f"evidence {structure.terms}"), repeat),
                settings,
                lambda done, total, r=repeat: progress(r * total + done, table.repeats * total),
            )
            save_checkpoint(checkpoint, key, run._asdict())
        else:
            run = SMCResult(**{name: value if value.ndim else float(value) for name, value in stored.items()})
        runs.append(run)
        progress(repeat + 1, table.repeats)
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
