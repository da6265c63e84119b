"""Checks of what a public function is given: each names the argument, what was found, what is expected, and the remedy."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from math import inf, isnan
from numbers import Integral
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from seatrial.core.errors import InputError, nearest

Thing = TypeVar("Thing")
_MAX_SHOWN_CHARACTERS = 80  # Characters of what was found that an error shows


def shown(value: Any) -> str:
    """Return a value as an error shows it: as it would be written, cut short; of a table its heading."""
    return repr(value).partition("\n")[0][:_MAX_SHOWN_CHARACTERS]


def check_kind(value: Any, kind: type[Thing] | tuple[type[Thing], ...], place: str, remedy: str) -> Thing:
    """Return a value of a kind, or of one of several.

    Raises:
        InputError: a value of another kind.
    """
    if not isinstance(value, kind):
        description = "None" if value is None else f"{_named(type(value))}: {shown(value)}"
        description = f"the {value.__name__} itself" if isinstance(value, type) else description
        expected = " or ".join(map(_named, kind if isinstance(kind, tuple) else (kind,)))
        raise InputError(place, found=description, expected=expected, remedy=remedy)
    return value


def check_each_of(values: Any, kind: type[Thing], place: str, remedy: str) -> tuple[Thing, ...]:
    """Return a list of values of a kind, as a tuple.

    Raises:
        InputError: no list, or a value of another kind.
    """
    return tuple(
        check_kind(value, kind, f"{place}[{i}]", remedy)
        for i, value in enumerate(check_sequence(values, place, remedy))
    )


def check_path(value: Any, place: str) -> Path:
    """Return a path.

    Raises:
        InputError: no text and no path, or an empty text.
    """
    if not isinstance(value, str | PathLike) or not str(value):
        raise InputError(
            place, found=shown(value), expected="a path", remedy='give it as text or as a Path, for example "trial.csv"'
        )
    return Path(value)


def check_text(value: Any, place: str, remedy: str) -> str:
    """Return a text that is not empty.

    Raises:
        InputError: an empty text, or no text at all.
    """
    if not isinstance(value, str) or not value:
        raise InputError(place, found=shown(value), expected="text", remedy=remedy)
    return value


def check_number(
    value: Any,
    place: str,
    *,
    least: float = -inf,
    above: float = -inf,
    below: float = inf,
    most: float = inf,
    is_finite: bool = True,
    remedy: str = "give its SI value",
) -> float:
    """Return a number that lies between bounds.

    Args:
        value: what was given.
        place: of it, for the error.
        least: smallest value allowed; `above` where that itself is not.
        above: see `least`.
        below: see `most`.
        most: largest value allowed; `below` where that itself is not.
        is_finite: whether infinities are refused.
        remedy: what to do about a value that is refused.

    Raises:
        InputError: no number, NaN, or one beyond the bounds.
    """
    number = as_number(value)
    if (
        isnan(number)
        or (is_finite and abs(number) == inf)
        or not (least <= number <= most and _within(above, number, below))
    ):
        raise InputError(
            place, found=shown(value), expected=_range(least, above, below, most, is_finite), remedy=remedy
        )
    return number


def check_count(value: Any, place: str, *, least: int = 1, multiple_of: int = 1, remedy: str = "correct it") -> int:
    """Return a whole number of a least size.

    Args:
        value: what was given.
        place: of it, for the error.
        least: smallest value allowed.
        multiple_of: what divides it.
        remedy: what to do about a value that is refused.

    Raises:
        InputError: another kind of number, one that is too small, or no multiple.
    """
    if isinstance(value, bool) or not isinstance(value, Integral) or value < least or int(value) % multiple_of:
        expected = "a whole number" if multiple_of == 1 else f"a multiple of {multiple_of}"
        raise InputError(place, found=shown(value), expected=f"{expected}, {least} or more", remedy=remedy)
    return int(value)


def check_choice(value: Any, allowed: Collection[str], place: str) -> str:
    """Return one of some names.

    Raises:
        InputError: another name; the remedy tells the nearest.
    """
    if not isinstance(value, str) or value not in allowed:
        raise InputError(place, found=shown(value), expected=", ".join(allowed), remedy=nearest(value, allowed))
    return value


def check_mapping(values: Any, place: str, remedy: str) -> Mapping[str, Any]:
    """Return a mapping of names.

    Raises:
        InputError: another kind of value, or a key that is no text.
    """
    if not isinstance(values, Mapping) or not all(isinstance(name, str) for name in values):
        raise InputError(place, found=shown(values), expected="a mapping of names to values", remedy=remedy)
    return values


def check_numbers(
    values: Any,
    place: str,
    *,
    known: Collection[str] | None = None,
    above: float = -inf,
    remedy: str = 'write for example {"u": 1.5}',
) -> dict[str, float]:
    """Return a mapping of names to finite numbers.

    Args:
        values: the input; None counts as nothing.
        place: of it, for the error.
        known: allowed names; any if None.
        above: see `check_number`.
        remedy: for a value that is no mapping.

    Raises:
        InputError: no mapping, a name that is not known, or a value that is no finite number.
    """
    given = check_mapping({} if values is None else values, place, remedy)
    if known is not None:
        check_known(given, known, place)
    return {name: check_number(value, f'{place}["{name}"]', above=above) for name, value in given.items()}


def check_known(names: Iterable[str], known: Collection[str], place: str) -> None:
    """Check that every name is known.

    Raises:
        InputError: the first that is not.
    """
    for name in names:
        if name not in known:
            raise InputError(
                place,
                found=f'"{name}", which nothing uses',
                expected="among " + (", ".join(known) or "none"),
                remedy=nearest(name, known) if known else "leave it out",
            )


def check_names(values: Any, place: str, example: str = "u") -> tuple[str, ...]:
    """Return a sequence of names; a single text is refused, because each letter would count as a name.

    Raises:
        InputError: a name alone, or something that holds no names.
    """
    remedy = f'write ["{values}"]' if isinstance(values, str) else f'write for example ["{example}"]'
    for name in check_sequence(values, place, remedy):
        check_text(name, place, remedy)
    return tuple(values)


def check_sequence(values: Any, place: str, remedy: str) -> Sequence[Any]:
    """Return a list, a tuple or an array; a text, whose letters would count as elements, is refused.

    Raises:
        InputError: something else.
    """
    if isinstance(values, str | bytes | Mapping) or not (isinstance(values, Sequence) or np.ndim(values) == 1):
        raise InputError(place, found=shown(values), expected="a list", remedy=remedy)
    return values


def check_order(
    lower: Any, upper: Any, place: str, *, is_finite: bool = True, remedy: str = "swap or correct them"
) -> None:
    """Check that two bounds are numbers, the lower one below the upper one.

    Raises:
        InputError: they are not.
    """
    low = check_number(lower, f"{place}, lower", is_finite=is_finite)
    high = check_number(upper, f"{place}, upper", is_finite=is_finite)
    if not low < high:
        raise InputError(place, found=f"lower {low:g}, upper {high:g}", expected="lower below upper", remedy=remedy)


def is_traced(*values: Any) -> bool:
    """Return whether one of the values is an array of JAX, whose number need not be known yet."""
    return any(hasattr(value, "aval") for value in values)


def check_array(
    values: Any, place: str, *, size: int | None = None, least: int = 1, is_finite: bool = True
) -> np.ndarray:
    """Return a list of numbers as an array, shape (n,).

    Args:
        values: what was given.
        place: of it, for the error.
        size: n; any if None.
        least: smallest n.
        is_finite: whether NaN and infinities are refused.

    Raises:
        InputError: something else, complex numbers among it, another length, or a number that is not finite.
    """
    try:
        array = np.empty(()) if np.asarray(values).dtype.kind in "USc" else np.asarray(values, float)
    except (TypeError, ValueError):
        array = np.empty(())
    if array.ndim != 1 or array.size < least or (size is not None and array.size != size):
        description = f"shape {array.shape}" if array.ndim else shown(values)
        wanted = f"numbers, shape ({'n' if size is None else size},)" + ", one at least" * (array.shape == (0,))
        raise InputError(place, found=description, expected=wanted, remedy="give a list or an array of one dimension")
    if is_finite and not np.isfinite(array).all():
        at = int(np.argmin(np.isfinite(array)))
        raise InputError(
            f"{place}[{at}]", found=str(array[at]), expected="a finite number", remedy="correct it or leave it out"
        )
    return array


def as_number(value: Any) -> float:
    """Return a number, NaN if there is none; text and truth are no numbers."""
    if value is None or isinstance(value, str | bytes | bool) or np.ndim(value):
        return float("nan")
    try:
        return float(value)
    except (TypeError, ValueError):
        return float("nan")


def _within(above: float, number: float, below: float) -> bool:
    return (above < number or above == -inf) and (number < below or below == inf)


def _range(least: float, above: float, below: float, most: float, is_finite: bool) -> str:
    """Return the bounds in words."""
    bounds = [
        f"above {above:g}" if above > -inf else f"{least:g} or more" if least > -inf else "",
        f"below {below:g}" if below < inf else f"at most {most:g}" if most < inf else "",
    ]
    words = " and ".join(filter(None, bounds))
    return f"a {'finite ' * is_finite}number" + (f", {words}" if words else "")


def _named(kind: type) -> str:
    """Return the name of a type with its article."""
    return f"{'an' if kind.__name__[0] in 'AEIOaeio' else 'a'} {kind.__name__}"
