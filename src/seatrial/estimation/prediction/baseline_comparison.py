"""Whether a model predicts held-back runs better than the baselines, judged by the CRPS of the same samples.

The difference of the two scores at each sample, d, is averaged over all samples of all runs. How far chance moves that mean follows from
the number of independent values that d is worth in each run, and, of three runs or more, from how the runs differ: the larger counts
(Diebold and Mariano, J. Bus. Econ. Stat. 13, 1995, with the variance by effective samples or by runs).
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Float

from seatrial.estimation.prediction.fit_verdict import FitLevel
from seatrial.estimation.prediction.prediction_scores import (
    DIVERGES,
    PredictedRun,
    crps_normal,
    independent_samples,
    score_channel,
)

CLEAR_RATIO = 1.1  # Ratio of the CRPS from which a baseline is clearly better
MAX_CHANCE = 0.05  # Probability below which a difference is not put down to chance
MIN_RUNS = 3  # Runs from which their own spread says what chance does


class Run(NamedTuple):
    """One channel of one held-back run: time, s, and measurements, NaN if there is none, SI; both of shape (n,)."""

    time: Float[np.ndarray, " n"]
    measured: Float[np.ndarray, " n"]


class Predicted(NamedTuple):
    """A normal prediction of each sample of a run: mean and standard deviation, noise included, SI; both of shape (n,)."""

    mean: Float[np.ndarray, " n"]
    sd: Float[np.ndarray, " n"]


@dataclass(frozen=True)
class PooledScore:
    """How one channel of all held-back runs together is predicted.

    Attributes:
        words: name of the model, such as "a linear Nomoto model".
        explained: share of the variance about each run's own mean.
        crps: mean continuous ranked probability score, SI.
        log_score: mean log density of the measurements, one at a time, nats, SI.
        diverges: whether the prediction leaves the finite numbers; the scores are 0 then.
    """

    words: str
    explained: float
    crps: float
    log_score: float
    diverges: bool = False


@dataclass(frozen=True)
class Comparison:
    """A comparison of a model with the baselines, for one channel.

    Attributes:
        channel: measured channel.
        ours: scores of the model.
        baselines: scores of the baselines, the best first.
        p_value: probability that chance explains the lead of the better one of the model and the best baseline. If the baseline is
            better, it is multiplied by the number of baselines (Bonferroni).
        level: pass if the model is best, caution if it is not, fail if a baseline is clearly better, by more than chance.
        by_run: mean CRPS of the model and of the best baseline in each run that measures the channel.
        is_simpler: whether the best baseline has other equations than the model.
    """

    channel: str
    ours: PooledScore
    baselines: tuple[PooledScore, ...]
    p_value: float
    level: FitLevel
    by_run: tuple[tuple[float, float], ...]
    is_simpler: bool


def compare(
    channel: str,
    runs: Sequence[Run],
    ours: Sequence[Predicted],
    baselines: Mapping[str, Sequence[Predicted]],
    same_equations: Collection[str] = (),
) -> Comparison:
    """Compare a model with baselines on one channel of held-back runs.

    Args:
        channel: measured channel.
        runs: held-back runs, of which one at least measures it.
        ours: the model's prediction of each run.
        baselines: those of each baseline, by the words that say what it is; one at least.
        same_equations: the baselines that have the model's own equations, so that they are no simpler.
    """
    own = _pooled("the model", runs, ours)
    scores = [_pooled(words, runs, predicted) for words, predicted in baselines.items()]
    best, *others = sorted(scores, key=lambda one: (one.diverges, one.crps))
    worse = own.diverges if own.diverges or best.diverges else best.crps < own.crps
    p_value = 0.0
    if not (own.diverges or best.diverges):
        theirs = baselines[best.words]
        p_value = min(1.0, len(scores) * _chance(runs, ours, theirs)) if worse else _chance(runs, theirs, ours)
    clear = own.diverges or own.crps > CLEAR_RATIO * best.crps
    level: FitLevel = "pass" if not worse else "fail" if clear and p_value < MAX_CHANCE else "caution"
    pairs = zip(_present(runs, ours), _present(runs, baselines[best.words]), strict=True)
    by_run = tuple(
        (float(crps_normal(*one).mean()), float(crps_normal(*other).mean())) for one, other in pairs if one[0].size
    )
    return Comparison(channel, own, (best, *others), p_value, level, by_run, best.words not in same_equations)


def _pooled(words: str, runs: Sequence[Run], predicted: Sequence[Predicted]) -> PooledScore:
    pairs = zip(runs, predicted, strict=True)
    score = score_channel([PredictedRun(*run, one.mean, one.sd, 0.0) for run, one in pairs])
    return PooledScore(words, score.explained, score.crps, score.log_score, score.missing == DIVERGES)


def _present(runs: Sequence[Run], predicted: Sequence[Predicted]) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Return measurements, means and standard deviations of each run where there is a measurement."""
    result = []
    for run, one in zip(runs, predicted, strict=True):
        there = np.isfinite(run.measured)
        result.append((run.measured[there], one.mean[there], one.sd[there]))
    return result


def _chance(runs: Sequence[Run], first: Sequence[Predicted], second: Sequence[Predicted]) -> float:
    """Return the probability that chance alone makes the CRPS of the first so much larger than that of the second, of one side."""
    differences, worth = [], []
    for run, own, other in zip(runs, _present(runs, first), _present(runs, second), strict=True):
        if own[0].size:
            difference = crps_normal(*own) - crps_normal(*other)
            differences.append(difference)
            time = run.time[np.isfinite(run.measured)]
            worth.append(max(1.0, independent_samples([(time, difference - difference.mean())])))
    weights = np.array([one.size for one in differences]) / sum(one.size for one in differences)
    means = np.array([one.mean() for one in differences])
    total = float(weights @ means)
    count = len(differences)
    alone = zip(weights, differences, worth, strict=True)
    variance = sum(w**2 * float(one.var()) / max(n - 1.0, 1e-9) for w, one, n in alone)
    freedom = max(1.0, sum(worth) - count)
    if count >= MIN_RUNS:
        between = count / (count - 1) * float(np.sum(weights**2 * (means - total) ** 2))
        if between > variance:
            variance, freedom = between, count - 1.0
    return float(scipy.special.stdtr(freedom, -total / np.sqrt(variance))) if variance > 0 else 0.5
