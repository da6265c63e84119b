"""Processes that end with the one that started them, also while they compute and also when that one was killed."""

import ctypes
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from typing import Any, TypeVar

from seatrial.core.errors import InputError, SeatrialError

# Work in a process of its own: a C library that aborts, walks in circles or fills the memory ends that process and
# nothing else.

Answer = TypeVar("Answer")

MEMORY = 8 << 30  # Bytes of address space
SECONDS = 300.0  # Of waiting for the next answer
_BEGIN = "import sys; from seatrial.core.processes import _answer; _answer(*map(int, sys.argv[1:]))"
_MORE, _FAILED, _END = range(3)
# Each thread would take address space, whether it works or not.
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
_is_apart = False  # Whether this process answers for another one


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
        memory: bytes that it may use, and write to a file.
        seconds: that each answer may take.

    Raises:
        InputError: it took too much, or the process broke.
        SeatrialError, OSError: as the question.
        Elsewhere: any other error of the question.
    """
    if _is_apart:
        with _bounded(memory):
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
        resource.setrlimit(resource.RLIMIT_FSIZE, (memory, memory))
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


@contextmanager
def _bounded(memory: int) -> Iterator[None]:
    """Lower the bounds of a process that has some, as one that was made for this question would have them."""
    import resource

    before = {kind: resource.getrlimit(kind) for kind in (resource.RLIMIT_AS, resource.RLIMIT_FSIZE)}
    lower = {kind: (memory, hard) for kind, (soft, hard) in before.items() if resource.RLIM_INFINITY != soft > memory}
    for kind, limits in lower.items():
        resource.setrlimit(kind, limits)
    try:
        yield
    finally:
        for kind in lower:
            resource.setrlimit(kind, before[kind])


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


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


SECONDS_BETWEEN_LOOKS = 1.0  # Seconds between two looks at whether the parent is there, where nothing tells
_PR_SET_PDEATHSIG = 1


def end_with_parent(parent: int | None = None) -> None:
    """End this process as soon as the one that started it has ended; call it before anything else.

    Linux has its kernel do it, which no computation holds up. There the thread that started this process counts as its parent, so
    that thread has to live as long. Elsewhere a thread watches, which sees the end when Python next changes threads.

    Args:
        parent: number of the process that started this one, if it is known and may have ended by now.
    """
    starter = multiprocessing.parent_process()
    number = (parent or os.getppid()) if starter is None else starter.pid
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
        if os.getppid() != number:  # it ended before that
            os._exit(1)

    def watch() -> None:
        if starter is not None:
            wait([starter.sentinel])
        while starter is None and os.getppid() == number:
            time.sleep(SECONDS_BETWEEN_LOOKS)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
