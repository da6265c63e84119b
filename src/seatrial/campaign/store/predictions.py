"""Stored predictions: how well the estimated vehicle, and simple predictors beside it, predict each channel of each record."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Float, Int
from pydantic import computed_field

from seatrial.core.dataset import Dataset
from seatrial.core.findings import Finding
from seatrial.estimation.prediction.baseline_comparison import Predicted
from seatrial.estimation.prediction.fit_verdict import FIT_LEVELS, FitLevel, Pooled
from seatrial.estimation.prediction.prediction_scores import Score
from seatrial.messages.render import remedy, statement


@dataclass(frozen=True, kw_only=True)
class Fit(Score):
    """Prediction of one channel of one record in free simulation, from its inputs only, and the verdict.

    Attributes:
        record: label.
        held_back: whether the record was not used in the fit.
        channel: measured channel.
        verdict: verdict on the scores.
        outside: parts of a held-back record that leave the fitted range of states and inputs, in words.
        ahead: if a held-back record is not predicted as a whole, its prediction horizon and the reason, in words; else empty.
    """

    record: str
    held_back: bool
    channel: str
    verdict: Finding
    outside: tuple[str, ...] = ()
    ahead: str = ""

    @computed_field
    @property
    def code(self) -> str:
        """Code of the verdict."""
        return self.verdict.code

    @computed_field
    @property
    def level(self) -> FitLevel:
        """Pass, unjudged, caution or fail."""
        return FIT_LEVELS[self.verdict.level]

    @property
    def is_alarm(self) -> bool:
        """Whether it forbids to rely on the model: a run that was not fitted, and is not predicted."""
        return self.held_back and self.level == "fail"

    @property
    def statement(self) -> str:
        """What was found and what it means."""
        return statement(self.verdict)

    @computed_field
    @property
    def advice(self) -> str:
        """Recommendation; empty for a pass."""
        return remedy(self.verdict)

    @property
    def found(self) -> str:
        """Reason, and where the record leaves the fitted range."""
        beyond = f"; outside the fitted range: {', '.join(self.outside)}"
        return self.statement + beyond * bool(self.outside)

    @property
    def finding(self) -> str:
        """The same, and how far ahead it is predicted; the cautions say what to do, once for all."""
        return "; ".join(filter(None, (self.found, self.ahead)))

    @computed_field
    @property
    def reason(self) -> str:
        """The same, with the recommendation."""
        return "; ".join(filter(None, (self.finding, self.advice)))


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
        disagreements: where structures that the data do not separate predict a held-back record differently.
    """

    records: tuple[str, ...]
    held_back: tuple[str, ...]
    channels: Annotated[tuple[str, ...], "channel"]
    fits: tuple[Fit, ...]
    pooled: tuple[Pooled, ...]
    structure: str
    data: Dataset
    disagreements: tuple[Finding, ...] = ()


@dataclass(frozen=True, eq=False)
class FittedBaselines:
    """Baselines fitted to the records that the model is fitted to; the held-back records lie one after another on `sample`.

    Attributes:
        channels: measured channels.
        records: labels of the held-back records.
        names: baselines that could be fitted.
        words: what each is, such as "a linear Nomoto model", by name.
        parameters: as fitted, SI, by name.
        noise_sd: SI, NaN if a baseline does not predict the channel.
        record: index of the record of each sample.
        mean: predictions, SI, NaN if a baseline does not predict the channel.
        refused: why others could not be fitted, by name.
    """

    channels: Annotated[tuple[str, ...], "channel"]
    records: tuple[str, ...]
    names: Annotated[tuple[str, ...], "baseline"]
    words: dict[str, str]
    parameters: dict[str, dict[str, float]]
    noise_sd: Float[np.ndarray, "baseline channel"]
    record: Int[np.ndarray, " sample"]
    mean: Float[np.ndarray, "baseline sample channel"]
    refused: dict[str, str]

    def of_channel(self, column: int) -> dict[str, list[Predicted]]:
        """Return the predictions of a channel in each record, by the words of the baselines that predict it."""
        predicted = {}
        for name, sd, mean in zip(self.names, self.noise_sd[:, column], self.mean[:, :, column], strict=True):
            if not np.isnan(sd):
                pieces = [mean[self.record == index] for index in range(len(self.records))]
                predicted[self.words[name]] = [Predicted(one, np.full(len(one), float(sd))) for one in pieces]
        return predicted
