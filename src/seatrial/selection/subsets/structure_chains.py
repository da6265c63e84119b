"""Markov chains over structures, all in step, each with its matrix swept on the terms that are there.

    sweep on p:  W_ij -= W_ip W_pj / W_pp,  W_pj /= |W_pp|,  W_pp <- -1 / W_pp     a second sweep undoes the first

After sweeps on S the corner of W is 2 b_S, its last column the posterior means and its block S minus the inverse of A_S, and the
product of pivots is |A_S| (Goodnight, The American Statistician 33, 1979). The settings of a few terms, the others as they are, need
those rows only. One move draws from all 2^3 settings of three units at once (units: terms that rules keep together), which has
adding, deleting and swapping in it and is never refused: Gibbs sampling in blocks. Which three is drawn without a look at the state,
half the time among partners: alike regressors, or terms that share a rule.

Many rows and little noise part the structures by hundreds of nats, and single chains stay where they start. So each chain is the cold
end of a ladder: the rungs see the evidence to the power beta = 1, 0.6, 0.4, … down to where all structures are nearly alike, and
neighbours exchange their places (parallel tempering: Geyer 1991). What is averaged is seen on the cold rungs alone.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, UInt64

from seatrial.selection.rule_masks import RuleMasks
from seatrial.selection.subsets.problem import Problem

MOVE_UNITS = 3  # Units in a move
REFRESH_MOVES = 200  # Moves after which the matrices are made anew, so that rounding does not add up
RUNG_RATIO = 1.6  # Ratio of beta between neighbours
HOTTEST_SPREAD = 10.0  # Nats between the worst structure and the best, on the hottest rung
_ONE = np.uint64(1)


class Units(NamedTuple):
    """What moves: terms that rules keep together, or single terms. The last unit is nobody, for moves of fewer.

    Attributes:
        members: columns of each, -1 if there are no more, shape (u+1, m).
        mask: structure of its terms, shape (u+1,).
        partner: cumulative probabilities of a partner for each of the u units, shape (u, u+1).
        with_wanted: structure of each and all that it wants, shape (u,).
    """

    members: Int[np.ndarray, "u1 m"]
    mask: UInt64[np.ndarray, " u1"]
    partner: Float[np.ndarray, "u u1"]
    with_wanted: UInt64[np.ndarray, " u"]


class Move(NamedTuple):
    """What one move of all walkers saw.

    Attributes:
        units: drawn on the cold rungs, shape (chains, 3).
        chance: probability that each is there given the rest, shape (chains, 3).
        codes: structures it chose from, shape (8, walkers), those of the other rungs included.
        scores: their log P(S) p(y | S), -inf where the rules forbid them, shape (8, walkers).
    """

    units: Int[np.ndarray, "chains 3"]
    chance: Float[np.ndarray, "chains 3"]
    codes: UInt64[np.ndarray, "8 walkers"]
    scores: Float[np.ndarray, "8 walkers"]


class Chains:
    """The state of the walkers, one on each rung of the ladder of each chain.

    Attributes:
        codes: structure of each walker, bit i for term i, with the terms that are always there, shape (walkers,).
        matrix: swept on the optional terms that are there, shape (walkers, k+1, k+1).
        places: walker on each rung of each ladder, the cold rung first, shape (chains, rungs).
    """

    def __init__(
        self,
        problem: Problem,
        units: Units,
        free: list[int],
        rules: RuleMasks,
        codes: UInt64[np.ndarray, " walkers"],
        chains: int,
        random: np.random.Generator,
    ):
        """Start at allowed structures, as many for each chain as it has rungs."""
        self._problem, self._units, self._rules, self._random = problem, units, rules, random
        self._free = np.asarray(free, np.uint64)
        k = len(free)
        self._log_pivots = None if problem.pivots is None else np.log(problem.pivots)
        self._squares = np.zeros(k) if problem.squares is None else problem.squares
        self._at = np.arange(codes.size)
        self._optional = np.bitwise_or.reduce(_ONE << self._free)
        self._first = units.mask & (~units.mask + _ONE)
        self.codes = codes
        self.places = random.permutation(codes.size).reshape(chains, -1)
        self._beta = RUNG_RATIO ** -np.arange(float(self.places.shape[1]))
        self._moved = 0
        self.refresh()

    @property
    def cold(self) -> Int[np.ndarray, " chains"]:
        """Walkers that see the evidence as it is."""
        return self.places[:, 0]

    def present(self) -> Bool[np.ndarray, "walkers k"]:
        """Return which optional terms are there."""
        return (self.codes[:, None] >> self._free & _ONE).astype(bool)

    def refresh(self) -> None:
        """Make the matrices from scratch."""
        base, is_present = self._problem.matrix, self.present()
        self.matrix = np.repeat(base[None], self.codes.size, 0)
        self._log_determinant = np.full(self.codes.size, np.log(self._problem.start))
        for column in range(is_present.shape[1]):
            self._sweep(np.flatnonzero(is_present[:, column]), column)

    def move(self) -> Move:
        """Let every walker make one move, then exchange rungs."""
        units = self._pick()
        columns = self._units.members[units].reshape(self.codes.size, -1)
        codes, scores = self._settings(units, columns)
        beta = np.empty(self.codes.size)
        beta[self.places] = self._beta
        weight = np.exp(beta * (scores - scores.max(0)))
        weight /= weight.sum(0)
        chosen = (np.cumsum(weight, 0) < self._random.random(self.codes.size)).sum(0).clip(max=len(weight) - 1)
        chance = ((codes[:, :, None] & self._first[units] != 0) * weight[:, :, None]).sum(0)
        changed = self.codes ^ codes[chosen, self._at]
        for slot in range(columns.shape[1]):
            column = columns[:, slot]
            flips = (column >= 0) & (changed >> self._free[column] & _ONE == _ONE)
            # units drawn twice were made nobody, so that no column is swept twice
            self._sweep(np.flatnonzero(flips), column[flips])
        self.codes = self.codes ^ changed
        seen = Move(units[self.cold], chance[self.cold], codes, scores)
        self._exchange(scores[chosen, self._at])
        return seen

    def _exchange(self, scores: Float[np.ndarray, " walkers"]) -> None:
        """Let walkers on neighbouring rungs change places, every other pair of them at a time."""
        lower = np.arange(self._moved % 2, self._beta.size - 1, 2)
        self._moved += 1
        if not lower.size:
            return
        colder, hotter = self.places[:, lower], self.places[:, lower + 1]
        gain = (self._beta[lower] - self._beta[lower + 1]) * (scores[hotter] - scores[colder])
        swap = np.log(self._random.random(gain.shape)) < gain
        self.places[:, lower] = np.where(swap, hotter, colder)
        self.places[:, lower + 1] = np.where(swap, colder, hotter)

    def _pick(self) -> Int[np.ndarray, "chains 3"]:
        """Return three different units for each chain, or fewer and nobody."""
        nobody = self._units.mask.size - 1
        units = np.empty((self.codes.size, MOVE_UNITS), int)
        units[:, 0] = self._random.integers(nobody, size=self.codes.size)
        cumulative = self._units.partner[units[:, 0]]
        for slot in range(1, MOVE_UNITS):
            drawn = (cumulative < self._random.random((self.codes.size, 1))).sum(1).clip(max=nobody)
            again = (units[:, :slot] == drawn[:, None]).any(1)
            units[:, slot] = np.where(again, nobody, drawn)
        return units

    def _settings(self, units: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the structures and scores of all settings of some units, by sweeps on their own rows in the order of a Gray code."""
        problem, n_members = self._problem, self._units.members.shape[1]
        inner = np.concatenate([columns, np.full((columns.shape[0], 1), problem.matrix.shape[0] - 1)], 1).T
        small = self.matrix[self._at, inner[:, None], inner[None, :]]  # chains last, so that arithmetic runs along them
        if columns.min() < 0:
            real = inner >= 0
            small = np.where(real[:, None] & real[None, :], small, np.eye(len(inner))[:, :, None])
        squares = np.where(columns >= 0, self._squares[columns], 0.0).T
        pivots = None if self._log_pivots is None else np.where(columns >= 0, self._log_pivots[columns], 0.0).T
        masks = self._units.mask[units]
        codes, corners, determinants = [self.codes], [small[-1, -1].copy()], [self._log_determinant]
        for setting in range(1, 2**MOVE_UNITS):
            unit = (setting & -setting).bit_length() - 1
            determinant = determinants[-1]
            for slot in range(unit * n_members, (unit + 1) * n_members):
                determinant = determinant + _sweep_all(small, slot, None if pivots is None else pivots[slot])
                small[-1, -1] += np.where(small[slot, slot] < 0, squares[slot], -squares[slot])
            codes.append(codes[-1] ^ masks[:, unit])
            corners.append(small[-1, -1].copy())
            determinants.append(determinant)
        scores = problem.constant - problem.shape * np.log(np.array(corners)) - 0.5 * np.array(determinants)
        result = np.array(codes)
        if problem.log_prior is not None:
            scores += problem.log_prior[np.bitwise_count(result & self._optional)]
        return result, np.where(self._rules.allowed(result), scores, -np.inf)

    def _sweep(self, which: np.ndarray, columns: np.ndarray | int) -> None:
        """Sweep the matrices of some chains on one column each."""
        if which.size:
            part, columns = self.matrix[which], np.broadcast_to(columns, which.shape)
            pivots = None if self._log_pivots is None else self._log_pivots[columns]
            self._log_determinant[which] += _sweep(part, columns, pivots, self._squares[columns])
            self.matrix[which] = part


def make_units(rules: RuleMasks, free: list[int], problem: Problem, n_terms: int) -> Units:
    """Put together what the rules keep together, and say who is whose partner.

    Args:
        rules: over all terms.
        free: numbers of the optional terms.
        problem: of these terms.
        n_terms: number of all terms.
    """
    links = rules.links(n_terms)
    closed = [links.decided(1 << i)[0] for i in range(n_terms)]
    together = {i: tuple(j for j in free if closed[i] >> j & 1 and closed[j] >> i & 1) for i in free}
    groups = list(dict.fromkeys(together.values()))
    longest = max(map(len, groups))
    place = {term: column for column, term in enumerate(free)}
    members = np.full((len(groups) + 1, longest), -1)
    for u, group in enumerate(groups):
        members[u, : len(group)] = [place[term] for term in group]
    mask = [sum(1 << i for i in group) for group in groups]
    whole = [links.decided(one)[0] for one in mask]
    shared = np.array(
        [[bool(whole[u] & mask[v] or whole[v] & mask[u]) for v in range(len(mask))] for u in range(len(mask))]
    )
    shared |= np.array([[any(links.rivals[i] & other for i in group) for other in mask] for group in groups])
    return Units(
        members,
        np.array([*mask, 0], np.uint64),
        _partners(_alike(problem, members[:-1]), shared),
        np.array(whole, np.uint64),
    )


def rungs_between(least: float, most: float) -> int:
    """Return the rungs of a ladder for structures whose log evidences lie this far apart."""
    return 1 + max(int(np.ceil(np.log((most - least) / HOTTEST_SPREAD) / np.log(RUNG_RATIO))), 0) if most > least else 1


def some_starts(
    units: Units, certain: int, rules: RuleMasks, walkers: int, random: np.random.Generator
) -> UInt64[np.ndarray, " walkers"]:
    """Allowed structures to start from: the smallest one, as many terms as the rules bear, and shares between.

    Args:
        units: what moves.
        certain: the smallest structure, as a bit mask.
        rules: over all terms.
        walkers: number of starts.
        random: generator.
    """
    starts = np.full(walkers, certain, np.uint64)
    share = np.linspace(0.0, 1.0, walkers)
    for u in random.permutation(units.with_wanted.size):
        bigger = starts | units.with_wanted[u]
        take = rules.allowed(bigger) & (random.random(walkers) < share)
        starts = np.where(take, bigger, starts)
    return starts


def _alike(problem: Problem, members: np.ndarray) -> Float[np.ndarray, "u u"]:
    """Return the squared cosines between regressors, the largest between the members of each two units."""
    diagonal = np.diag(problem.matrix)[:-1]
    square = problem.matrix[:-1, :-1] ** 2 / np.outer(diagonal, diagonal)
    padded = np.pad(square, ((0, 1), (0, 1)))[members[:, None, :, None], members[None, :, None, :]]
    return padded.max((2, 3))


def _partners(alike: Float[np.ndarray, "u u"], shared: Bool[np.ndarray, "u u"]) -> Float[np.ndarray, "u u1"]:
    """Return the cumulative probabilities: half of the draws any unit alike, half by resemblance and rules."""
    count = alike.shape[0]
    if count == 1:
        return np.array([[0.0, 1.0]])
    others = 1.0 - np.eye(count)
    kinship = np.maximum(alike, shared) * others + 1e-9 * others
    chance = 0.5 * others / (count - 1) + 0.5 * kinship / kinship.sum(1, keepdims=True)
    return np.cumsum(np.pad(chance, ((0, 0), (0, 1))), 1)


def _sweep(
    matrix: Float[np.ndarray, "n q q"],
    columns: np.ndarray | int,
    log_pivots: Float[np.ndarray, " n"] | None,
    squares: Float[np.ndarray, " n"],
) -> Float[np.ndarray, " n"]:
    """Sweep each matrix in place on its column, and say what that adds to the log determinant."""
    at = np.arange(matrix.shape[0])
    row = matrix[at, columns]
    pivot = row[at, columns]
    matrix -= row[:, :, None] * (row / pivot[:, None])[:, None, :]
    row = row / np.abs(pivot)[:, None]
    row[at, columns] = -1 / pivot
    matrix[at, columns] = row
    matrix[at, :, columns] = row
    sign = np.sign(pivot)
    matrix[:, -1, -1] += sign * squares
    return np.log(np.abs(pivot)) if log_pivots is None else sign * log_pivots


def _sweep_all(
    matrix: Float[np.ndarray, "q q n"], column: int, log_pivots: Float[np.ndarray, " n"] | None
) -> Float[np.ndarray, " n"]:
    """Return the same for one column of all matrices, which come last here; what terms add to the corner is left to the caller."""
    row = matrix[column].copy()
    pivot = row[column].copy()
    size = np.abs(pivot)
    matrix -= row[:, None] * (row / pivot)
    row /= size
    row[column] = -1 / pivot
    matrix[column] = row
    matrix[:, column] = row
    return np.log(size) if log_pivots is None else np.where(pivot > 0, log_pivots, -log_pivots)
