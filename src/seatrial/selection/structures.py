"""Candidate structures: every set of the optional terms added to those always there. A model is a set of coefficient names."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError

MAX_STRUCTURES = 64


@dataclass(frozen=True)
class Structure:
    """One candidate: its label (`M-0` is the full one, as in the paper) and its terms."""

    label: str
    terms: tuple[str, ...]


def all_structures(always: Sequence[str], optional: Sequence[str]) -> tuple[Structure, ...]:
    """Return all 2^k structures, the full one first, then by number of terms left out.

    Raises:
        InputError: malformed or repeated term, nothing to estimate, or too many structures for simulation-based evidence.
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
    if 2 ** len(optional) > MAX_STRUCTURES:
        raise InputError(
            "structure.optional",
            found=f"{len(optional)} optional terms, {2 ** len(optional)} structures",
            expected=f"at most {MAX_STRUCTURES} structures",
            remedy="move terms that are certain to `always`, or drop some",
        )
    sets = [left_out for size in range(len(optional) + 1) for left_out in combinations(optional, size)]
    structures = [(tuple(always) + tuple(term for term in optional if term not in left_out)) for left_out in sets]
    structures = [terms for terms in structures if terms]
    if not structures:
        raise InputError(
            "structure",
            found="no term at all",
            expected="at least one coefficient in `always` or `optional`",
            remedy='for example always = ["X_uabsu", "T_nabsn"]',
        )
    return tuple(Structure(f"M-{index}", terms) for index, terms in enumerate(structures))
