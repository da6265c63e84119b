"""The plan of all trials: which in which order, the chance that they meet the goals, and what to drop first.

Designs are those of the problem's grid on its control, and the same shapes and periods on every other control with two limits, each
amplitude the same share of the room that its control has.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf, sqrt
from pathlib import Path
from typing import Annotated

import numpy as np
from jaxtyping import Bool, Float
from pydantic import Field

from seatrial.core.errors import InputError
from seatrial.core.reporter import Reporter
from seatrial.design.cost import ElectricPower
from seatrial.design.design_problem import HALF, UTILITY_DRAWS, DesignProblem, check_whole_trials, covariance
from seatrial.design.goal_plan import MAX_TRIALS, PlannedTrial, Stage, StageGoal, choose_trials, find_stages, goals_met
from seatrial.design.limit_conflicts import check_some_allowed
from seatrial.design.robust import information_or_nan
from seatrial.design.safety import judge_safety
from seatrial.design.sweep import all_controls, inside_limits
from seatrial.design.trial_design import Beside
from seatrial.design.trial_plan import TrialPlan
from seatrial.manoeuvres.family import Family, design_words
from seatrial.manoeuvres.manoeuvre import Limits, Manoeuvre

# Share of the room of another control that the largest amplitude takes where the designed control has no two limits
ROOM_SHARE = 0.75


@dataclass(frozen=True)
class Step:
    """One trial of the plan.

    Attributes:
        stage: its number, from 0.
        words: of the design.
        control: that it drives.
        without: chance of meeting the goals if this trial alone is dropped.
        manoeuvre: that the vehicle runs.
        schedule: file of it, if it is written.
    """

    stage: int
    words: str
    control: str
    without: float
    manoeuvre: Annotated[Manoeuvre, Field(exclude=True)] = field(compare=False)
    schedule: Path = Path()


@dataclass(frozen=True)
class Plan:
    """A campaign planned.

    Attributes:
        basis: state of knowledge from which it is planned.
        stages: coefficients that are estimated together, in order.
        steps: trials, in the order in which they are run.
        chance: that all goals are met after them.
        chance_error: its Monte Carlo standard error.
        goals: chance of each goal, by coefficient, the least first.
        without_goal: chance that all others are met, by coefficient.
        seconds: that it takes.
        joules: energy that it takes; None if no power is stated.
        ended_by: the limit that ends it; empty if none does.
        further: trials, time and energy that would meet the goals; None if the plan does, or if no reasonable amount would.
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


@dataclass(frozen=True, eq=False)
class PlanSearch:
    """The trials after which goals are met with some chance, within a day; see `Search`.

    Attributes:
        shares: standard deviation wanted of a coefficient, as a share of its value.
        sds: standard deviation wanted, SI.
        trials: most of them, those that were run included.
        run: how many were.
        spent: time, s, and energy, J, that these took.
        chance: of meeting all goals, from which on no trial is added.
        time: that all trials with their turnaround may take, s.
        battery: energy for all trials, J.
        turnaround: time between trials, s.
        power: hotel load and propeller; None if nobody counts energy.
        basis: what is believed, in words.
    """

    shares: Mapping[str, float]
    sds: Mapping[str, float]
    trials: int
    run: int = 0
    spent: tuple[float, float] = (0.0, 0.0)
    chance: float = 0.9
    time: float = inf
    battery: float = inf
    turnaround: float = 0.0
    power: ElectricPower | None = None
    basis: str = "the priors"

    def find(self, problem: DesignProblem, beside: Beside, reporter: Reporter) -> Plan:
        """See `Search`; no design of the families stands beside a plan."""
        check_whole_trials(problem.per, problem.place, "a plan", joules=True)
        plan, draws, wanted = problem.plan(), problem.draws, {**self.shares, **self.sds}
        stages = find_stages(plan.names, [name for name in plan.names if name in wanted])
        designs, information = _designs(problem, plan, draws[:HALF], reporter)
        precision = np.linalg.inv(covariance(draws))
        share = np.array([self.shares.get(name, inf) for name in plan.names])
        sd = np.array([self.sds.get(name, inf) for name in plan.names])
        places = [np.array([plan.names.index(name) for name in stage.sought]) for stage in stages]
        goals = tuple(StageGoal(place, share, sd, precision) for place in places)
        seconds = np.array([one.family.end + self.turnaround for one in designs])
        joules = np.array([joules_of(self.power, self.turnaround, one.control(), one.family.end) for one in designs])
        judge = _Judge(problem.seed, plan, goals, draws, designs)

        def is_enough(trials: Sequence[PlannedTrial]) -> bool:
            return judge.chance(trials, slice(0, HALF)) >= self.chance

        chosen = choose_trials(goals, draws[:UTILITY_DRAWS], information, seconds, MAX_TRIALS, is_enough)
        inside, ended_by = self._inside(chosen, seconds, joules)
        does = is_enough(chosen)
        if not does and len(inside) == len(chosen):
            few = len(chosen) < MAX_TRIALS
            ended_by = "no design gives the missing information" if few else f"{MAX_TRIALS} trials are not enough"
        further = (len(chosen), *self._taken(chosen, seconds, joules)) if does and ended_by else None
        return self._planned(stages, designs, sorted(inside), judge, ended_by, further, seconds, joules)

    def _inside(
        self, chosen: Sequence[PlannedTrial], seconds: np.ndarray, joules: np.ndarray
    ) -> tuple[list[PlannedTrial], str]:
        """Return the first of the trials, as many as the day allows, and what ends them."""
        (time, energy), inside = self.spent, []
        for trial in chosen:
            time, energy = time + seconds[trial.design], energy + joules[trial.design]
            if time > self.time:
                return inside, f"the {self.time / 3600:.3g} h of [plan] end it"
            if energy > self.battery:
                return inside, f"the battery of {self.battery / 3600:.3g} Wh ends it"
            if len(inside) == max(self.trials - self.run, 0):
                return inside, f"[goal] trials = {self.trials} ends it"
            inside.append(trial)
        return inside, ""

    def _taken(
        self, trials: Sequence[PlannedTrial], seconds: np.ndarray, joules: np.ndarray
    ) -> tuple[float, float | None]:
        """Return the time, s, and the energy, J, that trials take."""
        time, energy = (float(sum(each[trial.design] for trial in trials)) for each in (seconds, joules))
        return time, None if self.power is None else energy

    def _planned(
        self,
        stages: tuple[Stage, ...],
        designs: "Sequence[_Design]",
        trials: Sequence[PlannedTrial],
        judge: "_Judge",
        ended_by: str,
        further: tuple[int, float, float | None] | None,
        seconds: np.ndarray,
        joules: np.ndarray,
    ) -> Plan:
        met = judge.met(trials, slice(HALF, None))
        chance = float(met.all(1).mean())
        spread = (chance * len(met) + 1) / (len(met) + 2)  # not zero where all draws agree (Laplace)
        asked = [name for name in judge.names if name in {**self.shares, **self.sds}]
        each = {name: float(met[:, judge.names.index(name)].mean()) for name in asked}
        others = {name: float(np.delete(met, judge.names.index(name), 1).all(1).mean()) for name in asked}
        steps = []
        for place, trial in enumerate(trials):
            design, rest = designs[trial.design], [*trials[:place], *trials[place + 1 :]]
            manoeuvre = design.family.manoeuvre(design.amplitude, design.period)
            steps.append(Step(trial.stage, design.words, design.family.control, judge.chance(rest), manoeuvre))
        return Plan(
            self.basis,
            stages,
            tuple(steps),
            chance,
            sqrt(spread * (1 - spread) / (len(met) + 2)),
            dict(sorted(each.items(), key=lambda one: one[1])),
            others,
            *self._taken(trials, seconds, joules),
            ended_by,
            further,
            self.chance,
        )


def joules_of(
    power: ElectricPower | None, turnaround: float, controls: Mapping[str, np.ndarray], duration: float
) -> float:
    """Return what a trial and its turnaround draw, J: the hotel load, and in the trial the propulsion; 0 if no power is stated."""
    if power is None:
        return 0.0
    return float(np.nanmean(power.driven(controls))) * duration + power.hotel * (duration + turnaround)


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


def _families(problem: DesignProblem, names: Sequence[str]) -> Iterator[tuple[Family, np.ndarray]]:
    """Yield families with their amplitudes, SI: the problem's, and for every other control with two limits those of the same room."""
    amplitudes, trims = problem.amplitudes, dict(problem.trim_of(problem.family))
    for family in problem.families:
        yield family, amplitudes
    driven = _room(problem.limits, problem.family.control, problem.family.trim)
    largest = ROOM_SHARE if driven == 0 else min(float(amplitudes.max()) / driven, 1.0)
    for name in names:
        room = _room(problem.limits, name, trims[name])
        if name != problem.family.control and room > 0:
            scaled = amplitudes / amplitudes.max() * largest * room
            for family in problem.families:
                yield replace(family, control=name, trim=trims[name], beside=()), scaled


def _room(control_limits: Mapping[str, Limits], control: str, trim: float) -> float:
    """Return how far a control may go from trim to both sides, SI; 0 if it has no two limits."""
    limits = control_limits.get(control)
    if limits is None or limits.lower is None or limits.upper is None:
        return 0.0
    return max(min(trim - limits.lower, limits.upper - trim), 0.0)


def _designs(
    problem: DesignProblem, plan: TrialPlan, draws: np.ndarray, reporter: Reporter
) -> tuple[list[_Design], Float[np.ndarray, "D S k k"]]:
    """Return the designs that keep all limits, and the information of each at the first draws; those that diverge at one are left out."""
    trim, designs = problem.trim_of(problem.family), []
    names = tuple(name for name, _ in trim)
    for family, amplitudes in _families(problem, names):
        periods = problem.periods
        rows, columns = (grid.ravel() for grid in np.meshgrid(amplitudes, periods[family.fits(periods)], indexing="ij"))
        if not rows.size:
            continue
        controls = all_controls(family, trim, rows, columns)
        kept = inside_limits(family, controls, trim, problem.limits)
        designs += [
            _Design(family, float(rows[i]), float(columns[i]), controls[i], names) for i in np.flatnonzero(kept)
        ]
    if not designs:
        raise InputError(
            problem.place("design"),
            found="no design that fits and keeps the limits of the controls",
            expected="one at least",
            remedy="lower the amplitudes or lengthen `ramp`; `seatrial design` names the broken limit",
        )
    report = reporter.progress(f"plan: {len(designs)} designs")
    report(0, 2)
    if problem.motion:
        every, limits = np.stack([one.controls for one in designs]), problem.motion
        safety = judge_safety(plan, every, draws, limits, problem.probability)
        check_some_allowed(replace(safety, names=tuple(one.words for one in designs)))
        designs = [one for one, allowed in zip(designs, safety.allowed, strict=True) if allowed]
    report(1, 2)
    information = information_or_nan(plan, np.stack([one.controls for one in designs]), draws[:UTILITY_DRAWS])
    finite = np.isfinite(information).all((1, 2, 3))
    if not finite.any():
        raise InputError(
            problem.place("design.amplitude"),
            found="designs that all diverge for some vehicle of the priors",
            expected="at least one design without divergence",
            remedy="narrow the priors to damping that dissipates, or excite less; `seatrial prior` shows the cause",
        )
    report(2, 2)
    return [one for one, is_finite in zip(designs, finite, strict=True) if is_finite], information[finite]


class _Judge:
    """Says which goals are met after some trials, over all draws; the information of a design is computed when it is first chosen."""

    def __init__(
        self,
        seed: int,
        plan: TrialPlan,
        goals: Sequence[StageGoal],
        draws: np.ndarray,
        designs: Sequence[_Design],
    ):
        self._plan, self._goals, self._draws, self._designs = plan, goals, draws, designs
        self._normal = np.random.default_rng(seed).standard_normal(draws.shape)
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
