"""The best structures of many blocks, kept by a threshold that rises as they come."""

from threading import Lock

import numpy as np
from jaxtyping import Float, UInt64


class Best:
    """The `most` highest scores offered, ties broken by the smaller number; blocks may come from several threads."""

    def __init__(self, most: int):
        """Keep nothing yet."""
        self._most, self._lock, self._threshold, self._held = most, Lock(), -np.inf, 0
        self._scores: list[np.ndarray] = []
        self._codes: list[np.ndarray] = []

    def offer(self, scores: Float[np.ndarray, "m lanes"], lane: int, shift: int) -> None:
        """Look at a block: its structure in row i and lane j has the number (i << shift) + lane + j."""
        flat = scores.ravel()
        found = np.flatnonzero((flat >= self._threshold) & (flat > -np.inf))
        found = found[_top(flat[found], self._most)]
        if not found.size:
            return
        row, column = np.divmod(found, scores.shape[1])
        with self._lock:
            self._scores.append(flat[found])
            self._codes.append((row << shift) + lane + column)
            self._held += found.size
            if self._held > 4 * self._most:
                self._compact()

    def ranked(self) -> tuple[Float[np.ndarray, " n"], UInt64[np.ndarray, " n"]]:
        """Scores, highest first, and numbers."""
        self._compact()
        scores, codes = self._scores[0], self._codes[0]
        order = np.lexsort((codes, -scores))
        return scores[order], codes[order].astype(np.uint64)

    def _compact(self) -> None:
        scores, codes = np.concatenate(self._scores), np.concatenate(self._codes)
        kept = _top(scores, self._most)
        self._scores, self._codes, self._held = [scores[kept]], [codes[kept]], kept.size
        if kept.size == self._most:
            self._threshold = float(scores[kept].min())


def _top(scores: np.ndarray, most: int) -> np.ndarray:
    """Where the highest are, in any order."""
    if scores.size <= most:
        return np.arange(scores.size)
    return np.argpartition(scores, scores.size - most)[scores.size - most :]
