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

from seatrial.core.coefficients import CoefficientName
from seatrial.core.signals import SPEEDS

MAX_TRIALS = 30  # Trials of a plan that are thought of, whatever the day allows
MIN_FALL = 1e-3  # Fall of the sum below which another trial helps nothing


@dataclass(frozen=True, eq=False)
class StageGoal:
    """What is asked of the coefficients to estimate together.

    Attributes:
        sought: their places among all k.
        share: standard deviation wanted as a share of the estimate, infinite if none is asked, shape (k,).
        sd: standard deviation wanted, SI, infinite if none is asked, shape (k,).
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
    """Return for every draw whether the goal of each coefficient is met after some trials; true if there is none.

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


# The stages in which the coefficients of a whole vehicle are sought: which axes together, and which before which.
#
# An axis needs another if one of its regressors has the velocity of the other: Y_uv needs the speed u. Axes that
# need each other in a circle, such as sway and yaw by Y_ur and N_uv, are sought together (the strongly connected
# components of the graph of needs); of stages that need nothing more, the one with the fewest unknowns comes first.

AXIS_ORDER = "XNYZMK"  # Axes in the order of how easily they are excited, where nothing else decides
PROPELLER_AXES = {"T": "X", "Q": "K"}  # Axis on which the thrust and the torque of a propeller act


@dataclass(frozen=True)
class Stage:
    """Coefficients to estimate together.

    Attributes:
        axes: on which they act.
        sought: their names, in the order of the vehicle.
        moves: velocities along these axes.
        given: other velocities that their regressors need.
        before: numbers, from 0, of the earlier stages that it needs.
    """

    axes: str
    sought: tuple[str, ...]
    moves: tuple[str, ...]
    given: tuple[str, ...]
    before: tuple[int, ...] = ()


def find_stages(names: Sequence[str], asked: Sequence[str]) -> tuple[Stage, ...]:
    """Return the stages of some coefficients, in the order in which they are run.

    Args:
        names: every coefficient to estimate.
        asked: those that have a goal. Axes without one are sought only with axes that need them.
    """
    terms: dict[str, list[CoefficientName]] = {axis: [] for axis in AXIS_ORDER}
    for term in map(CoefficientName.parse, names):
        terms[PROPELLER_AXES.get(term.axis, term.axis)].append(term)
    used = [axis for axis in AXIS_ORDER if terms[axis]]
    needs = {
        axis: {other for other in used if any(SPEEDS[other] in term.signals for term in terms[axis])} for axis in used
    }
    for through in used:
        for axis in used:
            if through in needs[axis]:
                needs[axis] |= needs[through]
    wanted = [axis for axis in used if any(term.text in asked for term in terms[axis])]
    stages: list[Stage] = []
    while missing := [axis for axis in wanted if not any(axis in stage.axes for stage in stages)]:
        done = {axis for stage in stages for axis in stage.axes}
        # An axis with those that it needs and that need it, and those it needs that nobody asked about.
        groups = [
            {axis, *(other for other in needs[axis] if axis in needs[other] or other not in wanted)} - done
            for axis in missing
        ]
        ready = [group for group in groups if not any(needs[axis] & set(wanted) - done - group for axis in group)]
        axes = min(ready, key=lambda group: sum(len(terms[axis]) for axis in group))
        stages.append(_stage([axis for axis in AXIS_ORDER if axis in axes], terms, names, needs, stages))
    return tuple(stages)


def _stage(
    axes: Sequence[str],
    terms: dict[str, list[CoefficientName]],
    names: Sequence[str],
    needs: dict[str, set[str]],
    earlier: Sequence[Stage],
) -> Stage:
    own = {term.text for axis in axes for term in terms[axis]}
    moves = tuple(speed for axis, speed in SPEEDS.items() if axis in axes)
    signals = {signal for axis in axes for term in terms[axis] for signal in term.signals}
    given = tuple(speed for speed in SPEEDS.values() if speed in signals and speed not in moves)
    needed = {other for axis in axes for other in needs[axis]}
    before = tuple(number for number, stage in enumerate(earlier) if needed & set(stage.axes))
    return Stage("".join(axes), tuple(name for name in names if name in own), moves, given, before)
