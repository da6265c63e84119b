"""Rules about which terms may stand together, as data with a sentence each, and as lines of text.

    X_uabsu requires X_u
    always T_nabsn
    never N_r3
    together Y_v N_v
    at most one of X_uu X_uabsu
    heredity

`heredity` stands for a rule for each product of several signals: it requires the linear term of each of them that the library has
on that axis (strong heredity: Chipman, Can. J. Stat. 24, 1996). `heredity of powers` asks that of powers of one signal too.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError, located
from seatrial.selection.library import TermLibrary

EXPECTED = (
    '"A requires B", "always A", "never A", "together A B", "at most one of A B", "heredity" or "heredity of powers", '
    "with names of terms"
)


@dataclass(frozen=True)
class Requires:
    """A term stands only where all its parents do."""

    term: str
    parents: tuple[str, ...]

    @property
    def terms(self) -> tuple[str, ...]:
        """Every term the rule names."""
        return (self.term, *self.parents)

    def __str__(self) -> str:
        return f"{self.term} requires {' and '.join(self.parents)}"


@dataclass(frozen=True)
class Always:
    """A term stands in every structure."""

    term: str

    @property
    def terms(self) -> tuple[str, ...]:
        """Every term the rule names."""
        return (self.term,)

    def __str__(self) -> str:
        return f"always {self.term}"


@dataclass(frozen=True)
class Never:
    """A term stands in no structure."""

    term: str

    @property
    def terms(self) -> tuple[str, ...]:
        """Every term the rule names."""
        return (self.term,)

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


def heredity(library: TermLibrary, powers: bool = False) -> tuple[Requires, ...]:
    """Rules by which no product stands without its parents, those on its axis that the library has.

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


def _parse(words: list[str], library: TermLibrary) -> tuple[Rule, ...]:
    def terms(texts: list[str], fewest: int) -> tuple[str, ...]:
        found = tuple(library.find(text, "term") for text in texts if text != "and")
        if len(set(found)) < max(fewest, len(found)):
            raise InputError(
                "terms",
                found=", ".join(found) or "none",
                expected=f"{'one' if fewest == 1 else 'at least two'}, each once",
                remedy="correct the list of terms",
            )
        return found

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
