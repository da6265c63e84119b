"""The question put to the engine, checked: which terms, which are certain, which structures are allowed."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from seatrial.core.errors import InputError, nearest
from seatrial.selection.subsets.gram import Gram, check_gram
from seatrial.selection.subsets.rules import MOST_TERMS, Rules, check_rules

MOST_OPTIONAL = 25


class Question(NamedTuple):
    """Terms by number.

    Attributes:
        names: of all terms.
        sure: numbers of those in every structure.
        free: numbers of the k others.
        certain: bitmask of `sure`.
        chance: prior probability of inclusion of each of the others, shape (k,).
    """

    names: tuple[str, ...]
    sure: list[int]
    free: list[int]
    certain: np.uint64
    chance: Float[np.ndarray, " k"]


def check_question(
    stats: Gram,
    names: Sequence[str],
    always: Sequence[str],
    rules: Rules | None,
    inclusion: float | Sequence[float],
    top: int,
) -> Question:
    """Check the arguments of `all_subsets`.

    Raises:
        InputError: any that cannot be used.
    """
    names = tuple(names)
    check_gram(stats, names)
    if unknown := [name for name in always if name not in names]:
        raise InputError(
            "terms always there",
            found=", ".join(unknown),
            expected="terms of the library",
            remedy=nearest(unknown[0], names),
        )
    sure = [i for i, name in enumerate(names) if name in always]
    free = [i for i, name in enumerate(names) if name not in always]
    if len(free) > MOST_OPTIONAL or len(names) > MOST_TERMS:
        raise InputError(
            "library of terms",
            found=f"{len(free)} optional terms of {len(names)}, 2^{len(free)} structures",
            expected=f"at most {MOST_OPTIONAL} optional terms, and {MOST_TERMS} in all, to visit every structure",
            remedy="move terms that are certain to `always`, drop some, or use a sampler over structures",
        )
    if rules is not None:
        check_rules(rules, len(names))
    if top < 1:
        raise InputError("best structures", found=str(top), expected="at least 1", remedy="ask for some")
    chance = np.asarray(inclusion, float)
    if chance.shape not in ((), (len(names),)) or not ((chance > 0) & (chance < 1)).all():
        raise InputError(
            "prior probability of inclusion",
            found=str(inclusion),
            expected=f"a number between 0 and 1, or {len(names)} of them",
            remedy="put terms that are certain in `always`, and leave out those that are impossible",
        )
    certain = np.uint64(sum(1 << i for i in sure))
    return Question(names, sure, free, certain, np.broadcast_to(chance, (len(names),))[free])
