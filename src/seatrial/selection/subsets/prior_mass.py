"""How many structures the rules allow, and their prior probability in all, with nothing enumerated.

Rules are implications (a term wants others) and rivalries: clauses of two literals. Deciding one term decides what follows from it;
terms that share no rule count by themselves. The branching goes on until no rule is left among undecided terms.
"""

from collections.abc import Sequence
from functools import lru_cache

from seatrial.selection.subsets.rules import Rules


def wanted_by(rules: Rules, n_terms: int) -> list[int]:
    """For each term the others that must be there if it is, as a bitmask, direct ones only."""
    wants = [*rules.parents, *[0] * (n_terms - len(rules.parents))]
    for group in rules.groups:
        wants = [mask | group if group >> i & 1 else mask for i, mask in enumerate(wants)]
    return [mask & ~(1 << i) for i, mask in enumerate(wants)]


def rivals_of(rules: Rules, n_terms: int) -> list[int]:
    """For each term those that must be absent if it is there, as a bitmask."""
    rivals = [0] * n_terms
    for some in rules.exclusive:
        rivals = [mask | some if some >> i & 1 else mask for i, mask in enumerate(rivals)]
    return [mask & ~(1 << i) for i, mask in enumerate(rivals)]


def allowed_mass(rules: Rules, sure: Sequence[int], chance: Sequence[float]) -> tuple[int, float]:
    """Number of allowed structures, and the probability that independent draws of the terms make one.

    Args:
        rules: over all terms.
        sure: numbers of terms in every structure.
        chance: prior probability that each term is there, for all terms; not used for those of `sure`.
    """
    d = len(chance)
    wants, rivals = wanted_by(rules, d), rivals_of(rules, d)
    wanting = [sum(1 << i for i in range(d) if wants[i] >> j & 1) for j in range(d)]
    fixed = sum(1 << i for i in sure)

    def weigh(members: int, present: bool) -> float:
        value = 1.0
        for i in bit_numbers(members & ~fixed):
            value *= chance[i] if present else 1.0 - chance[i]
        return value

    def decide(open_: int, start: int, present: bool) -> tuple[int, float]:
        """What remains once some terms are there, or absent, with all that follows."""
        there, absent = (start, 0) if present else (0, start)
        size = None
        while size != there | absent:
            size = there | absent
            for i in bit_numbers(there):
                there, absent = there | wants[i] & open_, absent | rivals[i] & open_
            for i in bit_numbers(absent):
                absent |= wanting[i] & open_
        if there & absent:
            return 0, 0.0
        count, mass = total(open_ & ~(there | absent))
        return count, mass * weigh(there, True) * weigh(absent, False)

    @lru_cache(maxsize=2**16)
    def total(open_: int) -> tuple[int, float]:
        linked = {i: (wants[i] | wanting[i] | rivals[i]) & open_ for i in bit_numbers(open_)}
        pivot = max(linked, key=lambda i: linked[i].bit_count(), default=-1)
        if pivot < 0 or not linked[pivot]:
            return 2 ** open_.bit_count(), 1.0
        part, size = 1 << pivot, None
        while size != part:
            size = part
            for i in bit_numbers(part):
                part |= linked[i]
        with_it, without = (decide(part, 1 << pivot, present) for present in (True, False))
        count, mass = total(open_ & ~part)
        return count * (with_it[0] + without[0]), mass * (with_it[1] + without[1])

    return decide((1 << d) - 1, fixed, True)


def closure(wants: Sequence[int], start: int) -> int:
    """Terms with all that they want, and what these want."""
    size = None
    while size != start:
        size = start
        for i in bit_numbers(start):
            start |= wants[i]
    return start


def bit_numbers(mask: int) -> list[int]:
    """Numbers of the bits that are set."""
    return [i for i in range(mask.bit_length()) if mask >> i & 1]
