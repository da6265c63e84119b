"""How well the estimated vehicle predicts records, those it was fitted to and those held back, and whether that will do."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Protocol

import jax
import numpy as np
import xarray as xr

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.inference.posterior import build_likelihood, build_parameters, first_sd, random_key, shared_model
from seatrial.campaign.store.estimates import Estimate, Fit, HasKey, OfStructure, read_predictions
from seatrial.campaign.store.stored_result import Store, StoredResult, key_of
from seatrial.core.dataset_file import open_dataset
from seatrial.core.record import Record
from seatrial.estimation.fit_verdict import LEVELS, FitVerdict, judge_fit, worst
from seatrial.estimation.output_error import initial_name
from seatrial.estimation.prediction import ANY, key_of_values, noise_sd, outputs_of_draws
from seatrial.estimation.priors import Normal
from seatrial.estimation.sensors import correlation_name
from seatrial.estimation.validation import score_channel
from seatrial.selection.structures import Structure

N_DRAWS = 200
MOST_NAMED = 6
"""Trials that one sentence names."""


class Drawn(Protocol):
    """Draws of the parameters of one structure, of a posterior or of what stands for it."""

    @property
    def structure(self) -> Structure:
        """Which terms."""
        ...

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        ...

    def draws(self, names: Sequence[str] | None = None) -> np.ndarray:
        """Draws of the named parameters, SI, shape (n, k)."""
        ...


def predict_held_back(campaign: Campaign, drawn: Drawn, trials: Trials) -> list[Fit]:
    """Predict the records that were not fitted; nothing is stored."""
    return [
        fit
        for record in trials.predict
        for fit in _fits(campaign.channels, drawn, record, True, _predict(campaign, drawn, record))
    ]


def stored_predictions(
    campaign: Campaign, estimate: OfStructure, trials: HasKey
) -> StoredResult[tuple[list[Fit], xr.Dataset]]:
    """Return where the predictions are kept, and what they depend on."""
    key = key_of("predictions", [field.name for field in fields(Fit)], estimate.key, trials.key)

    def read(path: Path) -> tuple[list[Fit], xr.Dataset]:
        return list(read_predictions(path).fits), open_dataset(path)

    return StoredResult(Store(campaign.folder).predictions, key, read)


def predict_all(campaign: Campaign, estimate: Estimate, trials: Trials) -> tuple[list[Fit], xr.Dataset]:
    """Predict every record with draws from the posterior; returns the fits and the stored curves.

    The curves lie on `sample`, the records one after another: record index, time, measured, mean, and the standard
    deviations of the motion (coefficients unknown) and of a measurement (noise added).
    """

    def predict() -> xr.Dataset:
        records = [*trials.fit, *trials.predict]
        pieces = [_predict(campaign, estimate, record) for record in records]
        columns = {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0] if name != "noise"}
        fits = [
            fit
            for index, (record, piece) in enumerate(zip(records, pieces, strict=True))
            for fit in _fits(campaign.channels, estimate, record, index >= len(trials.fit), piece)
        ]
        lengths = [record.time.size for record in records]
        return xr.Dataset(
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

    return stored_predictions(campaign, estimate, trials).read_or_make(predict)


def trial_verdicts(fits: Sequence[Fit]) -> dict[str, FitVerdict]:
    """Verdict of each record, by its label: the gravest of its channels."""
    return {
        label: worst([fit.verdict for fit in fits if fit.record == label])
        for label in dict.fromkeys(fit.record for fit in fits)
    }


def fit_complaints(fits: Sequence[Fit]) -> list[str]:
    """What keeps trials from passing, in words, what is graver first; one sentence for trials with the same trouble."""
    groups: dict[tuple[str, str, bool, str], list[Fit]] = {}
    for fit in sorted(fits, key=lambda fit: -LEVELS.index(fit.level)):
        if fit.level != "pass":
            groups.setdefault((fit.level, fit.about, fit.held_back, fit.channel), []).append(fit)
    said = []
    for (_, _, held_back, _), (first, *others) in groups.items():
        labels = [fit.record for fit in others[:MOST_NAMED]] + ["others"] * (len(others) > MOST_NAMED)
        likewise = f"; likewise {', '.join(labels)}" if others else ""
        said.append(f"{'held-back ' if held_back else ''}run {first.record}: {first.reason}{likewise}")
    return said


def _predict(campaign: Campaign, drawn: Drawn, record: Record) -> dict[str, np.ndarray]:
    """Motion under many draws; what only other trials know, such as this one's own bias, is drawn from its prior."""
    model = shared_model(campaign, drawn.structure)
    table = drawn.draws()
    table = table[:: max(1, table.shape[0] // N_DRAWS)][:N_DRAWS]
    known = dict(zip(drawn.names, table.T, strict=True))
    # Under one label for all records, so that records of one length share compiled code.
    anonymous = replace(record, label=ANY)
    likelihood, data = build_likelihood(campaign, model, [anonymous])
    key = random_key(campaign.seed, f"predict {record.label}")
    starts = {initial_name(state, ANY): first_sd(campaign.noise, state) for state in model.states}
    values = {}
    there = {one.name for one in build_parameters(campaign, campaign.model(drawn.structure), [anonymous])}
    for index, parameter in enumerate(build_parameters(campaign, model, [anonymous])):
        if parameter.name not in there:
            values[parameter.name] = np.zeros(len(table))
            continue
        name, prior = parameter.name.replace(f"[{ANY}]", f"[{record.label}]"), parameter.prior
        if name in known:
            values[parameter.name] = known[name]
            continue
        if parameter.name in starts:
            prior = Normal(prior.mean, starts[parameter.name])
        own = jax.random.fold_in(key_of_values(key, len(table)), index)
        values[parameter.name] = prior.draw(own, (len(table),))
    outputs = np.asarray(outputs_of_draws(likelihood)(values, data, key))[:, : record.time.size]
    noise = np.column_stack([noise_sd(sensor, values) for sensor in campaign.sensor_models])
    noise = np.sqrt((noise**2).mean(axis=0))
    motion = outputs.std(axis=0)
    return {
        "time": record.time,
        "measured": np.column_stack([record.channel(channel) for channel in campaign.channels]),
        "mean": outputs.mean(axis=0),
        "motion_sd": motion,
        "sd": np.hypot(motion, noise),
        "noise": noise,
    }


def _fits(
    channels: Sequence[str], drawn: Drawn, record: Record, held_back: bool, piece: Mapping[str, np.ndarray]
) -> list[Fit]:
    """Every channel of one record, scored and judged."""
    found = []
    for column, channel in enumerate(channels):
        tau = correlation_name(channel)
        coloured = tau in drawn.names
        score = score_channel(
            piece["time"],
            *(piece[name][:, column] for name in ("measured", "mean", "motion_sd")),
            noise_sd=float(piece["noise"][column]),
            correlation_time=float(np.median(drawn.draws([tau]))) if coloured else None,
        )
        verdict = judge_fit(score, channel, held_back, coloured)
        found.append(Fit(**vars(score), record=record.label, held_back=held_back, channel=channel, **verdict._asdict()))
    return found
