"""Posterior over all 2^k structures of a linear regression in closed form, none of them stored.

    P(S | y) ~ P(S) p(y | S),  p(y | S) = exp(constant) D_S^-1/2 (2 b_S)^-a,  D_S the product of pivots that carry the priors, too

Terms always there are eliminated first. Of the others the first are doubled at once, into lanes; then blocks of lanes double
the last ones and keep sums only: the total, joint inclusion, moments of the coefficients, and the best structures seen.

One elimination step over all subsets of the terms so far gives those with the next term, too. A symmetric matrix
[[p, b^T], [b, R]] is kept for every subset, as a lane. Without the next term what remains is R; with it,

    R - b b^T / p,   determinant times p,   coefficient of the term c = j^T z with j = -b / p and z the rest, the last entry -1,

so that each level doubles the lanes and the number of a lane is its bitmask (bit of the first level lowest). When no term is
left, what remains is 2 b_n. Moments go back the same way: from Q = sum of w z z^T over a lane's two halves, weighted,

    [[j^T Q1 j, j^T Q1], [Q1 j, Q0 + Q1]]

where Q1 is of the half with the term, whose posterior covariance adds v / p to the corner. Each lane costs the same at any k.
"""

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from threading import Lock
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, UInt64

from seatrial.core.processes import cores
from seatrial.selection.rule_masks import Conditions, RuleMasks, bits, conditions, no_structure, spread
from seatrial.selection.subsets.average import SubsetPosterior
from seatrial.selection.subsets.conjugate import Prior, evidence_of
from seatrial.selection.subsets.gram import Gram
from seatrial.selection.subsets.problem import Averages, Candidates, Problem, averages, check_candidates, make_problem

BLOCK_LEVELS, BLOCK_LANES = 10, 64  # Doublings and lanes of a block: 65 536 structures, whose arrays fit the cache
# Nats: a block is left out if all structures at its best would weigh exp(-40) of the best one of the first block.
NEGLIGIBLE_DEFICIT = 40.0


class SubsetElimination:
    """Buffers of `levels` doublings of matrices of a given size, in `lanes` lanes, reused by every run.

    NumPy, on blocks that nearly fit the cache. The same steps as one XLA program took as long or longer, since it fuses the way
    back badly, after seconds of compilation.
    """

    def __init__(self, size: int, levels: int, lanes: int):
        """Buffers for matrices of shape (size, size, lanes)."""
        sizes = [(size - level, lanes << level) for level in range(levels + 1)]
        self.matrices = _by_turns([(n, n, m) for n, m in sizes])
        self.moments = _by_turns([(n, n, m) for n, m in sizes])
        self.spreads = _by_turns([(n - 1, n - 1, m) for n, m in sizes])
        self.determinants = _by_turns([(m,) for _, m in sizes])
        self.slopes = [np.empty((n - 1, m)) for n, m in sizes[:-1]]
        self.inverses = [np.empty(m) for _, m in sizes[:-1]]
        self.product = np.empty(max([(n - 1) ** 2 * m for n, m in sizes]))

    def eliminate(
        self,
        matrix: Float[np.ndarray, "size size lanes"],
        determinant: Float[np.ndarray, " lanes"],
        pivots: Float[np.ndarray, " levels"] | None = None,
        squares: Float[np.ndarray, " levels"] | None = None,
    ) -> tuple[Float[np.ndarray, "rest rest more"], Float[np.ndarray, " more"]]:
        """Return all subsets of the first terms.

        Args:
            matrix: what remains before, a lane for each subset so far.
            determinant: product of the pivots so far.
            pivots: what the determinant is multiplied by for each term, if not by the pivot of elimination.
            squares: added to the last diagonal entry by the presence of each term.

        Returns:
            What remains of each lane and its determinant; the buffers keep them, until the next run.
        """
        determinants = self.determinants
        determinants[0][:] = determinant
        for level, (slope, inverse) in enumerate(zip(self.slopes, self.inverses, strict=True)):
            p, b, rest = matrix[0, 0], matrix[0, 1:], matrix[1:, 1:]
            np.divide(-1.0, p, out=inverse)
            np.multiply(b, inverse, out=slope)
            without, present = _halves(self.matrices[level + 1])
            without[:] = rest
            np.multiply(slope[:, None], b, out=present)
            present += rest
            if squares is not None:
                present[-1, -1] += squares[level]
            fewer, more = _halves(determinants[level + 1])
            fewer[:] = determinants[level]
            np.multiply(determinants[level], p if pivots is None else pivots[level], out=more)
            matrix = self.matrices[level + 1]
        return matrix, determinants[-1]

    def gather_moments(self, moment: Float[np.ndarray, "rest rest more"]) -> Float[np.ndarray, "size size lanes"]:
        """Return the sums over each lane's subsets of w z z^T, z the posterior means and -1, from those over the finest lanes."""
        self.moments[-1][:] = moment
        for level in reversed(range(len(self.slopes))):
            self._join(self.moments[level + 1], self.slopes[level], level, self.moments[level])
        return self.moments[0]

    def gather_spreads(
        self, spread: Float[np.ndarray, "less less more"], scale: Float[np.ndarray, " more"]
    ) -> tuple[Float[np.ndarray, "fewer fewer lanes"], Float[np.ndarray, " lanes"]]:
        """Return the sums over each lane's subsets of v A_S^-1, and of v, from those over the finest lanes; one row less than moments."""
        self.spreads[-1][:] = spread
        for level in reversed(range(len(self.slopes))):
            joined = self.spreads[level]
            self._join(self.spreads[level + 1], self.slopes[level][:-1], level, joined)
            fewer, more = _halves(scale)
            joined[0, 0] -= self.inverses[level] * more
            scale = fewer + more
        return self.spreads[0], scale

    def _join(self, halves: np.ndarray, slope: np.ndarray, level: int, out: np.ndarray) -> None:
        """Moments of a lane from those of its halves."""
        without, present = _halves(halves)
        product = self.product[: present.size].reshape(present.shape)
        np.add(without, present, out=out[1:, 1:])
        np.multiply(present, slope[:, None], out=product)
        cross = np.sum(product, axis=0, out=out[0, 1:])
        out[1:, 0] = cross
        np.sum(slope * cross, axis=0, out=out[0, 0])


# Sums over all structures: a block of lanes at a time, each relative to its own best, put together at the end.


class LaneSums(NamedTuple):
    """Over the structures of each lane, of weights exp(score - peak of its block); r levels of doubling in each lane.

    Attributes:
        peak: highest score of the lane's block, -inf where it was left out, shape (lanes,).
        weight: sum of w, shape (lanes,).
        corner: sum of w corner, shape (lanes,).
        present: sum of w over the structures with each term, shape (r, lanes).
        pairs: the same with both of each two terms, over a block, shape (r, r, blocks).
        moment: sum of w z z^T, shape (r+1, r+1, lanes).
        spread: sum of w corner A_S^-1, shape (r, r, lanes).
        allowed: number of structures that keep the rules, shape (lanes,).
    """

    peak: Float[np.ndarray, " lanes"]
    weight: Float[np.ndarray, " lanes"]
    corner: Float[np.ndarray, " lanes"]
    present: Float[np.ndarray, "r lanes"]
    pairs: Float[np.ndarray, "r r blocks"]
    moment: Float[np.ndarray, "r1 r1 lanes"]
    spread: Float[np.ndarray, "r r lanes"]
    allowed: Float[np.ndarray, " lanes"]

    def rescaled(self) -> "LaneSums":
        """Return the same relative to the highest peak of all."""
        factor = np.exp(self.peak - self.peak.max())
        of_block = factor[:: factor.size // self.pairs.shape[2]]
        return self._replace(
            peak=np.full_like(self.peak, self.peak.max()),
            pairs=self.pairs * of_block,
            **{name: getattr(self, name) * factor for name in ("weight", "corner", "present", "moment", "spread")},
        )

    def joint(self) -> Float[np.ndarray, "k k"]:
        """Return the probability that both of each two terms are there; of sums already rescaled.

        The terms before those doubled within come first; their settings are the lanes.
        """
        is_present = bits(np.arange(self.weight.size), self.weight.size.bit_length() - 1)
        across = self.present @ is_present.T
        whole = np.block([[(is_present * self.weight) @ is_present.T, across.T], [across, self.pairs.sum(2)]])
        return whole / self.weight.sum()


class LaneBlock(NamedTuple):
    """What a block needs beside its lanes.

    Attributes:
        shape: a = a0 + n/2.
        pivots: of the terms doubled within, as in `Problem`, shape (r,).
        squares: likewise, shape (r,).
        log_prior: as in `Problem`.
        conditions: what the rules ask, if there are any.
        shift: number of terms before these.
    """

    shape: float
    pivots: Float[np.ndarray, " r"] | None
    squares: Float[np.ndarray, " r"] | None
    log_prior: Float[np.ndarray, " k1"] | None
    conditions: Conditions | None
    shift: int


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
        result = np.flatnonzero((flat >= self._threshold) & (flat > -np.inf))
        result = result[_top(flat[result], self._most)]
        if not result.size:
            return
        row, column = np.divmod(result, scores.shape[1])
        with self._lock:
            self._scores.append(flat[result])
            self._codes.append((row << shift) + lane + column)
            self._held += result.size
            if self._held > 4 * self._most:
                self._compact()

    def ranked(self) -> tuple[Float[np.ndarray, " n"], UInt64[np.ndarray, " n"]]:
        """Return the scores, highest first, and numbers."""
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


def empty_sums(r: int, lanes: int, blocks: int) -> LaneSums:
    """Nothing summed yet, of r levels in lanes that are taken in blocks."""
    return LaneSums(
        peak=np.full(lanes, -np.inf),
        weight=np.zeros(lanes),
        corner=np.zeros(lanes),
        present=np.zeros((r, lanes)),
        pairs=np.zeros((r, r, blocks)),
        moment=np.zeros((r + 1, r + 1, lanes)),
        spread=np.zeros((r, r, lanes)),
        allowed=np.full(lanes, 2.0**r),
    )


def add_block(
    block: LaneBlock,
    tree: SubsetElimination,
    matrix: Float[np.ndarray, "r1 r1 lanes"],
    determinant: Float[np.ndarray, " lanes"],
    first: int,
    negligible: float,
    sums: LaneSums,
    best: Best,
) -> None:
    """Double the last terms in a few lanes, from lane `first` on, and add up, unless the best score is below `negligible`."""
    r, width = len(tree.slopes), tree.determinants[0].size
    here = slice(first, first + width)
    corner, product = tree.eliminate(matrix[..., here], determinant[here], block.pivots, block.squares)
    corner = corner[0, 0].reshape(-1, width)
    score, weight = _scores(block, corner, product.reshape(corner.shape))
    if block.log_prior is not None:
        inner, outer = np.arange(score.shape[0]), np.arange(first, first + width)
        score += block.log_prior[np.bitwise_count(inner)[:, None] + np.bitwise_count(outer)]
    if block.conditions is not None:
        forbidden = block.conditions.forbidden(here)
        score[forbidden] = -np.inf
        sums.allowed[here] = corner.shape[0] - forbidden.sum(0)
    peak = score.max()
    best.offer(score, first, block.shift)
    if not peak > negligible:
        return
    sums.peak[here] = peak
    np.subtract(score, peak, out=weight)
    np.exp(weight, out=weight)
    sums.moment[..., here] = tree.gather_moments(weight.reshape(1, 1, -1))
    corner *= weight
    sums.spread[..., here], sums.corner[here] = tree.gather_spreads(np.empty((0, 0, weight.size)), corner.ravel())
    by_setting = weight.sum(1)
    is_present = bits(np.arange(by_setting.size), r)
    sums.pairs[..., first // width] = (is_present * by_setting) @ is_present.T
    for term in reversed(range(r)):
        without, present = weight.reshape(2, -1, width)
        sums.present[term, here] = present.sum(0)
        weight = without + present
    sums.weight[here] = weight[0]


def all_subsets(
    stats: Gram,
    prior: Prior,
    names: Sequence[str],
    *,
    always: Sequence[str] = (),
    rules: RuleMasks | None = None,
    log_prior: Float[np.ndarray, " k1"] | None = None,
    top: int = 1000,
    threads: int | None = None,
) -> SubsetPosterior:
    """Return the probabilities of all structures, and averages over them.

    Args:
        stats: of the regression on all terms.
        prior: of its coefficients and noise.
        names: of the terms, one for each column.
        always: terms in every structure.
        rules: which structures are allowed, over `names`; all, if not given.
        log_prior: of a structure by its number of optional terms, as of `log_prior_by_size`; all structures alike, if not given.
        top: how many of the best structures to keep.
        threads: how many blocks at once; as many as there are cores, if not given.

    Raises:
        InputError: terms that the data cannot separate, too few data, too many terms, or rules that no structure keeps.
        NumericalError: a structure that leaves no noise, or numbers out of range.
    """
    candidates = check_candidates(stats, names, always)
    free = candidates.free
    evidence_of(stats, prior, range(len(candidates.names)))  # of all structures this one leaves the least noise
    problem, best = make_problem(stats, prior, candidates.sure, free, log_prior), Best(top)
    fixed = max(len(free) - BLOCK_LEVELS, 0)
    outer = SubsetElimination(len(free) + 1, fixed, 1)
    matrix, determinant = outer.eliminate(
        problem.matrix[..., None], np.array([problem.start]), *_parts(problem, slice(fixed))
    )
    lane_terms = spread(np.arange(2**fixed), free[:fixed]) | candidates.certain
    block = LaneBlock(
        problem.shape,
        *_parts(problem, slice(fixed, None)),
        problem.log_prior,
        None if rules is None else conditions(rules, lane_terms, free[fixed:]),
        fixed,
    )
    lanes = min(BLOCK_LANES, 2**fixed)
    sums = empty_sums(len(free) - fixed, 2**fixed, 2**fixed // lanes)

    def add(firsts: Iterable[int], negligible: float = -np.inf) -> None:
        tree = SubsetElimination(len(free) - fixed + 1, len(free) - fixed, lanes)
        for first in firsts:
            add_block(block, tree, matrix, determinant, first, negligible, sums, best)

    *others, last = range(0, 2**fixed, lanes)
    add([last])
    floor = float(sums.peak[last]) - NEGLIGIBLE_DEFICIT - len(free) * np.log(2)
    _share(lambda firsts: add(firsts, floor), others, threads)
    if not sums.allowed.any():
        raise no_structure()
    return SubsetPosterior(**_collect(candidates, problem, outer, sums.rescaled(), best))


def _by_turns(shapes: list[tuple[int, ...]]) -> list[np.ndarray]:
    """Return the arrays of which every second one lies in the same memory, so that what is in use stays in cache."""
    sizes = [int(np.prod(shape)) for shape in shapes]
    pair = [np.empty(max(sizes[turn::2], default=0)) for turn in (0, 1)]
    return [pair[i % 2][:size].reshape(shape) for i, (size, shape) in enumerate(zip(sizes, shapes, strict=True))]


def _halves(lanes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Views of the lanes without the last term, and of those with it."""
    half = lanes.shape[-1] // 2
    return lanes[..., :half], lanes[..., half:]


def _scores(
    block: LaneBlock, corner: Float[np.ndarray, "m lanes"], determinant: Float[np.ndarray, "m lanes"]
) -> tuple[Float[np.ndarray, "m lanes"], Float[np.ndarray, "m lanes"]]:
    """-a log(corner) - 1/2 log(determinant), over the latter, and an array as large to be written over."""
    free = np.empty_like(corner)
    np.log(determinant, out=determinant)
    determinant *= -0.5
    np.log(corner, out=free)
    free *= block.shape
    determinant -= free
    return determinant, free


def _collect(
    candidates: Candidates, problem: Problem, outer: SubsetElimination, sums: LaneSums, best: Best
) -> dict[str, Any]:
    """Put the sums of all lanes together."""
    sure, free = candidates.sure, candidates.free
    log_total = problem.constant + float(sums.peak[0] + np.log(sums.weight.sum()))
    scores, codes = best.ranked()
    log_prior = 0.0 if problem.log_prior is None else problem.log_prior[np.bitwise_count(codes)]
    joint = np.ones((len(candidates.names),) * 2)
    joint[np.ix_(free, free)] = together = sums.joint()
    joint[np.ix_(sure, free)] = np.diag(together)
    joint[np.ix_(free, sure)] = np.diag(together)[:, None]
    return dict(
        names=candidates.names,
        structures=spread(codes, free) | candidates.certain,
        log_evidence=problem.constant + scores - log_prior,
        probability=np.exp(problem.constant + scores - log_total),
        count=int(sums.allowed.sum()),
        inclusion=np.diag(joint).copy(),
        joint=joint,
        **_averages(problem, outer, sums, np.argsort([*sure, *free]))._asdict(),
    )


def _averages(problem: Problem, outer: SubsetElimination, sums: LaneSums, order: np.ndarray) -> Averages:
    """Return the moments of the coefficients from those of the lanes, in the order of the library."""
    moment = outer.gather_moments(sums.moment)[..., 0]
    spread, corner = outer.gather_spreads(sums.spread, sums.corner)
    result = averages(problem, moment, spread[..., 0], float(corner[0]))
    square = np.ix_(order, order)
    return Averages(result.mean[order], result.within[square], result.between[square])


def _parts(problem: Problem, terms: slice) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Return the pivots and squares of some terms."""
    return (
        None if problem.pivots is None else problem.pivots[terms],
        None if problem.squares is None else problem.squares[terms],
    )


def _share(work: Callable[[Iterable[int]], None], firsts: list[int], threads: int | None) -> None:
    """Let several threads take blocks from one list."""
    count, queue = min(threads or cores(), len(firsts)), iter(firsts)
    if count < 2:
        work(queue)
        return
    with ThreadPoolExecutor(count) as pool:
        for done in [pool.submit(work, queue) for _ in range(count)]:
            done.result()


def _top(scores: np.ndarray, most: int) -> np.ndarray:
    """Return where the highest are, in any order."""
    if scores.size <= most:
        return np.arange(scores.size)
    return np.argpartition(scores, scores.size - most)[scores.size - most :]
