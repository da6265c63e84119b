"""Selection among the candidate structures: evidences with checkpointed repeats, probabilities, verdicts."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from seatrial.campaign.compute.place import workers_of
from seatrial.campaign.compute.shared_work import Study
from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.inference.estimate import estimate_key
from seatrial.campaign.inference.model_error import stated_errors
from seatrial.campaign.inference.modes import all_modes
from seatrial.campaign.inference.posterior import widest
from seatrial.campaign.selection.screening import prior_in_key, shortlist_of
from seatrial.campaign.store.estimates import HasKey
from seatrial.campaign.store.stored_result import Store, StoredResult, as_json, key_of, load_checkpoint, save_checkpoint
from seatrial.compiled.random_keys import random_key
from seatrial.core.argument_checks import check_kind
from seatrial.core.reporter import SILENT, Progress, Reporter
from seatrial.estimation.diagnostics.error_evidence import log_evidence_gains
from seatrial.estimation.posterior.mode import Mode
from seatrial.sampling.nested import NestedRun
from seatrial.sampling.tempered_smc import SMCResult, SMCSettings
from seatrial.selection.compare import decide
from seatrial.selection.evidence import EvidenceSettings
from seatrial.selection.log_evidence import (
    NESTED_RUNS,
    PROGRESS_STEPS,
    EvidenceRun,
    EvidenceSchedule,
    EvidenceTask,
    Keys,
    MethodResult,
    run_task,
)
from seatrial.selection.method_agreement import Method
from seatrial.selection.structures import Structure
from seatrial.selection.verdict import Evidence, Selection, select


def select_structure(campaign: Campaign, trials: Trials, reporter: Reporter = SILENT) -> Selection:
    """Compute the evidence of every structure, side by side, and compare them; a current result is read.

    Args:
        campaign: configuration.
        trials: records, of `get_trials`.
        reporter: receives the progress.

    Returns:
        the probability of every structure and of every optional term, the most probable structure, and verdicts in words.

    Raises:
        InputError: no campaign, or no trials.
        NumericalError: an evidence that cannot be computed.
    """
    check_kind(campaign, Campaign, "campaign", "read it with `load_campaign`")
    check_kind(trials, Trials, "trials", "make them with `get_trials`")

    def compute() -> Selection:
        evidences, shortlist = _evidences(campaign, trials, reporter), shortlist_of(campaign, trials)
        optional, prior = campaign.structure.optional, campaign.selection.structure_prior
        return select(campaign.structures, evidences, optional, shortlist, prior)

    selection = stored_selection(campaign, trials).read_or_make(compute)
    # Also where it was there already: a kill may have come between writing it and this.
    for path in Store(campaign.folder).checkpoint("evidence").parent.glob("evidence-*.npz"):
        path.unlink()
    return selection


def current_selection(campaign: Campaign, trials: Trials) -> Selection | None:
    """The selection if it has been made and is current; nothing is computed."""
    kept = stored_selection(campaign, trials)
    return kept.read() if kept.is_current() else None


def evidence_key(campaign: Campaign, structure: Structure, trials: HasKey) -> str:
    """Key of one structure's evidence, which does not depend on the prior of the structures."""
    name = (
        "evidence about all modes, checked as sharply as it decides with every error"
        if len(campaign.structures) > 1
        else "evidence about all modes"
    )
    effort = {key: value for key, value in as_json(campaign.selection).items() if key != "structure_prior"}
    return key_of(name, estimate_key(campaign, structure, trials), effort)


def stored_selection(campaign: Campaign, trials: HasKey) -> StoredResult[Selection]:
    """Return where the selection is kept, and what it depends on."""
    keys = {structure.label: evidence_key(campaign, structure, trials) for structure in campaign.structures}
    path, key = Store(campaign.folder).selection, key_of("selection with every error" + prior_in_key(campaign), keys)
    return StoredResult(path, key, Selection, f"seatrial select {campaign.folder}")


class _StructureTask(NamedTuple):
    """Task of the evidence of one structure."""

    structure: Structure
    task: EvidenceTask


def _evidences(campaign: Campaign, trials: Trials, reporter: Reporter) -> list[Evidence]:
    """All tasks of all evidences side by side, until they are as sharp as the decisions need them (`decide`).

    What is decided follows from results alone, also in a run that is resumed: its checkpoints must not change its outcome.
    """
    study = Study(campaign, trials.fit)
    known, workers = all_modes(study, trials, reporter), workers_of(campaign, reporter)
    stored = [
        _StoredSchedule(campaign, one, known.of(one), evidence_key(campaign, one, trials), reporter)
        for one in campaign.structures
    ]
    by_label = {one.structure.label: one for one in stored}

    def run(places: Sequence[int]) -> None:
        tasks = [_StructureTask(stored[place].structure, task) for place in places for task in stored[place].begin()]

        def done(index: int, result: EvidenceRun | MethodResult) -> _StructureTask | None:
            structure = tasks[index].structure
            following = by_label[structure.label].add(result)
            if following is None:
                return None
            tasks[index] = _StructureTask(structure, following)
            by_label[structure.label].show(following, 0.0)
            return tasks[index]

        def on_progress(index: int, done: int, total: int) -> None:
            by_label[tasks[index].structure.label].show(tasks[index].task, done / total)

        workers.run(_compute, study, [*tasks], done, on_progress)

    gains = None
    if len(stored) > 1:
        modes = [next(iter(known.of(one)), None) for one in campaign.structures]
        posteriors = [study.posterior(one) for one in campaign.structures]
        gains = log_evidence_gains(posteriors, modes, stated_errors(campaign.estimation))
    schedules = [one.schedule for one in stored]
    optional, table = campaign.structure.optional, campaign.selection
    return decide(campaign.structures, schedules, optional, table.structure_prior, gains, table.repeats, run)


def _compute(study: Study, part: _StructureTask, report: Progress) -> EvidenceRun | MethodResult:
    campaign, terms, table = study.campaign, part.structure.terms, study.campaign.selection
    keys = Keys(random_key(campaign.seed, f"evidence {terms}"), random_key(campaign.seed, f"importance {terms}"))
    settings = EvidenceSettings(table.repeats, SMCSettings(particles=table.particles), table.draws)
    return run_task(study.posterior(part.structure), part.task, keys, settings, report)


class _StoredSchedule:
    """The schedule of one structure, its repeats kept on disk until the selection is written."""

    def __init__(self, campaign: Campaign, structure: Structure, modes: Sequence[Mode], key: str, reporter: Reporter):
        self.campaign, self.structure, self.reporter = campaign, structure, reporter
        self.schedule = EvidenceSchedule(0, modes)
        self.bars, self.shares = dict[Method, Progress](), dict[tuple[Method, int], float]()
        self.titles: dict[Method, str] = {
            "importance": " ".join(structure.terms),
            "smc": "check by tempered SMC, because it is in doubt or a decision depends on it",
            "nested": "nested sampling decides, because no two methods agree",
        }
        self.checkpoint_key = key_of("repeat", key, widest(campaign.structures).terms)

    def begin(self) -> list[EvidenceTask]:
        """Return the tasks that can run, as `EvidenceSchedule.begin`; a check goes on from the repeats that an interrupted run has kept."""
        for repeat in range(self.schedule.max_repeats):
            if repeat not in self.schedule.runs and (arrays := self._read("smc", repeat)) is not None:
                cold = arrays.pop("cold")
                self.schedule.runs[repeat] = EvidenceRun("smc", repeat, SMCResult(**arrays), cold=cold)
                self.show(EvidenceTask("smc", repeat), 1.0)
        for repeat in range(NESTED_RUNS if self.schedule.asked else 0):
            if repeat not in self.schedule.nested and (arrays := self._read("nested", repeat)) is not None:
                self.schedule.nested[repeat] = NestedRun(**arrays)
                self.show(EvidenceTask("nested", repeat), 1.0)
        tasks = self.schedule.begin()
        for task in tasks:
            self.show(task, 0.0)
        return tasks

    def add(self, result: EvidenceRun | MethodResult) -> EvidenceTask | None:
        """Add a result, a repeat also on disk, and return the task that can run now."""
        match result:
            case MethodResult():
                self.show(EvidenceTask(result.method), 1.0)
            case EvidenceRun(result=SMCResult() as run):
                self._write("smc", result.repeat, run._asdict() | {"cold": result.cold})
            case EvidenceRun(result=NestedRun() as run):
                self._write("nested", result.repeat, run._asdict())
        return self.schedule.add(result)

    def _read(self, method: Method, repeat: int) -> dict[str, Any] | None:
        """Return what an interrupted run has kept of a repeat; None if it has nothing."""
        arrays = load_checkpoint(self._checkpoint(method, repeat), self.checkpoint_key)
        return arrays and {name: value if value.ndim else value.item() for name, value in arrays.items()}

    def _write(self, method: Method, repeat: int, result: Mapping[str, Any]) -> None:
        arrays = {name: np.asarray(value) for name, value in result.items()}
        save_checkpoint(self._checkpoint(method, repeat), self.checkpoint_key, arrays)
        self.show(EvidenceTask(method, repeat), 1.0)

    def show(self, task: EvidenceTask, share: float) -> None:
        """Show the share of a task that is done, in a bar for each method."""
        if task.method not in self.bars:
            self.bars[task.method] = self.reporter.progress(
                f"evidence {self.structure.label}: {self.titles[task.method]}"
            )
        done, count = task.repeat + share, NESTED_RUNS
        if task.method != "nested":
            self.shares[task.method, task.repeat] = share
            done = sum(one for (method, _), one in self.shares.items() if method == task.method)
            count = 1 if task.method == "importance" else max(self.schedule.asked, len(self.shares) - 1)
        self.bars[task.method](round(PROGRESS_STEPS * done), PROGRESS_STEPS * count)

    def _checkpoint(self, method: Method, repeat: int) -> Path:
        return Store(self.campaign.folder).checkpoint(f"evidence-{self.structure.label}-{method}-{repeat}")
