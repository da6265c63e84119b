"""Stored baselines: what simple predictors, fitted to the same records, say of the held-back ones."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from seatrial.core.dataset_file import open_dataset
from seatrial.estimation.prediction.baseline_comparison import Comparison, PooledScore, Predicted


@dataclass(frozen=True, eq=False)
class BaselineCurves:
    """One baseline on every held-back record.

    Attributes:
        name: of the baseline.
        words: what it is, such as "a linear Nomoto model".
        parameters: as fitted, SI, by name.
        noise_sd: of each channel, SI, NaN where it does not predict it.
        means: of each held-back record, SI, shape (n, channels), NaN where it does not predict the channel.
    """

    name: str
    words: str
    parameters: dict[str, float]
    noise_sd: Float[np.ndarray, " channels"]
    means: tuple[Float[np.ndarray, "n channels"], ...]

    def of_channel(self, column: int) -> list[Predicted] | None:
        """Return the prediction of a channel in each record; None where the baseline does not predict it."""
        sd = float(self.noise_sd[column])
        if np.isnan(sd):
            return None
        return [Predicted(one[:, column], np.full(len(one), sd)) for one in self.means]


@dataclass(frozen=True)
class FittedBaselines:
    """Baselines fitted to the records that the model is fitted to.

    Attributes:
        channels: measured channels, in the order of the columns.
        records: labels of the held-back records.
        curves: baselines that could be fitted.
        refused: why others could not, by name.
    """

    channels: tuple[str, ...]
    records: tuple[str, ...]
    curves: tuple[BaselineCurves, ...]
    refused: dict[str, str]


def read_baselines(path: Path) -> FittedBaselines:
    """Read what baselines say of the held-back records; errors as `open_dataset`."""
    data = open_dataset(path)
    records, index = tuple(json.loads(data.attrs["records"])), data["record"].values
    parameters, words = (json.loads(data.attrs[name]) for name in ("parameters", "words"))
    curves = []
    for at, name in enumerate(map(str, data["baseline"].values)):
        means = data["mean"].values[at]
        pieces = tuple(means[index == one] for one in range(len(records)))
        curves.append(BaselineCurves(name, words[name], parameters[name], data["noise_sd"].values[at], pieces))
    channels = tuple(map(str, data["channel"].values))
    return FittedBaselines(channels, records, tuple(curves), json.loads(data.attrs["refused"]))


def decode_comparison(item: dict[str, Any]) -> Comparison:
    """Return how a model stands beside the baselines from its JSON."""
    ours, baselines = PooledScore(**item["ours"]), tuple(PooledScore(**one) for one in item["baselines"])
    return Comparison(**{**item, "ours": ours, "baselines": baselines})
