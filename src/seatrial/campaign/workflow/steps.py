"""The steps of a campaign as one table: what each needs, how it is made, and where its results are kept.

A step is given the same things to make its result and to find its key, so that no result outlives what it was made from: a key is made
of the campaign file and of the keys of what the step needs.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.store.stored_result import State, Store, StoredResult, key_of
from seatrial.campaign.store.structures import Summary
from seatrial.core.errors import InputError
from seatrial.core.files import depend_on
from seatrial.core.record import Record
from seatrial.core.reporter import SILENT, Reporter
from seatrial.logs.formats.registry import hash_of_log
from seatrial.selection.structures import Structure


class _Module:
    """A module of campaigns; each of its functions imports it when called, since most bring libraries that others do not need."""

    def __init__(self, name: str):
        self._name = f"seatrial.campaign.{name}"

    def __getattr__(self, function: str) -> Callable[..., Any]:
        return lambda *given: getattr(import_module(self._name), function)(*given)


import_logs = _Module("data.import_logs")
simulate = _Module("data.simulate")
batch = _Module("design.batch")
compare_utilities = _Module("design.compare_utilities")
free_form = _Module("design.free_form")
global_search = _Module("design.global_search")
plan = _Module("design.plan")
evaluate_schedule = _Module("design.evaluate_schedule")
relay = _Module("design.relay")
sensor_choice = _Module("design.sensor_choice")
sweep = _Module("design.sweep")
baselines = _Module("inference.baselines")
calibration = _Module("inference.calibration")
cross_validation = _Module("inference.cross_validation")
estimate = _Module("inference.estimate")
filter_trace = _Module("inference.filter_trace")
identifiability = _Module("inference.identifiability")
judge_predictions = _Module("inference.judge_predictions")
profile = _Module("inference.profile")
prior = _Module("prior.predictive")
rehearsal = _Module("rehearsal.run")
criteria = _Module("selection.criteria")
evidence = _Module("selection.evidence")
runner_up = _Module("selection.runner_up")
screening = _Module("selection.screening")


@dataclass(frozen=True)
class UnreadTrials:
    """What stands for records of which only the key is known."""

    key: str


@dataclass(frozen=True)
class UnreadEstimate:
    """What stands for the posterior of a structure of which only the key is known."""

    key: str
    structure: Structure


class NotCurrent(Exception):
    """A step on which another depends is not current, so that the key of the other cannot be known."""


def _must_be_current(stored: Sequence[StoredResult], *_: Any) -> None:
    """Return nothing, since nobody looks into this result to find a key."""
    if any(one.state() != "current" for one in stored):
        raise NotCurrent


@dataclass(frozen=True)
class Step:
    """One step.

    Attributes:
        name: of its result.
        needs: what it is given: results of other steps, `campaign`, `reporter`, or a setting of the call.
        make: returns its result; what is stored and current is read, all else computed and stored.
        stored: what it stores, found from the same needs of which only the keys are known; None for what is only derived from others.
        files: pattern of these files below `results`.
        seen: what other steps see of it where only keys are looked at, from what is stored and the needs; it raises `NotCurrent`.
        listed: its name where a campaign's standing is shown; empty where it is not shown.
        command: that makes it current.
    """

    name: str
    needs: tuple[str, ...]
    make: Callable[..., Any]
    stored: Callable[..., Iterable[StoredResult]] | None = None
    files: str = ""
    seen: Callable[..., Any] = _must_be_current
    listed: str = ""
    command: str = ""


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
            self._made[name] = step.make(*(self.get(need) for need in step.needs))
        return self._made[name]

    def stored(self, name: str) -> tuple[StoredResult, ...]:
        """Return what a step stores, with the keys that it has to have; nothing is computed.

        Raises:
            NotCurrent: what it needs is not current.
        """
        step = STEPS[name]
        return () if step.stored is None else tuple(step.stored(*self._views(step)))

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
            self._seen[name] = step.make(*given) if step.stored is None else step.seen(self.stored(name), *given)
        return self._seen[name]

    def _views(self, step: Step) -> list[Any]:
        return [self.seen(need) for need in step.needs if need != "reporter"]


# What the steps store, and what is seen of it, where that takes more than one line.


def _first(campaign: Campaign, reporter: Reporter) -> Any:
    """Return the designs from the priors: of imported trials those that were made before, if they still belong to the campaign."""
    if campaign.trial_design is None or not (campaign.imports is None or sweep.is_designed(campaign)):
        return None
    return sweep.design_first(campaign, reporter)


def _next(candidates: Campaign, chosen: Any, reporter: Reporter) -> Any:
    """Return the designs from the posterior, of a campaign that designs trials."""
    return None if candidates.trial_design is None else sweep.design_next(candidates, chosen, reporter)


def _stored_trials(campaign: Campaign) -> Iterator[StoredResult]:
    """Yield the records; one whose log is missing has no key."""
    store, imports = Store(campaign.folder), campaign.imports
    if not campaign.has_records:
        raise NotCurrent
    if imports is None:
        yield from (
            StoredResult(store.record(label), key, Record) for label, key in simulate.record_keys(campaign).items()
        )
        return
    for run in imports.runs:
        try:
            yield import_logs.stored_record(campaign, imports, run, _hash_of)
        except InputError:
            yield StoredResult(store.record(run), "", Record)


def _seen_trials(stored: Sequence[StoredResult], campaign: Campaign) -> UnreadTrials:
    _must_be_current(stored)
    keys = [one.key for one in stored]
    return UnreadTrials(keys[-1] if campaign.imports is None else import_logs.trials_key(campaign.imports, keys))


def _seen_estimates(stored: Sequence[StoredResult], campaign: Campaign, trials: UnreadTrials) -> list[UnreadEstimate]:
    return [UnreadEstimate(one.key, structure) for one, structure in zip(stored, campaign.structures, strict=True)]


def _seen_selection(stored: Sequence[StoredResult], campaign: Campaign, trials: Any) -> Any:
    """Return the selection itself, which says what is chosen."""
    _must_be_current(stored)
    return evidence.current_selection(campaign, trials)


def _stored_contenders(campaign: Campaign, selection: Any, trials: Any) -> Iterator[StoredResult]:
    if campaign.trial_design is None:
        return
    best, *others = (
        UnreadEstimate(estimate.estimate_key(campaign, one, trials), one) for one in runner_up.contending(selection)
    )
    yield from (runner_up.stored_contenders(campaign, best, runner, trials) for runner in others)


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


def _shortlisted(stored: Sequence[StoredResult], campaign: Campaign, trials: Any) -> Campaign:
    _must_be_current(stored)
    return screening.with_shortlist(campaign, trials)


def _promised(campaign: Campaign, first: Any) -> Any:
    return None if first is None else identifiability.known_before(campaign, first.best)


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


LOOP = (
    Step(
        "first",
        ("campaign", "reporter"),
        _first,
        lambda campaign: [] if campaign.trial_design is None else [sweep.stored_first(campaign)],
        "design.nc",
        listed="design",
        command="design",
    ),
    Step(
        "trials",
        ("campaign", "reporter"),
        import_logs.get_trials,
        _stored_trials,
        "records/*.nc",
        _seen_trials,
        listed="records",
        command="import",
    ),
    Step(
        "screening",
        ("campaign", "trials", "reporter"),
        screening.screening_of,
        lambda campaign, trials: (
            [screening.stored_screening(campaign, trials)] if screening.can_be_screened(campaign) else []
        ),
        "screening.nc",
    ),
    Step(  # the campaign with what a screening has left of its structures
        "candidates",
        ("campaign", "trials", "reporter"),
        screening.with_shortlist,
        lambda campaign, trials: [screening.stored_screening(campaign, trials)] if campaign.is_large else [],
        "screening.nc",
        _shortlisted,
    ),
    Step(
        "estimates",
        ("candidates", "trials", "reporter"),
        estimate.estimate_all,
        lambda campaign, trials: estimate.stored_estimates(campaign, trials).values(),
        "posterior/*.nc",
        _seen_estimates,
        listed="estimate",
        command="estimate",
    ),
    Step(
        "selection",
        ("candidates", "trials", "reporter"),
        evidence.select_structure,
        lambda campaign, trials: [evidence.stored_selection(campaign, trials)],
        "selection.json",
        _seen_selection,
        listed="select",
        command="select",
    ),
    Step("chosen", ("estimates", "selection"), lambda estimates, selection: estimates[selection.chosen]),
    Step("full", ("estimates",), lambda estimates: estimates[0]),
    Step(
        "known",
        ("candidates", "chosen", "trials"),
        identifiability.known_after,
        lambda campaign, chosen, trials: [identifiability.stored_known_after(campaign, chosen)],
        "known/*.json",
    ),
    Step(
        "promised",
        ("campaign", "first"),
        _promised,
        lambda campaign, first: (
            [] if campaign.trial_design is None else [identifiability.stored_known_before(campaign)]
        ),
        "known/design.json",
    ),
    Step(
        "filter",
        ("candidates", "full", "trials"),
        filter_trace.trace_filter,
        lambda campaign, full, trials: [filter_trace.stored_filter(campaign, full)],
        "filter.nc",
    ),
    Step(
        "predictions",
        ("candidates", "chosen", "trials"),
        judge_predictions.predict_all,
        lambda campaign, chosen, trials: [judge_predictions.stored_predictions(campaign, chosen, trials)],
        "predictions.nc",
        listed="predict",
        command="run",
    ),
    Step(
        "baselines",
        ("campaign", "trials", "reporter"),
        baselines.fit_all_baselines,
        lambda campaign, trials: (
            [baselines.stored_baselines(campaign, trials)] if baselines.has_held_back(campaign) else []
        ),
        "baselines.nc",
    ),
    Step(
        "next",
        ("candidates", "chosen", "reporter"),
        _next,
        lambda campaign, chosen: [] if campaign.trial_design is None else [sweep.stored_next(campaign, chosen)],
        "next.nc",
        listed="next",
        command="next",
    ),
    Step(
        "contenders",
        ("candidates", "selection", "trials", "reporter"),
        runner_up.find_contenders,
        _stored_contenders,
        "contenders.nc",
    ),
)
"""Steps of the whole loop, in the order in which they are made."""
BESIDE = (
    Step("prior", ("campaign", "reporter"), prior.predict_from_prior),
    Step(
        "design",
        ("campaign", "reporter"),
        sweep.design_first,
        lambda campaign: [sweep.stored_first(campaign)],
        "design.nc",
    ),
    Step(
        "own",
        ("campaign", "reporter"),
        evaluate_schedule.evaluate_own_schedule,
        lambda campaign: [] if (own := campaign.design.own) is None else [evaluate_schedule.stored_own(campaign, own)],
        "own.json",
    ),
    Step(
        "free_form",
        ("campaign", "levels", "reporter"),
        free_form.design_free_trial,
        lambda campaign, levels: [free_form.stored_free_trial(campaign, levels)],
        "free_form.json",
    ),
    Step(
        "relay",
        ("campaign", "reporter"),
        relay.design_relay_trial,
        lambda campaign: [relay.stored_relay(campaign)],
        "self_oscillation.json",
    ),
    Step(
        "searched",
        ("campaign", "budget", "reporter"),
        global_search.search_design,
        lambda campaign, budget: [global_search.stored_search(campaign, budget)],
        "searched.json",
    ),
    Step(
        "measures",
        ("campaign", "designs", "reporter"),
        compare_utilities.compare_measures,
        lambda campaign, designs: [compare_utilities.stored_measures(campaign, designs)],
        "measures.nc",
    ),
    Step("batch", ("campaign", "together", "reporter"), batch.plan_together),
    Step("plan", ("campaign", "so_far", "reporter"), plan.plan_trials),
    Step("sensors", ("campaign", "reporter"), sensor_choice.sensor_table),
    Step(
        "rehearsal",
        ("campaign", "vehicles", "reporter"),
        rehearsal.rehearse,
        lambda campaign, vehicles: [rehearsal.stored_rehearsal(campaign)],
        "rehearsal.nc",
    ),
    Step(
        "profiles",
        ("campaign", "trials", "parameters", "reporter"),
        profile.profile_all,
        lambda campaign, trials, parameters: [profile.stored_profiles(campaign, trials)],
        "profiles/*.json",
    ),
    Step(
        "criteria",
        ("candidates", "estimates", "trials", "from_time", "block", "reporter"),
        criteria.criteria_all,
        lambda campaign, estimates, *_: [criteria.stored_criteria(campaign, one) for one in estimates],
        "criteria/*.nc",
    ),
    Step(
        "cross_validation",
        ("candidates", "trials", "reporter"),
        cross_validation.cross_validate,
        lambda campaign, trials: [cross_validation.stored_cross_validation(campaign, trials)],
        "cross_validation.json",
    ),
    Step(
        "calibration",
        ("campaign", "trials", "replicates", "method", "reporter"),
        calibration.calibrate,
        lambda campaign, trials, *settings: [calibration.stored_calibration(campaign, trials, *settings)],
        "calibration-*.nc",
    ),
)
"""Steps that are made when they are asked for."""
STEPS = {step.name: step for step in (*LOOP, *BESIDE)}
