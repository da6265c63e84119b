"""Simulation-based calibration: whether stated uncertainty is what it says, over the whole way from data to posterior.

Parameters are drawn from the prior, data from the parameters, and a posterior from the data. The rank of each parameter among
its own posterior draws is then uniform, whatever the model (Talts et al., arXiv 1804.06788). Ranks are judged by the largest
distance of their distribution from the diagonal, against a band that holds all of it with stated probability
(Saeilynoja, Buerkner and Vehtari, Statistics and Computing 32, 2022).
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int
from scipy import stats

DRAWS = 99
"""Posterior draws that a rank is taken among: ranks run from 0 to 99."""
BINS = 20
LEVEL = 0.99


@dataclass(frozen=True, eq=False)
class Calibration:
    """Ranks of many replicates; r replicates, k quantities.

    Attributes:
        names: quantities: parameters, and the log-likelihood.
        ranks: of the true value among `DRAWS` posterior draws, shape (r, k).
    """

    names: tuple[str, ...]
    ranks: Int[np.ndarray, "r k"]

    def counts(self) -> Int[np.ndarray, "k bins"]:
        """Histogram of each quantity's ranks."""
        return np.array([np.bincount(column * BINS // (DRAWS + 1), minlength=BINS) for column in self.ranks.T])

    def count_band(self) -> tuple[int, int]:
        """Counts between which one bin lies with probability 0.99 if ranks are uniform."""
        low, high = stats.binom(len(self.ranks), 1 / BINS).ppf([0.5 * (1 - LEVEL), 0.5 * (1 + LEVEL)])
        return int(low), int(high)

    def p_values(self) -> Float[np.ndarray, " k"]:
        """Chi-squared probability of histograms as uneven as these, if ranks are uniform."""
        return np.array([stats.chisquare(counts).pvalue for counts in self.counts()])

    def distance(self) -> Float[np.ndarray, "k ranks"]:
        """Distribution of each quantity's ranks less the uniform one, at 1/100, 2/100, ..., 99/100."""
        at = np.arange(1, DRAWS + 1)
        return (self.ranks.T[:, None, :] < at[:, None]).mean(2) - at / (DRAWS + 1)

    def distance_band(self) -> Float[np.ndarray, " ranks"]:
        """Half width of the band that holds the whole of `distance` with probability 0.99, if ranks are uniform."""
        at = np.arange(1, DRAWS + 1) / (DRAWS + 1)
        return _widest(len(self.ranks)) * np.sqrt(at * (1 - at) / len(self.ranks))

    def coverage(self, share: float) -> Float[np.ndarray, " k"]:
        """Share of replicates whose truth lies inside the central interval of this posterior probability."""
        tail = 0.5 * (1 - share) * (DRAWS + 1)
        return ((self.ranks >= tail) & (self.ranks < DRAWS + 1 - tail)).mean(0)

    def outside(self) -> tuple[str, ...]:
        """Quantities whose ranks leave the band."""
        left = (np.abs(self.distance()) > self.distance_band()).any(1)
        return tuple(name for name, bad in zip(self.names, left, strict=True) if bad)

    def lines(self) -> list[str]:
        """What the ranks say, in words."""
        r, (low, high) = len(self.ranks), stats.binom(len(self.ranks), 0.9).ppf([0.005, 0.995]) / len(self.ranks)
        covered, p = self.coverage(0.9), self.p_values()
        said = [
            f"{name}: the 90 % interval holds the truth in {share:.1%} of {r} replicates (chance allows {low:.1%} to {high:.1%}), "
            f"histogram p = {value:.3f}"
            for name, share, value in zip(self.names, covered, p, strict=True)
        ]
        return said + [f"{name}: {_shape(self.distance()[self.names.index(name)])}" for name in self.outside()]


def ranks_of(truth: Float[np.ndarray, " k"], draws: Float[np.ndarray, "n k"]) -> Int[np.ndarray, " k"]:
    """Rank of each true value among `DRAWS` draws spread evenly over those given."""
    return (spread_evenly(draws) < truth).sum(0)


def spread_evenly(draws: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "ranks k"]:
    """`DRAWS` of the draws, at even distances."""
    return draws[np.linspace(0, len(draws) - 1, DRAWS).round().astype(int)]


@lru_cache(maxsize=16)
def _widest(replicates: int) -> float:
    """Quantile of the largest standardised distance from the diagonal over all ranks, by simulation with a fixed seed."""
    random, at = np.random.default_rng(0), np.arange(1, DRAWS + 1) / (DRAWS + 1)
    largest = []
    for _ in range(4000):
        counts = np.bincount(random.integers(0, DRAWS + 1, replicates), minlength=DRAWS + 1)
        away = np.abs(np.cumsum(counts)[:-1] / replicates - at)
        largest.append((away / np.sqrt(at * (1 - at) / replicates)).max())
    return float(np.quantile(largest, LEVEL))


def _shape(distance: Float[np.ndarray, " ranks"]) -> str:
    """What a deviation means."""
    half = distance.size // 2
    low, high = distance[:half].mean(), distance[half:].mean()
    if low > 0 > high:
        return "too many truths in the tails: the stated uncertainty is too small"
    if low < 0 < high:
        return "too few truths in the tails: the stated uncertainty is too large"
    return (
        "truths lie too low among the draws: the posterior is biased upwards"
        if low + high > 0
        else ("truths lie too high among the draws: the posterior is biased downwards")
    )
