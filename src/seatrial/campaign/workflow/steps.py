"""The steps of a campaign as one table: what each needs, how it is made, and where its results are kept.

A step is given the same things to make its result and to find its key, so that no result outlives what it was made from: a key is made
of the campaign file and of the keys of what the step needs.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import Any, NamedTuple

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.store.stored_result import State, Store, StoredResult, key_of
from seatrial.campaign.store.summary import Summary
from seatrial.core.errors import InputError
from seatrial.core.files import depend_on
from seatrial.core.record import Record
from seatrial.core.reporter import SILENT, Reporter
from seatrial.logs.formats.registry import hash_of_log
from seatrial.selection.structures import Structure


@dataclass(frozen=True)
class TrialsKey:
    """What stands for records of which only the key is known."""

    key: str


@dataclass(frozen=True)
class EstimateKey:
    """What stands for the posterior of a structure of which only the key is known."""

    key: str
    structure: Structure


class NotCurrent(Exception):
    """A step on which another depends is not current, so that the key of the other cannot be known."""


def require_current(stored: Sequence[StoredResult], *_: Any) -> None:
    """Return nothing, since nobody looks into this result to find a key."""
    if any(one.state() != "current" for one in stored):
        raise NotCurrent


class Work(NamedTuple):
    """The functions of a step, which are given what it needs.

    Attributes:
        compute: returns its result; what is stored and current is read, all else computed and stored.
        stored: what it stores, found from the same needs of which only the keys are known; None for what is only derived from others.
        seen: stand-in for its result while only keys are compared, from stored results and the needs; it raises `NotCurrent`.
    """

    compute: Callable[..., Any]
    stored: Callable[..., Iterable[StoredResult]] | None = None
    seen: Callable[..., Any] = require_current


@dataclass(frozen=True)
class Step:
    """One step.

    Attributes:
        name: of its result.
        needs: what it is given: results of other steps, `campaign`, `reporter`, or a setting of the call.
        files: pattern of what it stores, below `results`; empty if that is nothing.
        listed: its name where a campaign's standing is shown; empty if it is not shown.
        command: that makes it current.
    """

    name: str
    needs: tuple[str, ...]
    files: str = ""
    listed: str = ""
    command: str = ""

    @property
    def work(self) -> Work:
        """Its functions."""
        return work_of(self.name)


class Workflow:
    """The steps of one campaign, each made at most once.

    Args:
        campaign: configuration.
        reporter: receives what happens.
        settings: what steps need beside the campaign and each other, such as `levels` of a free-form trial.
    """

    def __init__(self, campaign: Campaign, reporter: Reporter = SILENT, **settings: Any):
        self.campaign = campaign
        self._made: dict[str, Any] = {"campaign": campaign, "reporter": reporter, **settings}
        self._seen: dict[str, Any] = {"campaign": campaign, **settings}

    def get(self, name: str) -> Any:
        """Return the result of a step: read where it is current, else computed, and so for all that it needs.

        Raises:
            SeatrialError: as the steps.
        """
        if name not in self._made:
            step = STEPS[name]
            self._made[name] = step.work.compute(*(self.get(need) for need in step.needs))
        return self._made[name]

    def stored(self, name: str) -> tuple[StoredResult, ...]:
        """Return what a step stores, with the keys that it has to have; nothing is computed.

        Raises:
            NotCurrent: what it needs is not current.
        """
        step = STEPS[name]
        stored = step.work.stored if step.files else None
        return () if stored is None else tuple(stored(*self._views(step)))

    def state(self, name: str) -> State:
        """Return whether a step is current; nothing is computed, and of datasets no more is read than the header."""
        try:
            states: set[State] = {one.state() for one in self.stored(name)}
        except NotCurrent:
            files = STEPS[name].files
            there = files and any(Store(self.campaign.folder).results.glob(files))
            return "stale" if there else "missing"
        if len(states) > 1:
            return "stale"
        return states.pop() if states else "current"

    def seen(self, name: str) -> Any:
        """Return what other steps see of a step where only keys are looked at.

        Raises:
            NotCurrent: it depends on a step that is not current.
        """
        if name not in self._seen:
            step, given = STEPS[name], self._views(STEPS[name])
            work = step.work
            self._seen[name] = work.seen(self.stored(name), *given) if step.files else work.compute(*given)
        return self._seen[name]

    def _views(self, step: Step) -> list[Any]:
        return [self.seen(need) for need in step.needs if need != "reporter"]


# The work of the steps whose keys are found otherwise than by what they need.


def _first() -> Work:
    from seatrial.campaign.design.sweep import design_first, is_designed, stored_first

    def compute(campaign: Campaign, reporter: Reporter) -> Any:
        """Return the designs from the priors: of imported trials those that were made before, if they still belong to the campaign."""
        if campaign.trial_design is None or not (campaign.imports is None or is_designed(campaign)):
            return None
        return design_first(campaign, reporter)

    return Work(compute, lambda campaign: [] if campaign.trial_design is None else [stored_first(campaign)])


def _trials() -> Work:
    from seatrial.campaign.data.import_logs import get_trials, stored_record, trials_key
    from seatrial.campaign.data.simulate import record_keys

    def stored(campaign: Campaign) -> Iterator[StoredResult]:
        """Yield the records; one whose log is missing has no key."""
        store, imports = Store(campaign.folder), campaign.imports
        if not campaign.has_records:
            raise NotCurrent
        if imports is None:
            yield from (StoredResult(store.record(label), key, Record) for label, key in record_keys(campaign).items())
            return
        for run in imports.runs:
            try:
                yield stored_record(campaign, imports, run, _hash_of)
            except InputError:
                yield StoredResult(store.record(run), "", Record)

    def seen(stored: Sequence[StoredResult], campaign: Campaign) -> TrialsKey:
        require_current(stored)
        keys = [one.key for one in stored]
        return TrialsKey(keys[-1] if campaign.imports is None else trials_key(campaign.imports, keys))

    return Work(get_trials, stored, seen)


def _candidates() -> Work:
    """Return the campaign with what a screening has left of its structures."""
    from seatrial.campaign.selection.screening import stored_screening, with_shortlist

    def seen(stored: Sequence[StoredResult], campaign: Campaign, trials: Any) -> Campaign:
        require_current(stored)
        return with_shortlist(campaign, trials)

    return Work(
        with_shortlist, lambda campaign, trials: [stored_screening(campaign, trials)] if campaign.is_large else [], seen
    )


def _estimates() -> Work:
    from seatrial.campaign.inference.estimate import estimate_all, stored_estimates

    def seen(stored: Sequence[StoredResult], campaign: Campaign, trials: TrialsKey) -> list[EstimateKey]:
        return [EstimateKey(one.key, structure) for one, structure in zip(stored, campaign.structures, strict=True)]

    return Work(estimate_all, lambda campaign, trials: stored_estimates(campaign, trials).values(), seen)


def _selection() -> Work:
    from seatrial.campaign.selection.evidence import current_selection, select_structure, stored_selection

    def seen(stored: Sequence[StoredResult], campaign: Campaign, trials: Any) -> Any:
        """Return the selection itself, which says what is chosen."""
        require_current(stored)
        return current_selection(campaign, trials)

    return Work(select_structure, lambda campaign, trials: [stored_selection(campaign, trials)], seen)


def _contenders() -> Work:
    from seatrial.campaign.inference.estimate import estimate_key
    from seatrial.campaign.selection.runner_up import contending, find_contenders, stored_contenders

    def stored(campaign: Campaign, selection: Any, trials: Any) -> Iterator[StoredResult]:
        if campaign.trial_design is None:
            return
        best, *others = (EstimateKey(estimate_key(campaign, one, trials), one) for one in contending(selection))
        yield from (stored_contenders(campaign, best, runner, trials) for runner in others)

    return Work(find_contenders, stored)


# The module below `seatrial.campaign` of each of the other steps, the function that makes it, and the function that says where it is
# stored, which is given the first of what the step needs; none of a step that stores nothing.
_PLAIN = {
    "average": ("inference.structure_average", "average_of", ""),
    "known": ("inference.identifiability", "known_after", "stored_known_after"),
    "filter": ("inference.filter_trace", "trace_filter", "stored_filter"),
    "predictions": ("inference.judge_predictions", "predict_all", "stored_predictions"),
    "prior": ("prior.predictive", "predict_from_prior", ""),
    "design": ("design.sweep", "design_first", "stored_first"),
    "free_form": ("design.searches", "design_free_trial", "stored_free_trial"),
    "relay": ("design.searches", "design_relay_trial", "stored_relay"),
    "searched": ("design.searches", "search_design", "stored_search"),
    "measures": ("design.searches", "compare_measures", "stored_measures"),
    "batch": ("design.searches", "plan_together", ""),
    "plan": ("design.plan", "plan_trials", ""),
    "sensors": ("design.searches", "sensor_table", ""),
    "rehearsal": ("rehearsal.run", "rehearse", "stored_rehearsal"),
    "profiles": ("inference.profile", "profile_all", "stored_profiles"),
    "cross_validation": ("inference.cross_validation", "cross_validate", "stored_cross_validation"),
    "calibration": ("inference.calibration", "calibrate", "stored_calibration"),
}


def work_of(name: str) -> Work:
    """Return the functions of a step, imported when it is first asked for, since most bring libraries that others do not need."""
    match name:
        case "first":
            return _first()
        case "trials":
            return _trials()
        case "screening":
            from seatrial.campaign.selection.screening import can_be_screened, screening_of, stored_screening

            return Work(
                screening_of,
                lambda campaign, trials: [stored_screening(campaign, trials)] if can_be_screened(campaign) else [],
            )
        case "candidates":
            return _candidates()
        case "estimates":
            return _estimates()
        case "selection":
            return _selection()
        case "chosen":
            return Work(lambda estimates, selection: estimates[selection.chosen])
        case "full":
            return Work(lambda estimates: estimates[0])
        case "promised":
            from seatrial.campaign.inference.identifiability import known_before, stored_known_before

            return Work(
                lambda campaign, first: None if first is None else known_before(campaign, first.best),
                lambda campaign, first: [] if campaign.trial_design is None else [stored_known_before(campaign)],
            )
        case "baselines":
            from seatrial.campaign.inference.baselines import fit_all_baselines, stored_baselines

            return Work(
                fit_all_baselines,
                lambda campaign, trials: (
                    [stored_baselines(campaign, trials)] if campaign.imports and campaign.imports.predict else []
                ),
            )
        case "next":
            from seatrial.campaign.design.sweep import design_next, stored_next

            return Work(
                lambda campaign, chosen, reporter: (
                    None if campaign.trial_design is None else design_next(campaign, chosen, reporter)
                ),
                lambda campaign, chosen: [] if campaign.trial_design is None else [stored_next(campaign, chosen)],
            )
        case "contenders":
            return _contenders()
        case "own":
            from seatrial.campaign.design.searches import evaluate_own_schedule, stored_own

            return Work(
                evaluate_own_schedule,
                lambda campaign: [] if (own := campaign.own_schedule) is None else [stored_own(campaign, own)],
            )
        case "criteria":
            from seatrial.campaign.selection.criteria import criteria_all, stored_criteria

            return Work(
                criteria_all,
                lambda campaign, estimates, *_: [stored_criteria(campaign.folder, one) for one in estimates],
            )
        case _:
            place, compute, stored = _PLAIN[name]
            module = import_module(f"seatrial.campaign.{place}")
            return Work(getattr(module, compute), partial(_stored_by, getattr(module, stored)) if stored else None)


def _stored_by(stored: Callable[..., StoredResult], *given: Any) -> list[StoredResult]:
    """Return what a step stores, by a function of the first of what it is given."""
    return [stored(*given[: len(signature(stored).parameters)])]


def _hash_of(path: Path) -> str:
    """Return the hash of a log, kept while its size and time of change stay."""
    depend_on(path)
    if not path.is_file():
        return hash_of_log(path)
    there = path.stat()
    return _hashed(path, there.st_size, there.st_mtime_ns)


@lru_cache(maxsize=256)
def _hashed(path: Path, size: int, changed: int) -> str:
    del size, changed  # part of the key only
    return hash_of_log(path)


# Steps of the whole loop, in the order in which they are made
LOOP = (
    Step("first", ("campaign", "reporter"), "design.nc", listed="design", command="design"),
    Step("trials", ("campaign", "reporter"), "records/*.nc", listed="records", command="import"),
    Step("screening", ("campaign", "trials", "reporter"), "screening.nc"),
    Step("candidates", ("campaign", "trials", "reporter"), "screening.nc"),
    Step("estimates", ("candidates", "trials", "reporter"), "posterior/*.nc", listed="estimate", command="estimate"),
    Step("selection", ("candidates", "trials", "reporter"), "selection.json", listed="select", command="select"),
    Step("chosen", ("estimates", "selection")),
    Step("average", ("candidates", "estimates", "selection")),
    Step("full", ("estimates",)),
    Step("known", ("candidates", "chosen", "trials"), "known/*.json"),
    Step("promised", ("campaign", "first"), "known/design.json"),
    Step("filter", ("candidates", "full", "trials"), "filter.nc"),
    Step(
        "predictions", ("candidates", "chosen", "trials", "average"), "predictions.nc", listed="predict", command="run"
    ),
    Step("baselines", ("campaign", "trials", "reporter"), "baselines.nc"),
    Step("next", ("candidates", "chosen", "reporter"), "next.nc", listed="next", command="next"),
    Step("contenders", ("candidates", "selection", "trials", "reporter"), "contenders.json"),
)
# Steps that are made when they are asked for
OTHER_STEPS = (
    Step("prior", ("campaign", "reporter")),
    Step("design", ("campaign", "reporter"), "design.nc"),
    Step("own", ("campaign", "reporter"), "own.json"),
    Step("free_form", ("campaign", "levels", "reporter"), "free_form.json"),
    Step("relay", ("campaign", "reporter"), "self_oscillation.json"),
    Step("searched", ("campaign", "budget", "reporter"), "searched.json"),
    Step("measures", ("campaign", "designs", "reporter"), "measures.nc"),
    Step("batch", ("campaign", "together", "reporter")),
    Step("plan", ("campaign", "so_far", "reporter")),
    Step("sensors", ("campaign", "reporter")),
    Step("rehearsal", ("campaign", "vehicles", "reporter"), "rehearsal.nc"),
    Step("profiles", ("campaign", "trials", "parameters", "reporter"), "profiles/*.json"),
    Step("criteria", ("candidates", "estimates", "trials", "reporter"), "criteria/*.json"),
    Step("cross_validation", ("candidates", "trials", "reporter"), "cross_validation.json"),
    Step("calibration", ("campaign", "trials", "replicates", "method", "reporter"), "calibration-*.nc"),
)
STEPS = {step.name: step for step in (*LOOP, *OTHER_STEPS)}


def stored_summary(flow: Workflow) -> StoredResult[Summary]:
    """Return where the summary is kept, and what it depends on: every result of the loop, and what the campaign says of names and goals.

    Results whose keys cannot be known count as none: as long as no design was made for imported trials, what it promised is one.
    """
    campaign, keys = flow.campaign, []
    for step in LOOP:
        try:
            keys.append([one.key for one in flow.stored(step.name)])
        except NotCurrent:
            keys.append(None)
    key = key_of("summary", keys, campaign.name, campaign.prior_units, campaign.goal, sorted(campaign.accepted))
    return StoredResult(Store(campaign.folder).summary, key, Summary, f"seatrial run {campaign.folder}")
