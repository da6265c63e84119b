"""Errors with a place, the value found, the value expected and a remedy; the two usual refusals have a function each."""

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
    """An input that cannot be used.

    Attributes:
        where: file, row, key or argument at fault.
        found: the input.
        expected: valid input.
        remedy: how to correct it.
    """

    def __init__(self, where: str, *, found: str, expected: str, remedy: str):
        self.where, self.found, self.expected, self.remedy = where, found, expected, remedy
        super().__init__(f"{where}\n  found:    {found}\n  expected: {expected}\n  remedy:   {remedy}")

    def sentence(self, with_remedy: bool = True) -> str:
        """Return the error without its place in one line."""
        sentence = f"{self.found}; expected {self.expected}"
        return f"{sentence}; {self.remedy}" if with_remedy else sentence

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


def not_among(where: str, name: object, allowed: Iterable[str], *, found: str = "") -> InputError:
    """Return the refusal of a name that is none of the allowed ones; the remedy is the nearest of them."""
    names = list(allowed)
    expected = "one of " + (", ".join(names) or "none")
    return InputError(where, found=found or f'"{name}"', expected=expected, remedy=nearest(name, names))


def too_few(where: str, found: str, least: object, remedy: str) -> InputError:
    """Return the refusal of a count below its least value; `found` names what is counted, as "2 samples"."""
    return InputError(where, found=found, expected=f"at least {least}", remedy=remedy)


class NumericalError(SeatrialError):
    """A computation without a usable result; the message has the reason and the remedy."""


_ELSEWHERE = "run it as a user who may read and write there, or copy it to your folder"
_ROOM = "free some space, then run the same command again: finished results are kept"
_FILE = "a file has the name of a needed folder: move it away"
_FOLDER = "a folder has the name of a needed file: move it away"
_REMEDIES = {
    errno.EEXIST: _FILE,
    errno.ENOTDIR: _FILE,
    errno.EISDIR: _FOLDER,
    errno.ELOOP: "a link has the name of a needed file: remove it",
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
        expected="a place in which files can be read and written",
        remedy=_REMEDIES.get(error.errno or 0, "check the path, its permissions and the space left on the disk"),
    )


def install_extra(extra: str) -> str:
    """Return the remedy for a missing extra. It names no package index: seatrial is in none, and anybody may take its name there."""
    wheel = f"dist/seatrial-{__version__}-py3-none-any.whl"
    return f'in the checkout, pip install -e ".[{extra}]"; or with the wheel, pip install "{wheel}[{extra}]"'


@contextmanager
def needing_extra(extra: str, where: str, found: str) -> Iterator[None]:
    """Import in the block a library that an extra installs.

    Args:
        extra: of seatrial, that installs it.
        where: what needs it, for the error.
        found: of the error, with {} for the library.

    Raises:
        InputError: it is not installed; names the command that installs it.
    """
    try:
        yield
    except ModuleNotFoundError as cause:
        raise InputError(
            where,
            found=found.format(str(cause.name).split(".")[0]),
            expected=f"the extra `{extra}`",
            remedy=install_extra(extra),
        ) from cause


def nearest(name: object, allowed: Iterable[str], otherwise: str = "") -> str:
    """Return the remedy for a misspelt name: the nearest allowed one, else `otherwise`, by default the whole list."""
    names = list(allowed)
    same = [one for one in names if one.lower() == str(name).lower()]
    close = same or difflib.get_close_matches(str(name), names, n=1, cutoff=0.5)
    return f'did you mean "{close[0]}"?' if close else otherwise or "use one of: " + ", ".join(names)
