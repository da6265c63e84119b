"""Simulation-based calibration: whether stated uncertainty is what it says, over the whole way from data to posterior.

Parameters are drawn from the prior, data from the parameters, and a posterior from the data. The rank of each parameter among
its own posterior draws is then uniform, whatever the model (Talts et al., arXiv 1804.06788). Ranks are judged by the largest
distance of their distribution from the diagonal, against a band that holds all of it with stated probability
(Saeilynoja, Buerkner and Vehtari, Statistics and Computing 32, 2022). That probability is of all quantities together: of k, each has
the k-th part of the allowance (Bonferroni), whatever their ranks have to do with each other.
"""

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Annotated

import numpy as np
import scipy
from jaxtyping import Bool, Float, Int

DRAWS = 99  # Posterior draws that a rank is taken among: ranks run from 0 to 99
BINS = 20
FALSE_ALARMS = 0.01  # Share of right posteriors of which any quantity is called uneven
RANK_SHARES = np.arange(1, DRAWS + 1) / (DRAWS + 1)
# What a replicate's draws have at most and at least where they mixed well. Ranks are among 99 draws; of 32 short
# chains 99 effective draws are 1.5 in each half, the means of which then differ so much that R-hat is 1.3, where
# nothing is wrong with them.
REPLICATE_MAX_R_HAT, REPLICATE_MIN_ESS, REPLICATE_MIN_MOVED = 1.3, DRAWS, 0.05


@dataclass(frozen=True, eq=False)
class Calibration:
    """Ranks of many replicates.

    Attributes:
        names: quantities: parameters, and the log-likelihood.
        ranks: of the true value among `DRAWS` posterior draws.
        method: how posteriors were drawn.
        structure: label of the structure.
        refused: share of the prior's draws that could not be simulated, and were drawn again.
        health: of each replicate: R-hat, effective sample size, share of divergent transitions, share of moves made, NaN if the
            method has no such number.
    """

    names: Annotated[tuple[str, ...], "quantity"]
    ranks: Int[np.ndarray, "replicate quantity"]
    method: str = ""
    structure: str = ""
    refused: float = 0.0
    health: Float[np.ndarray, "replicate diagnostic"] = field(default_factory=lambda: np.empty((0, 4)))

    def poor(self) -> Bool[np.ndarray, " r"]:
        """Return which replicates have draws that did not mix well, by the method's own diagnostics."""
        r_hat, ess, diverged, moved = self.health.T
        return (
            (r_hat > REPLICATE_MAX_R_HAT)
            | (ess < REPLICATE_MIN_ESS)
            | (diverged > 0.0)
            | (moved < REPLICATE_MIN_MOVED)
            | np.isnan(self.health).all(1)
        )

    def counts(self) -> Int[np.ndarray, "k bins"]:
        """Return the histogram of each quantity's ranks."""
        return np.array([np.bincount(column * BINS // (DRAWS + 1), minlength=BINS) for column in self.ranks.T])

    def count_band(self) -> tuple[int, int]:
        """Return the counts between which all bins of all quantities lie with probability 0.99 if ranks are uniform."""
        tail = 0.5 * FALSE_ALARMS / (BINS * len(self.names))
        low, high = scipy.stats.binom(len(self.ranks), 1 / BINS).ppf([tail, 1 - tail])
        return int(low), int(high)

    def p_values(self) -> Float[np.ndarray, " k"]:
        """Return the probability that of all quantities any has ranks so far from even, if all are uniform; an upper bound."""
        single = np.array([1.0 - stays_within(len(self.ranks), away) for away in self._farthest() * (1 - 1e-9)])
        return np.minimum(1.0, len(self.names) * np.maximum(single, 0.0))

    def distance(self) -> Float[np.ndarray, "k ranks"]:
        """Return the distribution of each quantity's ranks less the uniform one, at 1/100, 2/100, ..., 99/100."""
        at = np.arange(1, DRAWS + 1)
        return (self.ranks.T[:, None, :] < at[:, None]).mean(2) - RANK_SHARES

    def distance_band(self) -> Float[np.ndarray, " ranks"]:
        """Half width of the band that holds the whole of `distance` of all quantities with probability 0.99, if ranks are uniform."""
        return _widest(len(self.ranks), FALSE_ALARMS / len(self.names)) * _sd(len(self.ranks))

    def coverage(self, share: float) -> Float[np.ndarray, " k"]:
        """Share of replicates whose truth lies inside the central interval of this posterior probability."""
        tail = 0.5 * (1 - share) * (DRAWS + 1)
        return ((self.ranks >= tail) & (self.ranks < DRAWS + 1 - tail)).mean(0)

    def outside(self) -> tuple[str, ...]:
        """Return the quantities whose ranks leave the band."""
        left = self._farthest() > _widest(len(self.ranks), FALSE_ALARMS / len(self.names))
        return tuple(name for name, bad in zip(self.names, left, strict=True) if bad)

    def _farthest(self) -> Float[np.ndarray, " k"]:
        """Return the largest distance of each quantity in standard deviations."""
        return (np.abs(self.distance()) / _sd(len(self.ranks))).max(1)


def ranks_of(truth: Float[np.ndarray, " k"], draws: Float[np.ndarray, "n k"]) -> Int[np.ndarray, " k"]:
    """Rank of each true value among `DRAWS` draws spread evenly over those given."""
    return (spread_evenly(draws) < truth).sum(0)


def spread_evenly(draws: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "ranks k"]:
    """`DRAWS` of the draws, at even distances."""
    return draws[np.linspace(0, len(draws) - 1, DRAWS).round().astype(int)]


def stays_within(replicates: int, width: float) -> float:
    """Return the probability that uniform ranks stay within so many standard deviations of the diagonal, all along.

    Exact: counts up to one rank after another are sums of Poisson numbers, given that all of them add up to `replicates`.
    """
    mean, sd = replicates * RANK_SHARES, replicates * _sd(replicates)
    low = np.maximum(np.ceil(mean - width * sd), 0).astype(int)
    high = np.minimum(np.floor(mean + width * sd), replicates).astype(int)
    before, weight, step = 0, np.ones(1), scipy.stats.poisson.pmf(np.arange(replicates + 1), replicates / (DRAWS + 1))
    for first, last in zip([*low, replicates], [*high, replicates], strict=True):
        if first > last:
            return 0.0
        weight = np.convolve(weight, step[: last - before + 1])[first - before : last - before + 1]
        before = first
    return float(weight[0] / scipy.stats.poisson.pmf(replicates, replicates))


@lru_cache(maxsize=64)
def _widest(replicates: int, allowed: float) -> float:
    """Return the standard deviations that uniform ranks exceed anywhere with this probability at most."""
    low, high = 0.0, 40.0
    while high - low > 1e-3:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if 1.0 - stays_within(replicates, middle) <= allowed else (middle, high)
    return high


def _sd(replicates: int) -> Float[np.ndarray, " ranks"]:
    """Return the standard deviation of the distribution of uniform ranks."""
    return np.sqrt(RANK_SHARES * (1 - RANK_SHARES) / replicates)
