"""What the command line shows: progress bars with remaining time on a terminal, a quiet line now and then when piped."""

import sys
import time
from collections.abc import Callable
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.text import Text

from seatrial.core.reporter import Bar, duration_text, remaining
from seatrial.core.visible import visible

EVERY = 10.0  # Seconds between two lines of one piece of work, when piped
SHORT = 2.0  # Seconds of work whose end is not worth a line


class ConsoleReporter:
    """A `Reporter` on standard error; standard output is left to results. `also` is told of the same progress."""

    def __init__(self, quiet: bool = False, also: Callable[[str], Bar] | None = None):
        self.quiet = quiet
        self.also = also
        self.console = Console(stderr=True, highlight=False)
        self.bars = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TaskProgressColumn(),
            TimeElapsedColumn(),
            TextColumn("elapsed"),
            _Remaining(),
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

    def progress(self, title: str) -> Bar:
        """See `Reporter.progress`."""
        shown = self._shown(visible(title))
        if self.also is None:
            return shown
        words = self.also(title)

        def both(done: int, total: int, seconds: float | None = None, /) -> None:
            shown(done, total, seconds)
            words(done, total, seconds)

        return both

    def _shown(self, title: str) -> Bar:
        if not self.console.is_terminal or self.quiet:
            return _Lines(title, self.say)
        task, began = self.bars.add_task(title, total=None), []

        def told(done: int, total: int, seconds: float | None = None, /) -> None:
            if not began:
                began.append((time.monotonic(), done))
            now = time.monotonic()
            self.bars.update(task, completed=done, total=total, began=began[0], heard=now, seconds=seconds)

        return told


class _Remaining(ProgressColumn):
    """The remaining time of a piece of work, as it says or at its pace, in the words of the lines and of the dashboard."""

    def render(self, task: Task) -> Text:
        """Return it; nothing before it is known and after the end."""
        seconds = task.fields.get("seconds")
        if seconds is None and task.total:
            (began, begun_at), heard = task.fields["began"], task.fields["heard"]
            silent = time.monotonic() - heard
            seconds = remaining(heard - began, begun_at, int(task.completed), int(task.total), silent)
        return Text("" if seconds is None or task.finished else f"about {duration_text(seconds)} remaining")


class _Lines:
    """Progress of one piece of work in lines: every ten seconds and, if it took over two, at its end; timed from its first report."""

    def __init__(self, title: str, say: Callable[[str], None]):
        self.title, self.say = title, say
        self.started: float | None = None
        self.begun_at = 0
        self.shown_at = 0.0
        self.finished = False

    def __call__(self, done: int, total: int, seconds: float | None = None, /) -> None:
        now = time.monotonic()
        if self.started is None:
            self.started, self.shown_at, self.begun_at = now, now, done
        gone = now - self.started
        if done >= total and not self.finished:
            self.finished = True
            if gone > SHORT:
                self.say(f"{self.title}: done in {gone:.1f} s")
        elif now - self.shown_at >= EVERY and not self.finished:
            self.shown_at = now
            seconds = remaining(gone, self.begun_at, done, total) if seconds is None else seconds
            left = "" if seconds is None else f", about {seconds:.0f} s remaining"
            self.say(f"{self.title}: {done / max(total, 1):.0%} after {gone:.0f} s{left}")


def fail(text: str) -> None:
    """Print an error to standard error, plain."""
    print(visible(f"error: {text}"), file=sys.stderr)
