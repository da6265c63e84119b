"""Candidate structures: every set of the optional terms added to those always there that the rules allow. A model is a set of names."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError
from seatrial.selection.compiled_rules import CompiledRules, compile_rules
from seatrial.selection.library import TermLibrary
from seatrial.selection.rules import Always, parse_rules
from seatrial.selection.structure_count import count_structures

MAX_STRUCTURES = 64
"""Structures beyond which simulating each takes too long, and a screening has to choose a shortlist."""


@dataclass(frozen=True)
class Structure:
    """One candidate: its label (`M-0` is the full one, as in the paper) and its terms."""

    label: str
    terms: tuple[str, ...]


def structure_rules(always: Sequence[str], optional: Sequence[str], lines: Sequence[str] = ()) -> CompiledRules:
    """Compile which terms may stand together.

    Args:
        always: terms in every structure.
        optional: terms whose presence the data decide.
        lines: rules as text, see `seatrial.selection.rules`.

    Raises:
        InputError: malformed or repeated term, no term at all, or rules that contradict each other.
    """
    seen: dict[CoefficientName, str] = {}
    for term in [*always, *optional]:
        name = CoefficientName.parse(term)
        if name in seen:
            raise InputError(
                f"structure, term {term}",
                found=f"the same regressor as {seen[name]}",
                expected="each term once",
                remedy="remove one of the two",
            )
        seen[name] = term
    if not seen:
        raise InputError(
            "structure",
            found="no term at all",
            expected="at least one coefficient in `always` or `optional`",
            remedy='for example always = ["X_uabsu", "T_nabsn"]',
        )
    signals = tuple(dict.fromkeys(signal for name in seen for signal in name.signals))
    library = TermLibrary(tuple(seen), signals)
    return compile_rules(library, [*map(Always, always), *parse_rules(lines, library)])


def all_structures(rules: CompiledRules) -> tuple[Structure, ...]:
    """Return all structures that the rules allow, by number of optional terms left out: the full one first, where it is allowed.

    Raises:
        InputError: too many structures for simulation-based evidence.
    """
    count = count_structures(rules)
    if count.structures > MAX_STRUCTURES:
        raise InputError(
            "structure.optional",
            found=f"{len(rules.optional)} optional terms, {count.structures} structures",
            expected=f"at most {MAX_STRUCTURES} structures",
            remedy="screen them first, move terms that are certain to `always`, or add rules",
        )
    k = len(rules.optional)
    masks = [
        sum(1 << i for i in range(k) if i not in left_out)
        for size in range(k + 1)
        for left_out in combinations(range(k), size)
    ]
    return label_structures([rules.terms(mask) for mask in masks if rules.allows(mask) and rules.terms(mask)])


def label_structures(sets: Sequence[Sequence[str]]) -> tuple[Structure, ...]:
    """Structures M-0, M-1, … of these terms, in order."""
    return tuple(Structure(f"M-{index}", tuple(terms)) for index, terms in enumerate(sets))
