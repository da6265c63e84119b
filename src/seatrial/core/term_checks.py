"""Checks of terms that every model and library of them needs."""

from collections.abc import Iterable, Mapping
from itertools import combinations

from seatrial.core.coefficients import CoefficientName, is_coefficient
from seatrial.core.errors import InputError


def check_trim(term: CoefficientName, trim: Mapping[str, float], place: str) -> None:
    """Check that the trim of every signal is known that the term is a change of.

    Raises:
        InputError: one is not; the message names the term and the key.
    """
    for signal in term.trim_signals:
        if signal not in trim:
            rudder = f"{term.axis}_{term.text.partition('_')[2].replace('dr', 'delta_r')}"
            raise InputError(
                f"{place}, term {term}",
                found=f'no trim value of "{signal}"',
                expected=f"trim.{signal}",
                remedy="give the trim, because the term is a change from it"
                + f"; for the rudder write {rudder}" * (signal == "r" and is_coefficient(rudder)),
            )


def check_each_once(terms: Iterable[CoefficientName], place: str) -> None:
    """Check that no two terms are the same regressor, in whatever order their factors are written.

    Raises:
        InputError: two are; the message names both.
    """
    seen: dict[CoefficientName, CoefficientName] = {}
    for term in terms:
        if term in seen:
            raise InputError(
                f"{place}, term {term}",
                found=f"the same regressor as {seen[term]}",
                expected="each regressor once",
                remedy="leave one of the two out",
            )
        seen[term] = term


def terms_that_may_be_one(terms: Iterable[CoefficientName]) -> list[str]:
    """Return a sentence about every two terms that differ only where a signal changes its sign."""
    return [
        f"{first} and {second} differ only when {' and '.join(signals)} changes its sign: a record without such a change cannot "
        f"separate them. Leave one of them out, or plan a trial with it"
        for first, second in combinations(terms, 2)
        if (signals := first.parted_by_sign(second))
    ]
