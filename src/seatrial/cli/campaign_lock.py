"""One process works on a campaign at a time: a locked file keeps others out, and a file of notes says who it is and how far it has come.

The lock is the operating system's, so it ends with its process however that ends. Both files are removed when the work ends; notes
beside a file that is not locked were left by a process that was killed. A disk without locks holds nothing, and tells no other process.
"""

import errno
import json
import os
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from seatrial.core.errors import InputError
from seatrial.core.files import begin_file, open_regular
from seatrial.core.reporter import Bar

FILE_NAME = ".running.json"
LOCK_NAME = ".running.lock"
EVERY = 0.5  # Seconds between two notes of the progress
TRIES = 5  # Looks at notes that are being written
PATIENCE = 0.2  # Seconds that a lock is waited for: those who look at it hold it for an instant
# Errors of a link and of a folder in the place of a file, neither of which may turn the lock off.
_NO_FILE = (errno.ELOOP, errno.EISDIR)
_HELD: set["Occupation"] = set()  # What this process holds


@dataclass(frozen=True)
class Occupant:
    """Who works on a campaign, as its file says.

    Attributes:
        alive: whether it still does; otherwise it was killed.
        pid: of the process.
        host: on which it runs.
        command: as it was given.
        started: when, seconds since 1970.
        work: pieces of work begun so far: title, done, total, what was done at its first report, elapsed seconds from that to its last
            one, seconds since the last, and, of a whole run, the seconds that remain.
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

    def __init__(self, lock: FileLock, path: Path, command: tuple[str, ...]):
        self.lock, self.path, self.notes = lock, path, begin_file(path)
        self.head = {"pid": os.getpid(), "host": socket.gethostname(), "command": command, "started": time.time()}
        self.work: list[dict[str, Any]] = []
        self.began: list[float | None] = []
        self.guard, self.noted = threading.Lock(), 0.0
        self._note()

    def progress(self, title: str) -> Bar:
        """Begin a piece of work; call the result with (done, total), from any thread."""
        piece = {"title": title, "done": 0, "total": 0, "begun_at": 0, "elapsed": 0.0, "silent": 0.0, "seconds": None}
        with self.guard:
            number = len(self.work)
            self.work.append(piece)
            self.began.append(None)

        def told(done: int, total: int, seconds: float | None = None, /) -> None:
            with self.guard:
                began = self.began[number]
                if began is None:  # a piece may wait for others long before it begins
                    began = self.began[number] = time.monotonic()
                    piece["begun_at"] = int(done)
                piece.update(done=int(done), total=int(total), seconds=seconds, elapsed=time.monotonic() - began)
                if done >= total or time.monotonic() - self.noted > EVERY:
                    self._note()

        return told

    def release(self) -> None:
        """End it and remove the files."""
        _HELD.discard(self)
        with suppress(OSError):
            self.notes.close()
        self.path.unlink(missing_ok=True)
        with suppress(OSError):  # Windows removes it itself
            Path(self.lock.lock_file).unlink()
        with suppress(OSError):
            self.lock.release()

    def _note(self) -> None:
        """Write the notes in place. A full disk must not end a long run for the sake of its progress bar."""
        self.noted = time.monotonic()
        for piece, began in zip(self.work, self.began, strict=True):
            if began is not None and piece["done"] < piece["total"]:
                piece["silent"] = self.noted - began - piece["elapsed"]
        with suppress(OSError):
            self.notes.seek(0)
            self.notes.write(json.dumps({**self.head, "work": self.work}).encode())
            self.notes.truncate()
            self.notes.flush()


@contextmanager
def occupying(folder: Path) -> Iterator[Occupation | None]:
    """Hold a campaign while the block runs; None if the folder cannot be written to, as then nothing can be corrupted.

    Raises:
        InputError: another process works on it.
    """
    try:
        lock = _lock(folder)
        lock.acquire(timeout=PATIENCE, poll_interval=PATIENCE / 10)
        held = Occupation(lock, folder / FILE_NAME, ("seatrial", *sys.argv[1:]))
    except Timeout as cause:
        other = occupant_of(folder)
        raise InputError(
            str(folder),
            found=f"another process at work on this campaign{f': {other.words}' if other else ''}",
            expected="one at a time",
            remedy="wait until it ends, or stop it; finished work is kept",
        ) from cause
    except (OSError, NotImplementedError) as cause:  # a folder that cannot be written to, or a disk without locks
        if isinstance(cause, OSError) and cause.errno in _NO_FILE:
            raise
        yield None
        return
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
            with open_regular(path) as stream:
                content = json.loads(stream.readall())
            head = {**content, "command": tuple(content["command"]), "work": tuple(content["work"])}
            return Occupant(_is_locked(folder), **head)
        except (FileNotFoundError, InputError):
            return None
        except (ValueError, KeyError, TypeError, RecursionError):
            time.sleep(0.01)  # being written: the next look finds it whole
    if not path.exists():
        return None
    return Occupant(_is_locked(folder), 0, "an unknown host", ("seatrial",), path.stat().st_mtime)


def _lock(folder: Path) -> FileLock:
    return FileLock(folder / LOCK_NAME, thread_local=False, fallback_to_soft=False)


def _is_locked(folder: Path) -> bool:
    if not (folder / LOCK_NAME).exists():
        return False
    try:
        with _lock(folder).acquire(timeout=0):
            return False
    except Timeout:
        return True
    except (OSError, NotImplementedError):
        return False
