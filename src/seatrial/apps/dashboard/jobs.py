"""Commands on a campaign, in processes of their own: the same as in a shell, so they outlive the page and the dashboard.

What is running is read from the campaign's folder and remembered nowhere else: `.running.json` while it runs, and what it printed in
`results/last_command.txt`.
"""

import os
import re
import signal
import socket
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from seatrial.apps.campaign_lock import Occupant, occupant_of
from seatrial.apps.cli import COMMANDS
from seatrial.campaign.store.stored_result import Store
from seatrial.core.errors import InputError

STARTED = {name: command.makes for name, command in COMMANDS.items() if command.makes}
"""Commands that may be started from the page, and what they make."""
TAIL = 16_000
"""Bytes of output that are shown."""
_OPTION = re.compile(r"--[a-z][a-z-]*|[A-Za-z0-9][A-Za-z0-9_.-]{0,60}")


@dataclass(frozen=True)
class Job:
    """What a campaign's folder says about the command at work on it, or the last one.

    Attributes:
        occupant: who works on it, or was killed while it did.
        command: the last one that a dashboard started, as in a shell; empty where there was none.
        output: the end of what that printed.
        starting: whether it has been started and does not yet say so itself.
    """

    occupant: Occupant | None
    command: str
    output: str
    starting: bool = False

    @property
    def running(self) -> bool:
        """Whether a command is at work."""
        return self.starting or (self.occupant is not None and self.occupant.alive)

    @property
    def killed(self) -> bool:
        """Whether the last one was killed without a word."""
        return self.occupant is not None and not self.occupant.alive and not self.starting


class Jobs:
    """Starts and stops commands."""

    def __init__(self):
        self.started: dict[Path, subprocess.Popen] = {}

    def start(self, folder: Path, command: str, *options: str) -> None:
        """Start a command on a campaign.

        Raises:
            InputError: another is at work, or the command or an option is none.
            OSError: its output cannot be written.
        """
        if command not in STARTED or not all(_OPTION.fullmatch(option) for option in options):
            raise InputError(
                f"command {command[:40]!r}",
                found="no such command",
                expected=", ".join(STARTED),
                remedy="use the shell",
            )
        there = self.look(folder)
        if there.running:
            words = there.occupant.words if there.occupant else "one that was just started"
            raise InputError(
                str(folder),
                found=f"another command at work on this campaign: {words}",
                expected="one at a time",
                remedy="wait until it ends, or stop it; what it has finished is kept",
            )
        log = log_of(folder)
        log.parent.mkdir(exist_ok=True)
        line = [command, str(folder), *options]
        with log.open("wb") as stream:
            stream.write(f"$ seatrial {' '.join(line)}\n".encode())
            stream.flush()
            self.started[folder] = subprocess.Popen(
                [sys.executable, "-m", "seatrial", *line],
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                env={**os.environ, "PYTHONUNBUFFERED": "1", "COLUMNS": "120"},
            )

    def stop(self, folder: Path) -> None:
        """Interrupt the command at work, as Ctrl-C does; it ends at once and can be resumed.

        Raises:
            InputError: nothing is at work, or it is at work on another machine.
        """
        occupant, ours = occupant_of(folder), self.started.get(folder)
        if occupant is not None and occupant.alive and occupant.host == socket.gethostname():
            os.kill(occupant.pid, signal.SIGINT)
        elif ours is not None and ours.poll() is None:
            ours.send_signal(signal.SIGINT)
        else:
            raise InputError(
                str(folder),
                found=occupant.words if occupant is not None and occupant.alive else "nothing at work",
                expected="a command at work on this machine",
                remedy="stop it where it runs" if occupant is not None and occupant.alive else "reload the page",
            )

    def look(self, folder: Path) -> Job:
        """See what is at work on a campaign."""
        occupant, ours = occupant_of(folder), self.started.get(folder)
        fresh = ours is not None and ours.poll() is None
        first, _, rest = _end_of(log_of(folder)).partition("\n")
        command = first.removeprefix("$ ") if first.startswith("$ ") else ""
        return Job(occupant, command, rest, starting=fresh and (occupant is None or not occupant.alive))


def log_of(folder: Path) -> Path:
    """What the last command that a dashboard started printed."""
    return Store(folder).results / "last_command.txt"


def _end_of(path: Path) -> str:
    """First line and the end of a text."""
    try:
        with path.open("rb") as stream:
            head = stream.readline(2000)
            here, size = stream.tell(), path.stat().st_size
            stream.seek(max(here, size - TAIL))
            return (head + stream.read(TAIL)).decode(errors="replace")
    except OSError:
        return ""
