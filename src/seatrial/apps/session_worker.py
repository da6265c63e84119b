"""The other side of a session: it runs commands as the command line does, and between them rehearses the next step.

A rehearsal makes the step in a copy of the campaign that is thrown away, so that whatever the step imports and compiles is there when
it is asked for.
"""

import gc
import json
import logging
import os
import shutil
import signal
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

from seatrial.apps.campaign_lock import occupant_of
from seatrial.apps.cli import main
from seatrial.apps.running import Exit
from seatrial.core import engine
from seatrial.core.errors import SeatrialError
from seatrial.core.files import open_regular
from seatrial.core.processes import end_with_parent

PATIENCE = 2.0
"""Seconds that a command waits for a rehearsal to stop; then both run."""
LONGEST = 120.0
"""Seconds of a rehearsal."""
NICE = 10
"""Steps by which a rehearsal is less urgent than the rest of the machine's work."""


def answer(written: str) -> None:
    """Run the commands that come through a pipe, until it is closed or the process has grown too large.

    Args:
        written: the settings of a `Session`, as JSON.
    """
    settings = json.loads(written)
    if not settings["outlives"]:
        end_with_parent(settings["parent"])
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    engine.configure()
    folder, scratch = Path(settings["folder"]), Path(settings["scratch"])
    rehearsal = _Rehearsal(folder, scratch) if settings["prepares"] else None
    with Connection(settings["handle"]) as channel:
        while True:
            if rehearsal is not None:
                rehearsal.begin()
            try:
                asked = json.loads(channel.recv_bytes())
            except (EOFError, OSError):
                shutil.rmtree(scratch, ignore_errors=True)
                os._exit(Exit.OK)
            if not asked["words"]:
                continue
            if rehearsal is not None:
                rehearsal.stop()
            with _printing_to(asked["log"]):
                code = _run(asked["words"])
            last = _has_joined_a_cluster() or _held() > settings["memory"]
            with suppress(OSError):  # nobody waits any more
                channel.send_bytes(json.dumps({"code": code, "last": last}).encode())
            if last:
                return


def _run(words: list[str]) -> int:
    """Run one command as if it alone were run; returns its exit code."""
    sys.argv = ["seatrial", *words]
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with warnings.catch_warnings():  # each command warns anew
            main()
        return Exit.OK
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else Exit.OK if end.code is None else Exit.BUG
    except KeyboardInterrupt:
        return Exit.INTERRUPTED
    except Exception:
        traceback.print_exc()
        return Exit.BUG
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        gc.collect()


@contextmanager
def _printing_to(log: str | None) -> Iterator[None]:
    """Add what the block prints to a file; to the streams of this process where none is given."""
    if log is None:
        yield
        return
    before = {stream: os.dup(stream) for stream in (1, 2)}
    with open_regular(Path(log), "ab") as printed:
        for stream in before:
            os.dup2(printed.fileno(), stream)
    try:
        yield
    finally:
        for stream, kept in before.items():
            os.dup2(kept, stream)
            os.close(kept)


def _held() -> int:
    """Bytes of memory that this process holds; the most it has held where the system does not tell."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        import resource

        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def _has_joined_a_cluster() -> bool:
    """Whether machines are held for this process, which its end gives back."""
    place = sys.modules.get("seatrial.campaign.compute.place")
    return place is not None and place.has_joined()


class _Asked(Exception):
    """A command has come, or the time of a rehearsal is over."""


class _Rehearsal:
    """Gets the next step ready in a thread of low priority."""

    def __init__(self, folder: Path, scratch: Path):
        self.folder, self.scratch = folder.resolve(), scratch
        self.thread: threading.Thread | None = None
        self.is_stopped, self.until = threading.Event(), 0.0
        self.rehearsed: set[tuple[str, str]] = set()

    @property
    def is_at_it(self) -> bool:
        """Whether it goes on, stopped or not."""
        return self.thread is not None and self.thread.is_alive()

    def begin(self) -> None:
        """Begin, unless it is at it."""
        if not self.is_at_it:
            self.is_stopped.clear()
            self.thread = threading.Thread(target=self._run, daemon=True)
            self.thread.start()

    def stop(self) -> None:
        """Have it stop where it next tells its progress."""
        self.is_stopped.set()
        if self.thread is not None:
            self.thread.join(PATIENCE)

    def say(self, text: str) -> None:
        """See `Reporter.say`."""
        self.look(0, 0)

    def progress(self, title: str) -> Any:
        """See `Reporter.progress`."""
        self.look(0, 0)
        return self.look

    def look(self, done: int, total: int, seconds: float | None = None, /) -> None:
        """Go on only while nothing is asked."""
        if self.is_stopped.is_set() or time.monotonic() > self.until:
            raise _Asked

    def _run(self) -> None:
        import jax

        jax.devices()  # its threads have the priority of that which starts them
        if sys.platform == "linux":
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICE)
        self.until = time.monotonic() + LONGEST
        try:
            self._rehearse()
        except (_Asked, SeatrialError, OSError):
            pass  # what cannot be done says so when it is asked for
        except Exception:
            logging.getLogger(__name__).debug("the rehearsal of %s", self.folder, exc_info=True)

    def _rehearse(self) -> None:
        from seatrial.campaign.compute.place import VARIABLE
        from seatrial.campaign.config.load import load_campaign
        from seatrial.campaign.config.settings import ComputeSettings
        from seatrial.campaign.workflow.steps import Workflow

        self.look(0, 0)
        campaign = load_campaign(self.folder)
        steps = _next_steps(campaign)
        others = occupant_of(self.folder)
        if (
            not steps
            or VARIABLE in os.environ
            or (campaign.text, steps[0]) in self.rehearsed
            or (others is not None and others.alive)
        ):
            return
        with _copy_of(self.folder, self.scratch) as copy:
            flow = Workflow(replace(campaign, folder=copy, compute=ComputeSettings()), self)
            for step in steps:
                flow.get(step)
        self.rehearsed.add((campaign.text, steps[0]))


def _next_steps(campaign: Any) -> list[str]:
    """Return the first step that is not current and what its command tells beside it.

    None where all are current: looking has imported what reads them, and long records are not read for nothing.
    """
    from seatrial.campaign.workflow.steps import LOOP, Workflow

    flow = Workflow(campaign)
    listed = [step.name for step in LOOP if step.listed and not (step.name == "first" and campaign.imports is not None)]
    following = next((name for name in listed if flow.state(name) != "current"), None)
    if following is None or (following == "trials" and not campaign.is_simulated):
        return []
    return {"first": ["design", "promised"]}.get(following, [following])


@contextmanager
def _copy_of(folder: Path, scratch: Path) -> Iterator[Path]:
    """Give a folder of links to all that a campaign's has: what is written there takes the place of a link."""
    copy = Path(mkdtemp(dir=scratch)) / folder.name
    try:
        copy.mkdir()
        for path in folder.iterdir():
            if path.name != "results" and not path.name.startswith("."):
                (copy / path.name).symlink_to(path)
        for base, _, names in os.walk(folder / "results"):
            place = copy / Path(base).relative_to(folder)
            place.mkdir()
            for name in names:
                (place / name).symlink_to(Path(base, name))
        yield copy
    finally:
        shutil.rmtree(copy.parent, ignore_errors=True)
