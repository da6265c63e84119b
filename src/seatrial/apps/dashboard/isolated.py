"""A look at a file that somebody sent, in a process of its own: what takes too much memory or time ends there and nowhere else."""

import multiprocessing
import resource
import signal
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from seatrial.apps.dashboard.words import Worded, words_of
from seatrial.core.errors import InputError, SeatrialError
from seatrial.core.processes import end_with_parent

MEMORY = 6 << 30
"""Bytes of address space."""
SECONDS = 300
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
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_answer, args=(theirs, memory, question, about), daemon=True)
    process.start()
    _AT_WORK.add(process)
    theirs.close()
    try:
        if not ours.poll(seconds):
            raise _too_much(what, f"a file that is not read after {seconds:g} s")
        answer, error = ours.recv()
    except EOFError as cause:
        raise _too_much(what, "a file that cannot be read in the memory allowed, or that breaks its reader") from cause
    finally:
        _AT_WORK.discard(process)
        process.kill()
        process.join()
        ours.close()
    if error is not None:
        raise Worded(error)
    return answer


def end_all() -> None:
    """End every such process, so that a server which stops does not wait for them."""
    for process in list(_AT_WORK):
        process.kill()


_AT_WORK: set[Any] = set()


def _answer(out: Any, memory: int, question: Callable[..., Any], about: tuple) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()
    with suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    try:
        out.send((question(*about), None))
    except MemoryError:
        return
    except (SeatrialError, OSError) as error:
        out.send((None, words_of(error)))


def _too_much(what: str, found: str) -> InputError:
    return InputError(
        what,
        found=found,
        expected="a log of ordinary size and content",
        remedy="look at it with `seatrial inspect`; cut it, or export it again",
    )
