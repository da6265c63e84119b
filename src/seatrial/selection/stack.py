"""Stack: the mixture of models that predicts what was left out best, and the simplest model that predicts about as well as the best.

    maximise over w on the simplex  sum_r log sum_k w_k p_k(y_r | y_-r)

Yao, Vehtari, Simpson and Gelman (Bayesian Analysis 13, 2018). The problem is convex. With g_k = sum_r p_rk / sum_j w_j p_rj the step
w_k <- w_k g_k / R never lowers the sum, and no mixture is better than the present one by more than max g - R nats. A run of thousands of
samples has its weight on one model: no mixture of two predicts that run as well as the better one. So the standard error of differences
over runs says what a weight cannot: whether another run would agree.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

# Nats to the best mixture at which the weights are good enough, and steps at most.
NEAR_BEST, MAX_STEPS = 1e-3, 20_000
# Differences below so many nats are none: their standard error itself is unreliable (Sivula, Magnusson and Vehtari 2020).
SMALL = 4.0


@dataclass(frozen=True)
class Gap:
    """How much better one model scores than another, and its standard error from the differences of each run."""

    delta: float
    std_error: float

    def is_clear(self, std_errors: float, least: float = 0.0) -> bool:
        """Whether it is beyond so many standard errors and a least size."""
        return self.delta > max(std_errors * self.std_error, least)


def paired(one: Sequence[float], other: Sequence[float], mean: bool = False) -> Gap:
    """Return the sum, or the mean, of the differences of each run, and its standard error."""
    apart = np.subtract(one, other)
    total = Gap(float(apart.sum()), float(np.sqrt(apart.size) * apart.std(ddof=1)))
    return Gap(total.delta / apart.size, total.std_error / apart.size) if mean else total


def stacking_weights(log_density: Float[np.ndarray, "runs models"]) -> Float[np.ndarray, " models"]:
    """Return the weights of the best mixture, which sum to 1.

    Args:
        log_density: log density of each run, given all others, by each model, nats.
    """
    runs, models = log_density.shape
    density = np.exp(log_density - log_density.max(1, keepdims=True))
    weights = np.full(models, 1.0 / models)
    for _ in range(MAX_STEPS):
        gain = (density / (density @ weights)[:, None]).sum(0)
        weights *= gain / runs
        if gain.max() - runs < NEAR_BEST:
            break
    return weights / weights.sum()


def mixture_score(log_density: Float[np.ndarray, "runs models"], weights: Float[np.ndarray, " models"]) -> float:
    """Return the sum over runs of the log density of a mixture, nats."""
    top = log_density.max(1)
    return float((top + np.log(np.exp(log_density - top[:, None]) @ weights)).sum())


def simplest(
    score: Float[np.ndarray, "runs models"], stated: Sequence[str], terms: Sequence[int], least: float = SMALL
) -> int:
    """Return the place of the model with fewest terms that predicts within one standard error of the best, or a least difference.

    Differences between models of the error scatter more over runs than those between structures, and would hide these. So the model of
    the error is chosen first, by the best structure under each: the first one if nothing better can be told from it.

    Args:
        score: of each run by each model, such as its log density, nats; higher is better.
        stated: model of the error of each, the preferred one empty.
        terms: of the structure of each.
        least: difference of sums over runs below which there is none.
    """
    total, places = score.sum(0), range(len(stated))

    def is_worse(k: int, than: int) -> bool:
        return paired(score[:, than], score[:, k]).is_clear(1.0, least)

    best = max(places, key=lambda k: total[k])
    preferred = max((k for k in places if not stated[k]), key=lambda k: total[k], default=best)
    if not is_worse(preferred, best):
        best = preferred
    near = [k for k in places if stated[k] == stated[best] and not is_worse(k, best)]
    return min(near, key=lambda k: (terms[k], -total[k]))
