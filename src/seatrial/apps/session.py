"""A process that stays warm: it runs commands of one campaign one after another, and keeps what they imported and compiled.

Whoever asks sends the words of a command and is told its exit code. Between two commands the process gets the next step ready. A process
knows one campaign; it is killed and made anew at no loss, since whatever a command finishes is on disk.
"""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from multiprocessing import Pipe
from pathlib import Path
from tempfile import TemporaryDirectory

from seatrial.apps.running import Exit

MEMORY = 2 << 30
"""Bytes beyond which a process ends after its command."""
EVERY = 1.0
"""Seconds between two requests to get the next step ready: pages ask whenever somebody looks."""
_BEGIN = "import sys; from seatrial.apps.session_worker import answer; answer(*sys.argv[1:])"


class Session:
    """One such process.

    Args:
        folder: of the campaign.
        outlives: whether a command that is at work goes on when this process ends; one without work ends with this process in any case.
        prepares: whether it gets the next step ready while nothing is asked.
        memory: bytes that it may hold.
    """

    def __init__(self, folder: Path, outlives: bool, prepares: bool = True, memory: int = MEMORY):
        ours, theirs = Pipe()
        self._told = -EVERY
        self._channel, self._asked, self._is_last = ours, False, False
        self._scratch = TemporaryDirectory(prefix="seatrial-", ignore_cleanup_errors=True)
        places = {"PYTHONPATH": os.pathsep.join(place or os.getcwd() for place in sys.path)}
        settings = {
            "handle": theirs.fileno(),
            "parent": os.getpid(),
            "folder": str(folder),
            "scratch": self._scratch.name,
            "outlives": outlives,
            "prepares": prepares,
            "memory": memory,
        }
        printed = subprocess.DEVNULL if outlives else None
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-c", _BEGIN, json.dumps(settings)],
            pass_fds=[theirs.fileno()],
            env={**os.environ, **places, **({"COLUMNS": "120", "PYTHONUNBUFFERED": "1"} if outlives else {})},
            stdin=subprocess.DEVNULL,
            stdout=printed,
            stderr=printed,
            start_new_session=True,  # Ctrl-C is passed on, and only to a command
        )
        theirs.close()

    @property
    def is_usable(self) -> bool:
        """Whether it takes another command, now or after the one at work."""
        return not self._is_last and self.process.poll() is None

    @property
    def is_busy(self) -> bool:
        """Whether a command is at work, as far as `code` has been told."""
        return self._asked

    def start(self, words: Sequence[str], log: Path | None = None) -> None:
        """Start a command.

        Args:
            words: name, arguments and options.
            log: what it prints is added there; to the streams of this process where none is given.
        """
        self._asked = True
        self._send(words, log)

    def get_ready(self) -> None:
        """Have the next step made ready, where nothing is at work."""
        if not self._asked and time.monotonic() - self._told > EVERY:
            self._told = time.monotonic()
            self._send(())

    def code(self, seconds: float | None = 0.0) -> int | None:
        """Return the exit code of the command, that of the process where it ended with the command; None while it is at work.

        Args:
            seconds: to wait for it; without end if None.
        """
        try:
            if not self._channel.poll(seconds):
                return None
            said = json.loads(self._channel.recv_bytes())
            self._asked, self._is_last = False, said["last"]
            return said["code"]
        except (EOFError, OSError):
            self._asked, self._is_last = False, True
            code = self.process.wait()
            return code if code >= 0 else 128 - code

    def interrupt(self) -> None:
        """Interrupt the command as Ctrl-C does: the process ends at once, and with it what was compiled."""
        if self._asked:
            self.process.send_signal(signal.SIGINT)

    def kill(self) -> None:
        """End the process, whatever it does."""
        self.process.kill()

    def close(self) -> None:
        """End the process, but not a command that outlives this one."""
        self._is_last = True
        self._channel.close()
        self._scratch.cleanup()

    def _send(self, words: Sequence[str], log: Path | None = None) -> None:
        try:
            self._channel.send_bytes(json.dumps({"words": list(words), "log": log and str(log)}).encode())
        except OSError:
            self._is_last = True  # it has ended: `code` tells


def how_it_ended(code: int) -> str:
    """Say what to tell where a process ended with its command and said nothing; empty where the command has told."""
    if code <= 128 or code == Exit.INTERRUPTED:
        return ""
    name = signal.Signals(code - 128).name
    return f"error: the process ended without a message ({name}), perhaps because memory ran out; finished results are kept"
