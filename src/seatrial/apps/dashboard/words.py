"""Errors as words: for a page, and between processes, where an error itself may not pass."""

from seatrial.core.errors import SeatrialError, file_error


class Worded(SeatrialError):
    """An error of another process: its words, which is all that may pass between processes."""


def words_of(error: BaseException) -> str:
    """Say what went wrong, in words for the page."""
    return str(file_error(error) if isinstance(error, OSError) else error)
