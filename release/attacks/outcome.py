"""What came of an attack: success or a clear refusal, or one of the ways to fail."""

import contextlib
import io
import os
import sys
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

FINE = ("done", "refused", "skipped")
"""Success, an InputError, and what this machine cannot try."""
FAILED = ("traceback", "hang", "abort", "escape", "different", "bloated", "unclear")
"""An uncaught exception; no end in time; death by a signal; files or programs beyond those given; other bits than without the attack,
or results of another configuration; gigabytes; a refusal that does not say where, what and how to mend it."""
MOST_MEMORY = 1_500_000_000
"""Bytes that a process may have in memory, its libraries included."""
UNPICKLED = ("os", "posix", "nt", "subprocess", "builtins", "sys", "shutil", "runpy", "importlib")
"""Modules that a hostile pickle would use; libraries unpickle their own objects as they are imported."""
PROGRAMS = (sys.executable, "uname")
"""What may be started: ourselves, and what the standard library's `platform` asks."""
ALLOWED = (sys.prefix, sys.base_prefix, "/proc", "/dev", "/sys", "/etc", "/usr")


class Outcome(NamedTuple):
    """One of `FINE` or `FAILED`, and the line that tells it."""

    what: str
    line: str = ""


class Watchman:
    """An audit hook that notes programs, connections and files written outside a folder while it is on duty."""

    def __init__(self) -> None:
        """Install it; a hook cannot be removed."""
        self.place: Path | None = None
        self.seen: list[str] = []
        sys.addaudithook(self._note)

    @contextlib.contextmanager
    def on_duty(self, place: Path) -> Iterator[list[str]]:
        """Note what happens in the block."""
        self.seen, self.place = [], place
        try:
            yield self.seen
        finally:
            self.place = None

    def _note(self, event: str, arguments: tuple[Any, ...]) -> None:
        if self.place is None:
            return
        if event == "open" and isinstance(arguments[0], str | bytes):
            path, mode, flags = os.fsdecode(arguments[0]), str(arguments[1] or ""), arguments[2] or 0
            written = any(letter in mode for letter in "wax+") or flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
            own = (str(self.place), *ALLOWED, os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))
            if written and not os.path.abspath(path).startswith(own):
                self.seen.append(f"wrote {path}")
        elif event in ("os.system", "os.exec", "os.posix_spawn", "socket.connect"):
            self.seen.append(f"{event} {arguments[:1]}")
        elif event == "pickle.find_class" and str(arguments[0]) in UNPICKLED:
            self.seen.append(f"unpickled {arguments}")
        elif event == "subprocess.Popen" and os.fspath(arguments[0]) not in PROGRAMS:
            self.seen.append(f"started {arguments[0]}")


def judged(work: Callable[[], Any], watchman: Watchman, place: Path) -> Outcome:
    """Do work that is to succeed or to raise an InputError, and say what came of it."""
    from seatrial.core.errors import InputError, NumericalError

    with watchman.on_duty(place) as seen:
        try:
            work()
            found = Outcome("done")
        except (InputError, NumericalError) as error:
            found = Outcome("refused", str(error))
            if isinstance(error, InputError) and not all((error.where, error.found, error.expected, error.remedy)):
                found = Outcome("unclear", str(error))
        except BaseException as error:
            found = Outcome("traceback", told(error))
    return Outcome("escape", "; ".join(seen)) if seen else found


def mirror(number: int, random: Random, place: Path, watchman: Watchman) -> Outcome:
    """Do what an attack is to notice: nothing, a refusal, a mistake, a file outside the case's folder, a death."""
    from seatrial.core.errors import InputError

    def work() -> None:
        match number:
            case 1:
                raise InputError("here", found="this", expected="that", remedy="mend it")
            case 2:
                raise ZeroDivisionError("a mistake")
            case 3:
                place.with_name("outside").write_text("found")
            case 4:
                os.abort()

    return judged(work, watchman, place)


def command(*arguments: str) -> tuple[int, str]:
    """Run a command of seatrial in this process; returns its exit status and what it printed. A mistake of ours is raised."""
    from seatrial.__main__ import main

    printed, kept = io.StringIO(), sys.argv
    sys.argv = ["seatrial", *arguments]
    try:
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
            main()
        return 0, printed.getvalue()
    except SystemExit as ended:
        return int(ended.code or 0), printed.getvalue()
    finally:
        sys.argv = kept


def told(error: BaseException) -> str:
    """Return an exception and the last places of ours that it went through, in one line."""
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if "/seatrial/" in frame.filename]
    places = " < ".join(f"{Path(frame.filename).name}:{frame.lineno}" for frame in reversed(frames[-3:]))
    return f"{type(error).__name__}: {' '.join(str(error).split())[:160]} [{places}]"
