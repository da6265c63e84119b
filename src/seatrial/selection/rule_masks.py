"""Rules over structures as bit masks: which structures they allow, and how many these are.

A structure is an integer S whose bit i says that term i is there. It is allowed if

    parents[i] & ~S == 0 for every i in S,   S & group in (0, group),   popcount(S & some) <= 1
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, UInt64

from seatrial.core.errors import InputError

# Terms at most: bit 63 of an unsigned integer of 64 bits stands for what no structure has, see `conditions`.
MAX_TERMS = 63
_ONE = np.uint64(1)


class Links(NamedTuple):
    """Rules as clauses of two terms each, by bit masks, an entry for each term.

    Attributes:
        required: the others that must be there with it, without those that these require in turn.
        wanting: the others that must be absent without it.
        rivals: those that must be absent with it.
    """

    required: list[int]
    wanting: list[int]
    rivals: list[int]

    def decided(self, present: int = 0, absent: int = 0, among: int = -1) -> tuple[int, int]:
        """Return all terms that are there, and all that are absent, once some are: both hold a term if the rules contradict that.

        Args:
            present: terms that are there, as a bit mask.
            absent: terms that are not.
            among: terms that may follow.
        """
        before = -1
        while before != present | absent:
            before = present | absent
            for i in _bit_numbers(present):
                present, absent = present | self.required[i] & among, absent | self.rivals[i] & among
            for i in _bit_numbers(absent):
                absent |= self.wanting[i] & among
        return present, absent


@dataclass(frozen=True)
class RuleMasks:
    """Rules over terms by number.

    Attributes:
        parents: for each term, the terms that must be there if it is, as a bit mask; shorter where the last have none.
        groups: bit masks of terms of which all are there or none.
        exclusive: bit masks of terms of which at most one is there.
    """

    parents: tuple[int, ...] = ()
    groups: tuple[int, ...] = ()
    exclusive: tuple[int, ...] = ()

    @cached_property
    def n_terms(self) -> int:
        """Number of the last term that a rule is about, counted from 1."""
        masks = (*self.parents, *self.groups, *self.exclusive)
        return max([len(self.parents), *(mask.bit_length() for mask in masks)])

    def links(self, n_terms: int) -> Links:
        """Return the clauses of `n_terms` terms."""
        required, rivals = [*self.parents, *[0] * (n_terms - len(self.parents))], [0] * n_terms
        for group in self.groups:
            required = [mask | group if group >> i & 1 else mask for i, mask in enumerate(required)]
        for some in self.exclusive:
            rivals = [mask | some if some >> i & 1 else mask for i, mask in enumerate(rivals)]
        required, rivals = ([mask & ~(1 << i) for i, mask in enumerate(masks)] for masks in (required, rivals))
        wanting = [sum(1 << i for i in range(n_terms) if required[i] >> j & 1) for j in range(n_terms)]
        return Links(required, wanting, rivals)

    def allowed(self, structures: UInt64[np.ndarray, "*n"]) -> Bool[np.ndarray, "*n"]:
        """Return whether the rules allow each structure."""
        term, required, exclusive = self._arrays
        structures = np.asarray(structures, np.uint64)
        if not term.size and not exclusive.size:
            return np.ones(structures.shape, bool)
        structures = structures[..., None]
        kept = ((structures >> term & _ONE == 0) | (~structures & required == 0)).all(-1)
        return kept & (np.bitwise_count(structures & exclusive) <= 1).all(-1)

    @cached_property
    def _arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Terms that require others, what they require, and the sets of rivals: samplers ask at every move."""
        required = self.links(self.n_terms).required
        return (
            np.array([i for i, mask in enumerate(required) if mask], np.uint64),
            np.array([mask for mask in required if mask], np.uint64),
            np.array(self.exclusive, np.uint64),
        )


class Conditions(NamedTuple):
    """What the rules ask of the free bits, for each setting of the others (a lane).

    Attributes:
        free: the free bits' settings, as structures, shape (m,).
        among: whether each keeps the rules among free bits, shape (m,).
        care: bits that a lane asks about, shape (lanes,).
        need: which of these it wants set, shape (lanes,); a lane that breaks the rules by itself wants what cannot be.
    """

    free: UInt64[np.ndarray, " m"]
    among: Bool[np.ndarray, " m"]
    care: UInt64[np.ndarray, " lanes"]
    need: UInt64[np.ndarray, " lanes"]

    def forbidden(self, lanes: slice) -> Bool[np.ndarray, "m lanes"]:
        """Return which structures of some lanes break the rules."""
        kept = (self.free[:, None] & self.care[lanes]) == self.need[lanes]
        kept &= self.among[:, None]
        return ~kept


def conditions(rules: RuleMasks, fixed: UInt64[np.ndarray, " lanes"], free: Sequence[int]) -> Conditions:
    """Return what the rules ask of some terms once all others are decided.

    Then the rules ask of the free terms only that some be there and some not, beside what they ask among themselves: one masked
    comparison decides for all settings of these.

    Args:
        rules: over all terms.
        fixed: the other terms that are there, as structures, shape (lanes,).
        free: numbers of the free terms.

    Returns:
        The conditions of every lane.
    """
    values, mask = spread(np.arange(2 ** len(free)), free), sum(1 << term for term in free)
    among, valid = np.ones(values.shape, bool), np.ones(fixed.shape, bool)
    need, forbid = np.zeros_like(fixed), np.zeros_like(fixed)
    for term, required in enumerate(rules.links(rules.n_terms).required):
        inside, outside = required & mask, required & ~mask
        if mask >> term & 1:
            among &= ~_has(values, term) | _covers(values, inside)
            forbid |= np.where(_covers(fixed, outside), np.uint64(0), np.uint64(1 << term))
        else:
            is_present = _has(fixed, term)
            need |= np.where(is_present, np.uint64(inside), np.uint64(0))
            valid &= ~is_present | _covers(fixed, outside)
    for some in rules.exclusive:
        among &= np.bitwise_count(values & np.uint64(some)) <= 1
        count = np.bitwise_count(fixed & np.uint64(some))
        valid &= count <= 1
        forbid |= np.where(count == 1, np.uint64(some & mask), np.uint64(0))
    valid &= need & forbid == 0
    # no free term has this bit, so a lane that wants it matches nothing
    impossible = np.uint64(1 << MAX_TERMS)
    return Conditions(values, among, need | forbid, np.where(valid, need, impossible))


def count_allowed(rules: RuleMasks, sure: Sequence[int], n_terms: int) -> int:
    """Count the allowed structures, exactly; nothing is enumerated.

    Rules are implications (a term requires others) and rivalries: clauses of two literals. Deciding one term decides what follows
    from it; terms that share no rule count by themselves. The branching goes on until no rule is left among undecided terms
    (Bayardo and Pehoushek, AAAI 2000).

    Args:
        rules: over all terms.
        sure: numbers of terms in every structure.
        n_terms: number of all terms.
    """
    links = rules.links(n_terms)

    def decide(open_: int, start: int, present: bool) -> int:
        """Return what remains once some terms are there, or absent, with all that follows."""
        with_it, absent = links.decided(*((start, 0) if present else (0, start)), open_)
        if with_it & absent:
            return 0
        return total(open_ & ~(with_it | absent))

    @lru_cache(maxsize=2**16)
    def total(open_: int) -> int:
        linked = {i: (links.required[i] | links.wanting[i] | links.rivals[i]) & open_ for i in _bit_numbers(open_)}
        pivot = max(linked, key=lambda i: linked[i].bit_count(), default=-1)
        if pivot < 0 or not linked[pivot]:
            return 2 ** open_.bit_count()
        part, size = 1 << pivot, 0
        while size != part:
            size = part
            for i in _bit_numbers(part):
                part |= linked[i]
        return total(open_ & ~part) * sum(decide(part, 1 << pivot, present) for present in (True, False))

    return decide((1 << n_terms) - 1, sum(1 << i for i in sure), True)


def no_structure() -> InputError:
    """Return what to raise where no structure keeps all rules."""
    return InputError(
        "rules of the structures",
        found="no structure that keeps them all",
        expected="at least one",
        remedy="look for an exclusion between a term and one that it requires, or between terms of `always`",
    )


def spread(codes: np.ndarray, terms: Sequence[int]) -> UInt64[np.ndarray, "*n"]:
    """Return the structures of codes whose bit j stands for `terms[j]`."""
    codes = np.asarray(codes, np.uint64)
    structures = np.zeros_like(codes)
    for j, term in enumerate(terms):
        structures |= ((codes >> np.uint64(j)) & _ONE) << np.uint64(term)
    return structures


def bits(codes: np.ndarray, n_bits: int) -> Float[np.ndarray, "n_bits m"]:
    """Return whether each of the first bits of each code is set, 0 or 1."""
    return (np.asarray(codes, np.uint64) >> np.arange(n_bits, dtype=np.uint64)[:, None] & _ONE).astype(float)


def _bit_numbers(mask: int) -> list[int]:
    return [i for i in range(mask.bit_length()) if mask >> i & 1]


def _has(structures: UInt64[np.ndarray, "*n"], term: int) -> Bool[np.ndarray, "*n"]:
    return (structures >> np.uint64(term)) & _ONE == _ONE


def _covers(structures: UInt64[np.ndarray, "*n"], required: int) -> Bool[np.ndarray, "*n"]:
    return ~structures & np.uint64(required) == 0
