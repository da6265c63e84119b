"""Stored predictions: how well the estimated vehicle predicts each channel of each record, and all that were held back together."""

from dataclasses import dataclass
from typing import Annotated

from seatrial.core.dataset import Dataset
from seatrial.estimation.prediction.fit_verdict import FitLevel, FitVerdict
from seatrial.estimation.prediction.pooled_coverage import Pooled
from seatrial.estimation.prediction.prediction_scores import Score
from seatrial.estimation.prediction.remedies import with_advice


@dataclass(frozen=True, kw_only=True)
class Fit(Score):
    """How one channel of one record is predicted in free simulation, from its inputs alone, and what that means.

    Attributes:
        record: label.
        held_back: whether the record was not used in the fit.
        channel: measured channel.
        level: pass, unjudged, caution or fail.
        about: what the verdict is about in a few words; empty for a pass.
        reason: what was found and what it means.
        advice: what to do; empty for a pass.
        outside: where a held-back record leaves the range of states and inputs that was fitted, in words.
        ahead: how far ahead a held-back record is predicted that is not predicted as a whole, and why, in words; else empty.
    """

    record: str
    held_back: bool
    channel: str
    level: FitLevel
    about: str
    reason: str
    advice: str = ""
    outside: tuple[str, ...] = ()
    ahead: str = ""

    @property
    def found(self) -> str:
        """Reason, and where the record leaves the fitted range."""
        beyond = f"it goes beyond what was fitted: {', '.join(self.outside)}"
        return with_advice(self.reason, beyond * bool(self.outside))

    @property
    def finding(self) -> str:
        """The same, and how far ahead it is predicted; the cautions say what to do, once for all."""
        return with_advice(self.found, self.ahead)

    @property
    def words(self) -> str:
        """The same, and what to do."""
        return with_advice(self.finding, self.advice)

    @property
    def verdict(self) -> FitVerdict:
        """Level, subject, reason and advice."""
        return FitVerdict(self.level, self.about, self.reason, self.advice)


@dataclass(frozen=True, eq=False)
class Predictions:
    """Which records are predicted, and how well.

    Attributes:
        records: labels, in the order of the curves.
        held_back: those that were not fitted.
        channels: measured channels.
        fits: each channel of each record.
        pooled: each channel of all held-back records together; empty without such records.
        structure: label of the structure that predicts.
        data: curves on `sample`, the records one after another: `time`, s, index of the `record`, and by `channel` what was `measured`, the
            `mean`, and the standard deviations `motion_sd`, of the coefficients alone, and `sd`, with the noise of the sensor.
    """

    records: tuple[str, ...]
    held_back: tuple[str, ...]
    channels: Annotated[tuple[str, ...], "channel"]
    fits: tuple[Fit, ...]
    pooled: tuple[Pooled, ...]
    structure: str
    data: Dataset
