"""Work in a process of its own: a C library that aborts, walks in circles or fills the memory ends that process and nothing else."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from seatrial.core.errors import InputError, SeatrialError
from seatrial.core.processes import end_with_parent

Answer = TypeVar("Answer")

MEMORY = 8 << 30
"""Bytes of address space."""
SECONDS = 300.0
"""Of waiting for the next answer."""
_BEGIN = "import sys; from seatrial.core.apart import _answer; _answer(*map(int, sys.argv[1:]))"
_MORE, _FAILED, _END = range(3)
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Each thread would take address space, whether it works or not."""
_is_apart = False
"""Whether this process answers for another one."""


class Elsewhere(Exception):
    """An error of another process that does not travel: its kind, and its words as text."""

    def __init__(self, kind: str, words: str):
        super().__init__(kind, words)
        self.kind, self.words = kind, words

    def __str__(self) -> str:
        """Return the words alone."""
        return self.words


def apart(
    what: str,
    question: Callable[..., Iterable[Answer]],
    *about: Any,
    memory: int = MEMORY,
    seconds: float = SECONDS,
) -> Iterator[Answer]:
    """Answer a question in a process that ends with it, and with this one; where this one is such a process, here.

    Args:
        what: the file in question, for errors.
        question: function of a module, whose answers are handed on as they come.
        about: its arguments.
        memory: bytes that it may use.
        seconds: that each answer may take.

    Raises:
        InputError: it took too much, or the process broke.
        SeatrialError, OSError: as the question.
        Elsewhere: any other error of the question.
    """
    if _is_apart:
        yield from question(*about)
        return
    ours, theirs = Pipe()
    places = {"PYTHONPATH": os.pathsep.join(place or os.getcwd() for place in sys.path)}
    process = subprocess.Popen(
        [sys.executable, "-P", "-c", _BEGIN, str(theirs.fileno()), str(memory), str(os.getpid())],
        pass_fds=[theirs.fileno()],
        env={**os.environ, **places, **_ONE_THREAD},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    _AT_WORK.add(process)
    theirs.close()
    try:
        ours.send((question, about))
        while True:
            if not ours.poll(seconds):
                raise _too_much(what, f"a file that is not read after {seconds:g} s")
            kind, answer = ours.recv()
            if kind == _END:
                return
            if kind == _FAILED:
                raise answer
            yield answer
    except (EOFError, ConnectionError) as cause:
        raise _too_much(what, _last_words(process)) from cause
    finally:
        _AT_WORK.discard(process)
        process.kill()
        process.wait()
        ours.close()


def end_all() -> None:
    """End every process that answers now, so that a server which stops does not wait for them."""
    for process in list(_AT_WORK):
        process.kill()


_AT_WORK: set[subprocess.Popen] = set()


def _answer(handle: int, memory: int, parent: int) -> None:
    """Answer what comes through a pipe, through the same."""
    import resource

    global _is_apart
    _is_apart = True
    end_with_parent(parent)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    with Connection(handle) as out:
        try:
            question, about = out.recv()
            for answer in question(*about):
                out.send((_MORE, answer))
            out.send((_END, None))
        except MemoryError:
            os._exit(1)
        except Exception as error:
            travels = isinstance(error, SeatrialError) or (isinstance(error, OSError) and error.errno is not None)
            out.send((_FAILED, error if travels else Elsewhere(type(error).__name__, str(error))))


def _last_words(process: subprocess.Popen) -> str:
    with suppress(subprocess.TimeoutExpired):
        process.wait(1.0)
    if process.returncode is not None and process.returncode < 0:
        return f"a file that breaks its reader ({signal.Signals(-process.returncode).name})"
    return "a file that cannot be read in the memory allowed"


def _too_much(what: str, found: str) -> InputError:
    return InputError(
        what,
        found=found,
        expected="a whole log of ordinary size and content",
        remedy="the log is damaged, or too large to be read: copy or export it again, or cut it",
    )
