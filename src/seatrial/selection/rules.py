"""Rules about which terms may stand together: lines of text, data with a sentence each, and bit masks over the optional terms.

    X_uabsu requires X_u
    always T_nabsn
    never N_r3
    together Y_v N_v
    at most one of X_uu X_uabsu
    heredity

`heredity` stands for a rule for each product of several signals: it requires the linear term of each of them that the library has
on that axis (strong heredity: Chipman, Can. J. Stat. 24, 1996). `heredity of powers` asks that of powers of one signal too.
Compiled, what the rules force is taken out first: terms always there, and terms never there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from seatrial.core.coefficients import CoefficientName
from seatrial.core.display_units import listed
from seatrial.core.errors import InputError, located, nearest
from seatrial.core.signals import SIGNALS
from seatrial.selection.rule_masks import RuleMasks

EXPECTED = (
    '"A requires B", "always A", "never A", "together A B", "at most one of A B", "heredity" or "heredity of powers", '
    "with names of terms"
)


@dataclass(frozen=True)
class TermLibrary:
    """Candidate terms of one or several axes.

    Attributes:
        terms: each regressor once on its axis.
        signals: those that were measured or commanded.
    """

    terms: tuple[CoefficientName, ...]
    signals: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the terms."""
        return tuple(term.text for term in self.terms)

    def find(self, text: str, place: str) -> str:
        """Return the name under which the library has a term, whatever the order of its factors.

        Raises:
            InputError: malformed, of a signal that was not measured, or not in the library.
        """
        term = CoefficientName.parse(text)
        for signal in term.signals:
            if signal not in self.signals:
                raise InputError(
                    f"{place}, term {term}",
                    found=f'signal "{signal}" ({SIGNALS[signal].meaning}), which was not measured',
                    expected="one of " + ", ".join(self.signals),
                    remedy="leave the term out, or map the channel when importing",
                )
        if term not in self.terms:
            raise InputError(
                place,
                found=f"{term}, which is not in the library",
                expected="one of " + ", ".join(self.names),
                remedy=nearest(text, self.names) + " or add it to the library",
            )
        return self.names[self.terms.index(term)]


@dataclass(frozen=True)
class Requires:
    """A term stands only where all its parents do."""

    term: str
    parents: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.term} requires {' and '.join(self.parents)}"


@dataclass(frozen=True)
class Always:
    """A term stands in every structure."""

    term: str

    def __str__(self) -> str:
        return f"always {self.term}"


@dataclass(frozen=True)
class Never:
    """A term stands in no structure."""

    term: str

    def __str__(self) -> str:
        return f"never {self.term}"


@dataclass(frozen=True)
class Together:
    """All of the terms stand, or none."""

    terms: tuple[str, ...]

    def __str__(self) -> str:
        return f"together {' '.join(self.terms)}"


@dataclass(frozen=True)
class AtMostOne:
    """At most one of the terms stands: rival forms of the same physics."""

    terms: tuple[str, ...]

    def __str__(self) -> str:
        return f"at most one of {' '.join(self.terms)}"


Rule = Requires | Always | Never | Together | AtMostOne


@dataclass(frozen=True)
class CompiledRules:
    """What rules leave to decide.

    Attributes:
        always: terms in every structure.
        optional: terms that may stand or not.
        never: terms in none.
        masks: the rules among the optional terms, bit i for `optional[i]`.
    """

    always: tuple[str, ...]
    optional: tuple[str, ...]
    never: tuple[str, ...]
    masks: RuleMasks

    def terms(self, structure: int) -> tuple[str, ...]:
        """Return the names of all terms of a structure of the optional ones, those always there first."""
        return self.always + tuple(name for i, name in enumerate(self.optional) if structure >> i & 1)


def heredity(library: TermLibrary, powers: bool = False) -> tuple[Requires, ...]:
    """Return rules by which no product stands without its parents, those on its axis that the library has.

    Args:
        library: candidate terms.
        powers: ask u of u|u| too, and r of r^3.
    """
    rules = []
    for term in library.terms:
        product = len(term.signals) > 1 or (powers and sum(factor.power for factor in term.factors) > 1)
        linear = [CoefficientName.parse(f"{term.axis}_{signal}") for signal in term.signals]
        parents = tuple(library.names[library.terms.index(one)] for one in linear if one in library.terms)
        if product and parents:
            rules.append(Requires(term.text, parents))
    return tuple(rules)


def parse_rules(lines: Sequence[str], library: TermLibrary) -> tuple[Rule, ...]:
    """Read rules from lines of text; empty lines and what follows `#` do not count.

    Raises:
        InputError: a line that cannot be read, or a term the library lacks; the message names the line.
    """
    rules: list[Rule] = []
    for number, line in enumerate(lines, 1):
        words = line.partition("#")[0].replace(",", " ").split()
        if words:
            with located(f'rule in line {number}, "{line.strip()}"'):
                rules.extend(_parse(words, library))
    return tuple(rules)


def compile_rules(library: TermLibrary, rules: Sequence[Rule]) -> CompiledRules:
    """Compile rules for the terms of a library, contradictions found before anything is computed.

    Args:
        library: candidate terms.
        rules: in any of its spellings.

    Returns:
        Terms forced in, terms forced out, and masks over the others.

    Raises:
        InputError: a rule that names a term the library lacks; rules that contradict each other, or that leave a term which could
            never stand; the message names all of them.
    """
    named = [_renamed(rule, library) for rule in rules]
    bit = {name: 1 << i for i, name in enumerate(library.names)}
    present, absent = _decided(named, bit)
    for name in library.names:
        if present & absent & bit[name]:
            raise _contradiction(named, bit, 0, f"{name} can be neither included nor left out")
    optional = tuple(name for name in library.names if not (present | absent) & bit[name])
    for name in optional:
        with_it, without = _decided(named, bit, bit[name])
        if with_it & without:
            raise _contradiction(named, bit, bit[name], f"{name} could never stand")
    return CompiledRules(
        tuple(name for name in library.names if present & bit[name]),
        optional,
        tuple(name for name in library.names if absent & bit[name]),
        _masks(named, {name: 1 << i for i, name in enumerate(optional)}),
    )


def _masks(rules: Sequence[Rule], bit: Mapping[str, int]) -> RuleMasks:
    """Return the rules among the terms that have a bit."""

    def mask(terms: Sequence[str]) -> int:
        return sum(bit.get(term, 0) for term in terms)

    parents = dict.fromkeys(bit, 0)
    groups, exclusive = [], []
    for rule in rules:
        if isinstance(rule, Requires) and rule.term in bit:
            parents[rule.term] |= mask(rule.parents)
        elif isinstance(rule, Together) and mask(rule.terms):
            groups.append(mask(rule.terms))
        elif isinstance(rule, AtMostOne) and mask(rule.terms).bit_count() > 1:
            exclusive.append(mask(rule.terms))
    return RuleMasks(tuple(parents.values()), tuple(dict.fromkeys(groups)), tuple(dict.fromkeys(exclusive)))


def _decided(rules: Sequence[Rule], bit: Mapping[str, int], present: int = 0) -> tuple[int, int]:
    """Return which terms are there and which are not by the rules, once some are; those in both contradict the rules."""
    always = sum(bit[term] for term in {rule.term for rule in rules if isinstance(rule, Always)})
    never = sum(bit[term] for term in {rule.term for rule in rules if isinstance(rule, Never)})
    return _masks(rules, bit).links(len(bit)).decided(present | always, never)


def _contradiction(rules: Sequence[Rule], bit: Mapping[str, int], present: int, found: str) -> InputError:
    """Name the rules that contradict each other once some terms are there: those of which none can go without ending that."""
    needed = list(rules)
    for rule in rules:
        fewer = [one for one in needed if one is not rule]
        with_it, without = _decided(fewer, bit, present)
        needed = fewer if with_it & without else needed
    quoted = [f'"{rule}"' for rule in needed]
    return InputError(
        f"rules {listed(quoted)}",
        found=found,
        expected="rules that some structure with each optional term obeys",
        remedy="drop one of these rules, or leave the term out of the library",
    )


def _parse(words: list[str], library: TermLibrary) -> tuple[Rule, ...]:
    def terms(texts: list[str], fewest: int) -> tuple[str, ...]:
        results = tuple(library.find(text, "term") for text in texts if text != "and")
        if len(set(results)) < max(fewest, len(results)):
            raise InputError(
                "terms",
                found=", ".join(results) or "none",
                expected=f"{'one' if fewest == 1 else 'at least two'}, each once",
                remedy="correct the list of terms",
            )
        return results

    match words:
        case ["heredity"]:
            return heredity(library)
        case ["heredity", "of", "powers"]:
            return heredity(library, powers=True)
        case [term, "requires", *parents]:
            term, *parents = terms([term, *parents], 2)
            return (Requires(term, tuple(parents)),)
        case ["always", *several]:
            return tuple(Always(term) for term in terms(several, 1))
        case ["never", *several]:
            return tuple(Never(term) for term in terms(several, 1))
        case ["together", *several]:
            return (Together(terms(several, 2)),)
        case ["at", "most", "one", "of", *several]:
            return (AtMostOne(terms(several, 2)),)
    raise InputError("rule", found=" ".join(words), expected=EXPECTED, remedy="write the rule in one of these forms")


def _renamed(rule: Rule, library: TermLibrary) -> Rule:
    """Return the rule in the library's spelling."""

    def name(text: str) -> str:
        return library.find(text, f'rule "{rule}"')

    if isinstance(rule, Requires):
        return Requires(name(rule.term), tuple(map(name, rule.parents)))
    if isinstance(rule, Always | Never):
        return type(rule)(name(rule.term))
    return type(rule)(tuple(map(name, rule.terms)))
