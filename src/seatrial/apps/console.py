"""What the command line shows: progress bars with remaining time on a terminal, a quiet line now and then when piped."""

import sys
import time
from collections.abc import Callable
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from seatrial.core.reporter import Progress as Report
from seatrial.core.reporter import remaining
from seatrial.core.visible import visible

EVERY = 10.0
"""Seconds between two lines of one piece of work, when piped."""


class ConsoleReporter:
    """A `Reporter` on standard error; standard output is left to results. `also` is told of the same progress."""

    def __init__(self, quiet: bool = False, also: Callable[[str], Report] | None = None):
        self.quiet = quiet
        self.also = also
        self.console = Console(stderr=True, highlight=False)
        self.bars = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TaskProgressColumn(),
            TimeElapsedColumn(),
            TextColumn("elapsed, remaining"),
            TimeRemainingColumn(),
            console=self.console,
            transient=False,
            disable=quiet or not self.console.is_terminal,
        )

    @contextmanager
    def watching(self):
        """Show bars while the block runs."""
        with self.bars:
            yield self

    def say(self, text: str) -> None:
        """See `Reporter.say`."""
        if not self.quiet:
            self.console.print(visible(text), markup=False, soft_wrap=True)

    def progress(self, title: str) -> Report:
        """See `Reporter.progress`."""
        shown = self._shown(visible(title))
        if self.also is None:
            return shown
        told = self.also(title)

        def both(done: int, total: int) -> None:
            shown(done, total)
            told(done, total)

        return both

    def _shown(self, title: str) -> Report:
        if self.console.is_terminal and not self.quiet:
            task = self.bars.add_task(title, total=None)
            return lambda done, total: self.bars.update(task, completed=done, total=total)
        return _Lines(title, self.say)


class _Lines:
    """Progress of one piece of work as a line at its end and every ten seconds until then; time counts from its first report."""

    def __init__(self, title: str, say: Callable[[str], None]):
        self.title, self.say = title, say
        self.started: float | None = None
        self.begun_at = 0
        self.said = 0.0
        self.finished = False

    def __call__(self, done: int, total: int) -> None:
        now = time.monotonic()
        if self.started is None:
            self.started, self.said, self.begun_at = now, now, done
        gone = now - self.started
        if done >= total and not self.finished:
            self.finished = True
            self.say(f"{self.title}: done in {gone:.1f} s")
        elif now - self.said >= EVERY and not self.finished:
            self.said = now
            seconds = remaining(gone, self.begun_at, done, total)
            left = "" if seconds is None else f", about {seconds:.0f} s remaining"
            self.say(f"{self.title}: {done / max(total, 1):.0%} after {gone:.0f} s{left}")


def fail(text: str) -> None:
    """Print an error to standard error, plain."""
    print(visible(f"error: {text}"), file=sys.stderr)
