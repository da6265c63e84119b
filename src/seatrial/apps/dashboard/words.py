"""Errors as words: for a page, and between processes, where an error itself may not pass."""

from seatrial.core.errors import SeatrialError


class Worded(SeatrialError):
    """An error of another process: its words, which is all that may pass between processes."""


def words_of(error: BaseException) -> str:
    """Say what went wrong, in words for the page."""
    if isinstance(error, OSError):
        place = error.filename2 or error.filename
        if isinstance(error, FileNotFoundError):
            return f"{place}: not there any more. It was moved or deleted meanwhile: put it back, or reload the page."
        return f"{f'{place}: ' if place else ''}{error.strerror or error}. Check the permissions and the space left on the disk."
    return str(error)
