"""Whether innovations are as large and as independent as the filter takes them for, and what of its answer is left where they are not.

For a filter that is right they are white with unit variance. Where their mean square is s and n of them say as much as one that is
independent, the data are worth 1 / (s n) of what the filter thinks: by so much the information beyond the prior is discounted. n is the
variance of the mean of a block of innovations over that of independent ones (batch means), times (1 + r) / (1 - r) for what reaches into
the next blocks, r their correlation; of blocks of 1, 2, 4, ... samples, as long as there are enough, the largest.
"""

from collections import deque

import numpy as np
from jaxtyping import Float

BLOCK_LEVELS = 24  # Sizes of blocks, up to 2^23 samples: a day at 100 Hz
MIN_BLOCKS = 24  # Blocks from which their variance is taken
MIN_CORRELATED_BLOCKS = 96  # Blocks from which their correlation is
CLEAR_ERRORS = 2.0  # Standard errors from which a correlation of blocks counts


class InnovationMemory:
    """Sums over normalised innovations of m channels, in memory that does not grow."""

    def __init__(self, m: int):
        self.waiting = np.zeros((BLOCK_LEVELS, m))
        self.is_waiting = np.zeros((BLOCK_LEVELS, m), bool)
        self.last = np.full((BLOCK_LEVELS, m), np.nan)
        self.blocks, self.squares, self.products = (np.zeros((BLOCK_LEVELS, m)) for _ in range(3))
        self.recent: deque[tuple[float, np.ndarray, np.ndarray]] = deque()

    @property
    def count(self) -> Float[np.ndarray, " m"]:
        """Innovations of each channel."""
        return self.blocks[0]

    @property
    def mean_square(self) -> Float[np.ndarray, " m"]:
        """Their mean square; 1 if there is none."""
        return np.where(self.count > 0, self.squares[0] / np.maximum(self.count, 1), 1.0)

    def add(self, normalised: Float[np.ndarray, " m"]) -> None:
        """Add one sample, NaN if a channel is missing."""
        for channel, value in enumerate(normalised.tolist()):
            if value == value:
                self._add(channel, value)

    def _add(self, channel: int, total: float) -> None:
        for level in range(BLOCK_LEVELS):
            self.blocks[level, channel] += 1
            self.squares[level, channel] += total * total
            before = self.last[level, channel]
            if before == before:
                self.products[level, channel] += before * total
            self.last[level, channel] = total
            if not self.is_waiting[level, channel]:
                self.waiting[level, channel], self.is_waiting[level, channel] = total, True
                return
            total += self.waiting[level, channel]
            self.is_waiting[level, channel] = False

    def repeats(self) -> Float[np.ndarray, " m"]:
        """Return how many innovations of each channel say as much as an independent one, at least 1."""
        repeats = np.ones(self.count.size)
        for channel in range(repeats.size):
            enough = np.flatnonzero(self.blocks[:, channel] >= MIN_BLOCKS)
            if not enough.size or self.squares[0, channel] <= 0:
                continue
            size = 2.0**enough
            blocks, squares = self.blocks[enough, channel], self.squares[enough, channel]
            ratio = squares / blocks / size / self.mean_square[channel]
            r = np.minimum(self.products[enough, channel] / squares, 0.99)
            reach = np.where(
                (r > CLEAR_ERRORS / np.sqrt(blocks)) & (blocks >= MIN_CORRELATED_BLOCKS), (1 + r) / (1 - r), 1.0
            )
            repeats[channel] = max(1.0, float((ratio * reach).max()))
        return repeats

    def discount(self) -> float:
        """Return what the filter's information is to be divided by, that of the worst channel, at least 1."""
        return float(np.max(np.maximum(self.mean_square, 1.0) * self.repeats(), initial=1.0))

    def look(self, now: float, window: float) -> Float[np.ndarray, " m"]:
        """Return the root mean square of each channel over the last window, NaN if fewer than 20 innovations are in it.

        Args:
            now: time, s, not before that of an earlier look.
            window: s.
        """
        if not self.recent:
            self.recent.append((now, np.zeros(self.count.size), np.zeros(self.count.size)))
        self.recent.append((now, self.squares[0].copy(), self.count.copy()))
        while len(self.recent) > 1 and self.recent[0][0] < now - window:
            self.recent.popleft()
        _, squares, count = self.recent[0]
        fresh = self.count - count
        return np.sqrt(np.where(fresh >= 20, (self.squares[0] - squares) / np.maximum(fresh, 1), np.nan))


def discounted(cov: Float[np.ndarray, "k k"], by: float) -> Float[np.ndarray, "k k"]:
    """Return a covariance of which the information beyond the prior is divided by a number.

    Args:
        cov: in units of the prior's standard deviations.
        by: at least 1.
    """
    variance, axes = np.linalg.eigh(cov)
    left = np.where(variance < 1.0, 1.0 / (1.0 + (1.0 / np.maximum(variance, 1e-300) - 1.0) / by), variance)
    return (axes * left) @ axes.T
