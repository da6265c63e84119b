"""Predictions and the quality of their bands in words: shares explained, baselines, short horizons, calibration."""

from typing import TYPE_CHECKING

import numpy as np
import scipy

from seatrial.core.display_units import shown_unit
from seatrial.estimation.prediction.baseline_comparison import CLEAR_RATIO, MAX_CHANCE, Comparison, PooledScore
from seatrial.estimation.prediction.fitted_range import Outside

if TYPE_CHECKING:
    from seatrial.estimation.diagnostics.calibration import Calibration
    from seatrial.estimation.prediction.short_horizon import ShortHorizon

WORSE_THAN_MEAN, WORSE_THAN_MEANS = "worse than the run's own mean", "worse than the runs' own means"
# Standard errors from uniform ranks at which a shift or a spread of the ranks is reported
CLEAR_ERRORS = 2.6
MANY_REFUSED = 0.05  # Share of the prior above which the refused share is reported
MANY_POOR = 0.02  # Share of poorly mixed replicates from which they may be the cause of uneven ranks
# Words for the worst of each diagnostic of the replicates.
WORST_MIXING = (
    ("R-hat up to {:.2f}", np.max),
    ("at least {:.0f} effective draws", np.min),
    ("at most {:.2%} of transitions diverged", np.max),
    ("at least {:.0%} of the moves accepted", np.min),
)
MUCH = 0.9  # Share explained from which on tenths of a per cent are shown
FAR = 2.0  # Ratio of the CRPS from which one prediction is better by far
ROUNDING = 1e-6  # Share of the furthest value below which the edge of the fitted range is zero but for rounding


def explained_of(share: float, channel: str) -> str:
    """Return the share of a channel's variance that is explained, below nothing in words and as a number."""
    if share < 0:
        return f"{channel} is predicted {explained_text(share).replace('than', 'than by').replace('%)', '% of its variance explained)')}"
    return f"{explained_text(share)} of the variance of {channel} is explained"


def explained_short(share: float, runs: int = 1) -> str:
    """Return the same for a line that names the channel."""
    return explained_text(share, runs, 1) + " of the variance explained" * (share >= 0)


def explained_text(share: float, runs: int = 1, digits: int = 0) -> str:
    """Return the explained share of the variance of one run, or of several, for a table; a negative share also in words."""
    if share < 0:
        number = f"{share:.0%}" if share > -100 else f"{100 * share:.0e}%"
        return f"{WORSE_THAN_MEAN if runs == 1 else WORSE_THAN_MEANS} ({number})"
    return f"{share:.{1 if share > 0.99 else digits}%}"


def outside_text(one: Outside) -> str:
    """Return how far a signal leaves the fitted range: `u up to 2.1 m/s (fitted up to 1.5)`."""
    factor, unit = shown_unit(one.name)
    edge = 0.0 if abs(one.edge) < ROUNDING * abs(one.furthest) else one.edge
    way = "up to" if one.is_above else "down to"
    return f"{one.name} {way} {one.furthest * factor:.3g} {unit} (fitted {way} {edge * factor:.3g})"


def horizon_text(near: "ShortHorizon", channel: str, rate: float = 0.0, duration: float = 0.0) -> str:
    """Return how far ahead a channel is predicted, and why no further.

    Args:
        near: scores over a short horizon.
        channel: measured signal.
        rate: at which a small error grows in the model, 1/s, if the model is unstable; else 0.
        duration: of the record, s.
    """

    def share(value: float) -> str:
        if value > 0.999:
            return "over 99.9%"
        return "nothing" if value < 0 else f"{value:.1%}" if value > 0.99 else f"{value:.0%}"

    ahead = (
        f"over {near.horizon:.2g} s {share(near.explained)} of the variance of {channel} is explained, one sample ahead "
        f"{share(near.one_step)} (by holding the measured value {share(near.held)} and {share(near.one_step_held)})"
    )
    if rate > 0:
        return (
            f"the fitted model is unstable, so controls do not determine {duration:.0f} s: a small error grows by e in "
            f"{1 / rate:.2g} s (eigenvalue {rate:+.2g} 1/s); {ahead}"
        )
    if not near.is_good:
        return f"accumulated errors are not the cause, because short horizons are predicted little better: {ahead}"
    return f"errors accumulate along the run: {ahead}"


def score_lines(one: Comparison) -> list[str]:
    """Return a line for the model and each baseline."""
    factor, unit = shown_unit(one.channel)
    lines = []
    for score in (one.ours, *one.baselines):
        crps = f"CRPS {score.crps * factor:.3g} {unit}"
        numbers = f"{explained_short(score.explained, 2)}, {crps}, log score {score.log_score:.2f}"
        lines.append(f"{one.channel:<8} {score.words:<36} {'diverges' if score.diverges else numbers}")
    return lines


def comparison_text(one: Comparison) -> str:
    """Return the result of the comparison with the best baseline, and its remedy."""
    channel, own, best, count = one.channel, one.ours, one.baselines[0], len(one.baselines)
    if own.diverges:
        other = (
            "as every baseline does"
            if best.diverges
            else f"but {best.words} does not ({explained_short(best.explained, 2)})"
        )
        return f"held-back runs: the model's {channel} diverges, {other}: correct the model"
    if best.diverges:
        return f"held-back runs: every baseline diverges in {channel}, and the model does not"
    factor, unit = shown_unit(channel)
    scores = f"CRPS {best.crps * factor:.3g} against {own.crps * factor:.3g} {unit}"
    numbers = f"({_shares(best, own)}, {scores})"
    if one.level == "pass":
        chance = f", which chance may explain (p = {one.p_value:.2g})" if one.p_value >= MAX_CHANCE else ""
        beaten = f"held-back runs: the model predicts {channel} better than every baseline"
        return f"{beaten}{chance}; the best of them is {best.words} {numbers}"
    result = f"held-back runs: {best.words} predicts {channel} better than the model{_in_runs(one)} {numbers}"
    if one.level == "caution":
        little = "but only slightly"
        if one.p_value >= MAX_CHANCE:
            of = f" for the best of {count} baselines" if count > 1 else ""
            number = f" (p = {one.p_value:.2g}{of})" if one.p_value < 1 else ""
            little = f"but so few independent samples do not exclude chance{number}"
        if own.crps > CLEAR_RATIO * best.crps:
            return (
                f"{result}, {little}: hold back more or longer runs, and look at the runs in which the model is worse"
            )
        if not one.is_simpler:
            return (
                f"{result}, {little}: it predicts as well, but is no simpler model, because it has the same equations"
            )
        return f"{result}, {little}: prefer it, as the simpler model, or correct the model"
    if own.explained >= best.explained:
        return f"{result}: the model's motion is no worse, but its bands are too narrow or too wide; change its model of the residuals"
    return f"{result}: prefer it, or correct the model"


def _shares(best: PooledScore, own: PooledScore) -> str:
    if min(best.explained, own.explained) < 0:
        return " against ".join(explained_short(one.explained, 2) for one in (best, own))
    digits = 1 if min(best.explained, own.explained) >= MUCH else 0
    of_best, of_model = (f"{one.explained:.{digits}%}" for one in (best, own))
    if of_best == of_model:
        return f"{of_model} of the variance explained by both"
    return f"{of_best} against {of_model} of the variance explained"


def _in_runs(one: Comparison) -> str:
    """Return in how many runs the best baseline is better than the model, and whether by far."""
    by_run = np.array(one.by_run)
    is_better = by_run[:, 1] < by_run[:, 0]
    first, second = by_run[is_better].sum(axis=0)
    better, count = int(np.sum(is_better)), len(by_run)
    far = ", by far" if first > FAR * second else ""
    if count == 1:
        return f" in the only run{far}"
    worse = f"{',' if far else ''} and worse in {count - better}" if better < count else ""
    return f" in {better} of {count} runs{far}{worse}"


def calibration_lines(calibration: "Calibration") -> list[str]:
    """Return the result of a simulation-based calibration: the coverage of each quantity, and the shape of deviating ranks."""
    from seatrial.estimation.diagnostics.calibration import FALSE_ALARMS

    r, k, tail = len(calibration.ranks), len(calibration.names), 0.5 * FALSE_ALARMS / len(calibration.names)
    low, high = scipy.stats.binom(r, 0.9).ppf([tail, 1 - tail]) / r
    lines = [
        f"{name}: the 90 % interval contains the truth in {share:.1%} of {r} replicates (expected {low:.1%} to {high:.1%}), "
        f"p = {value:.3f} for uniform ranks"
        for name, share, value in zip(calibration.names, calibration.coverage(0.9), calibration.p_values(), strict=True)
    ]
    if k > 1:
        lines.append(f"range and p allow for the worst of {k} quantities, with any correlation")
    columns = dict(zip(calibration.names, calibration.ranks.T, strict=True))
    return lines + [f"{name}: {shape_of_ranks(columns[name])}" for name in calibration.outside()]


def calibration_report(calibration: "Calibration") -> list[str]:
    """Return `calibration_lines`, whether the draws mixed, and whether the stated uncertainty is calibrated."""
    outside, k = calibration.outside(), len(calibration.names)
    band = f"the band that contains {'it' if k == 1 else f'all {k} quantities'} with 99 % probability"
    verdict = (
        f"calibrated: the ranks lie inside {band}"
        if not outside
        else f"not calibrated: the ranks of {', '.join(outside)} leave {band}"
    )
    lines = [*calibration_lines(calibration), mixing_words(calibration)]
    if calibration.refused > MANY_REFUSED:
        lines.append(
            f"{calibration.refused:.0%} of the prior could not be simulated and was drawn again; `seatrial prior` shows the cause"
        )
    return [*lines, f"{verdict} (structure {calibration.structure}, {calibration.method})"]


def mixing_words(calibration: "Calibration") -> str:
    """Return whether poor mixing may be the cause of uneven ranks, by the diagnostics of the method."""
    poor, r = calibration.poor(), len(calibration.health)
    worst = [
        text.format(extreme(column[~np.isnan(column)]))
        for (text, extreme), column in zip(WORST_MIXING, calibration.health.T, strict=True)
        if not np.isnan(column).all()
    ]
    numbers = ", ".join(worst)
    if not poor.any():
        end = ", so the sampling is not the cause of the uneven ranks" if calibration.outside() else ""
        return f"the draws mixed well in all {r} replicates ({numbers}){end}"
    sentence = f"the draws mixed poorly in {poor.sum()} of {r} replicates ({numbers})"
    if poor.mean() < MANY_POOR:
        return f"{sentence}: too few to cause uneven ranks"
    return f"{sentence}: this may be the cause of uneven ranks; try another method, or narrower priors"


def shape_of_ranks(ranks: np.ndarray) -> str:
    """Return the meaning of a deviation: truths, standardised by a correct posterior, are standard normal."""
    from seatrial.estimation.diagnostics.calibration import DRAWS

    scores = scipy.stats.norm.ppf((ranks + 0.5) / (DRAWS + 1))
    even = scipy.stats.norm.ppf((np.arange(DRAWS + 1) + 0.5) / (DRAWS + 1)).std()
    shift, width = float(scores.mean()), float(scores.std() / even)
    parts = []
    if abs(shift) * np.sqrt(ranks.size) > CLEAR_ERRORS:
        side, where = ("downwards", "above") if shift > 0 else ("upwards", "below")
        parts.append(
            f"the posterior is biased {side}: truths lie {abs(shift):.1f} of its standard deviations {where} it"
        )
    if abs(width - 1) * np.sqrt(2 * ranks.size) > CLEAR_ERRORS:
        word = "overconfident" if width > 1 else "too wide"
        parts.append(f"the posterior is {word}: truths scatter {width:.1f} times as far as it states")
    return "; ".join(parts) or "the shape of the posterior is wrong, but not its place or width: see the picture"
