"""A process that stays warm: it runs commands of one campaign one after another, and keeps what they imported and compiled.

The dashboard sends the words of a command and receives its exit code. A process may be killed and replaced at no loss, since all that
a command finishes is on disk.
"""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from multiprocessing import Pipe
from pathlib import Path

from seatrial.cli.running import Exit

MEMORY = 2 << 30
"""Bytes beyond which a process ends after its command."""
_BEGIN = "import sys; from seatrial.dashboard.session_worker import answer; answer(*sys.argv[1:])"


class Session:
    """One such process. It ends with this one, but a command at work goes on.

    Args:
        memory: bytes that it may hold.
    """

    def __init__(self, memory: int = MEMORY):
        ours, theirs = Pipe()
        self._channel, self._asked, self._is_last = ours, False, False
        places = {"PYTHONPATH": os.pathsep.join(place or os.getcwd() for place in sys.path)}
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-c", _BEGIN, str(theirs.fileno()), str(memory)],
            pass_fds=[theirs.fileno()],
            env={**os.environ, **places, "COLUMNS": "120", "PYTHONUNBUFFERED": "1"},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C in the terminal of the dashboard ends no command
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

    def start(self, words: Sequence[str], log: Path) -> None:
        """Start a command.

        Args:
            words: name, arguments and options.
            log: file to which its output is added.
        """
        self._asked = True
        try:
            self._channel.send_bytes(json.dumps({"words": list(words), "log": str(log)}).encode())
        except OSError:
            self._is_last = True  # the process has ended: `code` returns how

    def code(self, seconds: float | None = 0.0) -> int | None:
        """Return the exit code of the command, that of the process where it ended with the command; None while it is at work.

        Args:
            seconds: to wait for it; without end if None.
        """
        try:
            if not self._channel.poll(seconds):
                return None
            answer = json.loads(self._channel.recv_bytes())
            self._asked, self._is_last = False, answer["last"]
            return answer["code"]
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


def how_it_ended(code: int) -> str:
    """Return what to tell where a process ended with its command and said nothing; empty if the command has told."""
    if code <= 128 or code == Exit.INTERRUPTED:
        return ""
    name = signal.Signals(code - 128).name
    return f"error: the process ended without a message ({name}), perhaps because memory ran out; finished results are kept"
