"""Errors that say where, what was found, what was expected and how to mend it."""

import difflib
import errno
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial

from seatrial import __version__


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

    def sentence(self, with_remedy: bool = True) -> str:
        """Return in one line what was found and expected, and how to mend it, for where the place is known already."""
        said = f"{self.found}; expected {self.expected}"
        return f"{said}; {self.remedy}" if with_remedy else said

    def __reduce__(self) -> tuple[Callable[[], "InputError"], tuple[()]]:
        """Return how it travels between processes."""
        return partial(type(self), self.where, found=self.found, expected=self.expected, remedy=self.remedy), ()


@contextmanager
def located(place: str) -> Iterator[None]:
    """Put the place (file and key) before the `where` of any input error raised inside the block, unless that names the file already."""
    file = re.sub(r":\d+$", "", place.partition(", ")[0])
    try:
        yield
    except InputError as error:
        where = error.where if error.where.startswith((f"{file}:", f"{file},")) else f"{place}: {error.where}"
        raise InputError(where, found=error.found, expected=error.expected, remedy=error.remedy) from error.__cause__


class NumericalError(SeatrialError):
    """A computation ended in a state that must not be used; the message says which and what to change."""


_ELSEWHERE = "run it as a user who may read and write there, or copy it to a folder of your own"
_ROOM = "free some space, then run the same command again: finished results are kept"
_FILE = "a file stands where a folder should be: move it away"
_FOLDER = "a folder stands where a file should be: move it away"
_REMEDIES = {
    errno.EEXIST: _FILE,
    errno.ENOTDIR: _FILE,
    errno.EISDIR: _FOLDER,
    errno.ENOENT: "it was moved or deleted in the meantime: put it back, or correct the path",
    errno.EACCES: _ELSEWHERE,
    errno.EPERM: _ELSEWHERE,
    errno.EROFS: _ELSEWHERE,
    errno.ENOSPC: _ROOM,
    errno.EDQUOT: _ROOM,
}


def file_error(error: OSError) -> InputError:
    """Return an error of the file system, with what to do about it."""
    return InputError(
        str(error.filename2 or error.filename or "file system"),
        found=error.strerror or str(error),
        expected="a place where files can be read and written",
        remedy=_REMEDIES.get(error.errno or 0, "check the path, its permissions and the space left on the disk"),
    )


def install_extra(extra: str) -> str:
    """Return the remedy for a missing extra. It names no package index: seatrial is in none, and anybody may take its name there."""
    wheel = f"dist/seatrial-{__version__}-py3-none-any.whl"
    return f'in the checkout, pip install -e ".[{extra}]"; or with the wheel, pip install "{wheel}[{extra}]"'


def nearest(name: object, allowed: Iterable[str], otherwise: str = "") -> str:
    """Return the remedy text for a misspelt name: the nearest allowed one, or what is to be done otherwise, by default the whole list."""
    names = list(allowed)
    close = difflib.get_close_matches(str(name), names, n=1, cutoff=0.5)
    return f'did you mean "{close[0]}"?' if close else otherwise or "use one of: " + ", ".join(names)
