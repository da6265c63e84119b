"""Global search over the settings of any family of designs by CMA-ES (Hansen, arXiv:1604.00772), through the library `cmaes`.

A multivariate normal over the box, in units of its sides, moves and reshapes itself towards the better half of what it draws.
Where it has shrunk to a point before the budget is spent, it starts again elsewhere: functions of a design have local optima.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from seatrial.core.errors import InputError
from seatrial.core.reporter import Progress, no_progress

BatchedUtility = Callable[[np.ndarray], np.ndarray]
"""Utilities, shape (P,), of settings, shape (P, s); NaN where a design is not allowed."""
POPULATION = 16  # Designs that are evaluated at once
FIRST_SD = 0.3  # Of the first population, as a share of the box


@dataclass(frozen=True, eq=False)
class GlobalOptimum:
    """The best settings found; s settings, P members of a population.

    Attributes:
        settings: shape (s,).
        utility: there.
        evaluations: designs evaluated.
        starts: how often the search began; more than one if it settled before its budget was spent.
        peaks: best utility of each start, shape (starts,); -inf where it met no design that is allowed.
        spread: standard deviation of each setting over the last population, as a share of its range, shape (s,).
        allowed: share of the designs evaluated that were allowed.
    """

    settings: Float[np.ndarray, " s"]
    utility: float
    evaluations: int
    starts: int
    peaks: Float[np.ndarray, " starts"]
    spread: Float[np.ndarray, " s"]
    allowed: float

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
    population: int = POPULATION,
    progress: Progress = no_progress,
) -> GlobalOptimum:
    """Maximise a utility over a box of at least two settings. The same seed gives the same result.

    Args:
        utility: batched utility; every call has `population` designs, so that it is compiled once.
        lower: lower ends of the box, shape (s,).
        upper: upper ends.
        budget: most designs to evaluate; whole populations are.
        seed: of all draws.
        population: designs in one call.
        progress: called with the designs done and the designs in all.

    Raises:
        InputError: an empty box, fewer than two settings, a budget below one population, or no design that is allowed.
    """
    lower, upper = np.asarray(lower, float), np.asarray(upper, float)
    _check(lower, upper, budget, population)
    rng = np.random.default_rng(seed)
    search = _fresh(np.full(lower.size, 0.5), rng, population)
    best, settings = -np.inf, lower
    peaks, allowed, worst = [-np.inf], 0, np.inf
    points = np.empty((population, lower.size))
    total = budget // population * population
    for done in range(0, total, population):
        if search.should_stop():
            search = _fresh(rng.random(lower.size), rng, population)
            peaks.append(-np.inf)
        points = np.array([search.ask() for _ in range(population)])
        result = np.asarray(utility(lower + points * (upper - lower)), float)
        fine = np.isfinite(result)
        allowed += int(fine.sum())
        if fine.any():
            worst = min(worst, float(result[fine].min()))
            top = int(np.nanargmax(np.where(fine, result, -np.inf)))
            peaks[-1] = max(peaks[-1], float(result[top]))
            if result[top] > best:
                best, settings = float(result[top]), lower + points[top] * (upper - lower)
        # A design that is not allowed ranks below all that are; by how much does not matter to ranks.
        cost = np.where(fine, -result, 1.0 - min(worst, 0.0))
        search.tell(list(zip(points, cost.tolist(), strict=True)))
        progress(done + population, total)
    if best == -np.inf:
        raise InputError(
            "global search, limits",
            found=f"{total} designs, and not one of them allowed",
            expected="some designs of the box inside the limits",
            remedy="widen the limits, or choose the box nearer to designs that are known to be allowed",
        )
    return GlobalOptimum(settings, best, total, len(peaks), np.array(peaks), points.std(0), allowed / total)


def _fresh(mean: np.ndarray, rng: np.random.Generator, population: int):
    from cmaes import CMA  # of use here alone

    box = np.tile([0.0, 1.0], (mean.size, 1))
    return CMA(mean, FIRST_SD, bounds=box, seed=int(rng.integers(2**31)), population_size=population)


def _check(lower: np.ndarray, upper: np.ndarray, budget: int, population: int) -> None:
    shapes = lower.ndim == 1 and lower.shape == upper.shape and lower.size >= 2
    finite = shapes and bool(np.isfinite([lower, upper]).all())
    crossed = np.flatnonzero(~(lower < upper)) if finite else np.array([], int)
    first = int(crossed[0]) if crossed.size else 0
    for holds, what, result, expected in (
        (shapes, "box", f"shapes {lower.shape} and {upper.shape}", "two vectors of one length, 2 or more"),
        (finite, "box", "ends that are not finite", "finite numbers"),
        (
            not crossed.size,
            "box",
            ""
            if not crossed.size
            else f"lower end {lower[first]:g} not below upper end {upper[first]:g} of setting {first + 1}: "
            f"{lower[first] - upper[first]:.6g} too high",
            "lower ends below upper ends",
        ),
        (population >= 4, "population", f"{population}", "4 or more"),
        (budget >= population, "budget", f"{budget} designs", f"at least one population, {population}"),
    ):
        if not holds:
            raise InputError(f"global search, {what}", found=result, expected=expected, remedy="correct this setting")
