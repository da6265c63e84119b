"""Stored baselines: what simple predictors, fitted to the same records, say of the held-back ones."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Float, Int

from seatrial.estimation.prediction.baseline_comparison import Predicted


@dataclass(frozen=True, eq=False)
class FittedBaselines:
    """Baselines fitted to the records that the model is fitted to; the held-back records lie one after another on `sample`.

    Attributes:
        channels: measured channels.
        records: labels of the held-back records.
        names: baselines that could be fitted.
        words: what each is, such as "a linear Nomoto model", by name.
        parameters: as fitted, SI, by name.
        noise_sd: SI, NaN where a baseline does not predict the channel.
        record: index of the record of each sample.
        mean: predictions, SI, NaN where a baseline does not predict the channel.
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
