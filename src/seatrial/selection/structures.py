"""Candidate structures: every set of the optional terms added to those always there that the rules allow. A model is a set of names."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from seatrial.core.coefficients import CoefficientName
from seatrial.core.display_units import listed
from seatrial.core.errors import InputError
from seatrial.selection.rule_masks import count_allowed
from seatrial.selection.rules import Always, CompiledRules, TermLibrary, compile_rules, parse_rules

MAX_STRUCTURES = 64  # Structures beyond which simulating each takes too long, and a screening has to choose a shortlist
# Speed along each axis, and what resists it.
DAMPING = {
    "X": ("u", "drag"),
    "Y": ("v", "sway damping"),
    "Z": ("w", "heave damping"),
    "K": ("p", "roll damping"),
    "M": ("q", "pitch damping"),
    "N": ("r", "yaw damping"),
}
# Words of a resistance by its regressor, `?` the speed.
ORDERS = {
    "?": "linear",
    "?abs?": "quadratic",
    "??": "square",
    "?2": "square",
    "?3": "cubic",
    "?4": "quartic",
    "?5": "quintic",
}
TRIM_SUFFIX = " about trim"
MAX_NAME_PARTS = 4  # Parts of a name beyond which it says what is left out instead


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
            found="no term that the rules allow",
            expected="at least one",
            remedy="drop a rule that excludes terms, or widen the library",
        )
    return count_allowed(rules.masks, (), k)


def all_structures(rules: CompiledRules) -> tuple[Structure, ...]:
    """Return all structures that the rules allow, by number of optional terms left out: the full one first, if it is allowed.

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


def structure_names(structures: Sequence[Structure]) -> dict[str, str]:
    """Name each of these structures by its terms, as in `linear and quadratic drag`, by its label.

    Drag and damping have words, where structures differ in them or nothing else resists, on several axes as in `drag: linear and quadratic;
    yaw damping: linear`; of other terms those count that some of the structures lack, by their names. No two names are alike.
    """
    every = list(dict.fromkeys(term for structure in structures for term in structure.terms))
    common = set(every).intersection(*(structure.terms for structure in structures)) if len(structures) > 1 else set()
    kinds = {resistance[0] for term in every if (resistance := _resistance(term))}
    differ = {resistance[0] for term in every if term not in common and (resistance := _resistance(term))}
    named = kinds if len(kinds) == 1 else differ
    return {structure.label: _name(structure.terms, every, common, named) for structure in structures}


def _name(terms: Sequence[str], every: Sequence[str], common: set[str], kinds: set[str]) -> str:
    resisting: dict[str, list[tuple[int, str]]] = {}
    others = []
    for term in terms:
        resistance = _resistance(term)
        if resistance and resistance[0] in kinds:
            resisting.setdefault(resistance[0], []).append(resistance[1:])
        elif term not in common:
            others.append(term)
    left_out = [term for term in every if term not in terms]
    if sum(map(len, resisting.values())) + len(others) > MAX_NAME_PARTS and len(left_out) <= MAX_NAME_PARTS:
        return f"all but {listed(left_out)}" if left_out else f"all {len(every)} terms"
    groups = [_group(what, sorted(orders), is_only=len(kinds) == 1) for what, orders in resisting.items()]
    return "; ".join([*groups, *([listed(others)] if others else [])]) or (
        f"no {min(kinds)}" if len(kinds) == 1 else "no optional term"
    )


def _group(what: str, orders: Sequence[tuple[int, str]], is_only: bool) -> str:
    """Return `linear and quadratic drag, cubic about trim`, or `drag: linear and quadratic, cubic about trim` beside other axes."""
    whole = [order for _, order in orders if not order.endswith(TRIM_SUFFIX)]
    changes = [order.removesuffix(TRIM_SUFFIX) for _, order in orders if order.endswith(TRIM_SUFFIX)]
    if is_only and not whole:
        return f"{listed(changes)} {what}{TRIM_SUFFIX}"
    parts = [f"{listed(whole)} {what}" if is_only else listed(whole)] if whole else []
    parts += [f"{listed(changes)}{TRIM_SUFFIX}"] if changes else []
    return ", ".join(parts) if is_only else f"{what}: {', '.join(parts)}"


def _resistance(term: str) -> tuple[str, int, str] | None:
    """Return what resists, its order as a rank and in words, of a term of its own axis' speed; None for any other."""
    axis, _, regressor = term.partition("_")
    if axis not in DAMPING:
        return None
    speed, what = DAMPING[axis]
    change = regressor.startswith(f"d{speed}")
    shape = regressor.removeprefix("d" * change).replace(speed, "?")
    return (what, list(ORDERS).index(shape), ORDERS[shape] + TRIM_SUFFIX * change) if shape in ORDERS else None
