"""The other searches of a trial, each its key and one call of `design_trial`; a current result is read, and its schedule written."""

from dataclasses import replace
from functools import partial
from pathlib import Path, PurePath
from typing import Any, TypeVar

import numpy as np

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.design_table import OwnSchedule
from seatrial.campaign.design.plan import stated_share
from seatrial.campaign.design.problem import believed_after, design_problem
from seatrial.campaign.design.residual_noise import with_residual_noise
from seatrial.campaign.design.schedule import write_own
from seatrial.campaign.design.sweep import design_first, design_key, write_design
from seatrial.campaign.store.estimates import Drawn
from seatrial.campaign.store.stored_result import Store, StoredResult, key_of
from seatrial.core.display_units import shown_unit
from seatrial.core.errors import InputError
from seatrial.core.reporter import SILENT, Reporter
from seatrial.design.batch import BatchSearch, PlannedBatch
from seatrial.design.free_form import FreeFormSearch
from seatrial.design.global_search import GlobalSearch
from seatrial.design.measures import MeasureSearch
from seatrial.design.own_schedule import OwnSearch
from seatrial.design.relay_sweep import PROPOSED_SHARES, RelaySearch, proposed_output
from seatrial.design.results import FreeTrial, Measures, OwnTrial, RelayTrial, Searched
from seatrial.design.sensor_choice import SensorComparison, SensorSearch
from seatrial.design.trial_design import Search, TrialDesign, design_trial
from seatrial.manoeuvres.family import Family

FoundT = TypeVar("FoundT")


def _searched(campaign: Campaign, kept: StoredResult[FoundT], search: Search[FoundT], reporter: Reporter) -> FoundT:
    """Read what a search found, or search."""
    return kept.read_or_make(
        lambda: design_trial(design_problem(campaign), search, partial(design_first, campaign, reporter), reporter)
    )


def _stored(campaign: Campaign, place: str, kind: type[FoundT], *key: Any) -> StoredResult[FoundT]:
    path = getattr(Store(campaign.folder), place)
    return StoredResult(path, key_of(*key, design_key(campaign)), kind, f"seatrial design {campaign.folder}")


def stored_free_trial(campaign: Campaign, levels: int) -> StoredResult[FreeTrial]:
    """Return where the free-form trial is kept, and what it depends on."""
    return _stored(campaign, "free_design", FreeTrial, "free form", "active", levels)


def design_free_trial(campaign: Campaign, levels: int, reporter: Reporter = SILENT) -> tuple[FreeTrial, Path]:
    """Search the levels that teach most about the full structure under its priors; a current result is read.

    Returns:
        what was found, and the schedule.

    Raises:
        InputError: no bounds of the control, limits that admit nothing, or several controls that move together.
        NumericalError: the vehicle diverges at a draw of the priors.
    """
    problem, search, ramp = design_problem(campaign), FreeFormSearch(levels), campaign.family.ramp
    search.check(problem)
    if (edge := search.edge(problem)) < ramp:
        reporter.say(
            f"{levels} levels are {edge:.4g} s apart, and design.ramp in {campaign.path} is {ramp:g} s. The control is then a line from "
            f"level to level; {int(campaign.family.active / ramp)} levels or fewer keep the ramp"
        )
    kept = stored_free_trial(campaign, levels)
    trial = _searched(campaign, kept, search, reporter)
    return trial, write_design(campaign, Store(campaign.folder).schedule(kept.path), search.manoeuvre(problem, trial))


def stored_search(campaign: Campaign, budget: int) -> StoredResult[Searched]:
    """Return where the design found by a global search is kept, and what it depends on."""
    return _stored(campaign, "searched", Searched, "searched", list(Searched.__dataclass_fields__), budget)


def search_design(campaign: Campaign, budget: int, reporter: Reporter = SILENT) -> tuple[Searched, Family, Path]:
    """Search the box of the grid, family by family, under the priors; a current result is read.

    Args:
        campaign: families, grid, utility (`fisher-d` instead of the filter's entropy) and limits.
        budget: designs to evaluate in all.
        reporter: who is told.

    Returns:
        what was found, its family, and the schedule.

    Raises:
        InputError: a grid of one amplitude or period, too small a budget, or no design inside the limits.
        NumericalError: the motion diverges at a draw of the priors.
    """
    problem, search, kept = design_problem(campaign), GlobalSearch(budget), stored_search(campaign, budget)
    search.check(problem)
    design = _searched(campaign, kept, search, reporter)
    family = next(one for one in campaign.families if one.kind == design.kind)
    path = Store(campaign.folder).schedule(kept.path)
    return design, family, write_design(campaign, path, search.manoeuvre(problem, design))


def stored_relay(campaign: Campaign) -> StoredResult[RelayTrial]:
    """Return where the self-oscillating test is kept, and what it depends on."""
    return _stored(campaign, "relay_design", RelayTrial, "self-oscillation")


def relay_search(campaign: Campaign) -> RelaySearch:
    """Return the search of the self-oscillating test of `[design.relay]`, checked before any work.

    Raises:
        InputError: none is asked for, or as `RelaySearch.check`.
    """
    relay, problem = campaign.design.relay, design_problem(campaign)
    search = RelaySearch("", ()) if relay is None else RelaySearch(relay.output, relay.threshold.values())
    search.check(problem)
    if relay is None:
        keys = "output, a channel that answers the control and is measured, and its threshold"
        if (proposed := proposed_output(problem)) is not None:
            name, size = proposed
            factor, unit = shown_unit(name)
            low, high = (f"{share * size * factor:.1g} {unit}" for share in PROPOSED_SHARES)
            keys = f'output = "{name}" and threshold = {{ from = "{low}", to = "{high}", points = 8 }}'
        raise InputError(
            campaign.where("design.relay"),
            found="nothing",
            expected="the output that is fed back, and its thresholds",
            remedy=f"add [design.relay] with {keys}",
        )
    return search


def design_relay_trial(campaign: Campaign, reporter: Reporter = SILENT) -> tuple[RelayTrial, Path]:
    """Choose the most informative test that oscillates and keeps the limits; a current result is read.

    Returns:
        what was found, and the schedule that is foreseen at the prior means.

    Raises:
        InputError: no `[design.relay]`, an output that is not measured or does not answer the control, or no design that oscillates
            inside the limits.
        NumericalError: the vehicle diverges at the prior means.
    """
    search, kept = relay_search(campaign), stored_relay(campaign)
    loop = search.loop(design_problem(campaign))
    trial = _searched(campaign, kept, search, reporter)
    path = Store(campaign.folder).schedule(kept.path)
    foreseen, _ = loop.foreseen(trial.amplitude, trial.threshold)
    law = {"family": loop.family.as_plain(), "amplitude": trial.amplitude, "threshold": trial.threshold}
    return trial, write_design(campaign, path, foreseen, trial.rule, relay=law)


def plan_together(campaign: Campaign, trials: int, reporter: Reporter = SILENT) -> PlannedBatch:
    """Choose so many trials among all designs inside the limits, weighed as one alone is.

    Raises:
        InputError: no design inside the limits.
        NumericalError: the motion diverges at a draw of the priors.
    """
    problem, search = design_problem(campaign), BatchSearch(trials)
    search.check(problem)
    batch = design_trial(problem, search, partial(design_first, campaign, reporter), reporter)
    paths = (
        write_design(campaign, Store(campaign.folder).batch_schedule(number), manoeuvre)
        for number, manoeuvre in enumerate(batch.manoeuvres, 1)
    )
    return replace(batch, schedules=tuple(paths))


def sensor_table(campaign: Campaign, reporter: Reporter = SILENT) -> SensorComparison:
    """Weigh other sensors on the best design, over draws of the priors.

    Raises:
        NumericalError: the motion diverges at a draw of the priors.
    """
    table = design_trial(design_problem(campaign), SensorSearch(), partial(design_first, campaign, reporter), reporter)
    goal, model = campaign.goal, campaign.model(campaign.full)
    if goal is None or not (goal.shares or goal.sds):
        return table
    stated = np.array([stated_share(campaign, model, name) for name in table.names]) * np.abs(table.mean)
    known = [
        dict(zip(table.names, zip(table.mean, np.hypot(worth.sd, stated), strict=True), strict=True))
        for _, worth in table.rows
    ]
    return replace(table, meets=tuple(not goal.unmet(one) for one in known))


def stored_measures(campaign: Campaign, count: int) -> StoredResult[Measures]:
    """Return where the measures of so many designs are kept, and what they depend on."""
    return _stored(campaign, "measures", Measures, "measures", count)


def compare_measures(campaign: Campaign, count: int, reporter: Reporter = SILENT) -> Measures:
    """Compute every measure for the best design of each family and for others spread over what they reach; a current result is read.

    Args:
        campaign: its priors, families and limits.
        count: designs, 5 at least.
        reporter: who is told.

    Raises:
        InputError: as `MeasureSearch.check`.
        NumericalError: the motion diverges at a draw of the priors.
    """
    search = MeasureSearch(count)
    search.check(design_problem(campaign))
    return _searched(campaign, stored_measures(campaign, count), search, reporter)


def stored_own(campaign: Campaign, own: OwnSchedule) -> StoredResult[OwnTrial]:
    """Return where the judgement of a campaign's own schedule is kept, and what it depends on."""
    controls = {name: values.tolist() for name, values in own.schedule.controls.items()}
    key = key_of("own", design_key(campaign), own.schedule.time.tolist(), controls)
    return StoredResult(Store(campaign.folder).own_design, key, OwnTrial, f"seatrial design {campaign.folder}")


def evaluate_own_schedule(campaign: Campaign, reporter: Reporter = SILENT) -> OwnTrial | None:
    """Weigh the schedule that [design] names under the priors, and write it if designs are; None if it names none.

    Raises:
        NumericalError: the motion diverges at a draw of the priors.
    """
    own = campaign.own_schedule
    if own is None:
        return None
    kept, name = stored_own(campaign, own), PurePath(own.source).name
    write_own(Store(campaign.folder).schedule(kept.path), own.schedule, name)
    return _searched(campaign, kept, OwnSearch(own.schedule, name), reporter)


def evaluate_schedule_after(campaign: Campaign, drawn: Drawn, designs: TrialDesign) -> OwnTrial | None:
    """Weigh the schedule that [design] names beside the best of designs that were swept from draws; None if it names none."""
    own = campaign.own_schedule
    if own is None:
        return None
    problem = design_problem(with_residual_noise(campaign, drawn), believed_after(campaign, drawn))
    return design_trial(problem, OwnSearch(own.schedule, PurePath(own.source).name), designs)
