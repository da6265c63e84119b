"""The plan of a campaign: which trials in which order, the chance that they meet the goals, and what to drop first.

Designs are those of `[design]` on its control, and the same shapes and periods on every other control with two limits, each amplitude
the same share of the room that its control has. The plan is made from what is believed: the priors, or the mode after a trial.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, sqrt
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.design_table import PowerTable
from seatrial.campaign.config.schema import Goal, PlanTable
from seatrial.campaign.design.problem import coefficient_draws, plan_of, prior_draws
from seatrial.campaign.design.residual_noise import with_residual_noise
from seatrial.campaign.design.schedule import commands_of, write_schedule
from seatrial.campaign.store.estimates import Drawn
from seatrial.campaign.store.stored_result import Store
from seatrial.core.errors import InputError
from seatrial.core.record import Record
from seatrial.core.reporter import SILENT, Reporter
from seatrial.design.cost import PropellerPower
from seatrial.design.design_problem import HALF, UTILITY_DRAWS, check_whole_trials
from seatrial.design.goal_plan import MAX_TRIALS, PlannedTrial, Stage, StageGoal, choose_trials, find_stages, goals_met
from seatrial.design.limit_conflicts import check_some_allowed
from seatrial.design.robust import information_or_nan
from seatrial.design.safety import judge_safety
from seatrial.design.sweep import all_controls, inside_limits
from seatrial.design.trial_plan import TrialPlan
from seatrial.manoeuvres.family import Family, design_words
from seatrial.manoeuvres.manoeuvre import Limits
from seatrial.vehicles.model import VehicleModel

# Share of the room of another control that the largest amplitude takes where the designed control has no two limits
ROOM_SHARE = 0.75


@dataclass(frozen=True, eq=False)
class SoFar:
    """What has been learnt: draws about the mode of the posterior, and the records behind it."""

    drawn: Drawn
    records: tuple[Record, ...]


@dataclass(frozen=True)
class Step:
    """One trial of the plan.

    Attributes:
        stage: its number, from 0.
        words: of the design.
        control: that it drives.
        schedule: that the vehicle runs.
        without: chance of meeting the goals if this trial alone is dropped.
    """

    stage: int
    words: str
    control: str
    schedule: Path
    without: float


@dataclass(frozen=True)
class Plan:
    """A campaign planned.

    Attributes:
        basis: what it is planned from.
        stages: which coefficients are sought together, in order.
        steps: trials, in the order in which they are run.
        chance: that all goals are met after them.
        chance_error: its Monte Carlo standard error.
        goals: chance of each goal, by coefficient, the least first.
        without_goal: chance that all others are met, by coefficient.
        seconds: that it takes.
        joules: that it takes; None where nobody asks.
        ended_by: what keeps it from going on; empty where nothing does.
        further: trials, time and energy that would do; None where the plan does, or nothing in reason would.
        asked: chance from which on no trial is added.
    """

    basis: str
    stages: tuple[Stage, ...]
    steps: tuple[Step, ...]
    chance: float
    chance_error: float
    goals: dict[str, float]
    without_goal: dict[str, float]
    seconds: float
    joules: float | None
    ended_by: str
    further: tuple[int, float, float | None] | None
    asked: float


def plan_trials(campaign: Campaign, so_far: SoFar | None = None, reporter: Reporter = SILENT) -> Plan:
    """Plan the trials of a campaign, or those that remain.

    Args:
        campaign: goals, limits, designs, and what a day allows.
        so_far: what earlier trials taught; None before the first one.
        reporter: told how far the work has come.

    Raises:
        InputError: no goal, designs that are ended early, or none inside the limits.
    """
    check_whole_trials(campaign.design.per, campaign.where, "a plan", joules=True)
    goal = goal_of(campaign.goal, campaign.model(campaign.full), campaign.where)
    if so_far is None:
        known, structure, basis = campaign, campaign.full, "the priors"
        draws = prior_draws(campaign, campaign.model(structure))
    else:
        known, structure = with_residual_noise(campaign, so_far.drawn), so_far.drawn.structure
        draws, count = coefficient_draws(so_far.drawn, campaign.seed), len(so_far.records)
        basis = f"{count} trial{'s' * (count != 1)} so far"
    plan = plan_of(known, known.model(structure))
    stages = find_stages(plan.names, [name for name in plan.names if name in {**goal.shares, **goal.sds}])
    designs, information = _designs(known, plan, draws[:HALF], reporter)
    precision = np.linalg.inv(np.atleast_2d(np.cov(draws, rowvar=False)))
    share = np.array([goal.shares.get(name, inf) for name in plan.names])
    sd = np.array([goal.sds.get(name, inf) for name in plan.names])
    goals = tuple(
        StageGoal(np.array([plan.names.index(name) for name in stage.sought]), share, sd, precision) for stage in stages
    )
    seconds = np.array([one.family.end + campaign.plan.turnaround for one in designs])
    joules = np.array(
        [_joules(campaign.power, campaign.family, campaign.plan, one.control(), one.family.end) for one in designs]
    )
    spent = _spent(campaign.power, campaign.family, campaign.plan, () if so_far is None else so_far.records)
    judge = _Judge(campaign, plan, goals, draws, designs)
    few = draws[:UTILITY_DRAWS]
    chosen = choose_trials(
        goals,
        few,
        information,
        seconds,
        MAX_TRIALS,
        lambda trials: judge.chance(trials, slice(0, HALF)) >= campaign.plan.chance,
    )
    most = max(goal.trials - (0 if so_far is None else len(so_far.records)), 0)
    inside, ended_by = _inside(campaign.plan, campaign.goal, chosen, seconds, joules, spent, most)
    is_enough = judge.chance(chosen, slice(0, HALF)) >= campaign.plan.chance
    if not is_enough and len(inside) == len(chosen):
        ended_by = (
            "no design gives the missing information"
            if len(chosen) < MAX_TRIALS
            else f"{MAX_TRIALS} trials are not enough"
        )
    further = (len(chosen), _sum(seconds, chosen), _energy(campaign.power, joules, chosen)) if is_enough else None
    return _written_plan(campaign, basis, stages, designs, sorted(inside), judge, seconds, joules, ended_by, further)


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


@dataclass(frozen=True, eq=False)
class _Design:
    """One member of a family, and all controls over time, SI."""

    family: Family
    amplitude: float
    period: float
    controls: Float[np.ndarray, "n c"]
    names: tuple[str, ...]

    @property
    def words(self) -> str:
        return design_words(self.family, self.amplitude, self.period)

    def control(self) -> dict[str, np.ndarray]:
        return dict(zip(self.names, self.controls.T, strict=True))


def _families(campaign: Campaign, names: Sequence[str]) -> Iterator[tuple[Family, np.ndarray]]:
    """Yield families with their amplitudes, SI: those of `[design]`, and for every other control with two limits those of the same room."""
    amplitudes, model_trim = campaign.design.grid()[0], dict(campaign.control_trim(campaign.model(campaign.full)))
    for family in campaign.families:
        yield family, amplitudes
    driven = _room(campaign.control_limits, campaign.family.control, campaign.family.trim)
    largest = ROOM_SHARE if driven == 0 else min(float(amplitudes.max()) / driven, 1.0)
    for name in names:
        room = _room(campaign.control_limits, name, model_trim[name])
        if name != campaign.family.control and room > 0:
            scaled = amplitudes / amplitudes.max() * largest * room
            for family in campaign.families:
                yield replace(family, control=name, trim=model_trim[name], beside=()), scaled


def _room(control_limits: Mapping[str, Limits], control: str, trim: float) -> float:
    """Return how far a control may go from trim to both sides, SI; 0 where it has no two limits."""
    limits = control_limits.get(control)
    if limits is None or limits.lower is None or limits.upper is None:
        return 0.0
    return max(min(trim - limits.lower, limits.upper - trim), 0.0)


def _designs(
    campaign: Campaign, plan: TrialPlan, draws: np.ndarray, reporter: Reporter
) -> tuple[list[_Design], Float[np.ndarray, "D S k k"]]:
    """Return the designs that keep all limits, and the information of each at the first draws; those that diverge at one are left out."""
    trim, designs = campaign.control_trim(plan.model), []
    names = tuple(name for name, _ in trim)
    for family, amplitudes in _families(campaign, names):
        periods = campaign.design.grid()[1]
        rows, columns = (grid.ravel() for grid in np.meshgrid(amplitudes, periods[family.fits(periods)], indexing="ij"))
        if not rows.size:
            continue
        controls = all_controls(family, trim, rows, columns)
        kept = inside_limits(family, controls, trim, campaign.control_limits)
        designs += [
            _Design(family, float(rows[i]), float(columns[i]), controls[i], names) for i in np.flatnonzero(kept)
        ]
    if not designs:
        raise InputError(
            campaign.where("design"),
            found="no design that fits and keeps the limits of the controls",
            expected="one at least",
            remedy="lower the amplitudes or lengthen `ramp`; `seatrial design` says which limit is broken",
        )
    report = reporter.progress(f"plan: {len(designs)} designs")
    report(0, 2)
    if campaign.motion_limits:
        every, limits = np.stack([one.controls for one in designs]), campaign.motion_limits
        safety = judge_safety(plan, every, draws, limits, campaign.design.probability)
        check_some_allowed(replace(safety, names=tuple(one.words for one in designs)))
        designs = [one for one, allowed in zip(designs, safety.allowed, strict=True) if allowed]
    report(1, 2)
    information = information_or_nan(plan, np.stack([one.controls for one in designs]), draws[:UTILITY_DRAWS])
    finite = np.isfinite(information).all((1, 2, 3))
    if not finite.any():
        raise InputError(
            campaign.where("design.amplitude"),
            found="designs under each of which the motion of some vehicle that the priors allow diverges",
            expected="one design at least that none of them diverges under",
            remedy="narrow the priors to damping that dissipates, or excite less; `seatrial prior` shows why",
        )
    report(2, 2)
    return [one for one, is_finite in zip(designs, finite, strict=True) if is_finite], information[finite]


class _Judge:
    """Says which goals are met after some trials, over all draws; the information of a design is computed when it is first chosen."""

    def __init__(
        self,
        campaign: Campaign,
        plan: TrialPlan,
        goals: Sequence[StageGoal],
        draws: np.ndarray,
        designs: Sequence[_Design],
    ):
        self._plan, self._goals, self._draws, self._designs = plan, goals, draws, designs
        self._normal = np.random.default_rng(campaign.seed).standard_normal(draws.shape)
        self._known: dict[int, np.ndarray] = {}
        self.names = plan.names

    def met(self, trials: Sequence[PlannedTrial], which: slice) -> Bool[np.ndarray, "S k"]:
        """Return whether each goal is met at some of the draws; where the motion diverges none is."""
        for number in {trial.design for trial in trials} - self._known.keys():
            self._known[number] = information_or_nan(self._plan, self._designs[number].controls[None], self._draws)[0]
        used = {trial.design: self._known[trial.design][which] for trial in trials}
        lost = ~np.all([np.isfinite(one).all((1, 2)) for one in used.values()], axis=0) if used else np.array(False)
        used = {number: np.where(np.isfinite(one), one, 0.0) for number, one in used.items()}
        are_met = goals_met(self._goals, self._draws[which], used, trials, self._normal[which])
        are_met[np.broadcast_to(lost, are_met.shape[:1])] = False
        return are_met

    def chance(self, trials: Sequence[PlannedTrial], which: slice = slice(HALF, None)) -> float:
        """Return the share of the draws at which all goals are met; the second half has no part in the choice."""
        return float(self.met(trials, which).all(1).mean())


def _inside(
    plan: PlanTable,
    goal: Goal | None,
    chosen: Sequence[PlannedTrial],
    seconds: np.ndarray,
    joules: np.ndarray,
    spent: tuple[float, float],
    most: int,
) -> tuple[list[PlannedTrial], str]:
    """Return the first of the trials, as many as the day allows, and what ends them."""
    time, energy, inside = *spent, []
    for trial in chosen:
        time, energy = time + seconds[trial.design], energy + joules[trial.design]
        if time > plan.time:
            return inside, f"the {plan.time / 3600:.3g} h of [plan] end it"
        if energy > plan.battery:
            return inside, f"the battery of {plan.battery / 3600:.3g} Wh ends it"
        if len(inside) == most:
            return inside, f"[goal] trials = {goal.trials if goal else most} ends it"
        inside.append(trial)
    return inside, ""


def _written_plan(
    campaign: Campaign,
    basis: str,
    stages: tuple[Stage, ...],
    designs: Sequence[_Design],
    trials: Sequence[PlannedTrial],
    judge: _Judge,
    seconds: np.ndarray,
    joules: np.ndarray,
    ended_by: str,
    further: tuple[int, float, float | None] | None,
) -> Plan:
    met = judge.met(trials, slice(HALF, None))
    chance, goal = float(met.all(1).mean()), goal_of(campaign.goal, campaign.model(campaign.full), campaign.where)
    spread = (chance * len(met) + 1) / (len(met) + 2)  # not zero where all draws agree (Laplace)
    asked = [name for name in judge.names if name in {**goal.shares, **goal.sds}]
    each = {name: float(met[:, judge.names.index(name)].mean()) for name in asked}
    others = {name: float(np.delete(met, judge.names.index(name), 1).all(1).mean()) for name in asked}
    steps = []
    for place, trial in enumerate(trials, 1):
        design = designs[trial.design]
        rest = [*trials[: place - 1], *trials[place:]]
        manoeuvre = design.family.manoeuvre(design.amplitude, design.period)
        path = write_schedule(
            Store(campaign.folder).plan_schedule(place),
            manoeuvre,
            campaign.family.sample_time,
            commands=commands_of(campaign),
        )
        steps.append(Step(trial.stage, design.words, design.family.control, path, judge.chance(rest)))
    return Plan(
        basis,
        stages,
        tuple(steps),
        chance,
        sqrt(spread * (1 - spread) / (len(met) + 2)),
        dict(sorted(each.items(), key=lambda one: one[1])),
        others,
        _sum(seconds, trials),
        _energy(campaign.power, joules, trials),
        ended_by,
        further if ended_by else None,
        campaign.plan.chance,
    )


def _joules(
    power: PowerTable | None, family: Family, plan: PlanTable, controls: dict[str, np.ndarray], duration: float
) -> float:
    """Return what a trial and its turnaround draw, J: the hotel load, and in the trial the propulsion; 0 where no power is stated."""
    if power is None:
        return 0.0
    propeller = PropellerPower(power.propulsion, power.at, family.control)
    driven = float(np.nanmean(propeller.watts(controls))) * duration
    return driven + power.hotel * (duration + plan.turnaround)


def _spent(power: PowerTable | None, family: Family, plan: PlanTable, records: Sequence[Record]) -> tuple[float, float]:
    """Return time, s, and energy, J, that the records took."""
    lengths = [float(record.time[-1] - record.time[0]) for record in records]
    controls = [dict(zip(record.controls, record.control.T, strict=True)) for record in records]
    joules = [_joules(power, family, plan, one, length) for one, length in zip(controls, lengths, strict=True)]
    return sum(lengths) + plan.turnaround * len(records), sum(joules)


def _sum(each: np.ndarray, trials: Sequence[PlannedTrial]) -> float:
    return float(sum(each[trial.design] for trial in trials))


def _energy(power: PowerTable | None, joules: np.ndarray, trials: Sequence[PlannedTrial]) -> float | None:
    return None if power is None else _sum(joules, trials)
