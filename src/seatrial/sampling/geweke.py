"""Geweke's scores along a chain, as the paper draws them over its traces, with the variance of the mean and as printed.

z = (mean_a - mean_b) / sqrt(V_a + V_b),  a an early segment, b the end of the chain (Geweke, Bayesian Statistics 4, 1992)
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from seatrial.core.errors import InputError
from seatrial.sampling.diagnostics import variance_of_mean


class GewekeScores(NamedTuple):
    """Scores of successive early segments.

    Attributes:
        start: index of each segment's first draw, shape (intervals,).
        length: draws in a segment.
        score: its score, in standard deviations, shape (intervals,); infinite or NaN where nothing moves.
    """

    start: Int[np.ndarray, " intervals"]
    length: int
    score: Float[np.ndarray, " intervals"]


def geweke_scores(
    chain: Float[np.ndarray, " n"], first: float = 0.1, last: float = 0.5, intervals: int = 20
) -> GewekeScores:
    """Scores of early segments against the end of the chain, V being the variance of a mean from the spectral density at zero.

    Standard normal each where the chain is stationary, so that 95 % lie within 2; segments that overlap share their luck.

    Args:
        chain: draws of one parameter.
        first: length of a segment as a share of the chain.
        last: share of the chain at its end that they are held against.
        intervals: segments, evenly spread from the first draw to where the end begins.

    Raises:
        InputError: shares that overlap, or segments of fewer than 10 draws.
    """
    return _scores(chain, first, last, intervals, variance_of_mean)


def printed_geweke_scores(
    chain: Float[np.ndarray, " n"], first: float = 0.1, last: float = 0.5, intervals: int = 20
) -> GewekeScores:
    """Scores with V the plain variance of the draws, as the paper prints them; arguments as `geweke_scores`.

    They cannot fail. The variance of the draws does not shrink with their number, nor does it grow with their correlation, so
    the score only says by how many posterior standard deviations the means differ, over sqrt(2): a chain that drifts by
    two of them in its course scores about -1, where the variance of the mean gives -10 after a thousand draws. To leave
    the band of 2 the means must lie nearly three standard deviations apart. For comparison with the paper only.
    """
    return _scores(chain, first, last, intervals, lambda draws: float(draws.var()))


def _scores(
    chain: np.ndarray, first: float, last: float, intervals: int, variance: Callable[[np.ndarray], float]
) -> GewekeScores:
    n = chain.size
    length, end = int(first * n), n - int(last * n)
    if length < 10 or length > end or end == n or intervals < 1:
        raise InputError(
            "Geweke's scores",
            found=f"{intervals} segments of {length} draws against the last {n - end} of {n}",
            expected="one segment or more, of 10 draws or more, that ends before the last part begins",
            remedy="use a longer chain, or shares such as 0.1 and 0.5",
        )
    late = chain[end:]
    start = np.linspace(0, end - length, intervals).astype(int)
    early = [chain[i : i + length] for i in start]
    spread = np.array([variance(draws) for draws in early]) + variance(late)
    difference = np.array([draws.mean() for draws in early]) - late.mean()
    with np.errstate(divide="ignore", invalid="ignore"):
        return GewekeScores(start, length, difference / np.sqrt(spread))
