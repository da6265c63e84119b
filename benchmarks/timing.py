"""Timing on a machine that is never quite idle: medians and minima over repeats that alternate between competitors."""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np


class Row(NamedTuple):
    """One line of the table: what was measured, on how many cores, and its median and minimum."""

    group: str
    what: str
    cores: int
    unit: str
    median: float
    minimum: float


class Ratio(NamedTuple):
    """A number that should not depend on the machine, from minima, and the bound it is held to, if any."""

    group: str
    what: str
    cores: int
    value: float
    at_most: float | None = None
    at_least: float | None = None

    @property
    def verdict(self) -> str:
        """Whether the bound is met, in a word."""
        if self.at_most is not None:
            return (
                f"met (at most {self.at_most:g})"
                if self.value <= self.at_most
                else f"MISSED (at most {self.at_most:g})"
            )
        if self.at_least is not None:
            return (
                f"met (at least {self.at_least:g})"
                if self.value >= self.at_least
                else f"MISSED (at least {self.at_least:g})"
            )
        return ""


def alternate(runs: dict[str, Callable[[], Any]], repeats: int, warm_up: bool = True) -> dict[str, np.ndarray]:
    """Seconds of each run, shape (repeats,), one after the other in turn, after one call that is not counted if `warm_up`."""
    for run in runs.values() if warm_up else ():
        run()
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(repeats):
        for name, run in runs.items():
            start = time.perf_counter()
            run()
            seconds[name].append(time.perf_counter() - start)
    return {name: np.array(values) for name, values in seconds.items()}


def processor_seconds(run: Callable[[], Any], repeats: int) -> tuple[Any, float, np.ndarray]:
    """Return the answer, and processor seconds of the first call, with what it compiles, and of later ones, shape (repeats,)."""
    spent, answer = [], None
    for _ in range(repeats + 1):
        start = time.process_time()
        answer = run()
        spent.append(time.process_time() - start)
    return answer, spent[0], np.array(spent[1:])


def row(group: str, what: str, cores: int, unit: str, seconds: np.ndarray, per: float) -> Row:
    """Row of seconds in units of `per` seconds: 1e-9 * lanes * steps for ns per lane and step."""
    return Row(group, what, cores, unit, float(np.median(seconds)) / per, float(seconds.min()) / per)


def agree(what: str, ours: np.ndarray, theirs: np.ndarray, tolerance: float, relative: bool = False) -> None:
    """Check that two competitors computed the same numbers.

    Raises:
        SystemExit: they did not; a faster wrong answer is no benchmark.
    """
    difference = np.abs(ours - theirs) / (np.abs(ours) if relative else 1.0)
    worst = float(np.max(difference)) if np.isfinite(difference).all() else float("nan")
    if not worst <= tolerance:
        raise SystemExit(f"benchmarks: {what} differ by {worst:.3g}, more than {tolerance:g}: the times mean nothing")
