"""How well the estimated vehicle predicts records: those it was fitted to, and those held back."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from seatrial.campaign.config import Campaign
from seatrial.campaign.estimate import Estimate
from seatrial.campaign.problem import initial_state
from seatrial.campaign.store import Store, is_current, key_of, write_dataset
from seatrial.campaign.trials import Trials
from seatrial.core.dataset_file import open_dataset
from seatrial.core.record import Record
from seatrial.estimation.output_error import initial_name, noise_name
from seatrial.estimation.simulation import simulate_outputs
from seatrial.vehicles.model import VehicleModel

N_DRAWS = 200
Z90 = 1.6448536269514722


@dataclass(frozen=True)
class Fit:
    """How one channel of one record is predicted in free simulation, from its inputs alone.

    Attributes:
        record: label.
        held_back: whether the record was not used in the fit.
        channel: measured channel.
        explained: share of the measured variance explained, 1 - SSE / SST; negative is worse than the record's own mean.
        rmse: root mean square error, SI.
        coverage: share of samples inside the 90 % predictive band.
        correlation: autocorrelation of residuals one measured sample apart.
        interval: median time between measured samples, s.
        samples: number of measured samples.
    """

    record: str
    held_back: bool
    channel: str
    explained: float
    rmse: float
    coverage: float
    correlation: float
    interval: float
    samples: int


def predict_all(campaign: Campaign, estimate: Estimate, trials: Trials) -> tuple[list[Fit], xr.Dataset]:
    """Predict every record with draws from the posterior; returns the fits and the stored curves.

    The curves lie on `sample`, the records one after another: record index, time, measured, mean, and the standard
    deviations of the motion (coefficients unknown) and of a measurement (noise added).
    """
    store = Store(campaign.folder)
    key = key_of("predictions", estimate.key, trials.key)
    if not is_current(store.predictions, key):
        records = [*trials.fit, *trials.predict]
        pieces = [_predict(campaign, estimate, record) for record in records]
        columns = {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}
        fits = [
            _fit(record, index >= len(trials.fit), channel, c, pieces[index])
            for index, record in enumerate(records)
            for c, channel in enumerate(campaign.channels)
        ]
        lengths = [record.time.size for record in records]
        dataset = xr.Dataset(
            {
                "time": ("sample", columns["time"], {"unit": "s"}),
                "record": ("sample", np.repeat(np.arange(len(records)), lengths)),
                **{name: (("sample", "channel"), columns[name]) for name in ("measured", "mean", "motion_sd", "sd")},
            },
            coords={"channel": list(campaign.channels)},
            attrs={
                "records": json.dumps([record.label for record in records]),
                "held_back": json.dumps([record.label for record in trials.predict]),
                "structure": estimate.structure.label,
                "fits": json.dumps([fit.__dict__ for fit in fits]),
            },
        )
        write_dataset(store.predictions, dataset, key)
    dataset = open_dataset(store.predictions)
    return [Fit(**fit) for fit in json.loads(dataset.attrs["fits"])], dataset


def fit_complaints(fits: Sequence[Fit], coloured: bool) -> list[str]:
    """What the residuals say about the model and its stated uncertainty, in words."""
    said = []
    fitted = [fit for fit in fits if not fit.held_back]
    worst = max(fitted, key=lambda fit: abs(fit.correlation))
    if not coloured and abs(worst.correlation) > 3.0 / np.sqrt(worst.samples) and abs(worst.correlation) > 0.1:
        rho = min(abs(worst.correlation), 0.999)
        said.append(
            f"residuals of {worst.channel} are correlated ({worst.correlation:+.2f} over {worst.interval:.2g} s, "
            f"run {worst.record}), which white noise is not: the stated standard deviations are "
            f"too small, by a factor of about {np.sqrt((1 + rho) / (1 - rho)):.1f}; "
            'set estimation.residuals = "coloured"'
        )
    said += [
        f"held-back run {fit.record} is predicted poorly: {fit.explained:.0%} of the variance of {fit.channel} explained"
        for fit in fits
        if fit.held_back and fit.explained < 0.5
    ]
    return said


def _predict(campaign: Campaign, estimate: Estimate, record: Record) -> dict[str, np.ndarray]:
    model = campaign.model(estimate.structure)
    table = estimate.draws()
    table = table[:: max(1, table.shape[0] // N_DRAWS)][:N_DRAWS]
    draws = dict(zip(estimate.names, table.T, strict=True))
    names = [initial_name(state, record.label) for state in model.states]
    initial = np.column_stack(
        [
            draws.get(name, np.full(table.shape[0], value))
            for name, value in zip(names, initial_state(campaign, model, record), strict=True)
        ]
    )
    outputs = np.asarray(
        _outputs(model, campaign.channels, campaign.has_delay)(
            {name: jnp.asarray(values) for name, values in draws.items() if name not in names},
            jnp.asarray(initial),
            jnp.asarray(np.column_stack([record.channel(name) for name in model.controls])),
            jnp.asarray(record.step),
        )
    )
    noise = np.column_stack([draws[noise_name(channel)] for channel in campaign.channels])
    motion = outputs.std(axis=0)
    return {
        "time": record.time,
        "measured": np.column_stack([record.channel(channel) for channel in campaign.channels]),
        "mean": outputs.mean(axis=0),
        "motion_sd": motion,
        "sd": np.sqrt(motion**2 + (noise**2).mean(axis=0)),
    }


@lru_cache(maxsize=16)
def _outputs(model: VehicleModel, channels: tuple[str, ...], delayed: bool):
    one = partial(simulate_outputs, model, channels, delayed)
    return jax.jit(jax.vmap(one, in_axes=(0, 0, None, None)))


def _fit(record: Record, held_back: bool, channel: str, column: int, piece: dict[str, np.ndarray]) -> Fit:
    measured, mean, sd = (piece[name][:, column] for name in ("measured", "mean", "sd"))
    present = np.isfinite(measured)
    residual, time = (measured - mean)[present], piece["time"][present]
    total = np.sum((measured[present] - measured[present].mean()) ** 2)
    centred = residual - residual.mean()
    return Fit(
        record.label,
        held_back,
        channel,
        float(1.0 - residual @ residual / total),
        float(np.sqrt(np.mean(residual**2))),
        float(np.mean(np.abs(residual) <= Z90 * sd[present])),
        float(centred[1:] @ centred[:-1] / (centred @ centred)),
        float(np.median(np.diff(time))),
        int(present.sum()),
    )
