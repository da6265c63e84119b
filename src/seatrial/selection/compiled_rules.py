"""Rules compiled to bit masks over the optional terms, contradictions found before anything is computed.

A structure is an integer S whose bit i says that optional term i stands. It is allowed if

    parents[i] & ~S == 0 for every i in S,   S & group in (0, group),   popcount(S & some) <= 1

What the rules force is taken out first: terms always there, and terms never there.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from seatrial.core.errors import InputError
from seatrial.selection.library import TermLibrary
from seatrial.selection.rules import Always, AtMostOne, Never, Requires, Rule, Together


@dataclass(frozen=True)
class CompiledRules:
    """Masks for structures of `optional` terms, bit i for term i.

    Attributes:
        always: terms in every structure.
        optional: terms that may stand or not.
        never: terms in none.
        parents: for each optional term the mask of those it requires.
        groups: masks of terms that stand together or not at all.
        exclusive: masks of terms of which at most one stands.
    """

    always: tuple[str, ...]
    optional: tuple[str, ...]
    never: tuple[str, ...]
    parents: tuple[int, ...]
    groups: tuple[int, ...]
    exclusive: tuple[int, ...]

    def allows(self, structure: int) -> bool:
        """Whether the rules allow a structure."""
        return (
            all(parents & ~structure == 0 for i, parents in enumerate(self.parents) if structure >> i & 1)
            and all(structure & group in (0, group) for group in self.groups)
            and all((structure & some).bit_count() <= 1 for some in self.exclusive)
        )

    def terms(self, structure: int) -> tuple[str, ...]:
        """Names of all terms of a structure, those always there first."""
        return self.always + tuple(name for i, name in enumerate(self.optional) if structure >> i & 1)


def compile_rules(library: TermLibrary, rules: Sequence[Rule]) -> CompiledRules:
    """Compile rules for the terms of a library.

    Raises:
        InputError: a rule that names a term the library lacks; two rules that contradict each other, or that leave a term which
            could never stand; the message names both.
    """
    for rule in rules:
        for term in rule.terms:
            library.find(term, f'rule "{rule}"')
    named = [_renamed(rule, library) for rule in rules]
    inside: dict[str, Rule] = {}
    outside: dict[str, Rule] = {}
    for rule in named:
        if isinstance(rule, Always):
            _put(rule.term, rule, inside, outside)
        if isinstance(rule, Never):
            outside[rule.term] = rule
    for term, rule in outside.items():
        if term in inside:
            raise _contradiction(term, inside[term], rule)
    _propagate(named, inside, outside)
    optional = tuple(name for name in library.names if name not in inside and name not in outside)
    bit = {name: 1 << i for i, name in enumerate(optional)}

    def mask(terms: Sequence[str]) -> int:
        return sum(bit.get(term, 0) for term in terms)

    parents = [0] * len(optional)
    groups, exclusive = [], []
    for rule in named:
        if isinstance(rule, Requires) and rule.term in bit:
            parents[optional.index(rule.term)] |= mask(rule.parents)
        elif isinstance(rule, Together) and mask(rule.terms):
            groups.append(mask(rule.terms))
        elif isinstance(rule, AtMostOne) and mask(rule.terms).bit_count() > 1:
            exclusive.append(mask(rule.terms))
    for term in optional:
        _check_possible(term, named)
    return CompiledRules(
        tuple(name for name in library.names if name in inside),
        optional,
        tuple(name for name in library.names if name in outside),
        tuple(parents),
        tuple(dict.fromkeys(groups)),
        tuple(dict.fromkeys(exclusive)),
    )


def _renamed(rule: Rule, library: TermLibrary) -> Rule:
    """The rule in the library's spelling."""

    def name(text: str) -> str:
        return library.find(text, f'rule "{rule}"')

    if isinstance(rule, Requires):
        return Requires(name(rule.term), tuple(map(name, rule.parents)))
    if isinstance(rule, Always | Never):
        return type(rule)(name(rule.term))
    return type(rule)(tuple(map(name, rule.terms)))


def _propagate(rules: Sequence[Rule], inside: dict[str, Rule], outside: dict[str, Rule]) -> None:
    """Follow what is forced until nothing new is, remembering the rule that forced each term."""
    before = -1
    while before != len(inside) + len(outside):
        before = len(inside) + len(outside)
        for rule in rules:
            if isinstance(rule, Requires):
                if rule.term in inside:
                    for parent in rule.parents:
                        _put(parent, rule, inside, outside)
                for parent in rule.parents:
                    if parent in outside:
                        _put(rule.term, rule, outside, inside, outside[parent])
            elif isinstance(rule, Together):
                for here, there in ((inside, outside), (outside, inside)):
                    if any(term in here for term in rule.terms):
                        for term in rule.terms:
                            _put(term, rule, here, there)
            elif isinstance(rule, AtMostOne):
                standing = [term for term in rule.terms if term in inside]
                if len(standing) > 1:
                    raise _contradiction(standing[1], inside[standing[1]], rule)
                for term in rule.terms:
                    if standing and term != standing[0]:
                        _put(term, rule, outside, inside)


def _put(term: str, rule: Rule, here: dict[str, Rule], there: dict[str, Rule], because: Rule | None = None) -> None:
    if term in there:
        raise _contradiction(term, there[term], because or rule)
    here.setdefault(term, rule)


def _check_possible(term: str, rules: Sequence[Rule]) -> None:
    """Refuse a term that no allowed structure has: everything it requires, in turn, must not break a rule of rivals."""
    needed: dict[str, Rule | None] = {term: None}
    before = 0
    while before != len(needed):
        before = len(needed)
        for rule in rules:
            if isinstance(rule, Requires) and rule.term in needed:
                needed.update({parent: rule for parent in rule.parents if parent not in needed})
            if isinstance(rule, Together) and any(one in needed for one in rule.terms):
                needed.update({one: rule for one in rule.terms if one not in needed})
    for rule in rules:
        if isinstance(rule, AtMostOne):
            standing = [one for one in rule.terms if one in needed]
            if len(standing) > 1:
                reason = next(needed[one] for one in reversed(standing) if needed[one] is not None)
                raise _contradiction(term, reason, rule, "could never stand")


def _contradiction(
    term: str, one: Rule | None, other: Rule, what: str = "can neither stand nor be left out"
) -> InputError:
    return InputError(
        f'rules "{one}" and "{other}"',
        found=f"{term} {what}",
        expected="rules that some structure with each optional term obeys",
        remedy="drop one of the two rules, or leave the term out of the library",
    )
