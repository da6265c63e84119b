"""How good a predicted distribution was once the measurement is known: errors, proper scores, calibration and whiteness.

    CRPS = int (F(x) - 1{y <= x})^2 dx                   Gneiting and Raftery, JASA 102, 2007
    Q = (n + 2) / n sum_k N_k r_k^2, r_k the mean product of the N_k pairs that are k intervals apart, over the mean square

The score of a normal prediction has a closed form; Q is the Ljung-Box statistic where no sample is missing, and that of
Stoffer and Toloi (Statistics and Probability Letters 13, 1992) where some are.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy import stats
from scipy.special import ndtr

BINS = 10
"""Bins of the histogram of the probability integral transform."""


class Whiteness(NamedTuple):
    """Autocorrelation of residuals and what follows from it.

    Attributes:
        lag: lags that some pair of samples has, in intervals, shape (k,).
        correlation: autocorrelation at each of them, shape (k,).
        pairs: number of pairs behind each, shape (k,); white noise stays within 2 / sqrt(pairs) at 95 % of lags.
        interval: median time between samples, s.
        p_value: probability that white noise shows as large a Q; 1 where there is nothing to test.
    """

    lag: Int[np.ndarray, " k"]
    correlation: Float[np.ndarray, " k"]
    pairs: Int[np.ndarray, " k"]
    interval: float
    p_value: float

    @property
    def neighbours(self) -> float:
        """Autocorrelation one interval apart; 0 where no two samples are neighbours."""
        return float(self.correlation[0]) if self.lag.size and self.lag[0] == 1 else 0.0


def explained_share(measured: Float[np.ndarray, " n"], predicted: Float[np.ndarray, " n"]) -> float:
    """Share of variance explained, 1 - SSE / SST; NaN where the measurement never changes."""
    total = float(np.sum((measured - measured.mean()) ** 2))
    return 1.0 - float(np.sum((measured - predicted) ** 2)) / total if _moves(measured) else np.nan


def nrmse_fit(measured: Float[np.ndarray, " n"], predicted: Float[np.ndarray, " n"]) -> float:
    """Fit by normalised root mean square error, 1 - |y - f| / |y - mean y|, the percentage of MATLAB's `compare` over 100.

    It is 1 - sqrt(1 - share explained): 95 % of the variance is a fit of 78 %. NaN where the measurement never changes.
    """
    return 1.0 - float(np.sqrt(1.0 - explained_share(measured, predicted)))


def crps_normal(
    measured: Float[np.ndarray, " n"], mean: Float[np.ndarray, " n"], sd: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Continuous ranked probability score of normal predictions, in the unit of the measurement; lower is better."""
    z = (measured - mean) / sd
    return sd * (z * (2 * ndtr(z) - 1) + 2 * stats.norm.pdf(z) - 1 / np.sqrt(np.pi))


def coverage(z: Float[np.ndarray, " n"], level: float) -> float:
    """Share of normalised residuals inside the central band of this probability."""
    return float(np.mean(np.abs(z) <= stats.norm.ppf(0.5 + 0.5 * level)))


def pit_shares(z: Float[np.ndarray, " n"]) -> Float[np.ndarray, " bins"]:
    """Histogram of the probability integral transform, shares that would all be 1 / 10."""
    return np.histogram(ndtr(z), BINS, (0.0, 1.0))[0] / z.size


def pit_distance(z: Float[np.ndarray, " n"]) -> float:
    """Largest distance of the distribution of the probability integral transform from uniform (Kolmogorov and Smirnov)."""
    return float(stats.kstest(ndtr(z), "uniform").statistic)


def whiteness(time: Float[np.ndarray, " n"], residual: Float[np.ndarray, " n"], lags: int = 20) -> Whiteness:
    """Autocorrelation and portmanteau test of the residuals that were measured; pairs across a gap count at their own lag.

    Args:
        time: s, strictly increasing.
        residual: one for each time, all present.
        lags: most lags to look at; at most a third of the samples.
    """
    interval = float(np.median(np.diff(time))) if time.size > 1 else 0.0
    values = residual - residual.mean() if residual.size else residual
    square = float(values @ values)
    if values.size < 8 or not _moves(residual):
        return Whiteness(np.empty(0, int), np.empty(0), np.empty(0, int), interval, 1.0)
    n = values.size
    sums = [_lagged(values, _grid(time), lag) for lag in range(1, min(lags, n // 3) + 1)]
    lag = np.array([k for k, (_, count) in enumerate(sums, 1) if count], int)
    pairs = np.array([count for _, count in sums if count], int)
    correlation = np.array([product / count for product, count in sums if count]) * n / square
    q = (n + 2) / n * float(np.sum(pairs * correlation**2))
    return Whiteness(lag, correlation, pairs, interval, float(stats.chi2.sf(q, lag.size)) if lag.size else 1.0)


def effective_samples(time: Float[np.ndarray, " n"], residual: Float[np.ndarray, " n"]) -> float:
    """Independent samples that these are worth, n / (1 + 2 sum_k r_k), the sum ending before the first r_k that is not positive."""
    n = residual.size
    if n < 8 or not _moves(residual):
        return float(min(n, 1))
    values, at, total = residual - residual.mean(), _grid(time), 0.0
    square = float(values @ values)
    for lag in range(1, n // 2):
        product, _ = _lagged(values, at, lag)
        if product <= 0:
            break
        total += product / square
    return n / (1 + 2 * total)


def _grid(time: np.ndarray) -> np.ndarray:
    """Which multiple of the median interval each sample falls on, counted from sample to sample so that jitter does not add up."""
    step = np.diff(time)
    return np.concatenate([[0], np.cumsum(np.maximum(1, np.round(step / np.median(step))).astype(int))])


def _lagged(values: np.ndarray, at: np.ndarray, lag: int) -> tuple[float, int]:
    """Sum of products of samples that are `lag` places apart, and the number of such pairs."""
    later = np.searchsorted(at, at + lag)
    found = later < at.size
    found[found] = at[later[found]] == at[found] + lag
    return float(values[found] @ values[later[found]]), int(found.sum())


def _moves(values: np.ndarray) -> bool:
    """Whether values differ by more than rounding."""
    return bool(np.ptp(values) > 1e-12 * np.abs(values).max()) if values.size else False
