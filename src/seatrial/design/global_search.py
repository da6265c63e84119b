"""Global search over the settings of any family of designs by CMA-ES (Hansen, arXiv:1604.00772), through the library `cmaes`.

A multivariate normal over the box, in units of its sides, moves and reshapes itself towards the better half of what it draws.
Where it has shrunk to a point before the budget is spent, it starts again elsewhere: functions of a design have local optima.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from seatrial.core.errors import InputError
from seatrial.core.reporter import Progress, Reporter, no_progress
from seatrial.design.design_problem import DesignProblem, check_whole_trials
from seatrial.design.results import POPULATION, Searched
from seatrial.design.robust import utility_table
from seatrial.design.safety import judge_safety
from seatrial.design.sweep import all_controls, inside_limits
from seatrial.design.trial_design import Beside
from seatrial.design.trial_plan import TrialPlan
from seatrial.manoeuvres.family import Family
from seatrial.manoeuvres.manoeuvre import Manoeuvre

BatchedUtility = Callable[[np.ndarray], np.ndarray]
"""Utilities, shape (P,), of settings, shape (P, s); NaN if a design is not allowed."""
FIRST_SD = 0.3  # Of the first population, as a share of the box


@dataclass(frozen=True, eq=False)
class GlobalOptimum:
    """The best settings found, of s.

    Attributes:
        settings: shape (s,).
        utility: there.
        starts: how often the search began; more than one if it settled before its budget was spent.
        spread: standard deviation of each setting over the last population, as a share of its range, shape (s,).
    """

    settings: Float[np.ndarray, " s"]
    utility: float
    starts: int
    spread: Float[np.ndarray, " s"]

    @property
    def settled(self) -> bool:
        """Whether a search ended by itself, or the last population was within a hundredth of the box."""
        return self.starts > 1 or bool((self.spread < 0.01).all())


def search_globally(
    utility: BatchedUtility,
    lower: Float[np.ndarray, " s"],
    upper: Float[np.ndarray, " s"],
    budget: int,
    seed: int,
    progress: Progress = no_progress,
) -> GlobalOptimum | None:
    """Maximise a utility over a box of at least two settings; None if no design is allowed. The same seed gives the same result.

    Args:
        utility: batched utility; every call has `POPULATION` designs, so that it is compiled once.
        lower: lower ends of the box, shape (s,).
        upper: upper ends.
        budget: most designs to evaluate, one population at least; whole populations are.
        seed: of all draws.
        progress: called with the designs done and the designs in all.
    """
    rng = np.random.default_rng(seed)
    search = _fresh(np.full(lower.size, 0.5), rng)
    best, settings = -np.inf, lower
    starts, worst = 1, np.inf
    points = np.empty((POPULATION, lower.size))
    total = budget // POPULATION * POPULATION
    for done in range(0, total, POPULATION):
        if search.should_stop():
            search = _fresh(rng.random(lower.size), rng)
            starts += 1
        points = np.array([search.ask() for _ in range(POPULATION)])
        result = np.asarray(utility(lower + points * (upper - lower)), float)
        fine = np.isfinite(result)
        if fine.any():
            worst = min(worst, float(result[fine].min()))
            top = int(np.nanargmax(np.where(fine, result, -np.inf)))
            if result[top] > best:
                best, settings = float(result[top]), lower + points[top] * (upper - lower)
        # A design that is not allowed ranks below all that are; by how much does not matter to ranks.
        cost = np.where(fine, -result, 1.0 - min(worst, 0.0))
        search.tell(list(zip(points, cost.tolist(), strict=True)))
        progress(done + POPULATION, total)
    return None if best == -np.inf else GlobalOptimum(settings, best, starts, points.std(0))


def _fresh(mean: np.ndarray, rng: np.random.Generator):
    from cmaes import CMA  # of use here alone

    box = np.tile([0.0, 1.0], (mean.size, 1))
    return CMA(mean, FIRST_SD, bounds=box, seed=int(rng.integers(2**31)), population_size=POPULATION)


@dataclass(frozen=True)
class GlobalSearch:
    """The best amplitude and period between the points of the grid, of every family; see `Search`.

    If the utility of the grid is the entropy of the filter, the search uses the D criterion.

    Attributes:
        budget: designs to evaluate in all.
    """

    budget: int

    def check(self, problem: DesignProblem) -> None:
        """Check that there is something to search in, and enough to search it, before any work.

        Raises:
            InputError: a grid of one amplitude or period, too small a budget, or designs that are counted by the second or joule.
        """
        check_whole_trials(problem.per, problem.place, "a global search")
        for name, low, high in zip(("amplitude", "period"), *_box(problem), strict=True):
            if not low < high:
                raise InputError(
                    problem.place(f"design.{name}"),
                    found="one value",
                    expected="a range to search in",
                    remedy="give `from` below `to`, or leave out the global search",
                )
        if self.budget < (fewest := POPULATION * len(problem.families)):
            raise InputError(
                "global search",
                found=f"{self.budget} design{'s' * (self.budget != 1)}",
                expected=f"at least {fewest}: populations of {POPULATION} in each family",
                remedy=f"ask for some {20 * fewest}",
            )

    def find(self, problem: DesignProblem, beside: Beside, reporter: Reporter) -> Searched:
        """See `Search`."""
        self.check(problem)
        best, count = beside().best, len(problem.families)
        choosing = problem.draws[: len(problem.draws) // 2]
        optima, refused = [], []
        for family in problem.families:
            plan = problem.plan(family)
            worth = _worth_of(problem, plan, family, choosing)
            progress = reporter.progress(f"global search: {family.words}")
            optimum = search_globally(worth, *_box(problem), self.budget // count, problem.seed, progress)
            if optimum is None:
                refused.append(family.words)
            else:
                optima.append((family, plan, optimum))
        if not optima:
            raise InputError(
                problem.place("design"),
                found=f"{self.budget} designs, none of them inside the limits",
                expected="some that are",
                remedy="widen the limits, or the ranges of amplitude and period",
            )
        family, plan, optimum = max(optima, key=lambda one: one[2].utility)
        at = optimum.settings
        control = all_controls(family, problem.trim_of(family), *(x[None] for x in at))[0]
        controls = np.stack([control, best.best_controls()])
        # On draws that had no part in the search, by their mean: of the worst of few draws little can be said.
        fresh = problem.fresh
        utility, beside_it = utility_table(plan, controls, problem.few(fresh), problem.criterion(fresh)).mean(1)
        return Searched(
            family.kind,
            float(at[0]),
            float(at[1]),
            float(utility),
            float(beside_it),
            best.words(*best.best),
            self.budget // count // POPULATION * POPULATION * count,
            optimum.settled,
            problem.safety_lines(plan, control, fresh),
            tuple(refused),
            problem.unit,
            self.budget,
        )

    def manoeuvre(self, problem: DesignProblem, design: Searched) -> Manoeuvre:
        """Return the result as a trial to run."""
        family = next(one for one in problem.families if one.kind == design.kind)
        return family.manoeuvre(design.amplitude, design.period)


def _box(problem: DesignProblem) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest amplitude and period of the grid."""
    amplitude, period = problem.amplitudes, problem.periods
    return np.array([amplitude[0], period[0]]), np.array([amplitude[-1], period[-1]])


def _worth_of(problem: DesignProblem, plan: TrialPlan, family: Family, draws: np.ndarray) -> BatchedUtility:
    """Utility of designs by amplitude and period; NaN if one does not fit or may leave the limits."""
    criterion, few, trim = problem.criterion(draws), problem.few(draws), problem.trim_of(family)
    resting = [value for _, value in trim]

    def worth(settings: np.ndarray) -> np.ndarray:
        controls = all_controls(family, trim, settings[:, 0], settings[:, 1])
        allowed = family.fits(settings[:, 1]) & inside_limits(family, controls, trim, problem.limits)
        if problem.motion:
            # Designs that are refused stand in with the trim, which is quick to judge and not looked at.
            held = np.where(allowed[:, None, None], controls, resting)
            allowed &= judge_safety(plan, held, draws, problem.motion, problem.probability).allowed
        table = utility_table(plan, np.where(allowed[:, None, None], controls, resting), few, criterion)
        return np.where(allowed, table.min(1) if problem.over == "worst" else table.mean(1), np.nan)

    return worth
