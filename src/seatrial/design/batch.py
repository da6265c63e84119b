"""Several trials planned together: those whose information, added up, is worth most.

Information of independent trials adds up, F = sum F_i. Trials are taken one after another, each the best beside those taken, and
then exchanged one by one while that helps (Fedorov, Theory of Optimal Experiments, 1972). A design may be taken twice.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from jaxtyping import Float
from pydantic import Field

from seatrial.core.reporter import Reporter
from seatrial.design.design_problem import DesignProblem, check_whole_trials
from seatrial.design.fisher_utilities import Criterion
from seatrial.design.robust import information_table
from seatrial.design.trial_design import Beside
from seatrial.manoeuvres.manoeuvre import Manoeuvre

EXCHANGE_ROUNDS = 20  # Exchanges of every trial, at most
DESIGNS_AT_ONCE = 64  # Designs whose information is computed between two reports of progress


@dataclass(frozen=True)
class Batch:
    """Trials planned together.

    Attributes:
        designs: index of each, by added information.
        utility: of the first, of the first two, and so on, averaged over the draws.
        repeated: utility of the single best design as often.
    """

    designs: tuple[int, ...]
    utility: tuple[float, ...]
    repeated: float


def plan_batch(information: Float[np.ndarray, "D S k k"], utility: Criterion, trials: int) -> Batch:
    """Choose so many trials of D designs, weighed over S draws of the coefficients.

    Args:
        information: Fisher information of every design at every draw, SI.
        utility: of the sum.
        trials: how many.
    """

    def worth(base: np.ndarray) -> np.ndarray:
        return np.asarray(utility(base + information)).mean(-1)

    nothing = np.zeros_like(information[0])
    chosen = [int(np.argmax(worth(nothing)))]
    repeated = float(np.asarray(utility(trials * information[chosen[0]])).mean())
    while len(chosen) < trials:
        chosen.append(int(np.argmax(worth(information[chosen].sum(0)))))
    best = float(np.asarray(utility(information[chosen].sum(0))).mean())
    for _ in range(EXCHANGE_ROUNDS):
        before = best
        for place in range(trials):
            others = information[chosen[:place] + chosen[place + 1 :]].sum(0) if trials > 1 else nothing
            result = worth(others)
            if result.max() > best + 1e-9 * abs(best):
                chosen[place], best = int(np.argmax(result)), float(result.max())
        if best == before:
            break
    return Batch(*_in_order(information, worth, nothing, chosen, utility), repeated)


def _in_order(
    information: np.ndarray, worth: Callable, nothing: np.ndarray, chosen: list[int], utility: Criterion
) -> tuple[tuple[int, ...], tuple[float, ...]]:
    """Return the trials chosen, each the best beside those before it, so that fewer may be run."""
    left, order, reached, base = list(chosen), [], [], nothing
    while left:
        gains = worth(base)[left]
        order.append(left.pop(int(np.argmax(gains))))
        base = base + information[order[-1]]
        reached.append(float(np.asarray(utility(base)).mean()))
    return tuple(order), tuple(reached)


@dataclass(frozen=True, eq=False)
class PlannedBatch:
    """Trials of one problem planned together.

    Attributes:
        words: each trial, by added information.
        found: their information.
        manoeuvres: one for each.
        unit: of the utility.
        schedules: file of each, if they are written.
    """

    words: tuple[str, ...]
    found: Batch
    manoeuvres: Annotated[tuple[Manoeuvre, ...], Field(exclude=True)]
    unit: str
    schedules: tuple[Path, ...] = ()


@dataclass(frozen=True)
class BatchSearch:
    """A number of trials among all designs inside the limits, evaluated like a single one; see `Search`."""

    trials: int

    def check(self, problem: DesignProblem) -> None:
        """Check that a trial counts as a whole, before any work."""
        check_whole_trials(problem.per, problem.place, "trials planned together")

    def find(self, problem: DesignProblem, beside: Beside, reporter: Reporter) -> PlannedBatch:
        """See `Search`."""
        self.check(problem)
        places, information = [], []
        few = problem.few(problem.draws)
        sweeps = [(sweep, *sweep.inside()) for sweep in beside().sweeps]
        total, done = sum(rows.size for _, rows, _, _ in sweeps), 0
        report = reporter.progress(f"information of {total} design{'s' * (total != 1)}")
        for sweep, rows, columns, controls in sweeps:
            places += [(sweep, int(i), int(j)) for i, j in zip(rows, columns, strict=True)]
            for start in range(0, len(controls), DESIGNS_AT_ONCE):
                report(done + start, total)
                some = controls[start : start + DESIGNS_AT_ONCE]
                information.append(information_table(problem.plan(sweep.family), some, few))
            done += len(controls)
        report(total, total)
        criterion = problem.criterion(problem.draws)
        batch = plan_batch(np.concatenate(information), criterion, self.trials)
        chosen = [places[index] for index in batch.designs]
        words = tuple(sweep.words(i, j) for sweep, i, j in chosen)
        manoeuvres = (
            sweep.family.manoeuvre(float(sweep.amplitude[i]), float(sweep.period[j])) for sweep, i, j in chosen
        )
        return PlannedBatch(words, batch, tuple(manoeuvres), problem.utility_unit)
