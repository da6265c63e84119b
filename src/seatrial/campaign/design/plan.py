"""The plan of a campaign, from its priors or from the mode after a trial: which trials in which order, and their schedules."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.schema import Goal
from seatrial.campaign.design.problem import believed_after, design_problem
from seatrial.campaign.design.residual_noise import with_residual_noise
from seatrial.campaign.design.schedule import commands_of, write_schedule
from seatrial.campaign.store.estimates import Drawn
from seatrial.campaign.store.stored_result import Store
from seatrial.core.errors import InputError
from seatrial.core.record import Record
from seatrial.core.reporter import SILENT, Reporter
from seatrial.design.cost import PropellerPower, in_joules
from seatrial.design.plan_search import Plan, PlanSearch, joules_of
from seatrial.design.trial_design import design_trial
from seatrial.vehicles.model import VehicleModel


@dataclass(frozen=True, eq=False)
class SoFar:
    """What has been learnt: draws about the mode of the posterior, and the records behind it."""

    drawn: Drawn
    records: tuple[Record, ...]


def plan_trials(campaign: Campaign, so_far: SoFar | None = None, reporter: Reporter = SILENT) -> Plan:
    """Plan the trials of a campaign, or those that remain, and write their schedules.

    Args:
        campaign: goals, limits, designs, and what a day allows.
        so_far: what earlier trials taught; None before the first one.
        reporter: told how far the work has come.

    Raises:
        InputError: no goal, designs that are ended early, or none inside the limits.
    """
    goal, day, stated = (
        goal_of(campaign.goal, campaign.model(campaign.full), campaign.where),
        campaign.plan,
        campaign.power,
    )
    power = None
    if stated is not None:
        power = in_joules(stated.hotel, PropellerPower(stated.propulsion, stated.at, campaign.family.control))
    search = PlanSearch(
        goal.shares,
        goal.sds,
        goal.trials,
        chance=day.chance,
        time=day.time,
        battery=day.battery,
        turnaround=day.turnaround,
        power=power,
    )
    problem = design_problem(campaign)
    if so_far is not None:
        count, lengths = len(so_far.records), [float(one.time[-1] - one.time[0]) for one in so_far.records]
        controls = [dict(zip(one.controls, one.control.T, strict=True)) for one in so_far.records]
        joules = sum(joules_of(power, day.turnaround, *one) for one in zip(controls, lengths, strict=True))
        search = replace(
            search,
            run=count,
            spent=(sum(lengths) + day.turnaround * count, joules),
            basis=f"{count} trial{'s' * (count != 1)} so far",
        )
        problem = design_problem(with_residual_noise(campaign, so_far.drawn), believed_after(campaign, so_far.drawn))
    plan, steps = design_trial(problem, search, reporter=reporter), []
    for place, step in enumerate(plan.steps, 1):
        path, commands = Store(campaign.folder).plan_schedule(place), commands_of(campaign)
        written = write_schedule(path, step.manoeuvre, campaign.family.sample_time, commands=commands)
        steps.append(replace(step, schedule=written))
    return replace(plan, steps=tuple(steps))


def goal_of(goal: Goal | None, model: VehicleModel, where: Callable[[str], str]) -> Goal:
    """Return the standard deviations that are asked for.

    Raises:
        InputError: none is.
    """
    if goal is None or not (goal.shares or goal.sds):
        names = [term.text for term in model.coefficients]
        raise InputError(
            where("goal.sd"),
            found="nothing",
            expected="how well each coefficient is to be known, which is what ends a campaign",
            remedy=f'add, for example, [goal] with sd = {{ {names[0]} = "10 %" }} and trials = 6',
        )
    return goal
