"""A set run through: every method fitted once, every held-back run predicted in every task, and what came of it as one result."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy

from benchmarks.public.method import Fitted, Method, Problem
from benchmarks.public.scores import PooledScore, RunScore, pool, score_run
from benchmarks.public.set_file import BenchmarkSet, campaign_of
from benchmarks.public.simulated import make_records
from benchmarks.public.tasks import TASKS, stretches
from seatrial import __version__
from seatrial.campaign.data.import_logs import import_trials
from seatrial.core.errors import InputError, SeatrialError
from seatrial.core.reporter import SILENT, Reporter

SCHEMA = 1
"""Number of the format of `result.json`."""
TIE = 0.01
"""Relative difference of two CRPS up to which they count as equal."""
UNLIKELY = 0.05
"""Probability below which chance is not taken for the reason of a difference."""
FEWEST_RUNS = 3
"""Held-back runs from which their spread says what chance does."""


@dataclass(frozen=True)
class Entry:
    """One method on one set.

    Attributes:
        method: its name.
        words: what it is.
        is_ours: whether it is this package's model.
        seconds_fit: s.
        seconds_predict: s, of all tasks.
        failed: why it could not be fitted or did not predict; empty if it did.
        note: what belongs to its results.
        about: parameters or coefficients, SI.
        about_sd: their standard deviations, SI, as far as they are stated.
        runs: scores of each run and channel, by task.
        pooled: scores of each channel over all held-back runs, by task.
    """

    method: str
    words: str
    is_ours: bool
    seconds_fit: float
    seconds_predict: float
    failed: str
    note: str
    about: Mapping[str, float]
    about_sd: Mapping[str, float]
    runs: Mapping[str, tuple[RunScore, ...]]
    pooled: Mapping[str, tuple[PooledScore, ...]]


class KnownCoefficient(NamedTuple):
    """A coefficient that a set knows, as a method found it: value and standard deviation, if stated, and what is known, SI."""

    method: str
    name: str
    value: float
    sd: float | None
    known: float


@dataclass(frozen=True)
class Result:
    """A set with the entries of all methods.

    Attributes:
        set: that was run.
        channels: with the SI unit of each.
        entries: one for each method.
        coefficient_units: SI unit of every coefficient of the campaign.
    """

    set: BenchmarkSet
    channels: Mapping[str, str]
    entries: tuple[Entry, ...]
    coefficient_units: Mapping[str, str]

    def beaten(self) -> list[str]:
        """Where our entry is not the best, in words: by task and channel the methods whose CRPS is lower by more than a hundredth."""
        sentences = []
        for ours in (one for one in self.entries if one.is_ours):
            if ours.failed:
                sentences.append(f"{ours.method}: {ours.failed}")
                continue
            for task in TASKS:
                for column, channel in enumerate(self.channels):
                    sentences += self._beaten(ours, task.name, column, channel)
        return sentences

    def _beaten(self, ours: Entry, task: str, column: int, channel: str) -> list[str]:
        own = ours.pooled[task][column].crps
        others = {
            one.method: one.pooled[task][column].crps for one in self.entries if not one.is_ours and not one.failed
        }
        better = {
            name: crps for name, crps in others.items() if crps is not None and (own is None or crps < own * (1 - TIE))
        }
        if not better:
            return []
        names = ", ".join(
            f"{name} ({crps:.3g}{self._by_chance(ours, name, task, channel)})"
            for name, crps in sorted(better.items(), key=lambda one: one[1])
        )
        has = "diverges" if own is None else f"has a CRPS of {own:.3g} {self.channels[channel]}"
        return [f"{ours.method}, {task}, {channel}: {has} and does not beat {names}"]

    def _by_chance(self, ours: Entry, name: str, task: str, channel: str) -> str:
        """Say how likely chance alone makes the other so much better, where three runs or more tell."""
        other = next(one for one in self.entries if one.method == name)
        pairs = [
            (own.crps - one.crps, one.samples)
            for own, one in zip(ours.runs[task], other.runs[task], strict=True)
            if one.channel == channel and own.crps is not None and one.crps is not None
        ]
        if len(pairs) < FEWEST_RUNS:
            return ""
        chance = chance_of(*np.array(pairs).T)
        return f", p = {chance:.2g}" if chance < UNLIKELY else f", which may be chance: p = {chance:.2g}"

    def coefficients(self) -> list["KnownCoefficient"]:
        """Return what each method found of the coefficients that the set knows."""
        return [
            KnownCoefficient(entry.method, name, entry.about[name], entry.about_sd.get(name), known)
            for entry in self.entries
            for name, known in self.set.known.items()
            if name in entry.about
        ]

    def as_json(self) -> dict:
        """Return all of it as plain data; `docs/dev/benchmark.md` tells the keys."""
        benchmark_set = self.set
        return {
            "format": SCHEMA,
            "seatrial": __version__,
            "set": {
                "name": benchmark_set.name,
                "title": benchmark_set.title,
                "vehicle": benchmark_set.vehicle,
                "source": dict(benchmark_set.source),
                "files": dict(benchmark_set.files),
                "fit": list(benchmark_set.fit),
                "held_back": list(benchmark_set.held_back),
                "horizon_s": benchmark_set.horizon,
                "known": dict(benchmark_set.known),
            },
            "channels": dict(self.channels),
            "tasks": {task.name: task.words for task in TASKS},
            "entries": [_plain(asdict(entry)) for entry in self.entries],
            "coefficients": [
                _plain(dict(zip(("method", "name", "value", "sd", "known"), one, strict=True)))
                for one in self.coefficients()
            ],
            "not_beaten": self.beaten(),
        }


def chance_of(differences: np.ndarray, samples: np.ndarray) -> float:
    """Return the probability that chance alone makes the mean of differences so large, by how they differ between runs (Student's t).

    Args:
        differences: of two methods' CRPS, one for each run.
        samples: of each run, which weigh it.
    """
    weights, count = samples / samples.sum(), len(samples)
    total = float(weights @ differences)
    variance = count / (count - 1) * float(np.sum((weights * (differences - total)) ** 2))
    return float(scipy.stats.t.sf(total / np.sqrt(variance), count - 1)) if variance > 0 else float(total <= 0)


def run_set(
    benchmark_set: BenchmarkSet, methods: Sequence[Method], data: Path | None, out: Path, reporter: Reporter = SILENT
) -> Result:
    """Fit methods to a set and score them on its held-back runs.

    Args:
        benchmark_set: set.
        methods: those that are run.
        data: folder of the set's files; None where its runs are made.
        out: folder of results; the campaign of the set and its records lie in a folder of the set's name below it.
        reporter: told how far it has come.

    Raises:
        InputError: a file of the set that is missing or wrong, a campaign that cannot be read, or no data folder.
    """
    folder = out / benchmark_set.name
    if benchmark_set.made is not None:
        data = folder / "records"
        make_records(benchmark_set, data)
    elif data is None:
        raise InputError(
            f'set "{benchmark_set.name}"',
            found="no data folder",
            expected="the folder of its files",
            remedy=f"give --data FOLDER or set SEATRIAL_DATA; {benchmark_set.source['get']} Licence: {benchmark_set.source['licence']}.",
        )
    campaign = campaign_of(benchmark_set, data, folder)
    trials = import_trials(campaign, reporter)
    problem, units = Problem(campaign, trials, reporter), campaign.model(campaign.full).channel_units()
    entries = tuple(_entry(problem, method, benchmark_set.horizon) for method in methods)
    return Result(benchmark_set, {channel: units[channel] for channel in campaign.channels}, entries, campaign.units)


def _entry(problem: Problem, method: Method, horizon: float) -> Entry:
    """Fit one method and score it; what it cannot do is kept in words."""
    began = time.perf_counter()
    tell = problem.reporter.progress(method.name)
    total = len(problem.trials.predict) * len(TASKS)
    tell(0, total + 1)
    runs: dict[str, tuple[RunScore, ...]] = {}
    fitted: Fitted | None = None
    fitted_at, failed = began, ""
    try:
        fitted = method.fit(problem)
        fitted_at = time.perf_counter()
        done = 1
        for task in TASKS:
            scores: list[RunScore] = []
            for record in problem.trials.predict:
                pieces = stretches(task, record, problem.channels, horizon)
                predicted = fitted.predict(record, pieces)
                scores += [
                    score_run(
                        record.label,
                        channel,
                        record.time,
                        record.channel(channel),
                        predicted.mean[:, j],
                        predicted.sd[:, j],
                    )
                    for j, channel in enumerate(problem.channels)
                ]
                done += 1
                tell(done, total + 1)
            runs[task.name] = tuple(scores)
    except (SeatrialError, np.linalg.LinAlgError) as error:
        failed = "; ".join(line.strip() for line in str(error).splitlines() if line.strip())
        tell(total + 1, total + 1)
    ended = time.perf_counter()
    pooled = (
        {}
        if failed
        else {
            task: tuple(pool([one for one in scores if one.channel == channel]) for channel in problem.channels)
            for task, scores in runs.items()
        }
    )
    return Entry(
        method.name,
        method.words,
        method.is_ours,
        (fitted_at if fitted is not None else ended) - began,
        ended - fitted_at if fitted is not None else 0.0,
        failed,
        "" if fitted is None else fitted.note,
        {} if fitted is None else dict(fitted.about),
        {} if fitted is None else dict(fitted.about_sd),
        {} if failed else runs,
        pooled,
    )


def _plain(value):
    """Return plain data with None where a number is not finite."""
    if isinstance(value, Mapping):
        return {key: _plain(one) for key, one in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(one) for one in value]
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return value
