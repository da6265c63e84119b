"""How many structures the rules allow, exactly, and how long all of them take, before anything runs.

Every rule is a set of clauses of two literals: a term requires each of its parents, a group is a ring of requirements, and of two
rivals one is absent. Structures are the solutions, counted by branching on the term with most clauses and multiplying over parts that
share none (Bayardo and Pehoushek, AAAI 2000), with nothing enumerated.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

from seatrial.core.errors import InputError
from seatrial.selection.compiled_rules import CompiledRules

MOST_EXACT = 25
"""Optional terms up to which every structure is visited."""
SECONDS = 1e-7
"""Time for each of the 2^k structures in the closed form, allowed or not: 3 s at k = 25 on one core (`benchmarks/run.py subsets`)."""

Literal = tuple[int, bool]
Clause = frozenset[Literal]


@dataclass(frozen=True)
class StructureCount:
    """Size of a search.

    Attributes:
        structures: allowed by the rules.
        optional: number of optional terms k, of 2^k subsets.
        exact: whether all of them can be visited.
        seconds: estimated time of that in the closed form.
    """

    structures: int
    optional: int
    exact: bool
    seconds: float

    def __str__(self) -> str:
        size = f"{self.structures:,} structures allowed of 2^{self.optional} = {2**self.optional:,}"
        if self.exact:
            return f"{size}, all of them in about {self.seconds:.2g} s"
        return f"{size}: more than {MOST_EXACT} optional terms, to be sampled"


def count_structures(rules: CompiledRules) -> StructureCount:
    """Count the structures that the rules allow.

    Raises:
        InputError: no term at all.
    """
    k = len(rules.optional)
    if not k and not rules.always:
        raise InputError(
            "library and rules",
            found="no term that may stand",
            expected="at least one",
            remedy="drop a rule that excludes terms, or widen the library",
        )
    return StructureCount(_count(_clauses(rules), frozenset(range(k))), k, k <= MOST_EXACT, SECONDS * 2**k)


def _clauses(rules: CompiledRules) -> frozenset[Clause]:
    """Pairs of literals, one of which must hold."""
    bits = {
        mask: [i for i in range(len(rules.optional)) if mask >> i & 1] for mask in (*rules.groups, *rules.exclusive)
    }
    clauses = {
        frozenset(((i, False), (j, True)))
        for i, mask in enumerate(rules.parents)
        for j in range(len(rules.optional))
        if mask >> j & 1 and i != j
    }
    for group in rules.groups:
        ring = bits[group]
        clauses |= {
            frozenset(((i, False), (j, True))) for i, j in zip(ring, ring[1:] + ring[:1], strict=True) if i != j
        }
    for rivals in rules.exclusive:
        clauses |= {frozenset(((i, False), (j, False))) for i, j in combinations(bits[rivals], 2)}
    return frozenset(clauses)


@lru_cache(maxsize=2**16)
def _count(clauses: frozenset[Clause], free: frozenset[int]) -> int:
    """Number of assignments of the free terms that satisfy every clause."""
    if not clauses:
        return 2 ** len(free)
    if frozenset() in clauses:
        return 0
    part = _connected(clauses)
    if part != clauses:
        inside = frozenset(i for clause in part for i, _ in clause)
        return _count(part, inside) * _count(clauses - part, free - inside)
    uses = [i for clause in clauses for i, _ in clause]
    pivot = max(sorted(set(uses)), key=uses.count)
    return sum(_count(_given(clauses, pivot, value), free - {pivot}) for value in (False, True))


def _connected(clauses: frozenset[Clause]) -> frozenset[Clause]:
    """Clauses that hang together with one of them."""
    terms, found = {i for i, _ in min(clauses, key=sorted)}, 0
    while found != len(terms):
        found = len(terms)
        terms |= {i for clause in clauses if any(i in terms for i, _ in clause) for i, _ in clause}
    return frozenset(clause for clause in clauses if any(i in terms for i, _ in clause))


def _given(clauses: frozenset[Clause], term: int, value: bool) -> frozenset[Clause]:
    """Clauses that remain once a term is known: those it satisfies go, from the others it goes."""
    return frozenset(clause - {(term, not value)} for clause in clauses if (term, value) not in clause)
