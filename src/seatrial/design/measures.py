"""How well the cheap measures of a design agree with its expected information gain, over some designs of a grid.

The expected information gain is that of the whole prior, by nested Monte Carlo with its error; the cheap ones are what a sweep can
afford: the filter's entropy reduction at the prior means, and criteria of the Fisher information there or over draws.
"""

import json
from dataclasses import dataclass

import numpy as np

from seatrial.compiled.random_keys import random_key
from seatrial.core.dataset import Dataset
from seatrial.core.errors import InputError, NumericalError
from seatrial.core.reporter import Reporter
from seatrial.design.design_problem import UTILITY_DRAWS, DesignProblem, check_whole_trials
from seatrial.design.expected_gain import GainSettings, importance_gain
from seatrial.design.fisher_utilities import find_criterion
from seatrial.design.prior_belief import draw_values, prior_cov
from seatrial.design.results import EXPECTED, Measures
from seatrial.design.robust import utility_table
from seatrial.design.trial_design import Beside
from seatrial.estimation.posterior.filter_error import process_name

FISHER_CRITERIA = ("fisher-d", "fisher-a", "fisher-e", "fisher-me")
# Four times the usual importance draws: weak designs leave posteriors that press on the priors' bounds
GAIN_SETTINGS = GainSettings(inner=256)


@dataclass(frozen=True)
class MeasureSearch:
    """Every measure of the best design of each family and of others spread over what they reach; see `Search`.

    Attributes:
        count: designs, 5 at least.
    """

    count: int

    def check(self, problem: DesignProblem) -> None:
        """Check that the expected gain of a problem's designs can be computed, before any work.

        Raises:
            InputError: process noise is expected, which the expected gain knows nothing of, or designs that are counted by the second.
        """
        check_whole_trials(problem.per, problem.place, "a comparison of measures", joules=True)
        process = problem.process or (0.0,) * len(problem.model.states)
        if moved := [process_name(state) for state, sd in zip(problem.model.states, process, strict=True) if sd]:
            raise InputError(
                problem.place(f"prior.{moved[0]}"),
                found="process noise, with a comparison of measures",
                expected="a motion without process noise: the expected gain counts only the noise of sensors, the cheap measures both",
                remedy="compare measures without the priors of process noise, or not at all",
            )

    def find(self, problem: DesignProblem, beside: Beside, reporter: Reporter) -> Measures:
        """See `Search`."""
        self.check(problem)
        designs, priors = beside(), problem.belief
        plan, cov = problem.plan(), prior_cov(priors)
        names, controls, entropy = [], [], []
        for sweep, row, column in _spread(designs.sweeps, self.count):
            names.append(sweep.words(row, column))
            controls.append(sweep.controls(row, column))
            entropy.append(float(sweep.gain[row, column]))
        held, key = np.stack(controls), random_key(problem.seed, "expected gain")
        measures = {"entropy of the filter": np.array(entropy)}
        mean = np.asarray(problem.normal.mean, float)[None]
        for name in FISHER_CRITERIA:
            measures[f"{name} at the prior means"] = utility_table(plan, held, mean, find_criterion(name, cov))[:, 0]
        draws = draw_values(priors, random_key(problem.seed, "draws of the measures"), UTILITY_DRAWS)
        averaged = utility_table(plan, held, draws, find_criterion("fisher-d", cov)).mean(1)
        measures[f"fisher-d over {UTILITY_DRAWS} draws"] = averaged
        progress, gains, refused = reporter.progress(f"expected gain of {len(names)} designs"), [], []
        for done, control in enumerate(held):
            progress(done, len(names))
            gains.append(importance_gain(plan, priors, control, key, GAIN_SETTINGS))
            if gains[-1].status:
                refused.append(f"{names[done]}: {gains[-1].status}")
        progress(len(names), len(names))
        if len(refused) > len(names) / 2:
            raise NumericalError("the expected gain cannot be computed for most designs; " + refused[0])
        kept = np.array([not gain.status for gain in gains])
        measures[EXPECTED] = np.array([gain.value for gain in gains])
        measures["error"] = np.array([gain.std_error for gain in gains])
        return Measures(
            Dataset(
                {name: ("design", values[kept]) for name, values in measures.items()},
                coords={"design": np.array(names)[kept]},
                attrs={"refused": json.dumps(refused)},
            )
        )


def _spread(sweeps: tuple, count: int) -> list[tuple]:
    """The best design of each family, and others at even ranks of the gain among all that are inside the limits."""
    chosen = [(sweep, *sweep.best) for sweep in sweeps[:count]]
    others = [(sweep, int(i), int(j)) for sweep in sweeps for i, j in np.argwhere(np.isfinite(sweep.gain))]
    others = [one for one in others if (one[1], one[2]) != one[0].best]
    others.sort(key=lambda one: one[0].gain[one[1], one[2]])
    places = np.linspace(0, len(others) - 1, min(count - len(chosen), len(others))).round().astype(int)
    return chosen + [others[place] for place in places]
