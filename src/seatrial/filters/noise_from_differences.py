"""Measurement noise from the record itself, by high-pass filtering: differences of rising order remove the motion and leave noise."""

from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import comb, eval_hermitenorm, factorial, ndtri

from seatrial.core.errors import InputError

MAX_ORDER = 6


class NoiseEstimate(NamedTuple):
    """Standard deviation of a sensor's white noise, its standard error, and the order of the differences it was read from."""

    sd: float
    std_error: float
    order: int


def noise_from_high_pass(time: Float[np.ndarray, " n"], measured: Float[np.ndarray, " n"]) -> NoiseEstimate:
    """Estimate the white measurement noise of one channel by high-pass filtering, for R.

    The k-th difference of even samples removes motion that is smooth over k samples and multiplies the variance of white noise
    by (2k choose k). Its spread is taken as the median absolute value, which outliers and steps do not move. The order is the
    first whose estimate the next one does not lower by more than its own error; what it does lower is added to the
    error. Coloured noise is not seen: its slow part counts as motion.

    Args:
        time: s.
        measured: samples, NaN if nothing was measured; differences are taken between successive measurements one
            median interval apart.

    Raises:
        InputError: fewer than 50 differences, or a sensor whose steps are coarser than its noise.
    """
    present = np.isfinite(measured)
    time, values = time[present], measured[present]
    step = np.diff(time)
    even = np.abs(step / np.median(step) - 1) < 0.1 if step.size else np.empty(0, bool)
    estimates = [_from_differences(values, even, order) for order in range(1, MAX_ORDER + 2)]
    fall = [here[0] - after[0] for here, after in pairwise(estimates)]
    chosen = next((k for k in range(MAX_ORDER) if fall[k] < estimates[k + 1][1]), MAX_ORDER - 1)
    sd, error = estimates[chosen]
    return NoiseEstimate(sd, float(np.hypot(error, max(0.0, fall[chosen]))), chosen + 1)


def _from_differences(values: np.ndarray, even: np.ndarray, order: int) -> tuple[float, float]:
    """Return the noise sd and its standard error from differences of one order."""
    whole = np.lib.stride_tricks.sliding_window_view(even, order).all(1) if even.size >= order else np.empty(0, bool)
    difference = np.abs(np.asarray(np.diff(values, order))[whole])
    if difference.size < 50:
        raise InputError(
            "measurement noise by high-pass filtering",
            found=f"{difference.size} differences of order {order} between evenly spaced samples",
            expected="at least 50",
            remedy="give a longer record, or state the noise",
        )
    middle = float(np.median(difference))
    if middle == 0.0 or np.unique(difference).size < 10:
        raise InputError(
            "measurement noise by high-pass filtering",
            found="a signal that moves in a few equal steps",
            expected="a sensor whose noise is larger than its resolution",
            remedy="state the noise as the resolution over the square root of 12",
        )
    sd = middle / ndtri(0.75) / np.sqrt(comb(2 * order, order))
    return float(sd), float(sd * _relative_error(order) / np.sqrt(difference.size))


def _density(z: float) -> float:
    """Density of the standard normal distribution."""
    return float(np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi))


@lru_cache
def _relative_error(order: int) -> float:
    """Return the asymptotic standard error of a median absolute value over its expectation, times the square root of the sample size.

    Differences of white noise are correlated; indicators of |z| < m expand in Hermite polynomials, whose terms of even order k
    correlate as the k-th power of that correlation (Mehler's formula).
    """
    m = ndtri(0.75)
    k = np.arange(2, 42, 2)
    weight = (2 * _density(m) * eval_hermitenorm(k - 1, m)) ** 2 / factorial(k)
    lags = np.arange(1, order + 1)
    correlation = np.asarray(comb(2 * order, order + lags) / comb(2 * order, order))
    variance = 0.25 + 2 * np.sum(weight * correlation[:, None] ** k)
    return float(np.sqrt(variance) / (2 * _density(m) * m))
