"""Errors that say where, what was found, what was expected and how to mend it."""

import difflib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager


class SeatrialError(Exception):
    """Base of every error seatrial raises on purpose; its text is meant for the user, without a traceback."""


class InputError(SeatrialError):
    """Something the user gave cannot be used.

    Attributes:
        where: file, row, key or argument at fault.
        found: what stands there.
        expected: what may stand there.
        remedy: how to mend it.
    """

    def __init__(self, where: str, *, found: str, expected: str, remedy: str):
        self.where, self.found, self.expected, self.remedy = where, found, expected, remedy
        super().__init__(f"{where}\n  found:    {found}\n  expected: {expected}\n  remedy:   {remedy}")


@contextmanager
def located(place: str) -> Iterator[None]:
    """Put the place (file and key) before the `where` of any input error raised inside the block."""
    try:
        yield
    except InputError as error:
        where = f"{place}: {error.where}"
        raise InputError(where, found=error.found, expected=error.expected, remedy=error.remedy) from error.__cause__


class NumericalError(SeatrialError):
    """A computation ended in a state that must not be used; the message says which and what to change."""


def nearest(name: str, allowed: Iterable[str]) -> str:
    """Return the remedy text for a misspelt name: the nearest allowed one, or the whole list."""
    names = list(allowed)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    return f'did you mean "{close[0]}"?' if close else "use one of: " + ", ".join(names)
