"""Pass, unjudged, caution or fail: what the scores of a predicted trial mean, why, and what to do.

A departure counts when it matters (the limits below) and when it is more than chance, three standard errors, for the number of
independent samples that the trial is worth.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np
from scipy.special import betainc, chdtr, chdtrc

from seatrial.core.findings import Finding, Level, Value
from seatrial.estimation.prediction.prediction_scores import DIVERGES, Score

if TYPE_CHECKING:
    from seatrial.estimation.simulation.sensor_errors import Noise

FitLevel = Literal["pass", "unjudged", "caution", "fail"]
# In order of gravity; unjudged is neither passed nor failed, for want of independent samples or of motion.
LEVELS: tuple[FitLevel, ...] = ("pass", "unjudged", "caution", "fail")
# Verdict on a run by the level of its finding.
FIT_LEVELS: Mapping[Level, FitLevel] = {"pass": "pass", "note": "unjudged", "caution": "caution", "alarm": "fail"}

POOR = 0.5  # Share of variance explained below which less is known of the motion than is not
# Share inside the 90 % band: errors 1.3 times those stated leave 0.8, errors twice as large 0.6.
NARROW, BROKEN = 0.8, 0.6
# Share inside the 90 % band of all held-back runs together below which bands do not hold: errors 1.14 times those
# stated.
NARROWER = 0.85
WIDE = 0.98  # Share inside the 90 % band when errors are 0.7 of those stated
# Variance of normalised residuals: 2 is errors 1.4 times those stated, 4 twice, 0.5 is 0.7 of them.
SPREAD, BURST, TAME = 2.0, 4.0, 0.5
MISSHAPEN = 0.1  # Distance of the transform from uniform: no probability that is stated is wrong by more than this
# Factor on standard deviations from which a correlation of residuals matters, and p-value below which it is no chance:
# of white residuals 0.5 % at most are called correlated (tests/estimation/test_integrated_correlation.py).
UNDERSTATED, LIKELY = 1.1, 0.01
FAINT = 0.1  # Correlation of neighbours below which only a sum over many lags shows one
# Sum of correlations over that of an autoregression with the same correlation of neighbours from which noise is a
# mixture.
BEYOND_ONE_TIME = 2.0
# Partial autocorrelation of order two, in its standard error 1 / sqrt(n), from which noise is said to be a mixture.
MIXED = 3.0
RARE = 0.00135  # Probability below which a departure is not put down to chance: three standard errors on one side
# Effective samples from which on bands are judged: of fewer, one outside more or less changes the verdict.
MIN_EFFECTIVE_SAMPLES = 10.0
# Mean square of normalised residuals that is no chance even where all samples are worth one: chi-square of one, three
# standard errors.
ONE_SAMPLE = 10.3
KS_CHANCE = 1.63  # 1 % point of the Kolmogorov-Smirnov distance times the root of the number of samples


# Codes of findings by which stated standard deviations are too small.
UNRELIABLE_SD = ("residuals-correlated", "residuals-biased")
LACKS = ("add-term", "add-delay", "add-error-model")  # Remedies for what a model may lack that misses motion


def judge_fit(
    score: Score,
    channel: str,
    held_back: bool,
    noise: "Noise",
    outside: bool = False,
    lacks: Sequence[str] = LACKS,
    feedback: bool = False,
) -> Finding:
    """Judge the scores of one channel; of several departures the first in order of gravity. A pass is a finding too.

    Args:
        score: of the channel.
        channel: its name.
        held_back: whether its run was not fitted.
        noise: as what its noise is modelled.
        outside: whether the run leaves the range that was fitted.
        lacks: remedies for what the model may lack and does not have yet.
        feedback: whether what the sensors showed made the controls, through an autopilot.
    """
    if not score.samples:
        return Finding("channel-not-measured", "note", (channel,), {}, ("check-map",))
    farther = ("fit-as-far",) if outside else ()
    if score.missing == DIVERGES:
        return Finding("prediction-diverges", "alarm", (channel,), {}, (*farther, "tame-priors"))
    if score.effective < MIN_EFFECTIVE_SAMPLES and score.variance < ONE_SAMPLE:
        return _few(score, channel, held_back, noise, feedback, lacks)
    result = _sizes(score, channel, held_back, farther) or _motion(score, channel, held_back, lacks)
    if result is None or (result.level == "note" and not held_back):
        result = check_residuals(score, channel, held_back, noise, feedback) or result
    return result or _shape(score, channel) or Finding("prediction-agrees", "pass", (channel,), _scores(score))


def check_residuals(score: Score, channel: str, held_back: bool, noise: "Noise", feedback: bool) -> Finding | None:
    """Report residuals that remember, by more than chance and by enough to matter; None where they do not. Arguments as `judge_fit`."""
    # Standard deviations that are too large do less harm: more than usual has to speak for that.
    chance = LIKELY if score.sd_factor > 1 else RARE
    if score.white > chance or 1 / UNDERSTATED < score.sd_factor < UNDERSTATED:
        return None
    is_faint = abs(score.correlation) < FAINT
    # A run that was not fitted shows the uncertainty of the coefficients, too, which is slow, and which the band contains; what was
    # fitted to a run takes slow errors away.
    if is_faint and (held_back or score.sd_factor < 1):
        return None
    # An autoregression, r_k = phi^k, has no partial autocorrelation of order two; white noise beside a slow error, r_k = a phi^k, has.
    # Where a is small, that one is lost in the noise, but the sum of r_k is not.
    partial = (score.second - score.correlation**2) / max(1 - score.correlation**2, 1e-3)
    alone = 2 * score.correlation / max(1 - score.correlation, 1e-3)
    mixed = partial > MIXED / np.sqrt(score.samples) or score.sd_factor**2 - 1 > BEYOND_ONE_TIME * alone
    values: dict[str, Value] = {
        "correlation": float(score.correlation),
        "interval": float(score.interval),
        "factor": float(score.sd_factor),
        "faint": bool(is_faint),
    }
    if noise in ("coloured", "drifting"):
        remedies = ("missing-term",) if noise == "drifting" else ("drifting-noise", "missing-term")
        return Finding("residuals-beyond-model", "caution", (channel,), values, remedies)
    if score.sd_factor < 1:
        return Finding("residuals-opposite", "caution", (channel,), values, ("check-filtering",))
    if feedback:
        return Finding("residuals-biased", "caution", (channel,), values, ("filter-error",))
    remedy = "drifting-noise" if mixed else "coloured-noise"
    return Finding("residuals-correlated", "caution", (channel,), values, (remedy,))


def _scores(score: Score) -> dict[str, Value]:
    """Return the scores that sentences name."""
    names = ("coverage", "variance", "explained", "effective", "noise_sd", "correlation_time")
    return {name: float(getattr(score, name)) for name in names}


def worst(findings: Sequence[Finding]) -> Finding:
    """Return the gravest finding of a trial's channels, the first of them where several are as grave."""
    return max(findings, key=lambda one: LEVELS.index(FIT_LEVELS[one.level]))


def _few(score: Score, channel: str, held_back: bool, noise: "Noise", feedback: bool, lacks: Sequence[str]) -> Finding:
    """Report that a run is worth too few samples to judge its band, and what it shows nevertheless."""
    if not held_back and (correlated := check_residuals(score, channel, held_back, noise, feedback)):
        return correlated
    motion = _motion(score, channel, held_back, lacks)
    if motion is None:
        return Finding("samples-too-few", "note", (channel,), _scores(score))
    return Finding("samples-too-few", "note", (channel,), {**_scores(score), "why": motion.code}, motion.remedies)


def _sizes(score: Score, channel: str, held_back: bool, farther: tuple[str, ...]) -> Finding | None:
    """Return the errors much larger or smaller than stated; samples in the band are binomial, the sum of squares chi-square."""
    n, values = max(score.effective, 1.0), _scores(score)
    short = betainc(n * (1 - score.coverage), n * score.coverage + 1, 0.1) < RARE
    large = chdtrc(n, n * score.variance) < RARE
    small = chdtr(n, n * score.variance) < RARE
    if (short and score.coverage < BROKEN) or (large and score.variance > BURST):
        remedies = (*farther, "look-at-trial") if held_back else ("look-at-residuals",)
        return Finding("errors-beyond-stated", "alarm", (channel,), values, remedies)
    if (short and score.coverage < NARROW) or (large and score.variance > SPREAD):
        remedies = (*farther, "more-trials") if held_back else ("outliers-or-term",)
        return Finding("band-too-narrow", "caution", (channel,), values, remedies)
    if small and not score.missing and score.variance < TAME and score.coverage > WIDE:
        return Finding("band-too-wide", "caution", (channel,), values, ("compare-sensors",))
    return None


def _motion(score: Score, channel: str, held_back: bool, lacks: Sequence[str]) -> Finding | None:
    """Little of the motion explained, and why: noise, ignorance or a wrong model, which sizes let through as honestly stated."""
    values = _scores(score)
    if score.missing:
        return Finding("signal-constant", "note", (channel,), values, ("moving-trial",))
    if score.explained >= POOR:
        return None
    if held_back and score.coefficient_share > POOR and score.variance < BURST:
        return Finding("coefficients-uncertain", "caution", (channel,), values, ("next-trial",))
    if score.noise_share > POOR:
        return Finding("noise-hides-motion", "note", (channel,), values, ("move-more",))
    if held_back:
        return Finding("predicted-poorly", "caution", (channel,), values, tuple(lacks))
    return Finding("fitted-poorly", "caution", (channel,), values, ("add-term", "add-delay", "estimated-start"))


def _shape(score: Score, channel: str) -> Finding | None:
    """Return the errors of the right size that are not normal, or lie to one side."""
    if score.pit_distance <= max(MISSHAPEN, KS_CHANCE / np.sqrt(max(score.effective, 1.0))):
        return None
    below = sum(score.pit[: len(score.pit) // 2])
    side = float(max(below, 1 - below)) if abs(below - 0.5) > MISSHAPEN else 0.0
    values = {"distance": float(score.pit_distance), "side": side}
    return Finding("errors-not-normal", "caution", (channel,), values, ("check-bias",))
