"""Which structure, and which model of the error, predicts runs that were left out; results without JAX."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import computed_field

from seatrial.estimation.prediction.pooled_coverage import Pooled
from seatrial.estimation.prediction.prediction_scores import Score
from seatrial.selection.structures import Structure

# Standard errors, and nats, beyond which a difference is one: below four nats the standard error itself is unreliable
# (Sivula, Magnusson and Vehtari 2020).
CLEAR, SMALL = 2.0, 4.0
OWN = "as stated"  # Name of the campaign's own model of the error


@dataclass(frozen=True)
class LeftOutRun:
    """One run as the others predict it.

    Attributes:
        label: of the run.
        elpd: log p(y_r | y_-r), nats: of all its measurements together.
        error: its Monte Carlo standard error.
        k_hat: tail index of the weights; above 0.7 they are not to be trusted.
        refitted: whether the mode of the others had to be found.
        scores: of each channel in free simulation, by name.
    """

    label: str
    elpd: float
    error: float
    k_hat: float
    refitted: bool
    scores: dict[str, Score]


@dataclass(frozen=True)
class LeaveOneRunOut:
    """All runs, each predicted from the others.

    Attributes:
        runs: one for each.
        bands: whether the stated bands hold on all runs together, each left out in turn, by channel.
        log_evidence: of the joint posterior, by the same draws.
        status: empty if healthy, else what is wrong in words.
    """

    runs: tuple[LeftOutRun, ...]
    bands: dict[str, Pooled]
    log_evidence: float
    status: str

    @property
    def elpd(self) -> float:
        """Sum over runs, nats; higher is better."""
        return sum(run.elpd for run in self.runs)

    @property
    def std_error(self) -> float:
        """Standard error of the sum, the runs being a sample of possible ones."""
        return float(np.sqrt(len(self.runs)) * np.std([run.elpd for run in self.runs], ddof=1))

    @property
    def k_hat(self) -> float:
        """Worst of all runs."""
        return max(run.k_hat for run in self.runs)

    def crps(self, channel: str) -> tuple[float, ...]:
        """Return the mean continuous ranked probability score of a channel in each run, SI; lower is better."""
        return tuple(run.scores[channel].crps for run in self.runs)

    def mean_crps(self, channel: str) -> float:
        """Return the mean of that over runs."""
        return float(np.mean(self.crps(channel)))

    def mean_score(self, channel: str, name: str) -> float:
        """Return the mean of a score of one channel over all runs, each run by its number of samples.

        Args:
            channel: measured channel.
            name: of the score, an attribute of `Score`.
        """
        scores = [run.scores[channel] for run in self.runs]
        samples = np.array([one.samples for one in scores], float)
        return float(samples @ [getattr(one, name) for one in scores] / samples.sum())


@dataclass(frozen=True)
class Candidate:
    """One structure under one model of the error.

    Attributes:
        structure: which terms.
        error_model: name.
        words: what the model of the error says.
        lines: that make it in a campaign file; none for the campaign's own.
        left: each run as the others predict it; None if there is no result.
        coefficients: value and standard deviation of each at the mode, SI.
        refused: why there is no result; empty if there is one.
    """

    structure: Structure
    error_model: str
    words: str
    lines: tuple[str, ...]
    left: LeaveOneRunOut | None = None
    coefficients: tuple[tuple[str, float, float], ...] = ()
    refused: str = ""

    @property
    def result(self) -> LeaveOneRunOut:
        """Each run as the others predict it, of a candidate that has a result."""
        assert self.left is not None
        return self.left

    @computed_field
    @property
    def total(self) -> float:
        """Sum over runs, nats; higher is better."""
        return float(np.sum([run.elpd for run in self.left.runs])) if self.left else 0.0

    @property
    def name(self) -> str:
        """Structure and model of the error."""
        label = self.structure.label
        return label if self.error_model == OWN else f"{label}, {self.error_model}"


@dataclass(frozen=True)
class Gap:
    """How much better one candidate scores than another, and its standard error from the differences of each run."""

    delta: float
    std_error: float

    def is_clear(self, least: float = 0.0) -> bool:
        """Whether it is beyond two standard errors and a least size."""
        return self.delta > max(CLEAR * self.std_error, least)


@dataclass(frozen=True)
class CrossValidation:
    """All candidates, each run left out in turn.

    Attributes:
        runs: labels.
        candidates: structures under the campaign's own model of the error first.
        cautions: what a reader must know.
    """

    runs: tuple[str, ...]
    candidates: tuple[Candidate, ...]
    cautions: tuple[str, ...]

    @property
    def found(self) -> list[Candidate]:
        """Candidates that have a result."""
        return [one for one in self.candidates if not one.refused]

    @property
    def own(self) -> list[Candidate]:
        """Those under the campaign's own model of the error."""
        return [one for one in self.found if one.error_model == OWN]

    @computed_field
    @property
    def best(self) -> Candidate:
        """The one that predicts runs left out best."""
        return max(self.found, key=lambda one: one.total)

    @computed_field
    @property
    def recommended(self) -> Candidate | None:
        """The best where it is clearly better than the best under the campaign's own model of the error, else None."""
        clear = self.best.error_model != OWN and gap(self.best, self.own_best).is_clear(SMALL)
        return self.best if clear else None

    def probability(self, candidate: Candidate) -> float:
        """Return the probability by evidence of a structure among those under the same model of the error."""
        same = [one for one in self.found if one.error_model == candidate.error_model]
        values = np.array([one.result.log_evidence for one in same])
        weights = np.exp(values - values.max())
        return float(weights[same.index(candidate)] / weights.sum())

    @property
    def likely(self) -> Candidate:
        """The one that the evidence prefers under the campaign's own model of the error."""
        return max(self.own, key=lambda one: one.result.log_evidence)

    @property
    def own_best(self) -> Candidate:
        """The one under the campaign's own model of the error that predicts runs left out best."""
        return max(self.own, key=lambda one: one.total)


def gap(one: Candidate, other: Candidate) -> Gap:
    """Return how much better the first predicts runs left out, nats."""
    return paired(*([run.elpd for run in each.result.runs] for each in (one, other)))


def paired(one: Sequence[float], other: Sequence[float], mean: bool = False) -> Gap:
    """Return the sum, or the mean, of the differences of each run, and its standard error."""
    apart = np.subtract(one, other)
    total = Gap(float(apart.sum()), float(np.sqrt(apart.size) * apart.std(ddof=1)))
    return Gap(total.delta / apart.size, total.std_error / apart.size) if mean else total
