"""A look at a file that somebody sent, in a process of its own: what takes too much memory or time ends there and nowhere else."""

from collections.abc import Callable, Iterator
from typing import Any

from seatrial.apps.dashboard.words import Worded, words_of
from seatrial.core.apart import apart
from seatrial.core.errors import SeatrialError

MEMORY = 6 << 30
"""Bytes of address space."""
SECONDS = 300.0
"""Of waiting."""


def isolated(
    what: str, question: Callable[..., Any], *about: Any, memory: int = MEMORY, seconds: float = SECONDS
) -> Any:
    """Answer a question in a process that ends with it.

    Args:
        what: the file, for errors.
        question: function of a module.
        about: its arguments.
        memory: bytes it may use.
        seconds: it may take.

    Raises:
        Worded: an error of the question, in its words.
        InputError: it took too much.
    """
    (answer,) = apart(what, _worded, question, about, memory=memory, seconds=seconds)
    return answer


def _worded(question: Callable[..., Any], about: tuple) -> Iterator[Any]:
    try:
        yield question(*about)
    except (SeatrialError, OSError) as error:
        raise Worded(words_of(error)) from None
