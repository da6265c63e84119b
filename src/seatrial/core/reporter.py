"""How a campaign tells what it is doing; the command line implements it, and `SilentReporter` says nothing."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Protocol, TypeVar

from seatrial.core.argument_checks import shown
from seatrial.core.errors import InputError
from seatrial.core.processes import cores

Result = TypeVar("Result")
Progress = Callable[[int, int], None]  # Called with the work done and the work in all


class Bar(Protocol):
    """A `Progress` that may be given the remaining time, s, by a whole run: it knows steps that have not begun."""

    def __call__(self, done: int, total: int, seconds: float | None = None, /) -> None:
        """Take note of the work done and the work in all."""
        ...


class Reporter(Protocol):
    """Receives what happens."""

    def say(self, text: str) -> None:
        """One line of result."""
        ...

    def progress(self, title: str) -> Bar:
        """Begin a long piece of work; call the result with (done, total)."""
        ...


class SilentReporter:
    """A reporter that says nothing."""

    def say(self, text: str) -> None:
        """See `Reporter.say`."""

    def progress(self, title: str) -> Bar:
        """See `Reporter.progress`."""
        return lambda done, total, seconds=None, /: None


MIN_PACE_SHARE = 0.02  # Share of a piece of work from which its pace is believed: before, what was compiled weighs more


# Share of the time since the last report that is still expected at least: what took so long without a word is not over
# at once.
SILENT_SHARE = 0.25


def remaining(seconds: float, begun_at: int, done: int, total: int, silent: float = 0.0) -> float | None:
    """Return the time that a piece of work still takes at its pace, s; None if that is not known yet.

    Args:
        seconds: from its first report to its last.
        begun_at: work done at the first.
        done: work done.
        total: work in all.
        silent: seconds since the last report.
    """
    made = done - begun_at
    if made <= 0 or made < MIN_PACE_SHARE * total:
        return None
    return max(seconds * (total - done) / made - silent, SILENT_SHARE * silent)


def duration_text(seconds: float) -> str:
    """Write a time as seconds, minutes or hours."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def no_progress(done: int, total: int) -> None:
    """Tell nobody."""


def check_progress(progress: Any) -> None:
    """Check, before anything is computed, that progress can be told.

    Raises:
        InputError: something that cannot be called.
    """
    if not callable(progress):
        raise InputError(
            "progress",
            found=shown(progress),
            expected="a function of the work done and the work in all",
            remedy="leave it out, or write for example lambda done, total: print(done, total)",
        )


SILENT = SilentReporter()


def run_side_by_side(tasks: Sequence[Callable[[], Result]]) -> list[Result]:
    """Run independent tasks on all cores and return their results in order.

    Compiled code releases the interpreter, so threads are enough. Every task draws from its own key: the results do not
    depend on how many run at once.
    """
    with ThreadPoolExecutor(max_workers=min(len(tasks), cores()) or 1) as pool:
        futures = [pool.submit(task) for task in tasks]
        try:
            return [future.result() for future in futures]
        except BaseException:
            pool.shutdown(cancel_futures=True, wait=False)
            raise
