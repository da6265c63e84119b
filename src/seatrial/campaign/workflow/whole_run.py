"""How far a whole run has come, by the seconds that its steps took before on this machine."""

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
"""Of a step's expected time, the most that counts as done before it is."""
PARTS = 1000
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
        self.before, self.took, self.now, self.began = 0.0, 0.0, "", time.monotonic()
        self.show()

    def say(self, text: str) -> None:
        """See `Reporter.say`."""
        self.reporter.say(text)

    def progress(self, title: str) -> Progress:
        """See `Reporter.progress`."""
        told = self.reporter.progress(title)

        def both(done: int, total: int) -> None:
            told(done, total)
            self.show()

        return both

    def begin(self, step: str) -> None:
        """Say which step is made now."""
        self.now, self.began = step, time.monotonic()

    def end(self) -> None:
        """Say that it is made, and learn how long it took."""
        if self.now in self.expected:
            seconds = time.monotonic() - self.began
            self.before, self.took = self.before + self.expected[self.now], self.took + seconds
            learn(self.now, seconds)
        self.now = ""
        self.show()

    def show(self) -> None:
        """Show how far the run has come; a step is as much slower than expected as those before it were."""
        if self.tell is None:
            return
        ahead, usual = self.expected.get(self.now, 0.0), UNSURE * sum(self.expected.values())
        pace = (self.took + usual) / (self.before + usual)
        done = self.before + min((time.monotonic() - self.began) / pace, SHARE * ahead)
        self.tell(round(PARTS * done / sum(self.expected.values())), PARTS)


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
