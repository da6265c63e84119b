"""Sums over all structures: a block of lanes at a time, each relative to its own best, put together at the end."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from seatrial.selection.subsets.best import Best
from seatrial.selection.subsets.doubling import Doubling
from seatrial.selection.subsets.rules import Conditions, bits


class Sums(NamedTuple):
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
        chance: their prior probability, given the lane, shape (lanes,).
    """

    peak: Float[np.ndarray, " lanes"]
    weight: Float[np.ndarray, " lanes"]
    corner: Float[np.ndarray, " lanes"]
    present: Float[np.ndarray, "r lanes"]
    pairs: Float[np.ndarray, "r r blocks"]
    moment: Float[np.ndarray, "r1 r1 lanes"]
    spread: Float[np.ndarray, "r r lanes"]
    allowed: Float[np.ndarray, " lanes"]
    chance: Float[np.ndarray, " lanes"]

    def rescaled(self) -> "Sums":
        """The same relative to the highest peak of all."""
        factor = np.exp(self.peak - self.peak.max())
        of_block = factor[:: factor.size // self.pairs.shape[2]]
        return self._replace(
            peak=np.full_like(self.peak, self.peak.max()),
            pairs=self.pairs * of_block,
            **{name: getattr(self, name) * factor for name in ("weight", "corner", "present", "moment", "spread")},
        )

    def joint(self) -> Float[np.ndarray, "k k"]:
        """Probability that both of each two terms are there; of sums already rescaled.

        The terms before those doubled within come first; their settings are the lanes.
        """
        there = bits(np.arange(self.weight.size), self.weight.size.bit_length() - 1)
        across = self.present @ there.T
        whole = np.block([[(there * self.weight) @ there.T, across.T], [across, self.pairs.sum(2)]])
        return whole / self.weight.sum()


class Block(NamedTuple):
    """What a block needs beside its lanes.

    Attributes:
        shape: a = a0 + n/2.
        pivots: of the terms doubled within, as in `Problem`, shape (r,).
        squares: likewise, shape (r,).
        chance: prior probability of each setting of these terms without rules, shape (2^r,).
        conditions: what the rules ask, if there are any.
        shift: number of terms before these.
    """

    shape: float
    pivots: Float[np.ndarray, " r"] | None
    squares: Float[np.ndarray, " r"] | None
    chance: Float[np.ndarray, " m"]
    conditions: Conditions | None
    shift: int


def no_sums(r: int, lanes: int, blocks: int) -> Sums:
    """Nothing summed yet, of r levels in lanes that are taken in blocks."""
    return Sums(
        peak=np.full(lanes, -np.inf),
        weight=np.zeros(lanes),
        corner=np.zeros(lanes),
        present=np.zeros((r, lanes)),
        pairs=np.zeros((r, r, blocks)),
        moment=np.zeros((r + 1, r + 1, lanes)),
        spread=np.zeros((r, r, lanes)),
        allowed=np.full(lanes, 2.0**r),
        chance=np.ones(lanes),
    )


def add_block(
    block: Block,
    tree: Doubling,
    matrix: Float[np.ndarray, "r1 r1 lanes"],
    determinant: Float[np.ndarray, " lanes"],
    first: int,
    negligible: float,
    sums: Sums,
    best: Best,
) -> None:
    """Double the last terms in a few lanes, from lane `first` on, and add up, unless the best score is below `negligible`."""
    r, width = len(tree.slopes), tree.determinants[0].size
    here = slice(first, first + width)
    corner, product = tree.eliminate(matrix[..., here], determinant[here], block.pivots, block.squares)
    corner = corner[0, 0].reshape(-1, width)
    score, weight = _scores(block, corner, product.reshape(corner.shape))
    if block.conditions is not None:
        forbidden = block.conditions.forbidden(here)
        score[forbidden] = -np.inf
        sums.allowed[here] = corner.shape[0] - forbidden.sum(0)
        sums.chance[here] = block.chance @ ~forbidden
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
    there = bits(np.arange(by_setting.size), r)
    sums.pairs[..., first // width] = (there * by_setting) @ there.T
    for term in reversed(range(r)):
        without, present = weight.reshape(2, -1, width)
        sums.present[term, here] = present.sum(0)
        weight = without + present
    sums.weight[here] = weight[0]


def _scores(
    block: Block, corner: Float[np.ndarray, "m lanes"], determinant: Float[np.ndarray, "m lanes"]
) -> tuple[Float[np.ndarray, "m lanes"], Float[np.ndarray, "m lanes"]]:
    """-a log(corner) - 1/2 log(determinant), over the latter, and an array as large to be written over."""
    free = np.empty_like(corner)
    np.log(determinant, out=determinant)
    determinant *= -0.5
    np.log(corner, out=free)
    free *= block.shape
    determinant -= free
    return determinant, free
