"""What a method of the benchmark is: something fitted to runs, which predicts others with a standard deviation.

A method that only knows means gets its standard deviations from what it leaves of the runs that it was fitted to, by how far ahead it
predicts (`with_spread`), so that a baseline is not beaten for want of an error bar.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from jaxtyping import Float

from benchmarks.public.tasks import Stretch, leads
from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.data.import_logs import Trials
from seatrial.core.record import Record
from seatrial.core.reporter import Reporter

SMALLEST = 1e-9
"""Least standard deviation that is stated, in ranges of the channel."""


@dataclass(frozen=True, eq=False)
class Problem:
    """What a method is fitted to.

    Attributes:
        campaign: of the set: vehicle, priors, seed.
        trials: records; those under `predict` are held back and no method may look at their measurements.
        reporter: told how far it has come.
    """

    campaign: Campaign
    trials: Trials
    reporter: Reporter

    @property
    def records(self) -> tuple[Record, ...]:
        """Runs to fit."""
        return self.trials.fit

    @property
    def channels(self) -> tuple[str, ...]:
        """Measured channels to predict."""
        return self.campaign.channels

    @property
    def controls(self) -> tuple[str, ...]:
        """What drives the vehicle, given motions included; known at every sample of every run."""
        return self.trials.fit[0].controls


@dataclass(frozen=True, eq=False)
class Predicted:
    """One run as predicted: means and standard deviations, noise included, SI, NaN where nothing is predicted, shape (n, m)."""

    mean: Float[np.ndarray, "n m"]
    sd: Float[np.ndarray, "n m"]


class Fitted(Protocol):
    """A method that was fitted."""

    @property
    def about(self) -> Mapping[str, float]:
        """Coefficients or parameters, SI, by name."""
        ...

    @property
    def about_sd(self) -> Mapping[str, float]:
        """Standard deviations of these, SI, as far as they are stated."""
        ...

    @property
    def note(self) -> str:
        """What belongs to its results, in a few words; empty if nothing does."""
        ...

    def predict(self, record: Record, stretches: Sequence[Stretch]) -> Predicted:
        """Predict all channels of the problem along stretches of a run, from its controls and the measurements up to each start."""
        ...


@dataclass(frozen=True)
class Method:
    """One method.

    Attributes:
        name: in tables and on the command line.
        words: what it is.
        is_ours: whether it is this package's model, or something that the model has to beat.
        fit: fits it to the runs of a problem.

            Raises:
                InputError: it cannot be fitted to these runs, or a library that it needs is not installed.
        is_slow: whether it takes many times as long as others, and is run only where it is asked for by name.
    """

    name: str
    words: str
    is_ours: bool
    fit: Callable[[Problem], Fitted]
    is_slow: bool = False


Means = Callable[[Record, Sequence[Stretch]], Float[np.ndarray, "n m"]]
"""Means of all channels along stretches of a run, NaN where nothing is predicted, or nothing is known of a channel."""


@dataclass(frozen=True, eq=False)
class _Spread:
    """Means of a method, with standard deviations from what they leave of the fitted runs."""

    means: Means
    records: Sequence[Record]
    channels: Sequence[str]
    about: Mapping[str, float]
    note: str
    about_sd: Mapping[str, float] = field(default_factory=dict)
    _kept: dict[int, np.ndarray] = field(default_factory=dict)

    def predict(self, record: Record, stretches: Sequence[Stretch]) -> Predicted:
        """See `Fitted`."""
        lead = leads(stretches, record.time.size)
        longest = int(max(end - begin for begin, end in stretches))
        sd = self._sd(longest, whole=len(stretches) == 1)
        return Predicted(
            self.means(record, stretches), np.where(lead[:, None] > 0, sd[np.minimum(lead, len(sd) - 1)], np.nan)
        )

    def _sd(self, longest: int, whole: bool) -> np.ndarray:
        """Standard deviation by lead: one for all of a whole run, else the root mean square over all stretches, shape (leads, m)."""
        key = 0 if whole else longest
        if key not in self._kept:
            self._kept[key] = self._measured_sd(longest, whole)
        return self._kept[key]

    def _measured_sd(self, longest: int, whole: bool) -> np.ndarray:
        count, squares = np.zeros((longest + 1, len(self.channels))), np.zeros((longest + 1, len(self.channels)))
        extent = np.zeros(len(self.channels))
        for record in self.records:
            measured = np.column_stack([record.channel(channel) for channel in self.channels])
            extent = np.fmax(extent, np.nanmax(measured, 0) - np.nanmin(measured, 0))
            last = record.time.size - 1
            pieces = [(0, last)] if whole else [(a, min(a + longest, last)) for a in _begins(measured, longest)]
            left, lead = measured - self.means(record, pieces), leads(pieces, record.time.size)
            there = np.isfinite(left) & (lead[:, None] > 0)
            at = np.zeros_like(lead) if whole else lead
            np.add.at(count, at, there)
            np.add.at(squares, at, np.where(there, left**2, 0.0))
        if whole:
            count, squares = count[:1], squares[:1]
        else:
            count, squares = count[1:], squares[1:]
            window = max(1, longest // 10)
            count, squares = (_running_sum(column, window) for column in (count, squares))
        with np.errstate(invalid="ignore", divide="ignore"):
            sd = np.maximum(np.sqrt(squares / count), SMALLEST * extent)
        sd = np.where(np.isfinite(sd), sd, np.nanmax(np.where(np.isfinite(sd), sd, 0.0), 0))
        return sd if whole else np.vstack([sd[:1], sd])


def with_spread(problem: Problem, means: Means, about: Mapping[str, float], note: str = "") -> Fitted:
    """Return a fitted method of which only the means are known; its errors on the fitted runs are its standard deviations.

    Args:
        problem: whose runs were fitted.
        means: of any run along stretches of it.
        about: parameters by name, SI.
        note: see `Fitted`.
    """
    return _Spread(means, problem.records, problem.channels, about, note)


def _begins(measured: np.ndarray, longest: int) -> list[int]:
    """Samples about every stretch's length apart at which all channels are measured; at most some hundreds."""
    rows = np.flatnonzero(np.isfinite(measured).all(1))
    rows = rows[rows < len(measured) - 1]
    apart = max(longest, len(measured) // 500, 1)
    chosen = np.searchsorted(rows, np.arange(rows[0], rows[-1] + 1, apart)) if rows.size else []
    return [int(rows[k]) for k in dict.fromkeys(chosen) if k < rows.size]


def _running_sum(columns: np.ndarray, window: int) -> np.ndarray:
    """Return sums over a centred window of rows, which narrows towards both ends."""
    total = np.vstack([np.zeros((1, columns.shape[1])), np.cumsum(columns, 0)])
    at = np.arange(len(columns))
    half = np.minimum(window // 2, np.minimum(at, at[::-1]))
    return total[at + half + 1] - total[at - half]
