"""Selection among the candidate structures: evidences with checkpointed repeats, probabilities, verdicts."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from seatrial.campaign.compute.place import workers_of
from seatrial.campaign.compute.study import Study
from seatrial.campaign.config import Campaign
from seatrial.campaign.estimate import estimate_key
from seatrial.campaign.problem import random_key
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
from seatrial.campaign.watch import SILENT, Watch
from seatrial.core.errors import NumericalError
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
FINE = 1000
"""Steps in which a repeat is shown."""


def select_structure(campaign: Campaign, trials: Trials, watch: Watch = SILENT) -> Selection:
    """Compute the evidence of every structure, side by side, and compare them; a current result is read."""
    store = Store(campaign.folder)
    keys, key = _keys(campaign, trials)
    if not is_current(store.selection, key):
        evidences = _evidences(campaign, trials, keys, watch)
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


class _Part(NamedTuple):
    """Part of the evidence of one structure: a repeat of tempered SMC, or importance sampling where no repeat is given."""

    structure: Structure
    repeat: int | None


class _Run(NamedTuple):
    """One repeat, as arrays by name."""

    repeat: int
    arrays: dict[str, np.ndarray]


class _Weighed(NamedTuple):
    """Evidence by importance sampling; None where it failed, and why, or where there are too many parameters for it."""

    evidence: Evidence | None
    failure: str | None = None


def _evidences(campaign: Campaign, trials: Trials, keys: Mapping[str, str], watch: Watch) -> list[Evidence]:
    """By importance sampling about the mode, checked by tempered SMC from the prior: they share no code."""
    repeats = [_Repeats(campaign, one, keys[one.label], watch) for one in campaign.structures]
    of = {one.structure.label: one for one in repeats}
    weighed: dict[str, _Weighed] = {}
    parts = [part for one in repeats for part in (*one.missing(), _Part(one.structure, None))]

    def done(index: int, result: _Run | _Weighed) -> _Part | None:
        label = parts[index].structure.label
        if isinstance(result, _Weighed):
            weighed[label] = result
            return None
        of[label].keep(result)
        return next(iter(of[label].following()), None)

    def told(index: int, done: int, total: int) -> None:
        part = parts[index]
        if part.repeat is not None:
            of[part.structure.label].told(part.repeat, done / total)

    workers_of(campaign, watch).run(_compute, Study(campaign, trials.fit), parts, done, told)
    return [_judged(of[one.label].in_order(), weighed[one.label]) for one in campaign.structures]


def _judged(runs: list[SMCResult], weighed: _Weighed) -> Evidence:
    first = {} if weighed.evidence is None else {"importance": weighed.evidence}
    failed = {} if weighed.failure is None else {"importance": weighed.failure}
    return judge(first | {"smc": combine_runs(runs)}, failed, blunt=BLUNT)


def _compute(study: Study, part: _Part, report: Progress) -> _Run | _Weighed:
    """One part of an evidence."""
    campaign, posterior = study.campaign, study.posterior(part.structure)
    if part.repeat is not None:
        key = jax.random.fold_in(random_key(campaign, f"evidence {part.structure.terms}"), part.repeat)
        settings = SMCSettings(particles=campaign.source.selection.particles)
        run = sample_tempered_smc(posterior, key, settings, report)
        return _Run(part.repeat, {name: np.asarray(value) for name, value in run._asdict().items()})
    if posterior.dim > SMALL:
        return _Weighed(None)
    try:
        return _Weighed(importance_evidence(posterior, random_key(campaign, f"importance {part.structure.terms}")))
    except NumericalError as error:
        return _Weighed(None, str(error))


class _Repeats:
    """Repeats for one structure, kept on disk until the selection is written; more than asked for while they check too bluntly."""

    def __init__(self, campaign: Campaign, structure: Structure, key: str, watch: Watch):
        self.campaign, self.structure, self.key = campaign, structure, key
        self.asked = campaign.source.selection.repeats
        self.runs: dict[int, SMCResult] = {}
        self.shares = np.zeros(MOST_REPEATS * self.asked)
        self.progress = watch.progress(f"evidence {structure.label}: {' '.join(structure.terms)}")
        for repeat in range(MOST_REPEATS * self.asked):
            if (stored := load_checkpoint(self._checkpoint(repeat), key)) is not None:
                self._add(_Run(repeat, stored))

    def missing(self) -> list[_Part]:
        """Those asked for that are not there, or else what follows them."""
        missing = [_Part(self.structure, repeat) for repeat in range(self.asked) if repeat not in self.runs]
        return missing or self.following()

    def following(self) -> list[_Part]:
        """One more once all so far are there, if they check too bluntly and may be more."""
        there = len(self.in_order())
        if not self.asked <= there < MOST_REPEATS * self.asked or combine_runs(self.in_order()).std_error <= BLUNT:
            return []
        return [_Part(self.structure, there)]

    def in_order(self) -> list[SMCResult]:
        """The repeats up to the first that is not there, or the first at which they check sharply enough."""
        runs: list[SMCResult] = []
        while len(runs) in self.runs:
            if len(runs) >= self.asked and combine_runs(runs).std_error <= BLUNT:
                break
            runs.append(self.runs[len(runs)])
        return runs

    def keep(self, run: _Run) -> None:
        """Add a repeat, also on disk."""
        save_checkpoint(self._checkpoint(run.repeat), self.key, run.arrays)
        self._add(run)

    def told(self, repeat: int, share: float) -> None:
        """Show how much of a repeat is done."""
        self.shares[repeat] = share
        count = max(self.asked, 1 + int(np.flatnonzero(self.shares).max(initial=0)))
        self.progress(round(float(FINE * self.shares[:count].sum())), FINE * count)

    def _add(self, run: _Run) -> None:
        self.runs[run.repeat] = SMCResult(
            **{name: value if value.ndim else float(value) for name, value in run.arrays.items()}
        )
        self.told(run.repeat, 1.0)

    def _checkpoint(self, repeat: int) -> Path:
        return Store(self.campaign.folder).checkpoint(f"evidence-{self.structure.label}-{repeat}")


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
