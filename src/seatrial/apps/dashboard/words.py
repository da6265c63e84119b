"""Errors as words for a page."""

from seatrial.core.errors import SeatrialError, file_error


class Worded(SeatrialError):
    """An error of another process, in words."""


def words_of(error: BaseException) -> str:
    """Say what went wrong, in words for the page."""
    return str(file_error(error) if isinstance(error, OSError) else error)
