"""How far a whole run has come, by the seconds that its steps took before on this machine, and by how far the step at work has come."""

import json
import os
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from seatrial.core.engine import cache_directory
from seatrial.core.reporter import Progress, Reporter

TITLE = "whole run"
USUAL = {
    "first": 10.0,
    "trials": 1.0,
    "estimates": 30.0,
    "selection": 30.0,
    "predictions": 5.0,
    "next": 10.0,
    "contenders": 5.0,
}
"""Seconds of steps that this machine has not made yet: of the demo campaign, on two cores."""
LEAST = 0.5
"""Seconds of any other."""
SHARE = 0.95
"""Of a step's time, the most that counts as over before it is."""
PARTS = 1000
EARLY = 0.1
"""Share of a step's own bars from which they say more of its time than what it took before."""
SURE = 0.02
"""Share of one bar from which its own pace is believed."""
UNSURE = 0.25
"""Share of the whole run that the pace of its steps has to outweigh: short steps say little about long ones."""


class WholeRun:
    """A reporter that passes on what it is told, and shows one bar for all steps that are to be made.

    Args:
        reporter: to pass on to.
        steps: names of the steps to be made, in order; no bar is shown for one alone.
    """

    def __init__(self, reporter: Reporter, steps: Sequence[str]):
        self.reporter = reporter
        known = learnt()
        self.expected = {step: known.get(step, USUAL.get(step, LEAST)) for step in steps}
        self.tell = reporter.progress(TITLE) if len(steps) > 1 else None
        self.before, self.took, self.now, self.began, self.shown = 0.0, 0.0, "", time.monotonic(), 0
        self.bars: dict[str, _Bar] = {}
        self.show()

    def say(self, text: str) -> None:
        """See `Reporter.say`."""
        self.reporter.say(text)

    def progress(self, title: str) -> Progress:
        """See `Reporter.progress`."""
        told = self.reporter.progress(title)

        bar = self.bars[title] = _Bar()

        def both(done: int, total: int) -> None:
            told(done, total)
            bar.move(done / max(total, 1))
            self.show()

        return both

    def begin(self, step: str) -> None:
        """Say which step is made now."""
        self.now, self.began, self.bars = step, time.monotonic(), {}

    def end(self) -> None:
        """Say that it is made, and learn how long it took."""
        if self.now in self.expected:
            seconds = time.monotonic() - self.began
            self.before, self.took = self.before + self.expected.pop(self.now), self.took + seconds
            learn(self.now, seconds)
        self.now = ""
        self.show()

    def show(self) -> None:
        """Show how far the run has come.

        A step is as much slower than expected as those before it were; the farther it is, the more its own bars say of how long it takes,
        and no less remains of it than of any one of them. Where a step turns out to be longer than it was, the bar waits: it never goes
        back, and the time that remains grows.
        """
        if self.tell is None:
            return
        usual = UNSURE * (self.before + sum(self.expected.values()))
        pace = (self.took + usual) / (self.before + usual)
        over = time.monotonic() - self.began if self.now in self.expected else 0.0
        share = sum(bar.share for bar in self.bars.values()) / len(self.bars) if over > 0 and self.bars else 0.0
        here = pace * self.expected.get(self.now, 0.0)
        trust = share / (share + EARLY)
        here = (1.0 - trust) * here + trust * (over / share if share > 0 else 0.0)
        here = max([here, *(over + bar.remaining for bar in self.bars.values())])
        later = pace * sum(seconds for step, seconds in self.expected.items() if step != self.now)
        whole = self.took + max(here, over / SHARE) + later
        self.shown = max(self.shown, round(PARTS * (self.took + over) / whole) if whole > 0 else PARTS)
        self.tell(self.shown, PARTS)


class _Bar:
    """How far one piece of work has come, and since when it moves."""

    def __init__(self):
        self.share, self.at_first, self.since = 0.0, 0.0, 0.0

    def move(self, share: float) -> None:
        """Take note of a share; the first above 0 begins the count of its pace."""
        self.share = share
        if share > 0.0 and not self.since:
            self.at_first, self.since = share, time.monotonic()

    @property
    def remaining(self) -> float:
        """Seconds that its pace leaves, the less the earlier it is; 0 where it is over or has no pace."""
        moved = self.share - self.at_first
        if moved <= 0.0:
            return 0.0
        trust = self.share / (self.share + SURE)
        return trust * (time.monotonic() - self.since) * (1.0 - self.share) / moved


def learnt() -> dict[str, float]:
    """Return the seconds that each step took on this machine, as far as it has been made; an unreadable file knows nothing."""
    try:
        kept = json.loads(_place().read_text(encoding="utf-8"))
        return {str(step): float(seconds) for step, seconds in kept.items()}
    except (OSError, ValueError, AttributeError, TypeError):
        return {}


def learn(step: str, seconds: float) -> None:
    """Keep how long a step took, averaged with what is known of it; where nothing can be written, nothing is learnt."""
    known = learnt()
    known[step] = round(0.5 * (known.get(step, seconds) + seconds), 2)
    with suppress(OSError):  # written plainly, since no answer rests on this file
        _place().parent.mkdir(parents=True, exist_ok=True)
        beside = _place().with_suffix(f".{os.getpid()}")
        beside.write_text(json.dumps(known), encoding="utf-8")
        beside.replace(_place())


def _place() -> Path:
    return cache_directory().parent / "seconds.json"
