"""Which structures are allowed, by bit tests: parents that must be present, groups all or none, at most one of some.

A structure is a number whose bit i says that term i is there. Once some bits are fixed, the rules ask of the others only that
some be set and some not, beside what they ask among themselves: one masked comparison decides for all values of those.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, UInt64

from seatrial.core.errors import InputError

MOST_TERMS = 63
_ONE = np.uint64(1)


@dataclass(frozen=True)
class Rules:
    """Rules over the terms of a library, in its order.

    Attributes:
        parents: for each term, the terms that must be there if it is, as a bitmask; shorter where the last have none.
        groups: bitmasks of terms of which all are there or none.
        exclusive: bitmasks of terms of which at most one is there.
    """

    parents: tuple[int, ...] = ()
    groups: tuple[int, ...] = ()
    exclusive: tuple[int, ...] = ()

    def allowed(self, structures: UInt64[np.ndarray, "*n"]) -> Bool[np.ndarray, "*n"]:
        """Whether each structure keeps the rules."""
        structures = np.asarray(structures, np.uint64)
        kept = np.ones(structures.shape, bool)
        for term, wanted in enumerate(self.parents):
            kept &= ~_has(structures, term) | _covers(structures, wanted)
        for group in self.groups:
            kept &= (structures & np.uint64(group) == 0) | _covers(structures, group)
        for some in self.exclusive:
            kept &= np.bitwise_count(structures & np.uint64(some)) <= 1
        return kept


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
        """Which structures of some lanes break the rules."""
        kept = (self.free[:, None] & self.care[lanes]) == self.need[lanes]
        kept &= self.among[:, None]
        return ~kept


def conditions(rules: Rules, fixed: UInt64[np.ndarray, " lanes"], free: Sequence[int]) -> Conditions:
    """What the rules ask of the terms `free` when of the other terms those in `fixed` are there."""
    values, mask = spread(np.arange(2 ** len(free)), free), sum(1 << term for term in free)
    among, valid = np.ones(values.shape, bool), np.ones(fixed.shape, bool)
    need, forbid = np.zeros_like(fixed), np.zeros_like(fixed)
    for term, wanted in _wants(rules):
        inside, outside = wanted & mask, wanted & ~mask
        if mask >> term & 1:
            among &= ~_has(values, term) | _covers(values, inside)
            forbid |= np.where(_covers(fixed, outside), np.uint64(0), np.uint64(1 << term))
        else:
            there = _has(fixed, term)
            need |= np.where(there, np.uint64(inside), np.uint64(0))
            valid &= ~there | _covers(fixed, outside)
    for some in rules.exclusive:
        among &= np.bitwise_count(values & np.uint64(some)) <= 1
        count = np.bitwise_count(fixed & np.uint64(some))
        valid &= count <= 1
        forbid |= np.where(count == 1, np.uint64(some & mask), np.uint64(0))
    valid &= need & forbid == 0
    impossible = np.uint64(1 << MOST_TERMS)
    return Conditions(values, among, need | forbid, np.where(valid, need, impossible))


def no_structure() -> InputError:
    """What to raise where no structure keeps all rules."""
    return InputError(
        "rules of the structures",
        found="no structure that keeps them all",
        expected="at least one",
        remedy="look for an exclusion between a term and one that it wants, or between terms that are always there",
    )


def check_rules(rules: Rules, n_terms: int) -> None:
    """Check that the rules speak of terms that exist.

    Raises:
        InputError: they do not.
    """
    highest = max([len(rules.parents), *(m.bit_length() for m in (*rules.parents, *rules.groups, *rules.exclusive))])
    if highest > n_terms:
        raise InputError(
            "rules of the structures",
            found=f"a rule about term number {highest}",
            expected=f"terms 1 to {n_terms}",
            remedy="write the rules over the same terms, in the same order",
        )


def spread(codes: np.ndarray, terms: Sequence[int]) -> UInt64[np.ndarray, "*n"]:
    """Structures of codes whose bit j stands for `terms[j]`."""
    codes = np.asarray(codes, np.uint64)
    structures = np.zeros_like(codes)
    for j, term in enumerate(terms):
        structures |= ((codes >> np.uint64(j)) & _ONE) << np.uint64(term)
    return structures


def bits(codes: np.ndarray, terms: int) -> Float[np.ndarray, "terms m"]:
    """Whether each of the first bits of each code is set, 0 or 1."""
    return (np.asarray(codes, np.uint64) >> np.arange(terms, dtype=np.uint64)[:, None] & _ONE).astype(float)


def _wants(rules: Rules) -> list[tuple[int, int]]:
    """Every term and the terms that it wants, those of its groups among them."""
    wants = dict(enumerate(rules.parents))
    for group in rules.groups:
        for term in range(group.bit_length()):
            if group >> term & 1:
                wants[term] = wants.get(term, 0) | group & ~(1 << term)
    return list(wants.items())


def _has(structures: UInt64[np.ndarray, "*n"], term: int) -> Bool[np.ndarray, "*n"]:
    return (structures >> np.uint64(term)) & _ONE == _ONE


def _covers(structures: UInt64[np.ndarray, "*n"], wanted: int) -> Bool[np.ndarray, "*n"]:
    return ~structures & np.uint64(wanted) == 0
