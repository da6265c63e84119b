"""Trials that are chosen for a goal, and the chance that the goal is met once they are run.

The coefficients c of one stage are sought together, those of all others are taken as known. After trials of information I_i(c) the stage
has the covariance (P^-1 + sum I_i(c))^-1, P that of what is believed before. A goal is a standard deviation, or a share of the estimate,
which lies about c with that covariance. Trials are taken one after another, each the one that lowers

    sum over the goals of E[max(0, ln(sd / wanted))]

most for the time it takes. The expected values are means over draws of what is believed about c.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

MIN_FALL = 1e-3
"""Fall of the sum below which another trial helps nothing."""


@dataclass(frozen=True, eq=False)
class StageGoal:
    """What is asked of the coefficients that are sought together.

    Attributes:
        sought: their places among all k.
        share: standard deviation wanted as a share of the estimate, infinite where none is asked, shape (k,).
        sd: standard deviation wanted, SI, infinite where none is asked, shape (k,).
        precision: inverse covariance of all k before, SI.
    """

    sought: Int[np.ndarray, " s"]
    share: Float[np.ndarray, " k"]
    sd: Float[np.ndarray, " k"]
    precision: Float[np.ndarray, "k k"]

    def covariance(self, information: Float[np.ndarray, "*b k k"]) -> Float[np.ndarray, "*b s s"]:
        """Return the covariance of what is sought, SI, after trials of so much information."""
        rows, columns = np.ix_(self.sought, self.sought)
        return np.linalg.inv(self.precision[rows, columns] + information[..., rows, columns])

    def missing(self, values: Float[np.ndarray, "S k"], information: Float[np.ndarray, "*b S k k"]) -> np.ndarray:
        """Return the sum over the goals of how much is missing, in nats, mean over the draws, shape (*b,)."""
        sd = np.sqrt(np.diagonal(self.covariance(information), axis1=-2, axis2=-1))
        ratio = sd / self._wanted(values[:, self.sought])
        return np.log(np.maximum(ratio, 1.0)).sum(-1).mean(-1)

    def met(
        self,
        values: Float[np.ndarray, "S k"],
        information: Float[np.ndarray, "S k k"],
        normal: Float[np.ndarray, "S k"],
    ) -> Bool[np.ndarray, "S s"]:
        """Return whether each goal is met, for vehicles of these values; `normal` places each estimate about its value."""
        cov = self.covariance(information)
        away = np.einsum("sij,sj->si", np.linalg.cholesky(cov), normal[:, self.sought])
        wanted = self._wanted(values[:, self.sought] + away)
        return np.sqrt(np.diagonal(cov, axis1=1, axis2=2)) <= wanted

    def _wanted(self, values: np.ndarray) -> np.ndarray:
        with np.errstate(invalid="ignore"):
            share = self.share[self.sought] * np.abs(values)
        return np.maximum(np.fmin(share, self.sd[self.sought]), np.finfo(float).tiny)


class PlannedTrial(NamedTuple):
    """A trial: the number of its stage, and that of its design, from 0."""

    stage: int
    design: int


def choose_trials(
    stages: Sequence[StageGoal],
    values: Float[np.ndarray, "S k"],
    information: Float[np.ndarray, "D S k k"],
    seconds: Float[np.ndarray, " D"],
    most: int,
    is_enough: Callable[[Sequence[PlannedTrial]], bool],
) -> list[PlannedTrial]:
    """Return trials in the order of what they add.

    Args:
        stages: what is asked of each.
        values: draws of what is believed, SI.
        information: of each design at each draw, SI.
        seconds: that each design takes.
        most: trials.
        is_enough: whether what is chosen does.
    """
    chosen: list[PlannedTrial] = []
    total = [np.zeros_like(information[0]) for _ in stages]
    while len(chosen) < most and not is_enough(chosen):
        falls = np.stack(
            [
                stage.missing(values, now) - stage.missing(values, now + information)
                for stage, now in zip(stages, total, strict=True)
            ]
        )
        if falls.max() < MIN_FALL:
            break
        stage, design = np.unravel_index(np.argmax(falls / seconds), falls.shape)
        chosen.append(PlannedTrial(int(stage), int(design)))
        total[stage] = total[stage] + information[design]
    return chosen


def goals_met(
    stages: Sequence[StageGoal],
    values: Float[np.ndarray, "S k"],
    information: dict[int, Float[np.ndarray, "S k k"]],
    trials: Sequence[PlannedTrial],
    normal: Float[np.ndarray, "S k"],
) -> Bool[np.ndarray, "S k"]:
    """Return for every draw whether the goal of each coefficient is met after some trials; true where there is none.

    Args:
        stages: what is asked of each.
        values: draws of what is believed, SI.
        information: of the designs that are run, by number, SI.
        trials: that are run.
        normal: standard normal numbers, which place the estimates about the values.
    """
    are_met = np.ones(values.shape, bool)
    for number, stage in enumerate(stages):
        total = sum((information[trial.design] for trial in trials if trial.stage == number), np.zeros((1, 1, 1)))
        shape = (*values.shape, values.shape[1])
        are_met[:, stage.sought] = stage.met(values, np.broadcast_to(total, shape), normal)
    return are_met
