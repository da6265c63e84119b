"""The candidate terms, checked, and one matrix with all that tells structures apart: what remains without the terms always there.

[[A, h], [h^T, 2 b0 + y^T y]]  ->  columns scaled so that elimination's pivots carry the priors of the terms, too
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from seatrial.core.errors import InputError, NumericalError
from seatrial.selection.rule_masks import MAX_TERMS
from seatrial.selection.subsets.conjugate import Prior, evidence_constant
from seatrial.selection.subsets.gram import Gram, check_gram

# Optional terms up to which every structure is visited: 2^25 take about 3 s on one core (`benchmarks/run.py subsets`).
MOST_OPTIONAL = 25
LARGEST_LOG = 600.0  # Natural logarithm of a determinant that a double holds with room to spare


class Candidates(NamedTuple):
    """Terms by number: which are certain and which may be there.

    Attributes:
        names: of all terms.
        sure: numbers of those in every structure.
        free: numbers of the k others.
        certain: bitmask of `sure`.
    """

    names: tuple[str, ...]
    sure: list[int]
    free: list[int]
    certain: np.uint64


class Problem(NamedTuple):
    """Of k optional terms after m terms always there.

    The log of p(y | S) is constant - shape log(corner) - 1/2 log(determinant), both after elimination of S.

    Attributes:
        matrix: scaled, shape (k+1, k+1).
        start: determinant of the structure of no optional term.
        pivots: what each term multiplies the determinant by, if not the pivot of elimination, shape (k,).
        squares: what each term adds to the corner, shape (k,), if anything.
        constant: nats.
        shape: a = a0 + n/2.
        scale: coefficients over those of the scaled columns, shape (k,).
        slope: coefficients of the terms always there over what remains, shape (m, k+1).
        inverse: inverse of their block of A, shape (m, m).
        log_prior: log P(S) by the number of optional terms, nats but for a constant, shape (k+1,); None if it is equal for all.
    """

    matrix: Float[np.ndarray, "k1 k1"]
    start: float
    pivots: Float[np.ndarray, " k"] | None
    squares: Float[np.ndarray, " k"] | None
    constant: float
    shape: float
    scale: Float[np.ndarray, " k"]
    slope: Float[np.ndarray, "m k1"]
    inverse: Float[np.ndarray, "m m"]
    log_prior: Float[np.ndarray, " k1"] | None


class Averages(NamedTuple):
    """Posterior averages over structures of the coefficients, those always there first.

    Attributes:
        mean: shape (m+k,); a coefficient counts as zero if its term is absent.
        within: average of the covariances in each structure, shape (m+k, m+k).
        between: covariance of the means of the structures, shape (m+k, m+k).
    """

    mean: Float[np.ndarray, " d"]
    within: Float[np.ndarray, "d d"]
    between: Float[np.ndarray, "d d"]


def check_candidates(stats: Gram, names: Sequence[str], always: Sequence[str]) -> Candidates:
    """Return the question, checked.

    Args:
        stats: of the regression on all terms.
        names: of the terms, one for each column.
        always: terms in every structure.

    Raises:
        InputError: terms that the data cannot separate, or too many.
    """
    names = tuple(names)
    check_gram(stats, names)
    sure = [i for i, name in enumerate(names) if name in always]
    free = [i for i, name in enumerate(names) if name not in always]
    if len(names) > MAX_TERMS:
        raise InputError(
            "library of terms",
            found=f"{len(names)} terms",
            expected=f"at most {MAX_TERMS}, the bits of a number",
            remedy="drop some, or select axis by axis",
        )
    return Candidates(names, sure, free, np.uint64(sum(1 << i for i in sure)))


def make_problem(
    stats: Gram,
    prior: Prior,
    always: Sequence[int],
    optional: Sequence[int],
    log_prior: Float[np.ndarray, " k1"] | None = None,
) -> Problem:
    """Eliminate the terms always there and scale the rest.

    Args:
        stats: checked statistics.
        prior: of the coefficients.
        always: numbers of the terms in every structure.
        optional: numbers of the others.
        log_prior: of a structure by its number of optional terms.

    Raises:
        InputError: a prior for another number of optional terms.
        NumericalError: prior and data so far apart that determinants overflow.
    """
    if log_prior is not None and len(log_prior) != len(optional) + 1:
        raise InputError(
            "log_prior",
            found=f"{len(log_prior)} numbers of terms",
            expected=f"{len(optional) + 1}, from 0 to all {len(optional)} optional terms",
            remedy=f'for example log_prior_by_size("multiplicity", {len(optional)})',
        )
    posterior, sure, free = prior.posterior(stats), np.asarray(always, int), np.asarray(optional, int)
    order = np.concatenate([sure, free])
    corner = 2 * prior.rate + stats.square + posterior.square[sure].sum()
    whole = np.block(
        [
            [posterior.matrix[np.ix_(order, order)], posterior.moment[order, None]],
            [posterior.moment[None, order], np.array([[corner]])],
        ]
    )
    m = sure.size
    inverse = np.linalg.inv(whole[:m, :m])
    slope = -inverse @ whole[:m, m:]
    rest = whole[m:, m:] + whole[m:, :m] @ slope
    constant = evidence_constant(stats, prior) + 0.5 * posterior.log_ratio[sure].sum()
    log_pivot = -posterior.log_ratio[free]
    if posterior.determinant:
        constant -= 0.5 * np.linalg.slogdet(whole[:m, :m])[1]
        scale, pivots = np.exp(0.5 * log_pivot), None
        log_pivot = log_pivot + np.log(np.diag(rest)[:-1])
    else:
        scale, pivots = 1 / np.sqrt(np.diag(rest)[:-1]), np.exp(log_pivot)
    if 0.5 * np.abs(log_pivot).sum() > LARGEST_LOG:
        raise NumericalError(
            "prior and data differ by more than a number can represent: widen or narrow the prior of the coefficients"
        )
    columns = np.append(scale, 1.0)
    squares = posterior.square[free]
    return Problem(
        rest * np.outer(columns, columns),
        float(np.exp(-0.5 * log_pivot.sum())),
        pivots,
        squares if squares.any() else None,
        float(constant - 0.25 * log_pivot.sum()),
        prior.shape + 0.5 * stats.n,
        scale,
        slope,
        inverse,
        None if log_prior is None or not np.ptp(log_prior) else np.asarray(log_prior, float),
    )


def averages(
    problem: Problem, moment: Float[np.ndarray, "k1 k1"], spread: Float[np.ndarray, "k k"], corner: float
) -> Averages:
    """Return the averages from sums over structures in scaled columns.

    Args:
        problem: as made.
        moment: sum of w z z^T, z the posterior means of a structure and -1.
        spread: sum of w corner A_S^-1.
        corner: sum of w corner.
    """
    columns, total = np.append(problem.scale, 1.0), moment[-1, -1]
    moment = moment * np.outer(columns, columns) / total
    spread = spread * np.outer(problem.scale, problem.scale) / total
    freedom = 2 * (problem.shape - 1)
    m, slope = problem.inverse.shape[0], problem.slope
    up = np.vstack([slope, np.eye(slope.shape[1])])
    means = up @ moment @ up.T
    mean = -means[:-1, -1]
    within = up[:-1, :-1] @ spread @ up[:-1, :-1].T
    within[:m, :m] += corner / total * problem.inverse
    return Averages(mean, within / freedom, means[:-1, :-1] - np.outer(mean, mean))
