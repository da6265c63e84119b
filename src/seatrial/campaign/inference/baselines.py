"""Baselines beside the model: fitted to the same records, scored on the same held-back ones, and what follows from that."""

from collections.abc import Mapping, Sequence

import numpy as np

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.store.estimates import HasKey
from seatrial.campaign.store.predictions import FittedBaselines
from seatrial.campaign.store.stored_result import Store, StoredResult, key_of
from seatrial.core.reporter import SILENT, Reporter
from seatrial.estimation.prediction.acceleration_baseline import WORDS, acceleration_baseline
from seatrial.estimation.prediction.baseline_comparison import Comparison, Predicted, Run, compare
from seatrial.estimation.prediction.baselines import BASELINES, FittedBaseline, fit_baselines
from seatrial.messages.predictions import comparison_text, score_lines

NOTHING_HELD_BACK = "no run is held back, so no baseline could be compared"


def stored_baselines(campaign: Campaign, trials: HasKey) -> StoredResult[FittedBaselines]:
    """Return where the baselines are kept, and what they depend on."""
    full = campaign.full.terms
    key = key_of("baselines", trials.key, full, campaign.vehicle, campaign.channels)
    return StoredResult(Store(campaign.folder).baselines, key, FittedBaselines, f"seatrial run {campaign.folder}")


def fit_all_baselines(campaign: Campaign, trials: Trials, reporter: Reporter = SILENT) -> FittedBaselines | None:
    """Fit every baseline that applies and predict the held-back records; None if there are none.

    Least squares of accelerations takes the terms of the full structure.

    Args:
        campaign: configuration.
        trials: records.
        reporter: told that it is at work.
    """
    if campaign.imports is None or not campaign.imports.predict:
        return None

    def make() -> FittedBaselines:
        model = campaign.model(campaign.full)
        family = [*BASELINES.values(), acceleration_baseline(model)]
        progress = reporter.progress("baselines")
        fitted, refused = [], {}
        for done, one in enumerate(family):
            progress(done, len(family))
            members, why = fit_baselines(trials.fit, campaign.channels, model.controls, [one])
            fitted += members
            refused |= why
        progress(len(family), len(family))
        return _predicted(campaign.channels, trials, fitted, {one.name: one.words for one in family}, refused)

    return stored_baselines(campaign, trials).read_or_make(make)


def compare_with_baselines(
    baselines: FittedBaselines | None, curves: Sequence[Mapping[str, np.ndarray]]
) -> tuple[Comparison, ...]:
    """Compare a model with the baselines, channel by channel; nothing if no run is held back, or none measures the channel.

    Args:
        baselines: of `fit_all_baselines`.
        curves: the model's predictions of the same held-back records, in the same order: `time`, `measured`, `mean` and `sd`.
    """
    if baselines is None:
        return ()
    compared = []
    for column, channel in enumerate(baselines.channels):
        runs = [Run(one["time"], one["measured"][:, column]) for one in curves]
        if not any(np.isfinite(run.measured).any() for run in runs):
            continue
        ours = [Predicted(one["mean"][:, column], one["sd"][:, column]) for one in curves]
        others = baselines.of_channel(column)
        if others:
            compared.append(compare(channel, runs, ours, others, [WORDS]))
    return tuple(compared)


def comparison_lines(baselines: FittedBaselines | None, compared: Sequence[Comparison]) -> list[str]:
    """Return how the model stands beside the baselines: what it means first, then the scores of each channel, and what was not fitted."""
    if baselines is None:
        return [NOTHING_HELD_BACK]
    lines = [comparison_text(one) for one in compared]
    lines += [f"  {line}" for one in compared for line in score_lines(one)]
    return lines + [f"  {text}" for text in refused_words(baselines)]


def refused_words(baselines: FittedBaselines) -> list[str]:
    """Return which baselines were not fitted, and why, once for those with the same reason."""
    reasons = dict.fromkeys(baselines.refused.values())
    names = {why: ", ".join(name for name, one in baselines.refused.items() if one == why) for why in reasons}
    return [f"not fitted: {names[why]}; {why}" for why in reasons]


def comparison_alarms(compared: Sequence[Comparison]) -> list[str]:
    """Return what forbids to prefer the model: baselines that are clearly better."""
    return [comparison_text(one) for one in compared if one.level == "fail"]


def comparison_cautions(compared: Sequence[Comparison]) -> list[str]:
    """Return where the model does not beat a baseline, though not by much, or not by more than chance."""
    return [comparison_text(one) for one in compared if one.level == "caution"]


def _predicted(
    channels: Sequence[str],
    trials: Trials,
    fitted: Sequence[FittedBaseline],
    words: Mapping[str, str],
    refused: Mapping[str, str],
) -> FittedBaselines:
    """Predict with each baseline; the held-back records lie one after another on `sample`."""
    lengths = [record.time.size for record in trials.predict]
    mean = np.full((len(fitted), sum(lengths), len(channels)), np.nan)
    noise_sd = np.full((len(fitted), len(channels)), np.nan)
    for at, one in enumerate(fitted):
        columns = [list(channels).index(channel) for channel in one.channels]
        mean[at][:, columns] = np.concatenate([one.predict(record) for record in trials.predict])
        noise_sd[at, columns] = one.noise_sd
    return FittedBaselines(
        tuple(channels),
        tuple(record.label for record in trials.predict),
        tuple(one.name for one in fitted),
        {one.name: words[one.name] for one in fitted},
        {one.name: dict(one.parameters) for one in fitted},
        noise_sd,
        np.repeat(np.arange(len(lengths)), lengths),
        mean,
        dict(refused),
    )
