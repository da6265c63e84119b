"""Pass, unjudged, caution or fail: what the scores of a predicted trial mean, why, and what to do.

A departure counts when it matters (the limits below) and when it is more than chance, three standard errors, for the number of
independent samples that the trial is worth.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from scipy.special import betainc, chdtr, chdtrc

from seatrial.core.display_units import shown_unit
from seatrial.core.usual_priors import DRIFT_TIME_PRIOR, SIZE_PRIOR, TIME_PRIOR
from seatrial.estimation.prediction.prediction_scores import DIVERGES, Score
from seatrial.estimation.prediction.remedies import count_below

if TYPE_CHECKING:
    from seatrial.estimation.simulation.sensor_errors import Noise

FitLevel = Literal["pass", "unjudged", "caution", "fail"]
LEVELS: tuple[FitLevel, ...] = ("pass", "unjudged", "caution", "fail")
"""In order of gravity; unjudged is neither passed nor failed, for want of independent samples or of motion."""

POOR = 0.5
"""Share of variance explained below which less is known of the motion than is not."""
NARROW, BROKEN = 0.8, 0.6
"""Share inside the 90 % band: errors 1.3 times those stated leave 0.8, errors twice as large 0.6."""
NARROWER = 0.85
"""Share inside the 90 % band of all held-back runs together below which bands do not hold: errors 1.14 times those stated."""
WIDE = 0.98
"""Share inside the 90 % band when errors are 0.7 of those stated."""
SPREAD, BURST, TAME = 2.0, 4.0, 0.5
"""Variance of normalised residuals: 2 is errors 1.4 times those stated, 4 twice, 0.5 is 0.7 of them."""
MISSHAPEN = 0.1
"""Distance of the transform from uniform: no probability that is stated is wrong by more than this."""
UNDERSTATED, LIKELY = 1.1, 0.01
"""Factor on standard deviations from which a correlation of residuals matters, and p-value below which it is no chance: of white
residuals 0.5 % at most are called correlated (tests/estimation/test_integrated_correlation.py)."""
FAINT = 0.1
"""Correlation of neighbours below which only a sum over many lags shows one."""
BEYOND_ONE_TIME = 2.0
"""Sum of correlations over that of an autoregression with the same correlation of neighbours from which noise is a mixture."""
MIXED = 3.0
"""Partial autocorrelation of order two, in its standard error 1 / sqrt(n), from which noise is said to be a mixture."""
RARE = 0.00135
"""Probability below which a departure is not put down to chance: three standard errors on one side."""
FEWEST = 10.0
"""Effective samples from which on bands are judged: of fewer, one outside more or less changes the verdict."""
ONE_SAMPLE = 10.3
"""Mean square of normalised residuals that is no chance even where all samples are worth one: chi-square of one, three standard errors."""
KS_CHANCE = 1.63
"""1 % point of the Kolmogorov-Smirnov distance times the root of the number of samples."""


COLOURED, MIXED_COLOUR, BIASED = DISOWNING = (
    "correlated residuals",
    "slow and white residuals",
    "biased through the autopilot",
)
"""What verdicts are about that say that stated standard deviations are too small."""
WORSE_THAN_MEAN, WORSE_THAN_MEANS = "worse than the run's own mean", "worse than the runs' own means"
LACKS = ("a term", "a delay", "a model of the error")
"""What a model may lack that misses motion."""


_FARTHER = "fit a run that goes as far, or else "
"""What to do first where a run leaves the fitted range."""


class FitVerdict(NamedTuple):
    """A level, what it is about in a few words, the reason, which is what was found and means, and what to do, empty for a pass."""

    level: FitLevel
    about: str
    reason: str
    advice: str = ""


def judge_fit(
    score: Score,
    channel: str,
    held_back: bool,
    noise: "Noise",
    outside: bool = False,
    lacks: Sequence[str] = LACKS,
    feedback: bool = False,
) -> FitVerdict:
    """Say what the scores of one channel mean; of several departures the first in order of gravity.

    Args:
        score: of the channel.
        channel: its name.
        held_back: whether its run was not fitted.
        noise: as what its noise is modelled.
        outside: whether the run leaves the range that was fitted.
        lacks: what the model may lack and does not have yet.
        feedback: whether what the sensors showed made the controls, through an autopilot.
    """
    use = "prediction" if held_back else "fit"
    if not score.samples:
        return FitVerdict(
            "unjudged",
            "not measured",
            f"nothing was measured of {channel}: the {use} cannot be judged",
            "check the channel map",
        )
    if score.missing == DIVERGES:
        return FitVerdict(
            "fail",
            "diverges",
            f"the simulated {channel} grows without bound: the model cannot move as this trial did",
            f"{_FARTHER * outside}check units and signs, or narrow the priors to damping that dissipates",
        )
    if score.effective < FEWEST and score.variance < ONE_SAMPLE:
        return _few(score, channel, held_back, noise, feedback, lacks)
    found = _sizes(score, channel, held_back, outside) or _motion(score, channel, held_back, lacks)
    if found is None or (found.level == "unjudged" and not held_back):
        found = residual_verdict(score, channel, held_back, noise, feedback) or found
    return found or _shape(score, channel) or FitVerdict("pass", "", _praise(score, channel))


def residual_verdict(score: Score, channel: str, held_back: bool, noise: "Noise", feedback: bool) -> FitVerdict | None:
    """Say that residuals remember, by more than chance and by enough to matter; None where they do not. Arguments as `judge_fit`."""
    # Standard deviations that are too large do less harm: more than usual has to speak for that.
    chance = LIKELY if score.sd_factor > 1 else RARE
    if score.white > chance or 1 / UNDERSTATED < score.sd_factor < UNDERSTATED:
        return None
    is_faint = abs(score.correlation) < FAINT
    # A run that was not fitted shows the uncertainty of the coefficients, too, which is slow, and which the band contains; what was
    # fitted to a run takes slow errors away.
    if is_faint and (held_back or score.sd_factor < 1):
        return None
    lasting = ", and lasting" if is_faint else ""
    result = f"residuals of {channel} are correlated ({score.correlation:+.2f} over {score.interval:.2g} s{lasting})"
    if noise in ("coloured", "drifting"):
        remedy = (
            "look for a missing term"
            if noise == "drifting"
            else f"{slow_remedy('drifting', channel)}, or look for a missing term"
        )
        return FitVerdict(
            "caution",
            "correlated beyond the model",
            f"{result} after the fitted correlation is taken out: they have more than one time scale, and stated standard "
            "deviations are rough",
            remedy,
        )
    if score.sd_factor < 1:
        return FitVerdict(
            "caution",
            "opposite residuals",
            f"{result}, so they are not white noise: neighbours have opposite errors, and the stated standard deviations are "
            "too large",
            "check whether the sensor or the import filtered or differenced the channel",
        )
    if feedback:
        return FitVerdict(
            "caution",
            BIASED,
            f"{result}: the autopilot puts these errors into the controls, which biases the coefficients, and more data do not help",
            'set estimation.likelihood = "filter-error"',
        )
    # An autoregression, r_k = phi^k, has no partial autocorrelation of order two; white noise beside a slow error, r_k = a phi^k, has.
    # Where a is small, that one is lost in the noise, but the sum of r_k is not.
    partial = (score.second - score.correlation**2) / max(1 - score.correlation**2, 1e-3)
    alone = 2 * score.correlation / max(1 - score.correlation, 1e-3)
    mixed = partial > MIXED / np.sqrt(score.samples) or score.sd_factor**2 - 1 > BEYOND_ONE_TIME * alone
    return FitVerdict(
        "caution",
        MIXED_COLOUR if mixed else COLOURED,
        f"{result}, so they are not white noise: the stated standard deviations are too small, by a factor of about "
        f"{score.sd_factor:.1f}",
        slow_remedy("drifting" if mixed else "coloured", channel),
    )


def either(words: Sequence[str]) -> str:
    """Return alternatives as a sentence has them: `a`, `a or b`, `a, b or c`."""
    return " or ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def explained_words(share: float, channel: str) -> str:
    """Say what share of a channel's variance is explained, below nothing in words and as a number."""
    if share < 0:
        return f"{channel} is predicted {explained_share(share).replace('than', 'than by').replace('%)', '% of its variance explained)')}"
    return f"{explained_share(share)} of the variance of {channel} is explained"


def explained_short(share: float, runs: int = 1) -> str:
    """Say the same in a line that names the channel."""
    return explained_share(share, runs, 1) + " of the variance explained" * (share >= 0)


def explained_share(share: float, runs: int = 1, digits: int = 0) -> str:
    """Return the explained share of the variance of one run, or of several, for a table: of less than nothing, what that means, too."""
    if share < 0:
        number = f"{share:.0%}" if share > -100 else f"{100 * share:.0e}%"
        return f"{WORSE_THAN_MEAN if runs == 1 else WORSE_THAN_MEANS} ({number})"
    return f"{share:.{1 if share > 0.99 else digits}%}"


def worst(verdicts: Sequence[FitVerdict]) -> FitVerdict:
    """Return the gravest verdict of a trial's channels, the first of them where several are as grave."""
    return max(verdicts, key=lambda verdict: LEVELS.index(verdict.level))


def _few(
    score: Score, channel: str, held_back: bool, noise: "Noise", feedback: bool, lacks: Sequence[str]
) -> FitVerdict:
    """Say that a run tells too little of its band, and what it shows nevertheless."""
    if not held_back and (found := residual_verdict(score, channel, held_back, noise, feedback)):
        return found
    motion = _motion(score, channel, held_back, lacks)
    worth = (
        "one independent sample"
        if score.effective < 1.5
        else f"{count_below(score.effective, FEWEST)} independent samples"
    )
    return FitVerdict(
        "unjudged",
        motion.about if motion else "too little to judge",
        f"{channel} of this run is worth {worth}, too few to judge whether its band holds ({FEWEST:.0f} are needed; "
        f"{score.coverage:.0%} lies inside the 90 % band); "
        + (motion.reason if motion else explained_words(score.explained, channel)),
        motion.advice if motion else "",
    )


def _sizes(score: Score, channel: str, held_back: bool, outside: bool) -> FitVerdict | None:
    """Return the errors much larger or smaller than stated; samples in the band are binomial, the sum of squares chi-square."""
    n = max(score.effective, 1.0)
    short = betainc(n * (1 - score.coverage), n * score.coverage + 1, 0.1) < RARE
    large = chdtrc(n, n * score.variance) < RARE
    small = chdtr(n, n * score.variance) < RARE
    result = f"{score.coverage:.0%} of {channel} lies inside the 90 % band and errors are {np.sqrt(score.variance):.1f} times those stated"
    if (short and score.coverage < BROKEN) or (large and score.variance > BURST):
        do = (
            f"{_FARTHER * outside}look at this trial for a sensor fault, a wrong unit or another condition (current, load, trim), then "
            "add a term or fit it too"
            if held_back
            else "look at its residuals for outliers, a wrong unit or a missing term"
        )
        return FitVerdict(
            "fail", "errors beyond what is stated", f"{result}: do not rely on its stated uncertainty", do
        )
    if (short and score.coverage < NARROW) or (large and score.variance > SPREAD):
        do = (
            f"{_FARTHER * outside}fit more trials like it, or add a term"
            if held_back
            else "look for outliers or a missing term"
        )
        return FitVerdict("caution", "band too narrow", f"{result}: the stated uncertainty is too small", do)
    if small and not score.missing and score.variance < TAME and score.coverage > WIDE:
        return FitVerdict(
            "caution",
            "band too wide",
            f"{result}: this trial was quieter than the stated noise, so the band promises less than the model can do",
            "check whether the trials have the same sensors",
        )
    return None


def _motion(score: Score, channel: str, held_back: bool, lacks: Sequence[str]) -> FitVerdict | None:
    """Little of the motion explained, and why: noise, ignorance or a wrong model, which sizes let through as honestly stated."""
    if score.missing:
        return FitVerdict(
            "unjudged",
            "never changes",
            f"the measured {channel} never changes: how much of its motion is explained has no meaning",
            "test on a trial that moves",
        )
    if score.explained >= POOR:
        return None
    result, left = explained_words(score.explained, channel), _noise_words(score, channel)
    if held_back and score.coefficient_share > POOR and score.variance < BURST:
        return FitVerdict(
            "caution",
            "coefficients uncertain",
            f"{result}, which is what the uncertainty of the coefficients allows: they are not known well enough to predict it",
            "run the next trial that is proposed",
        )
    if score.noise_share > POOR:
        return FitVerdict(
            "unjudged",
            "noise hides the motion",
            f"{result}: the residuals of the fit, {left}, are as large as the motion of this run, so this run tests little",
            "use one that moves more, or add a term if the sensor is better than that",
        )
    if held_back:
        return FitVerdict(
            "caution",
            "predicted poorly",
            f"{result}: the model misses most of the motion; its band is wide because of the residuals of the fit, "
            f"{left}, not because the coefficients are uncertain",
            f"add {either(lacks)}",
        )
    return FitVerdict(
        "caution",
        "fitted poorly",
        f"{result}: the model misses most of the motion",
        "add a term, a delay or an estimated initial state",
    )


def _noise_words(score: Score, channel: str) -> str:
    """Size of the noise of the fit, and its correlation time."""
    factor, unit = shown_unit(channel)
    slow = f" with a correlation time of {score.correlation_time:.2g} s" if score.correlation_time else ""
    return f"{score.noise_sd * factor:.2g} {unit}{slow}"


def slow_remedy(kind: "Noise", channel: str) -> str:
    """Say how to model residuals that are slow, or white noise on slow ones, and with which priors."""
    from seatrial.estimation.simulation.sensor_errors import correlation_name, drift_name, drift_time_name

    if kind == "coloured":
        return (
            f'set estimation.residuals = "coloured", and for each channel add a section of its correlation time in s, here '
            f"[prior.{correlation_name(channel)}], for example with {TIME_PRIOR}"
        )
    return (
        'set estimation.residuals = "drifting", white noise on a slow error, and for each channel add sections of the size and of the '
        f"correlation time of the slow one, here [prior.{drift_name(channel)}], for example with {SIZE_PRIOR}, and "
        f"[prior.{drift_time_name(channel)}], in s, up to three times the duration of a run, for example with {DRIFT_TIME_PRIOR}, "
        f"in place of [prior.{correlation_name(channel)}] where there is one"
    )


def _shape(score: Score, channel: str) -> FitVerdict | None:
    """Return the errors of the right size that are not normal, or lie to one side."""
    if score.pit_distance <= max(MISSHAPEN, KS_CHANCE / np.sqrt(max(score.effective, 1.0))):
        return None
    below = sum(score.pit[: len(score.pit) // 2])
    side = f", {max(below, 1 - below):.0%} of it on one side of the prediction" if abs(below - 0.5) > MISSHAPEN else ""
    return FitVerdict(
        "caution",
        "errors not normal",
        f"errors of {channel} are not spread as stated (off by {score.pit_distance:.2f}{side}): probabilities are rough",
        "look for a bias of the sensor or outliers",
    )


def _praise(score: Score, channel: str) -> str:
    return f"{explained_words(score.explained, channel)} and {score.coverage:.0%} lies inside the 90 % band"
