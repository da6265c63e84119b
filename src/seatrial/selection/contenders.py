"""The two most probable structures side by side, as a result: by how much their motions differ, and what a trial would tell."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Float

from seatrial.core.findings import Finding, Value
from seatrial.core.serialise import AS_LIST
from seatrial.selection.structures import Structure
from seatrial.selection.verdict import Selection

STANDING = 3.0  # Nats of evidence within which structures stand beside the best
BAND_WIDTH = 3.29  # Width of a 90 % band over its standard deviation


@dataclass(frozen=True, eq=False)
class SpeedDifference:
    """By how much a velocity of the best structure exceeds the runner-up's in one manoeuvre, SI.

    Attributes:
        words: which manoeuvre.
        excitation: standard deviation of its control.
        time: samples that are kept, s.
        best: velocity through the water of the best, posterior mean.
        difference: excess at the posterior means.
        lower: lower end of its 90 % band, both posteriors drawn independently.
        upper: upper end.
        largest: largest difference at any sample.
        rms: its root mean square.
    """

    words: str
    excitation: float
    time: Annotated[Float[np.ndarray, " n"], AS_LIST]
    best: Annotated[Float[np.ndarray, " n"], AS_LIST]
    difference: Annotated[Float[np.ndarray, " n"], AS_LIST]
    lower: Annotated[Float[np.ndarray, " n"], AS_LIST]
    upper: Annotated[Float[np.ndarray, " n"], AS_LIST]
    largest: float
    rms: float


@dataclass(frozen=True, eq=False)
class Contenders:
    """The best structure and the runner-up.

    Attributes:
        best: the most probable structure.
        runner_up: the next.
        channel: the velocity that is compared.
        noise: standard deviation of the residuals of its sensor, SI; NaN if it is not measured.
        manoeuvres: the fitted records, and then the next trial.
        amplitude: of the designs of the best family, SI.
        period: of them, s.
        expected_nats: log Bayes factor expected of each; NaN if a limit is broken.
        trial: the design that would tell most, in words.
    """

    best: Structure
    runner_up: Structure
    channel: str
    noise: float
    manoeuvres: tuple[SpeedDifference, ...]
    amplitude: Annotated[Float[np.ndarray, " A"], AS_LIST]
    period: Annotated[Float[np.ndarray, " P"], AS_LIST]
    expected_nats: Annotated[Float[np.ndarray, "A P"], AS_LIST]
    trial: str

    @property
    def labels(self) -> tuple[str, str]:
        """Best and runner-up."""
        return self.best.label, self.runner_up.label

    @property
    def decisive(self) -> tuple[int, int]:
        """Indices of the amplitude and the period that would tell most."""
        return largest_of(self.expected_nats)

    @property
    def nats(self) -> float:
        """Expected log Bayes factor of that design."""
        return float(self.expected_nats[self.decisive])

    def disagreements(self, selection: Selection) -> list[Finding]:
        """Return whether the two predict the next trial differently and the data do not separate them."""
        probability = dict(zip([one.label for one in selection.structures], selection.probability, strict=True))
        first, second = (float(probability[label]) for label in self.labels)
        if second < np.exp(-STANDING) * first:
            return []
        weights = dict(zip(self.labels, (first / (first + second), second / (first + second)), strict=True))
        one = self.manoeuvres[-1]
        sd = np.hypot(np.nan_to_num(self.noise), (one.upper - one.lower) / BAND_WIDTH)
        means = [one.best[:, None], (one.best - one.difference)[:, None]]
        return disagreements(weights, means, sd[:, None], [self.channel], trial=one.words)

    @property
    def shown(self) -> tuple[SpeedDifference, SpeedDifference]:
        """Manoeuvres worth a picture: the fitted record of most excitation, and the next trial."""
        *records, trial = self.manoeuvres
        return max(records, key=lambda one: one.excitation), trial


def largest_of(values: np.ndarray) -> tuple[int, int]:
    """Return row and column of the largest value that is a number."""
    row, column = np.unravel_index(np.nanargmax(values), values.shape)
    return int(row), int(column)


def disagreements(
    weights: Mapping[str, float],
    means: Sequence[Float[np.ndarray, "n m"]],
    sd: Float[np.ndarray, "n m"],
    channels: Sequence[str],
    **where: Value,
) -> list[Finding]:
    """Return the channels of one manoeuvre in which structures differ by more than the standard deviation that one states.

    Args:
        weights: probability of each structure, by label; they sum to 1.
        means: what each predicts, SI.
        sd: standard deviation of a measurement as the most probable one states it, SI.
        channels: of the columns.
        where: values of the findings.
    """
    mean = np.average(means, 0, [*weights.values()])
    variance = np.average((np.array(means) - mean) ** 2, 0, [*weights.values()])
    spread, stated = (np.sqrt(np.nanmean(one, 0)) for one in (variance, sd**2))
    return [
        Finding(
            "structures-disagree",
            "caution",
            (channel,),
            {"labels": (*weights,), "spread": float(spread[i]), "stated": float(stated[i]), **where},
            ("decide-structure",),
        )
        for i, channel in enumerate(channels)
        if spread[i] > stated[i]
    ]
