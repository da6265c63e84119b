"""How far a whole run has come, by the seconds that its steps took before on this machine, and by how far the step at work has come."""

import json
import os
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from seatrial.campaign.workflow.steps import STEPS, Workflow
from seatrial.compiled.engine import cache_directory, seconds_of_compiling
from seatrial.core.reporter import Bar, Reporter, duration_text, remaining

if TYPE_CHECKING:
    from seatrial.campaign.config.campaign import Campaign
    from seatrial.campaign.data.import_logs import Trials

TITLE = "whole run"
# Seconds of steps that this machine has not made yet: of the demo campaign, on two cores
USUAL_SECONDS = {
    "first": 10.0,
    "trials": 1.0,
    "estimates": 30.0,
    "selection": 30.0,
    "predictions": 5.0,
    "next": 10.0,
    "contenders": 5.0,
}
LEAST_SECONDS = 0.5  # Seconds of any other
MAX_STEP_SHARE = 0.95  # Of a step's time, the most that counts as over before it is
BAR_PARTS = 1000
EARLY_SHARE = 0.1  # Share of a step's own bars from which they say more of its time than what it took before
SILENT_SHARE = 0.2  # Likewise, more of a step whose bars say nothing
EVERY = 1.0  # Seconds between two looks while no step reports anything
SIZED_STEPS = ("estimates", "selection")  # Steps whose time grows with the work of a likelihood
LEAST_SAID = 2.0  # Seconds of work from which how long it takes is said before
MAX_COMPILING = 0.2  # Share of the time, beyond which it says nothing of the next time
MAX_KEPT = 1000  # Steps and campaigns of which the file keeps the seconds
DEMO_SIZE = 6000  # Samples times states of the demo campaign, over its four structures
# Share of the whole run that the pace of its steps has to outweigh: short steps say little about long ones
UNSURE_SHARE = 0.25


class WholeRun:
    """A reporter that passes on what it is told, and shows one bar for all steps that are to be made.

    Args:
        reporter: to pass on to.
        steps: names of the steps to be made, in order; no bar is shown for one alone.
    """

    def __init__(self, reporter: Reporter, steps: Sequence[str]):
        self.reporter = reporter
        self.size, self.expected = 1.0, expected_seconds(steps)
        self.tell = reporter.progress(TITLE) if len(steps) > 1 else None
        self.before, self.took, self.now, self.began, self.shown = 0.0, 0.0, "", time.monotonic(), 0
        self.heard = self.began
        self.bars: dict[str, _Bar] = {}
        self.guard, self.is_over = threading.RLock(), threading.Event()
        self.show()

    def __enter__(self) -> "WholeRun":
        """Show from here on how the time goes by, also while a step reports nothing."""
        if self.tell is not None:
            threading.Thread(target=self._watch, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self.is_over.set()

    def _watch(self) -> None:
        while not self.is_over.wait(EVERY):
            self.show()

    def resize(self, size: float) -> None:
        """Expect steps to take longer by the work of a likelihood, of which `size_of` says how large it is."""
        with self.guard:
            for step in self.expected.keys() & set(SIZED_STEPS):
                self.expected[step] *= size / self.size
            self.size = size

    def say(self, text: str) -> None:
        """See `Reporter.say`."""
        self.reporter.say(text)

    def progress(self, title: str) -> Bar:
        """See `Reporter.progress`."""
        inner = self.reporter.progress(title)
        with self.guard:
            bar = self.bars[title] = _Bar()

        def both(done: int, total: int, seconds: float | None = None, /) -> None:
            inner(done, total, seconds)
            with self.guard:
                bar.move(done, total)
                self.heard = bar.heard
            self.show()

        return both

    def begin(self, step: str) -> None:
        """Return which step is made now."""
        with self.guard:
            self.now, self.began, self.bars = step, time.monotonic(), {}

    def end(self) -> None:
        """Report that it is made, and learn how long it took."""
        with self.guard:
            if self.now in self.expected:
                seconds = time.monotonic() - self.began
                self.before, self.took = self.before + self.expected.pop(self.now), self.took + seconds
                learn(self.now, seconds / (self.size if self.now in SIZED_STEPS else 1.0))
            self.now = ""
        self.show()

    def show(self) -> None:
        """Show how far the run has come, and the time that remains.

        A step is as much slower than expected as those before it were; the farther it is, the more its own bars say of how long it takes,
        and no less remains of it than of any one of them. Where a step turns out to be longer than it was, the bar waits: it never goes
        back, and the time that remains grows.
        """
        if self.tell is None:
            return
        with self.guard:
            self._show(self.tell)

    def _show(self, tell: Bar) -> None:
        usual = UNSURE_SHARE * (self.before + sum(self.expected.values()))
        # Steps that took no time on this machine say nothing of a pace.
        pace = (self.took + usual) / (self.before + usual) if self.before + usual > 0.0 else 1.0
        over = time.monotonic() - self.began if self.now in self.expected else 0.0
        share = sum(bar.share for bar in self.bars.values()) / len(self.bars) if over > 0 and self.bars else 0.0
        trust, here = share / (share + EARLY_SHARE), pace * self.expected.get(self.now, 0.0)
        here = (1.0 - trust) * here + trust * ((self.heard - self.began) / share if share > 0 else 0.0)
        # It is never over at once: the time that remains falls, and grows again if nothing is heard.
        least = over * (1.0 / MAX_STEP_SHARE + SILENT_SHARE * (1.0 - share))
        here = max([here, least, *(over + bar.remaining for bar in self.bars.values())])
        later = pace * sum(seconds for step, seconds in self.expected.items() if step != self.now)
        whole = self.took + here + later
        self.shown = max(self.shown, round(BAR_PARTS * (self.took + over) / whole) if whole > 0 else BAR_PARTS)
        tell(self.shown, BAR_PARTS, whole - self.took - over)


class _Bar:
    """How far one piece of work has come, and since when it reports."""

    def __init__(self):
        self.done, self.total, self.begun_at, self.since, self.heard = 0, 1, 0, None, 0.0

    def move(self, done: int, total: int) -> None:
        """Take note of the work done; the first report begins the count of its pace."""
        self.heard = time.monotonic()
        if self.since is None:
            self.begun_at, self.since = done, self.heard
        self.done, self.total = done, max(total, 1)

    @property
    def share(self) -> float:
        """Share of its work that is done."""
        return self.done / self.total

    @property
    def remaining(self) -> float:
        """Seconds that its pace leaves, as its own line says; 0 if it is over or has no pace yet."""
        if self.since is None:
            return 0.0
        silent = time.monotonic() - self.heard
        return remaining(self.heard - self.since, self.begun_at, self.done, self.total, silent) or 0.0


def size_of(campaign: "Campaign", trials: "Trials") -> float:
    """Return the work of one likelihood of every structure, in that of the demo campaign: samples times states."""
    samples = sum(record.time.size for record in trials.fit)
    return len(campaign.structures) * len(campaign.model(campaign.full).states) * samples / DEMO_SIZE


def expected_seconds(steps: Sequence[str], size: float = 1.0) -> dict[str, float]:
    """Return how long steps take on this machine by what they took before, for a likelihood of such a size."""
    known = learnt()
    seconds = {step: known.get(step, USUAL_SECONDS.get(step, LEAST_SECONDS)) for step in steps}
    return {step: one * (size if step in SIZED_STEPS else 1.0) for step, one in seconds.items()}


@contextmanager
def timed(flow: Workflow, reporter: Reporter, step: str, of: str = "") -> Iterator[None]:
    """Return how long work takes by what it took in this campaign before, and keep how long it takes now.

    The first time nothing is said, and nothing is said or kept if the step is current. Work that compiles programs takes longer than it
    will the next time, and is not kept.

    Args:
        flow: steps of the campaign, none of them made yet.
        reporter: told before the work begins.
        step: that takes most of the time.
        of: what else the time depends on, such as a number of vehicles.
    """
    if STEPS[step].files and flow.state(step) == "current":
        yield
        return
    name, began, compiled = f"{step} {of} {flow.campaign.folder.resolve()}", time.monotonic(), seconds_of_compiling()
    if (seconds := learnt().get(name, 0.0)) >= LEAST_SAID:
        reporter.say(f"about {duration_text(seconds)}, by its earlier time in this campaign")
    yield
    seconds = time.monotonic() - began
    if seconds_of_compiling() - compiled <= MAX_COMPILING * seconds:
        learn(name, seconds)


def learnt() -> dict[str, float]:
    """Return the seconds that each step took on this machine for a likelihood of size 1; an unreadable file knows nothing."""
    try:
        kept = json.loads(_place().read_text(encoding="utf-8"))
        return {str(step): float(seconds) for step, seconds in kept.items()}
    except (OSError, ValueError, AttributeError, TypeError):
        return {}


def learn(step: str, seconds: float) -> None:
    """Keep how long a step took, averaged with what is known of it; where nothing can be written, nothing is learnt."""
    known = learnt()
    known[step] = round(0.5 * (known.pop(step, seconds) + seconds), 2)  # the newest last
    known = dict(list(known.items())[-MAX_KEPT:])
    with suppress(OSError):  # written plainly, since no answer rests on this file
        _place().parent.mkdir(parents=True, exist_ok=True)
        beside = _place().with_suffix(f".{os.getpid()}")
        beside.write_text(json.dumps(known), encoding="utf-8")
        beside.replace(_place())


def _place() -> Path:
    return cache_directory().parent / "seconds.json"
