"""The plan of a campaign, from its priors or from the mode after a trial: which trials in which order, and their schedules."""

from collections import Counter
from dataclasses import dataclass, replace
from math import hypot, sqrt

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.schema import Goal
from seatrial.campaign.design.problem import believed_after, design_problem
from seatrial.campaign.design.residual_noise import with_residual_noise
from seatrial.campaign.design.schedule import commands_of, write_schedule
from seatrial.campaign.inference.model_error import stated_errors
from seatrial.campaign.store.estimates import Drawn
from seatrial.campaign.store.stored_result import Store
from seatrial.core.coefficients import CoefficientName
from seatrial.core.display_units import percent
from seatrial.core.errors import InputError
from seatrial.core.record import Record
from seatrial.core.reporter import SILENT, Reporter
from seatrial.core.signals import RATES, SPEEDS
from seatrial.design.cost import ElectricPower
from seatrial.design.plan_search import Plan, PlanSearch, joules_of
from seatrial.design.trial_design import design_trial
from seatrial.estimation.priors import nominal
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
        reporter: receives the progress.

    Raises:
        InputError: no goal, designs that are ended early, or none inside the limits.
    """
    goal, day, stated = goal_of(campaign), campaign.plan, campaign.power
    power = None
    if stated is not None:
        power = ElectricPower(stated.hotel, stated.propulsion, stated.at, campaign.family.control)
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


def goal_of(campaign: Campaign) -> Goal:
    """Return the standard deviations that are asked for, less what errors of stated inputs take of them, in squares.

    If all inertias of an axis are multiplied by one number, and all its coefficients too, no motion changes. If a sensor shows s times a
    velocity, a coefficient changes by s to the power of that velocity in its term, and by 1 / s along the axis of the sensor.

    Raises:
        InputError: no standard deviation is asked for, or one that errors of stated inputs exceed alone.
    """
    goal, model = campaign.goal, campaign.model(campaign.full)
    if goal is None or not (goal.shares or goal.sds):
        names = [term.text for term in model.coefficients]
        raise InputError(
            campaign.where("goal.sd"),
            found="nothing",
            expected="the required precision of each coefficient, which ends a campaign",
            remedy=f'add, for example, [goal] with sd = {{ {names[0]} = "10 %" }} and trials = 6',
        )
    taken = {name: stated_share(campaign, model, name) for name in (*goal.shares, *goal.sds)}
    values = {name: abs(nominal(campaign.prior(name))) for name in goal.sds}
    sizes = {**goal.shares} | {name: sd / values[name] for name, sd in goal.sds.items() if values[name]}
    for name, share in sizes.items():
        if taken[name] >= share:
            raise InputError(
                campaign.where(f"goal.sd.{name}"),
                found=f"{percent(share)}, but errors of stated inputs already make {percent(taken[name])}",
                expected="more than these errors, which no trial reduces",
                remedy="weigh the vehicle, compare its speed sensor with another, and state inertia_error and scale_error in "
                "[estimation]; or relax the goal",
            )
    shares = {name: sqrt(share**2 - taken[name] ** 2) for name, share in goal.shares.items()}
    sds = {name: sqrt(sd**2 - (taken[name] * values[name]) ** 2) for name, sd in goal.sds.items()}
    return replace(goal, shares=shares, sds=sds)


def stated_share(campaign: Campaign, model: VehicleModel, name: str) -> float:
    """Return the standard deviation of a coefficient from errors of stated inputs alone, as a share of its value."""
    term, stated = CoefficientName.parse(name), stated_errors(campaign.estimation)
    axis = term.axis if term.axis in SPEEDS else "X"  # thrust acts along X
    is_free = model.per_unit_mass or any(
        one.is_added_mass and one.axis == axis for one in map(CoefficientName.parse, campaign.full.terms)
    )
    powers = Counter({SPEEDS[axis]: -1})
    for factor in term.factors:
        powers[factor.signal] += factor.power
    scaled = sum(powers[channel] ** 2 for channel in campaign.channels if channel in RATES)
    return hypot(0.0 if is_free else stated.inertia, stated.scale * sqrt(scaled))
