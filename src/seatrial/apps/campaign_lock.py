"""One process works on a campaign at a time: a locked file says which, what it is doing and how far it has come.

The lock is the operating system's (`flock`), so it ends with its process however that ends. The file is removed when the work ends;
one that is there and not locked was left by a process that was killed. A system or a disk without such locks (Windows has none) holds
nothing, and tells no other process.
"""

import json
import os
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from seatrial.core.errors import InputError

try:
    import fcntl
except ImportError:
    fcntl = None

FILE_NAME = ".running.json"
EVERY = 0.5
"""Seconds between two notes of the progress."""
TRIES = 5
"""Looks at a lock before it is believed."""
_HELD: set["Occupation"] = set()
"""What this process holds."""


@dataclass(frozen=True)
class Occupant:
    """Who works on a campaign, as its file says.

    Attributes:
        alive: whether it still does; otherwise it was killed.
        pid: of the process.
        host: on which it runs.
        command: as it was given.
        started: when, seconds since 1970.
        work: pieces of work begun so far: title, done, total and elapsed seconds of each.
    """

    alive: bool
    pid: int
    host: str
    command: tuple[str, ...]
    started: float
    work: tuple[dict[str, Any], ...] = ()

    @property
    def words(self) -> str:
        """For a sentence."""
        began = time.strftime("%d %b %H:%M:%S", time.localtime(self.started))
        return f"`{' '.join(self.command)}`, process {self.pid} on {self.host}, begun {began}"


class Occupation:
    """The lock of one campaign, and the notes of progress in it."""

    def __init__(self, handle: int, path: Path, command: tuple[str, ...]):
        self.handle, self.path = handle, path
        self.head = {"pid": os.getpid(), "host": socket.gethostname(), "command": command, "started": time.time()}
        self.work: list[dict[str, Any]] = []
        self.guard, self.noted = threading.Lock(), 0.0
        self._note()

    def progress(self, title: str) -> Callable[[int, int], None]:
        """Begin a piece of work; call the result with (done, total), from any thread."""
        piece = {"title": title, "done": 0, "total": 0, "elapsed": 0.0}
        began = time.monotonic()
        with self.guard:
            self.work.append(piece)

        def told(done: int, total: int) -> None:
            with self.guard:
                piece.update(done=int(done), total=int(total), elapsed=time.monotonic() - began)
                if done >= total or time.monotonic() - self.noted > EVERY:
                    self._note()

        return told

    def release(self) -> None:
        """End it and remove the file."""
        _HELD.discard(self)
        self.path.unlink(missing_ok=True)
        with suppress(OSError):
            os.close(self.handle)

    def _note(self) -> None:
        """Write the file in place, where its lock is. A full disk must not end a long run for the sake of its progress bar."""
        self.noted = time.monotonic()
        content = json.dumps({**self.head, "work": self.work}).encode()
        with suppress(OSError):
            os.pwrite(self.handle, content, 0)
            os.ftruncate(self.handle, len(content))


@contextmanager
def occupying(folder: Path) -> Iterator[Occupation | None]:
    """Hold a campaign while the block runs; None where the folder cannot be written to, as then nothing can be corrupted.

    Raises:
        InputError: another process works on it.
    """
    handle = _locked(folder / FILE_NAME)
    if handle is None:
        yield None
        return
    held = Occupation(handle, folder / FILE_NAME, ("seatrial", *sys.argv[1:]))
    _HELD.add(held)
    try:
        yield held
    finally:
        held.release()


def release_all() -> None:
    """Release what this process holds, before it ends at once."""
    for held in list(_HELD):
        held.release()


def occupant_of(folder: Path) -> Occupant | None:
    """Who works on a campaign, or was killed while it did; None for nobody."""
    path = folder / FILE_NAME
    for _ in range(TRIES):
        try:
            with path.open("rb") as stream:
                alive = _is_locked(stream.fileno())
                content = json.loads(stream.read())
            return Occupant(alive, **{**content, "command": tuple(content["command"]), "work": tuple(content["work"])})
        except FileNotFoundError:
            return None
        except (ValueError, KeyError, TypeError, RecursionError):
            time.sleep(0.01)  # being written: the next look finds it whole
    return Occupant(False, 0, "an unknown host", ("seatrial",), path.stat().st_mtime) if path.exists() else None


def _locked(path: Path) -> int | None:
    """Open and lock the file; it may be removed by its last holder between the two, and is then made anew."""
    while fcntl is not None:
        try:
            handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except OSError:
            return None
        try:
            taken = _try(handle)
        except OSError:  # a file system without locks
            os.close(handle)
            return None
        if not taken:
            os.close(handle)
            other = occupant_of(path.parent)
            raise InputError(
                str(path.parent),
                found=f"another process at work on this campaign{f': {other.words}' if other else ''}",
                expected="one at a time",
                remedy="wait until it ends, or stop it; what it has finished is kept",
            )
        with suppress(OSError):
            if os.stat(path).st_ino == os.fstat(handle).st_ino:
                return handle
        os.close(handle)
    return None


def _try(handle: int) -> bool:
    """Lock it, if nobody holds it for longer than the instant that a look by `occupant_of` takes."""
    assert fcntl is not None
    for _ in range(TRIES):
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            time.sleep(0.02)
        else:
            return True
    return False


def _is_locked(handle: int) -> bool:
    if fcntl is None:
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    fcntl.flock(handle, fcntl.LOCK_UN)
    return False
