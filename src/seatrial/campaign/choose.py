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
from seatrial.sampling.target import Progress
from seatrial.sampling.tempered_smc import SMCResult, SMCSettings, sample_tempered_smc
from seatrial.selection.evidence import Evidence, combine_runs
from seatrial.selection.structures import Structure
from seatrial.selection.verdict import Selection, select


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
    table = campaign.source.selection
    settings = SMCSettings(particles=table.particles)
    posterior = build_posterior(campaign, structure, trials.fit)
    runs = []
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
    return combine_runs(runs)


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
