"""What the command line shows: progress bars with remaining time on a terminal, one quiet line per step when piped."""

import sys
import time
from collections.abc import Callable
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from seatrial.sampling.target import Progress as Report


class ConsoleWatch:
    """A `Watch` on standard error; standard output is left to results."""

    def __init__(self, quiet: bool = False):
        self.quiet = quiet
        self.console = Console(stderr=True, highlight=False)
        self.bars = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TaskProgressColumn(),
            TimeElapsedColumn(),
            TextColumn("gone, left"),
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
        """See `Watch.say`."""
        if not self.quiet:
            self.console.print(text, markup=False, soft_wrap=True)

    def progress(self, title: str) -> Report:
        """See `Watch.progress`."""
        if self.console.is_terminal and not self.quiet:
            task = self.bars.add_task(title, total=None)
            return lambda done, total: self.bars.update(task, completed=done, total=total)
        return _Lines(title, self.say)


class _Lines:
    """Progress of one piece of work as one line at its end; time counts from its first report."""

    def __init__(self, title: str, say: Callable[[str], None]):
        self.title, self.say = title, say
        self.started: float | None = None
        self.finished = False

    def __call__(self, done: int, total: int) -> None:
        self.started = time.monotonic() if self.started is None else self.started
        if done >= total and not self.finished:
            self.finished = True
            self.say(f"{self.title}: done in {time.monotonic() - self.started:.1f} s")


def fail(text: str) -> None:
    """Print an error to standard error, plain."""
    print(f"error: {text}", file=sys.stderr)
