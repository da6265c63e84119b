"""What Markov chains over structures see on their way: visits, probabilities, coefficients, and every structure evaluated.

All but the last is seen on the cold rungs of the chains' ladders.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, UInt64

from seatrial.selection.subsets.structure_chains import REFRESH, Chains

EVERY = 5
"""Moves between two looks at the coefficients."""


class Sums(NamedTuple):
    """Weighted sums over structures, of k optional terms, in scaled columns.

    Attributes:
        pairs: weight of both of each two terms, shape (k, k).
        moment: sum of w z z^T, z the posterior means and -1, shape (k+1, k+1).
        spread: sum of w corner A_S^-1, shape (k, k).
        corner: sum of w corner, shape (1,).
    """

    pairs: np.ndarray
    moment: np.ndarray
    spread: np.ndarray
    corner: np.ndarray


class Seen(NamedTuple):
    """What the chains saw after warm-up, of k optional terms in u units.

    Attributes:
        presence: visits with each term, for each half of each chain, shape (2, chains, k).
        chance: sum of each unit's probability of being there given the rest, shape (chains, u+1).
        draws: moves that drew each unit, shape (chains, u+1).
        mean: sum of posterior means, scaled, shape (chains, k).
        sums: over the looks.
        inside: visits in the second half to structures evaluated before it, shape (chains,).
    """

    presence: np.ndarray
    chance: np.ndarray
    draws: np.ndarray
    mean: np.ndarray
    sums: Sums
    inside: np.ndarray


class Evaluated(NamedTuple):
    """Different structures, in order of number, and their log P(S) p(y | S)."""

    codes: UInt64[np.ndarray, " n"]
    scores: Float[np.ndarray, " n"]


def walk(walkers: Chains, n_units: int, moves: int) -> tuple[Seen, Evaluated, Evaluated]:
    """Let the chains walk, and give what they saw, what was evaluated in the first half, and what in all."""
    chains, k = walkers.cold.size, walkers.matrix.shape[1] - 1
    warmup = moves // 4
    half = half_of(moves)
    seen = Seen(
        presence=np.zeros((2, chains, k)),
        chance=np.zeros((chains, n_units)),
        draws=np.zeros((chains, n_units)),
        mean=np.zeros((chains, k)),
        sums=Sums(np.zeros((k, k)), np.zeros((k + 1, k + 1)), np.zeros((k, k)), np.zeros(1)),
        inside=np.zeros(chains),
    )
    found, fresh = Evaluated(np.empty(0, np.uint64), np.empty(0)), []
    before, at = found, np.arange(chains)[:, None]
    visits = []
    for now in range(moves):
        move = walkers.move()
        fresh.append((move.codes, move.scores))
        if now == half - 1 or now == moves - 1 or (now + 1) % REFRESH == 0:
            walkers.refresh()
            found, fresh = _merge(found, fresh), []
        if now == half - 1:
            before = found
        if now < warmup:
            continue
        cold = walkers.cold
        there = walkers.present()[cold].astype(float)
        seen.presence[int(now >= half)] += there
        seen.chance[at, move.units] += move.chance
        seen.draws[at, move.units] += 1
        if now >= half:
            visits.append(walkers.codes[cold])
        if now % EVERY == 0:
            _look(walkers, there, seen)
    seen.inside[:] = np.isin(np.array(visits), before.codes).sum(0)
    return seen, before, found


def sums_over(
    matrix: Float[np.ndarray, "n k1 k1"], there: Float[np.ndarray, "n k"], weight: Float[np.ndarray, " n"]
) -> Sums:
    """Sums over structures whose swept matrices and terms are given."""
    z = np.column_stack([matrix[:, :-1, -1] * there, np.full(weight.size, -1.0)])
    corner = weight * matrix[:, -1, -1]
    covariance = matrix[:, :-1, :-1] * there[:, :, None] * there[:, None, :]
    return Sums(
        (weight * there.T) @ there, (weight * z.T) @ z, -np.tensordot(corner, covariance, 1), np.array([corner.sum()])
    )


def _look(walkers: Chains, there: np.ndarray, seen: Seen) -> None:
    """Add the coefficients where the chains are."""
    matrix = walkers.matrix[walkers.cold]
    seen.mean[:] += matrix[:, :-1, -1] * there
    for total, part in zip(seen.sums, sums_over(matrix, there, np.ones(len(there))), strict=True):
        total[:] += part


def _merge(found: Evaluated, fresh: list[tuple[np.ndarray, np.ndarray]]) -> Evaluated:
    """Add structures, each once and only if it is allowed."""
    codes = np.concatenate([found.codes, *(codes.ravel() for codes, _ in fresh)])
    scores = np.concatenate([found.scores, *(scores.ravel() for _, scores in fresh)])
    kept = scores > -np.inf
    codes, first = np.unique(codes[kept], return_index=True)
    return Evaluated(codes, scores[kept][first])


def share_inside(inside: Float[np.ndarray, " chains"], moves: int) -> tuple[float, float]:
    """Log of the share of visits in the structures known before, and its standard error."""
    visits = moves - half_of(moves)
    share = inside / visits
    # no visit outside says only that there are fewer than about one in all visits
    least = 1.0 / (visits * inside.size)
    value = max(float(share.mean()), least)
    return float(np.log(value)), float(np.hypot(share.std(ddof=1) / np.sqrt(inside.size), least) / value)


def half_of(moves: int) -> int:
    """Move at which the second half after warm-up begins."""
    return (moves + moves // 4) // 2


def presence_r_hat(presence: Float[np.ndarray, "2 chains k"], moves: int) -> Float[np.ndarray, " k"]:
    """R-hat of numbers that are 0 or 1, between the halves of all chains; 1 where nothing ever changed."""
    length = np.array([half_of(moves) - moves // 4, moves - half_of(moves)])[:, None, None]
    means = (presence / length).reshape(-1, presence.shape[2])
    within, between = (means * (1 - means)).mean(0), means.var(0, ddof=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(between > 0, np.sqrt(1 + between / within), 1.0)
