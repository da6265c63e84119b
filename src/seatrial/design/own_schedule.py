"""A schedule of one's own, weighed beside the best of the families by the same measure, and judged against every limit."""

from dataclasses import dataclass

import numpy as np

from seatrial.core.reporter import Reporter
from seatrial.design.design_problem import HALF, DesignProblem, covariance
from seatrial.design.results import OwnTrial
from seatrial.design.safety import judge_safety
from seatrial.design.trial_design import Beside, plan_as_run
from seatrial.design.trial_plan import TrialPlan
from seatrial.manoeuvres.schedule import Schedule


@dataclass(frozen=True, eq=False)
class OwnSearch:
    """A schedule that somebody wrote or recorded, from trim and as long as it is; see `Search`.

    Attributes:
        schedule: controls over time, sampled as designs are, SI.
        source: name of its file.
    """

    schedule: Schedule
    source: str

    def find(self, problem: DesignProblem, beside: Beside, reporter: Reporter) -> OwnTrial:
        """See `Search`; the half of the draws that has no part in a choice judges both."""
        designs = beside()
        best, draws, fresh, time = designs.best, problem.draws, problem.fresh, self.schedule.time
        trim = problem.trim_of(problem.family)
        plan = problem.plan_of(time.size, float(time[1]))
        controls = np.column_stack(list(self.schedule.columns(trim).values()))
        pairs = (plan, controls), (plan_as_run(problem.plan(), designs.sweeps[0]), designs.sweeps[0].best_controls())
        utility, of_best = (float(problem.utilities(one, held[None], fresh, draws)[0]) for one, held in pairs)
        limits, probability = problem.motion, problem.probability
        safety = judge_safety(plan, controls[None], fresh[:HALF], limits, probability) if limits else None
        sd, sd_beside = (_sd_after(one, held, draws) for one, held in pairs)
        return OwnTrial(
            source=self.source,
            duration=float(time[-1]),
            utility=utility,
            beside=of_best,
            best=best.words(*best.best),
            best_duration=float(best.family.end),
            unit=problem.utility_unit,
            names=plan.names,
            units=tuple(problem.model.unit_of(term) for term in problem.model.coefficients),
            sd=sd,
            sd_beside=sd_beside,
            safety=() if safety is None else safety.words(0),
            is_safe=safety is None or bool(safety.allowed[0]),
            probability=probability,
        )


def _sd_after(plan: TrialPlan, controls: np.ndarray, draws: np.ndarray) -> tuple[float, ...]:
    """Standard deviations after a trial, SI, linearised at the mean of what is believed."""
    before = np.linalg.inv(covariance(draws))
    information = np.asarray(plan.information(draws.mean(0), controls))
    return tuple(map(float, np.sqrt(np.diag(np.linalg.inv(before + information)))))
