"""Candidate structures: every set of the optional terms added to those always there that the rules allow. A model is a set of names."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError
from seatrial.selection.library import TermLibrary
from seatrial.selection.rule_masks import allowed_mass
from seatrial.selection.rules import Always, CompiledRules, compile_rules, parse_rules

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


def count_structures(rules: CompiledRules) -> int:
    """Count the structures that the rules allow, exactly, with nothing enumerated.

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
    return allowed_mass(rules.masks, (), [0.5] * k)[0]


def all_structures(rules: CompiledRules) -> tuple[Structure, ...]:
    """Return all structures that the rules allow, by number of optional terms left out: the full one first, where it is allowed.

    Raises:
        InputError: too many structures for simulation-based evidence.
    """
    count = count_structures(rules)
    if count > MAX_STRUCTURES:
        raise InputError(
            "structure.optional",
            found=f"{len(rules.optional)} optional terms, {count} structures",
            expected=f"at most {MAX_STRUCTURES} structures",
            remedy="screen them first, move terms that are certain to `always`, or add rules",
        )
    k = len(rules.optional)
    masks = [
        sum(1 << i for i in range(k) if i not in left_out)
        for size in range(k + 1)
        for left_out in combinations(range(k), size)
    ]
    allowed = rules.masks.allowed(np.array(masks, np.uint64))
    sets = [rules.terms(mask) for mask, keeps in zip(masks, allowed, strict=True) if keeps]
    return label_structures([terms for terms in sets if terms])


def label_structures(sets: Sequence[Sequence[str]]) -> tuple[Structure, ...]:
    """Return structures M-0, M-1, … of these terms, in order."""
    return tuple(Structure(f"M-{index}", tuple(terms)) for index, terms in enumerate(sets))
