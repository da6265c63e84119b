"""Sequential thresholded least squares, the baseline people know (Brunton, Proctor and Kutz, PNAS 113, 2016).

    repeat   c_S = argmin |y - Phi_S c|^2;   S <- { j in S : |c_j| |Phi_j| / sqrt(n) >= threshold }   until S stays

The threshold is on the coefficient of a column of root mean square 1, in the unit of the response, so that no unit of a signal
decides. One threshold of a path is chosen by BIC, n log(rss / n) + p log n, or by cross-validation over trials or stretches.
No uncertainty and no prior: a term is there or not.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, UInt64

from seatrial.core.errors import InputError
from seatrial.selection.rule_masks import MOST_TERMS
from seatrial.selection.subsets.gram import Gram, check_gram

STEPS = 40
"""Thresholds of the path, if none are given."""
LEAST, MOST = 1e-3, 1.001
"""The path's ends over the largest coefficient of the full fit: from nearly every term to none."""


class Thresholded(NamedTuple):
    """Fits along thresholds.

    Attributes:
        names: terms.
        thresholds: on coefficients of columns of unit root mean square, unit of the response, shape (s,).
        structures: bit i for term i, shape (s,).
        coefficients: zero where absent, shape (s, k).
        criterion: BIC, or mean squared error of prediction of what was left out, shape (s,).
        best: index of the smallest criterion, the highest such threshold.
    """

    names: tuple[str, ...]
    thresholds: Float[np.ndarray, " s"]
    structures: UInt64[np.ndarray, " s"]
    coefficients: Float[np.ndarray, "s k"]
    criterion: Float[np.ndarray, " s"]
    best: int

    @property
    def terms(self) -> tuple[str, ...]:
        """Names of the chosen terms."""
        return tuple(name for i, name in enumerate(self.names) if int(self.structures[self.best]) >> i & 1)


def thresholded_least_squares(
    stats: Gram,
    names: Sequence[str],
    *,
    always: Sequence[str] = (),
    folds: Sequence[Gram] = (),
    thresholds: Sequence[float] | None = None,
) -> Thresholded:
    """Fit along a path of thresholds and choose one.

    Args:
        stats: of the regression on all terms.
        names: of the terms, one for each column.
        always: terms that no threshold removes.
        folds: statistics of the parts that `stats` is the sum of, to choose by cross-validation; by BIC, if none.
        thresholds: rising or not, positive; from nearly every term to none, if not given.

    Raises:
        InputError: as `check_gram`; terms that are not known, thresholds not positive, folds that do not add up or of which the
            others do not determine every term.
    """
    names = tuple(names)
    check_gram(stats, names)
    _check(stats, names, always, folds)
    sure = np.array([name in always for name in names])
    if thresholds is None:
        full = np.abs(np.linalg.solve(stats.matrix, stats.moment) * _size(stats))
        path = np.geomspace(LEAST, MOST, STEPS) * full.max()
    else:
        path = np.asarray(thresholds, float)
    if path.ndim != 1 or not path.size or not (path > 0).all():
        raise InputError(
            "thresholds",
            found=str(thresholds),
            expected="positive numbers",
            remedy="give some in the unit of the response, or none for a path of its own",
        )
    coefficients = np.array([_fit(stats, sure, threshold) for threshold in path])
    if folds:
        criterion = np.array([_left_out(folds, sure, threshold) for threshold in path])
    else:
        left = np.array([max(_residual(stats, c), np.finfo(float).tiny) for c in coefficients])
        criterion = stats.n * np.log(left / stats.n) + np.log(stats.n) * (coefficients != 0).sum(1)
    least = np.flatnonzero(criterion <= criterion.min())
    best = int(least[np.argmax(path[least])])
    structures = np.array([sum(1 << int(i) for i in np.flatnonzero(c)) for c in coefficients], np.uint64)
    return Thresholded(names, path, structures, coefficients, criterion, best)


def _fit(stats: Gram, sure: np.ndarray, threshold: float) -> Float[np.ndarray, " k"]:
    """Apply least squares and a threshold in turn, until the terms stay; they only ever become fewer."""
    there, coefficients = np.ones(sure.size, bool), np.zeros(sure.size)
    while True:
        chosen = np.flatnonzero(there)
        coefficients[:] = 0.0
        coefficients[chosen] = np.linalg.solve(stats.matrix[np.ix_(chosen, chosen)], stats.moment[chosen])
        kept = there & (sure | (np.abs(coefficients) * _size(stats) >= threshold))
        if (kept == there).all():
            return coefficients
        there = kept


def _left_out(folds: Sequence[Gram], sure: np.ndarray, threshold: float) -> float:
    """Return the mean squared error for each part of the fit to the others."""
    total = 0.0
    for i, part in enumerate(folds):
        others = [fold for j, fold in enumerate(folds) if j != i]
        total += _residual(part, _fit(sum(others[1:], others[0]), sure, threshold))
    return total / sum(fold.n for fold in folds)


def _size(stats: Gram) -> Float[np.ndarray, " k"]:
    """Return the root mean squares of the columns."""
    return np.sqrt(np.diag(stats.matrix) / stats.n)


def _residual(stats: Gram, c: Float[np.ndarray, " k"]) -> float:
    """Return the sum of squares that coefficients leave."""
    return float(stats.square - 2 * c @ stats.moment + c @ stats.matrix @ c)


def _check(stats: Gram, names: tuple[str, ...], always: Sequence[str], folds: Sequence[Gram]) -> None:
    if len(names) > MOST_TERMS:
        raise InputError(
            "library of terms", found=f"{len(names)} terms", expected=f"at most {MOST_TERMS}", remedy="drop some"
        )
    unknown = [name for name in always if name not in names]
    if unknown:
        raise InputError(
            "terms always there",
            found=", ".join(unknown),
            expected="terms of the library",
            remedy="one of " + ", ".join(names),
        )
    if not folds:
        return
    if len(folds) < 2 or sum(fold.n for fold in folds) != stats.n:
        raise InputError(
            "parts for cross-validation",
            found=f"{len(folds)} of {sum(fold.n for fold in folds)} measurements in all",
            expected=f"at least two, of {stats.n} together",
            remedy="cut the rows in parts and build the statistics of each",
        )
    for i in range(len(folds)):
        others = [fold for j, fold in enumerate(folds) if j != i]
        check_gram(sum(others[1:], others[0]), names)
