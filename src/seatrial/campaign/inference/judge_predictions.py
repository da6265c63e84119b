"""How well the estimated vehicle predicts records, those it was fitted to and those held back, and whether that will do."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.import_table import ImportTable
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.inference.posterior import build_posterior, first_sd, initial_state, posterior_of_one
from seatrial.campaign.inference.structure_average import StructureAverage
from seatrial.campaign.store.estimates import Drawn, Estimate, HasKey, OfStructure
from seatrial.campaign.store.predictions import Fit, Predictions
from seatrial.campaign.store.stored_result import Store, StoredResult, key_of
from seatrial.compiled.random_keys import random_key
from seatrial.core.dataset import Dataset
from seatrial.core.findings import Finding, Message
from seatrial.core.record import Record
from seatrial.estimation.prediction.fit_verdict import (
    LEVELS,
    POOR,
    SLOW,
    Pooled,
    judge_fit,
    judge_runs,
    without_numbers,
    worst,
)
from seatrial.estimation.prediction.fitted_range import outside_fitted
from seatrial.estimation.prediction.forecast import Forecaster, make_forecaster
from seatrial.estimation.prediction.prediction import Prediction, offsets_at_zero, predict
from seatrial.estimation.prediction.prediction_scores import DIVERGES, score_channel
from seatrial.estimation.prediction.short_horizon import (
    HORIZON,
    MAX_RECORD_SHARE,
    MIN_GROWTH,
    ShortHorizon,
    growth_rate,
    short_horizons,
)
from seatrial.estimation.simulation.sensor_errors import Noise
from seatrial.messages.predictions import explained_short, horizon_text, outside_text
from seatrial.messages.render import sentence
from seatrial.selection.contenders import disagreements
from seatrial.selection.structures import Structure

N_DRAWS = 200
CURVES = ("time", "measured", "mean", "motion_sd", "sd")  # What is kept of a prediction at each sample


class HeldBack(NamedTuple):
    """How records that were not fitted are predicted: each channel of each, each of all of them together, and `CURVES` of each record."""

    fits: tuple[Fit, ...]
    pooled: tuple[Pooled, ...]
    curves: tuple[Mapping[str, np.ndarray], ...] = ()


def predict_held_back(campaign: Campaign, drawn: Drawn, trials: Trials) -> HeldBack:
    """Predict the records that were not fitted; nothing is stored."""
    predicted, setting = [_predict(campaign, drawn, record, True) for record in trials.predict], _setting(campaign)
    ahead = _forecast_by(campaign, drawn, trials.fit)
    fits = [fit for one in predicted for fit in _fits(setting, one, ahead, trials.fit)]
    return HeldBack(tuple(fits), _pooled(setting, predicted, fits), tuple(map(_curves, predicted)))


def held_back_curves(predictions: Predictions) -> tuple[dict[str, np.ndarray], ...]:
    """Return `CURVES` of each record that was not fitted, of `predict_all`."""
    data = predictions.data
    index = data["record"].values
    return tuple(
        {name: data[name].values[index == at] for name in CURVES}
        for at, one in enumerate(predictions.records)
        if one in predictions.held_back
    )


def stored_predictions(
    campaign: Campaign, estimate: OfStructure, trials: HasKey, average: OfStructure
) -> StoredResult[Predictions]:
    """Return where the predictions are kept, and what they depend on."""
    key = key_of("predictions", estimate.key, trials.key, average.key)
    return StoredResult(Store(campaign.folder).predictions, key, Predictions, f"seatrial run {campaign.folder}")


def predict_all(
    campaign: Campaign, estimate: Estimate, trials: Trials, average: Estimate | StructureAverage
) -> Predictions:
    """Predict every record with draws from the posterior, those that were not fitted with draws of the average."""

    def predict() -> Predictions:
        whole = predictions_by(campaign, estimate, trials, average)
        return replace(whole, disagreements=tuple(_disagreements(campaign, average, trials.predict)))

    return stored_predictions(campaign, estimate, trials, average).read_or_make(predict)


def predictions_by(campaign: Campaign, drawn: Drawn, trials: Trials, average: Drawn) -> Predictions:
    """Predict every record with some draws, those that were not fitted with draws of the average; nothing is stored."""
    records, count, setting = [*trials.fit, *trials.predict], len(trials.fit), _setting(campaign)
    predicted = [_predict(campaign, drawn, record) for record in trials.fit]
    predicted += [_predict(campaign, average, record, True) for record in trials.predict]
    ahead = _forecast_by(campaign, drawn, trials.fit)
    fits = _fitted(setting, predicted[:count], ahead)
    fits += [fit for one in predicted[count:] for fit in _fits(setting, one, ahead, trials.fit)]
    held_back = HeldBack(tuple(fits), _pooled(setting, predicted[count:], fits), tuple(map(_curves, predicted)))
    return predictions_of(campaign.channels, drawn.structure, records, trials.predict, held_back)


def predictions_of(
    channels: Sequence[str],
    structure: Structure,
    records: Sequence[Record],
    held_back: Sequence[Record],
    predicted: HeldBack,
) -> Predictions:
    """Return predictions as they are stored, the `CURVES` of all records one after another.

    Args:
        channels: that are measured.
        structure: that predicts.
        records: one at least.
        held_back: those that were not fitted.
        predicted: of `predict_held_back`.
    """
    pieces = predicted.curves
    columns = {name: np.concatenate([piece[name] for piece in pieces]) for name in CURVES}
    data = Dataset(
        {
            "time": ("sample", columns["time"], {"unit": "s"}),
            "record": ("sample", np.repeat(np.arange(len(records)), [record.time.size for record in records])),
            **{name: (("sample", "channel"), columns[name]) for name in CURVES[1:]},
        }
    )
    labels, unseen = (tuple(record.label for record in some) for some in (records, held_back))
    return Predictions(labels, unseen, tuple(channels), predicted.fits, predicted.pooled, structure.label, data)


def trial_verdicts(fits: Sequence[Fit]) -> dict[str, Finding]:
    """Verdict of each record, by its label: the gravest of its channels."""
    return {
        label: worst([fit.verdict for fit in fits if fit.record == label])
        for label in dict.fromkeys(fit.record for fit in fits)
    }


def held_back_lines(held_back: HeldBack) -> list[str]:
    """Return how what was not fitted is predicted, each channel of each record in one line, then each channel of all together."""
    lines = []
    for fit in held_back.fits:
        share = "" if fit.missing else f"{explained_short(fit.explained)}, "
        scores = (
            fit.missing
            if not fit.samples or fit.missing == DIVERGES
            else f"{share}{fit.coverage:.0%} inside the 90 % band"
        )
        ahead = fit.statement if fit.verdict.code == "course-left" else fit.ahead
        head = f"held-back run {fit.record}: {fit.channel:<8} {fit.level}; {scores}"
        lines.append("; ".join(filter(None, (head, *fit.outside, ahead, fit.advice if ahead else ""))))
    return lines + [f"held-back runs together: {one.level}; {sentence(one.verdict)}" for one in held_back.pooled]


def held_back_alarms(fits: Sequence[Fit], pooled: Sequence[Pooled]) -> list[Finding]:
    """Return what forbids to rely on the model, for runs that were not fitted: all of them together first, then each that fails alone."""
    together = [one.verdict for one in pooled if one.level == "fail"]
    return together + [_finding(group) for group in _alike(fits) if group[0].is_alarm]


def fit_complaints(fits: Sequence[Fit], pooled: Sequence[Pooled] = ()) -> list[Message]:
    """Return what else keeps trials from passing, what is graver first; one finding for trials with the same trouble."""
    together = [one.verdict for one in pooled if one.level in ("caution", "unjudged")]
    groups = _alike(fits)
    named = {first.record for first, *_ in groups}
    beyond = {fit.record: fit.outside for fit in fits if fit.outside and fit.record not in named}
    left = [f"held-back run {record} leaves the fitted range: {', '.join(words)}" for record, words in beyond.items()]
    return [*together, *(_finding(group) for group in groups if not group[0].is_alarm), *left]


def fitted_failures(fits: Sequence[Fit]) -> list[Finding]:
    """Return which fitted runs the model does not explain."""
    return [_finding(group) for group in _alike(fits) if group[0].level == "fail" and not group[0].held_back]


def disowned(fits: Sequence[Fit]) -> str:
    """Return why the stated standard deviations do not hold: residuals of fitted runs are not the noise that is modelled; or empty."""
    return next(
        (
            sentence(_finding(group))
            for group in _alike(fits)
            if group[0].code == SLOW and not group[0].verdict.values["modelled"]
        ),
        "",
    )


def held_back_cautions(imports: ImportTable | None, trials: Trials) -> list[str]:
    """What held-back records cannot show: nothing if all imported ones were fitted, little where they repeat an input."""
    if imports is not None and not trials.predict:
        return [f"no run was held back, so the bands are not tested on new runs; {hold_back_words(imports)}"]
    return [
        f"held-back run {record.label} has the input of run {other.label}, so a good prediction shows only that the vehicle repeats "
        f"itself. Hold back a run with another input"
        for record in trials.predict
        for other in trials.fit
        if np.array_equal(record.control, other.control)
    ]


def hold_back_words(imports: ImportTable) -> str:
    """Return how to hold a run back: the only one that is fitted cannot be moved."""
    if len(imports.fit) > 1:
        return "move a run from fit to predict in [import]"
    return "record another run, and name it in `predict` of [import]"


def _alike(fits: Sequence[Fit]) -> list[list[Fit]]:
    """Return fits that do not pass, what is graver first, those with the same trouble together."""
    groups: dict[tuple, list[Fit]] = {}
    for fit in sorted(fits, key=lambda fit: -LEVELS.index(fit.level)):
        if fit.level != "pass":
            verdict = fit.verdict
            key = (verdict.level, verdict.code, verdict.remedies[:1], fit.held_back)
            groups.setdefault(key, []).append(fit)
    return list(groups.values())


def _finding(group: Sequence[Fit]) -> Finding:
    """Return the finding of the first of some fits with the same trouble, with the names of the others."""
    first, *others = group
    records: dict[str, list[str]] = {first.channel: []}
    for fit in others:
        records.setdefault(fit.channel, []).append(fit.record)
    likewise = tuple((channel, tuple(runs)) for channel, runs in records.items() if runs)
    return first.verdict.among(
        run=first.record, held_back=first.held_back, outside=first.outside, ahead=first.ahead, likewise=likewise
    )


def _disagreements(
    campaign: Campaign, average: Estimate | StructureAverage, records: Sequence[Record]
) -> Iterator[Finding]:
    """Yield where structures that stand beside each other predict a record differently."""
    if isinstance(average, StructureAverage):
        for record in records:
            each = [_predict(campaign, one, record, True) for one in average.members]
            means, first = [one.mean for one in each], each[0]
            where = {"run": record.label, "held_back": True}
            yield from disagreements(average.labels, means, first.sd, first.channels, **where)


def _predict(campaign: Campaign, drawn: Drawn, record: Record, held_back: bool = False) -> Prediction:
    draws = dict(zip(drawn.names, drawn.draws().T, strict=True))
    posterior = posterior_of_one(campaign, drawn.structure, record)
    model = posterior.likelihood.model
    return predict(
        posterior,
        offsets_at_zero(draws) if held_back else draws,
        record,
        start=initial_state(campaign, model, record),
        first_sd={state: first_sd(campaign.noise, state) for state in model.states},
        n=N_DRAWS,
        key=random_key(campaign.seed, f"predict {record.label}"),
    )


class _Setting(NamedTuple):
    """What a campaign has, by which predictions are judged.

    Attributes:
        noise: kind of each measured channel.
        has_feedback: whether an autopilot closes the loop.
        lacks: remedies for what the model may lack, but for what the campaign has already, by channel.
        for_short: what helps a vehicle that cannot be simulated for long, and the campaign does not have yet.
    """

    noise: Mapping[str, Noise]
    has_feedback: bool
    lacks: Mapping[str, tuple[str, ...]]
    for_short: tuple[str, ...]


def _setting(campaign: Campaign) -> _Setting:
    noise = {sensor.channel: sensor.noise for sensor in campaign.sensor_models}
    filtered = campaign.estimation.likelihood == "filter-error"
    delay = () if campaign.has_delay else ("add-delay",)
    lacks = {}
    for channel, kind in noise.items():
        slow = kind in ("coloured", "drifting")
        lacks[channel] = (
            "add-term",
            *delay,
            *(() if filtered else ("filter-error",) if slow else ("add-error-model",)),
        )
    cut = campaign.imports is None or campaign.imports.split is not None
    for_short = () if filtered else ("filter-error",) if cut else ("filter-error", "split-runs")
    return _Setting(noise, bool(campaign.autopilot.loops), lacks, for_short)


# `(record, horizon) ->` how each channel of a record is forecast so many seconds ahead.
ForecastBy = Callable[[Record, float], Mapping[str, ShortHorizon]]


def _forecast_by(campaign: Campaign, drawn: Drawn, fitted: Sequence[Record]) -> ForecastBy:
    """Return what forecasts records by their measurements; the errors that remain are found once for each horizon."""

    @cache
    def forecaster(horizon: float) -> Forecaster:
        posterior = build_posterior(campaign, drawn.structure, fitted)
        known = {state: first_sd(campaign.noise, state) for state in posterior.likelihood.model.states}
        return make_forecaster(posterior, dict(zip(drawn.names, drawn.draws().T, strict=True)), horizon, known)

    def ahead(record: Record, horizon: float) -> Mapping[str, ShortHorizon]:
        chosen = forecaster(float(f"{horizon:.1g}"))
        start = initial_state(campaign, chosen.posterior.likelihood.model, record)
        return short_horizons(chosen, record, horizon, start)

    return ahead


def _fits(
    setting: _Setting, predicted: Prediction, forecast: ForecastBy, fitted: Sequence[Record] | None = None
) -> list[Fit]:
    """Every channel of one record, scored and judged; `fitted` are those that were, if the record was not."""
    held_back, record = fitted is not None, predicted.record
    outside = () if fitted is None else tuple(map(outside_text, outside_fitted(fitted, record)))
    scores = {channel: predicted.score(channel) for channel in setting.noise}
    verdicts = {
        channel: judge_fit(
            score,
            channel,
            held_back,
            setting.noise[channel],
            bool(outside),
            setting.lacks[channel],
            setting.has_feedback,
        )
        for channel, score in scores.items()
    }
    duration = float(record.time[-1] - record.time[0])
    output, values = predicted.likelihood.output, predicted.values
    own = {name: float(column[0]) for name, column in output.apart(values).items()}
    rate = growth_rate(output.model, {**values, **own}, record)
    is_unstable = rate * duration > np.log(MIN_GROWTH)
    # A whole record is lost where it is not predicted, though there is motion to predict.
    lost = [
        channel
        for channel, one in scores.items()
        if (held_back or is_unstable)
        and (one.missing == DIVERGES or (not one.missing and one.explained < POOR and one.noise_share < POOR))
    ]
    horizon = min(1 / rate if is_unstable else HORIZON, MAX_RECORD_SHARE * duration)
    ahead = forecast(record, horizon) if lost else {}
    fits = []
    for channel, score in scores.items():
        near, verdict = ahead.get(channel) if channel in lost else None, verdicts[channel]
        words = "" if near is None else horizon_text(near, channel, rate * is_unstable, duration)
        if near is not None:
            remedies = setting.for_short if near.is_good else ()
            if is_unstable:
                level, said = "caution" if near.is_good else "alarm", {"words": words, "horizon": near.horizon}
                verdict, words = Finding("course-left", level, (channel,), said, remedies), ""
            elif remedies:
                verdict = replace(verdict, remedies=(*verdict.remedies, *remedies)).among(horizon=near.horizon)
        of = {"record": record.label, "held_back": held_back, "channel": channel, "outside": outside, "ahead": words}
        fits.append(Fit(**vars(score), **of, verdict=verdict))
    return fits


def _fitted(setting: _Setting, predicted: Sequence[Prediction], forecast: ForecastBy) -> list[Fit]:
    """Every channel of the fitted records, scored and judged.

    A correlation that each record alone is too short to show, and all together show, is a finding about each.
    """
    fits = [fit for one in predicted for fit in _fits(setting, one, forecast)]
    for channel, noise in setting.noise.items():
        own = [at for at, fit in enumerate(fits) if fit.channel == channel]
        if len(own) < 2 or predicted[0].is_filtered:
            continue
        together = score_channel([one.run(channel) for one in predicted])
        for at in own:
            score = replace(fits[at], white=together.white, sd_factor=together.sd_factor)
            verdict = judge_fit(score, channel, False, noise, feedback=setting.has_feedback)
            if verdict.code == SLOW and score.level in ("pass", "unjudged"):
                fits[at] = replace(score, verdict=verdict)
    return fits


def _curves(predicted: Prediction) -> dict[str, np.ndarray]:
    return {name: getattr(predicted, name) for name in CURVES}


def _pooled(setting: _Setting, predicted: Sequence[Prediction], fits: Sequence[Fit]) -> tuple[Pooled, ...]:
    """Every channel of all held-back records together, but for those in which the vehicle leaves its course by itself."""
    pooled = []
    for channel in setting.noise if predicted else ():
        own = [fit for fit in fits if fit.held_back and fit.channel == channel]
        kept = [one for one, fit in zip(predicted, own, strict=True) if fit.code != "course-left"]
        if kept:
            pooled.append(judge_runs([one.run(channel) for one in kept], channel, setting.lacks[channel]))
        else:
            pooled.append(without_numbers(Finding("runs-leave-course", "note", (channel,)), len(predicted)))
    return tuple(pooled)
