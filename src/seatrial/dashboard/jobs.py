"""Commands on a campaign, in processes of their own: the same as in a shell, so they outlive the page and the dashboard.

The process of a campaign stays after its command, so that the next one finds everything imported and compiled. What is running
is read from the campaign's folder and remembered nowhere else: `.running.json` while it runs, and what it printed in
`results/last_command.txt`.
"""

import os
import re
import shlex
import signal
import socket
from collections import OrderedDict
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path

from seatrial.campaign.store.stored_result import Store
from seatrial.cli.campaign_lock import Occupant, occupant_of
from seatrial.core.errors import InputError
from seatrial.core.files import begin_file, open_regular
from seatrial.core.visible import visible
from seatrial.dashboard.campaign_paths import logs_of
from seatrial.dashboard.command_options import STARTED
from seatrial.dashboard.session import Session, how_it_ended

TAIL = 16_000
"""Bytes of output that are shown."""
LOG = "last_command.txt"
"""What was printed by the last command."""
LIVE, ROS, IDLE = "live", "ros2", 1800
"""The command that follows a trial, its source that is topics, and seconds without a sample after which it ends if a page started it."""
TEXTS = (".csv", ".tsv", ".txt", ".log")
"""Names of text files that may grow end so."""
KEPT = 2
"""Processes that stay without work: a few hundred megabytes each."""
_OPTION = re.compile(r"--[a-z][a-z-]*(=[\w][\w ,.%\[\]+-]{0,80})?|[A-Za-z0-9][A-Za-z0-9_.-]{0,60}", re.ASCII)
"""An option as a page writes it: neither a path nor anything that begins another option."""


@dataclass(frozen=True)
class Job:
    """What a campaign's folder says about the command at work on it, or the last one.

    Attributes:
        occupant: who works on it, or was killed while it did.
        command: the last one that a dashboard started, as in a shell; empty if there was none.
        output: the end of what that printed.
        starting: whether it has been started and does not yet say so itself.
    """

    occupant: Occupant | None
    command: str
    output: str
    starting: bool = False

    @property
    def word(self) -> str:
        """Word of the command, such as check; empty if there was none."""
        return " ".join(self.command.split()[1:2])

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
        self.sessions: OrderedDict[Path, Session] = OrderedDict()

    def start(self, folder: Path, command: str, *options: str) -> None:
        """Start a command on a campaign.

        Raises:
            InputError: another is at work, or the command or an option is none.
            OSError: its output cannot be written.
        """
        if command not in STARTED:
            raise InputError(
                f"command {command[:40]!r}",
                found="no such command",
                expected=", ".join(STARTED),
                remedy="use the shell",
            )
        for option in options:
            if not _OPTION.fullmatch(option):
                raise InputError(
                    f"option {option[:40]!r}",
                    found="characters that a page refuses",
                    expected="letters, digits, spaces and , . % + - _",
                    remedy="correct it, or use the shell",
                )
        self._begin(folder, [command, str(folder), *options])

    def follow(self, folder: Path, source: str) -> None:
        """Follow a trial from a text file inside the campaign's folder, from a UDP port of this machine, or from topics of ROS 2.

        Args:
            folder: of the campaign.
            source: path from the folder, the number of the port, or `ROS`.

        Raises:
            InputError: another command is at work, or there is no such source.
            OSError: its output cannot be written.
        """
        if source.isascii() and source.isdigit() and 0 < int(source[:6]) < 65536:
            place = f"udp:0.0.0.0:{int(source)}"
        elif source == ROS:
            place = ROS
        elif source in logs_of(folder, TEXTS):
            place = str(folder / source)
        else:
            raise InputError(
                "source of the trial",
                found=repr(source[:80]),
                expected=f"a text file in the campaign's folder, a port from 1 to 65535, or {ROS}",
                remedy="choose one",
            )
        self._begin(folder, [LIVE, str(folder), place, f"--idle={IDLE}"])

    def _begin(self, folder: Path, line: list[str]) -> None:
        there = self.look(folder)
        if there.running:
            words = there.occupant.words if there.occupant else "one that was just started"
            raise InputError(
                str(folder),
                found=f"another command at work on this campaign: {words}",
                expected="one at a time",
                remedy="wait until it ends, or stop it; finished work is kept",
            )
        log = log_of(folder)
        log.parent.mkdir(exist_ok=True)
        with begin_file(log) as stream:
            stream.write(visible(f"$ seatrial {shlex.join(line)}\n").encode())
        self.session_of(folder).start(line, log)

    def stop(self, folder: Path) -> None:
        """Interrupt the command at work, as Ctrl-C does; it ends at once and can be resumed.

        Raises:
            InputError: nothing is at work, or it is at work on another machine.
        """
        occupant, ours = occupant_of(folder), self.sessions.get(folder)
        if occupant is not None and occupant.alive and occupant.host == socket.gethostname():
            os.kill(occupant.pid, signal.SIGINT)
        elif ours is not None and ours.is_busy:
            ours.interrupt()
        else:
            raise InputError(
                str(folder),
                found=occupant.words if occupant is not None and occupant.alive else "nothing at work",
                expected="a command at work on this machine",
                remedy="stop it on its page" if occupant is not None and occupant.alive else "reload the page",
            )

    def look(self, folder: Path) -> Job:
        """See what is at work on a campaign."""
        ours = self.sessions.get(folder)
        fresh = ours is not None and ours.is_busy and not self._has_ended(folder, ours)
        occupant = occupant_of(folder)
        starting = fresh and (occupant is None or not occupant.alive)
        return Job(occupant, *_said_in(log_of(folder)), starting=starting)

    def close(self) -> None:
        """End the processes that have no work."""
        for session in self.sessions.values():
            session.close()
        self.sessions.clear()

    def session_of(self, folder: Path) -> Session:
        """Return the process of a campaign; of those without work only the latest are kept."""
        there = self.sessions.get(folder)
        if there is None or not there.is_usable:
            if there is not None:
                there.close()
            self.sessions[folder] = Session()
        self.sessions.move_to_end(folder)
        idle = [one for one, session in self.sessions.items() if not session.is_busy]
        for one in idle[:-KEPT]:
            self.sessions.pop(one).close()
        return self.sessions[folder]

    def _has_ended(self, folder: Path, session: Session) -> bool:
        """Look whether a command has ended; a process that ended with it has its last words written, and is replaced."""
        code = session.code()
        if code is None:
            return False
        if words := how_it_ended(code):
            with open_regular(log_of(folder), "ab") as stream:
                stream.write(f"{words}\n".encode())
        return True


def log_of(folder: Path) -> Path:
    """What the last command printed that a dashboard started."""
    return Store(folder).results / LOG


def _said_in(log: Path) -> tuple[str, str]:
    """Command whose words a log holds, as in a shell, and the end of what it printed."""
    first, _, rest = _end_of(log).partition("\n")
    return (first.removeprefix("$ ") if first.startswith("$ ") else ""), rest


def _end_of(path: Path) -> str:
    """First line and the end of a text."""
    try:
        with BufferedReader(open_regular(path)) as stream:
            head = stream.readline(2000)
            here, size = stream.tell(), path.stat().st_size
            stream.seek(max(here, size - TAIL))
            return (head + stream.read(TAIL)).decode(errors="replace")
    except (OSError, InputError):
        return ""
