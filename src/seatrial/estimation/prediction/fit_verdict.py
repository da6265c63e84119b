"""Pass, unjudged, caution or fail: what the scores of a predicted run, or of all held-back runs together, mean, and what to do.

A departure counts when it matters and when it is more than chance, for the number of independent samples that the runs are worth.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import scipy

from seatrial.core.findings import Finding, Level, Value
from seatrial.estimation.prediction.prediction_scores import (
    BAND,
    BURST,
    DIVERGES,
    PredictedRun,
    Score,
    score_channel,
    unscored,
)

if TYPE_CHECKING:
    from seatrial.estimation.simulation.sensor_errors import Noise

FitLevel = Literal["pass", "unjudged", "caution", "fail"]
# In order of gravity; unjudged is neither passed nor failed, for want of independent samples or of motion.
LEVELS: tuple[FitLevel, ...] = ("pass", "unjudged", "caution", "fail")
# Verdict on a run by the level of its finding.
FIT_LEVELS: Mapping[Level, FitLevel] = {"pass": "pass", "note": "unjudged", "caution": "caution", "alarm": "fail"}

POOR = 0.5  # Share of variance explained below which less is known of the motion than is not
# Share inside the 90 % band: errors 1.14 times those stated leave 0.85, twice as large 0.6, and 0.7 of them 0.98.
NARROW, BROKEN, WIDE = 0.85, 0.6, 0.98
# Factor on standard deviations from which a correlation of residuals matters, and p-value below which it is no chance.
UNDERSTATED, LIKELY = 1.1, 0.01
CHANCE = 0.00135  # Probability below which a share inside a band is not put down to chance: three standard errors on one side
# Independent samples from which on bands may pass: of ten, slow errors leave 85 % inside by chance too often (docs/dev/held_back.md).
MIN_EFFECTIVE_SAMPLES = 20.0
SLOW = "residuals-correlated"  # Code of a finding by which stated standard deviations are too small
LACKS = ("add-term", "add-delay", "add-error-model")  # Remedies for what a model may lack that misses motion


@dataclass(frozen=True, kw_only=True)
class Pooled(Score):
    """All held-back runs of one channel, judged together.

    Attributes:
        channel: measured channel.
        runs: that have measurements of it.
        least: share inside the 90 % band in the run with the fewest.
        most: share in the run with the most.
        verdict: verdict on the numbers.
    """

    channel: str
    runs: int
    least: float
    most: float
    verdict: Finding

    @property
    def level(self) -> FitLevel:
        """Pass, unjudged, caution or fail."""
        return FIT_LEVELS[self.verdict.level]


def judge_fit(
    score: Score,
    channel: str,
    held_back: bool,
    noise: "Noise",
    outside: bool = False,
    lacks: Sequence[str] = LACKS,
    feedback: bool = False,
    together: Mapping[str, Value] | None = None,
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
        together: of all held-back runs, what sentences name beside the scores; what is wrong with these is an alarm.
    """
    names = ("coverage", "lower", "upper", "p_value", "effective", "variance", "explained", "noise_sd")
    numbers = ("widen", "widen_lower", "widen_upper")
    values = {name: getattr(score, name) for name in (*names, *numbers)} | dict(together or {})

    def finding(code: str, level: Level, *remedies: str) -> Finding:
        return Finding(code, level, (channel,), values, remedies)

    farther = ("fit-as-far",) if outside else ()
    if not score.samples:
        return Finding("channel-not-measured", "note", (channel,), {}, ("check-map",))
    if score.missing == DIVERGES:
        return Finding("prediction-diverges", "alarm", (channel,), {}, (*farther, "tame-priors"))
    is_broken = score.coverage < BROKEN or score.variance > BURST
    if score.p_value < CHANCE and (score.coverage < NARROW or is_broken):
        if together:
            return finding("band-too-narrow", "alarm", "widen-bands", *lacks)
        remedies = (*farther, "look-at-trial" if is_broken else "more-trials") if held_back else ("look-at-residuals",)
        return finding("band-too-narrow", "alarm" if is_broken else "caution", *remedies)
    has_few = score.effective < MIN_EFFECTIVE_SAMPLES
    motion = _judge_motion(score, held_back, bool(together), lacks)
    if motion and motion[1] != "note" and not has_few:
        return finding(*motion)
    # A run that was not fitted shows the uncertainty of the coefficients, too, which is slow, and which the band contains.
    if not held_back and score.white < LIKELY and score.sd_factor > UNDERSTATED:
        values = {"factor": score.sd_factor, "modelled": noise in ("coloured", "drifting"), "feedback": feedback}
        error = ("missing-term",) if noise == "drifting" else ("drifting-noise",)
        return finding(SLOW, "caution", *(("filter-error",) if feedback else error))
    if motion:
        return finding(motion[0], "note", *motion[2:])
    if has_few or (held_back and score.coverage < NARROW):
        return finding("samples-too-few", "note", *(("hold-back-more",) if held_back else ()))
    n, inside = score.effective, score.coverage
    if inside > WIDE and scipy.special.betainc(n * inside, n * (1 - inside) + 1, BAND) < CHANCE:
        return finding("band-too-wide", "caution", "compare-sensors")
    return finding("prediction-agrees", "pass")


def judge_runs(runs: Sequence[PredictedRun], channel: str, lacks: Sequence[str] = LACKS) -> Pooled:
    """Judge the stated bands of one channel by all held-back runs together, each predicted without having been fitted.

    Args:
        runs: every held-back run.
        channel: its name.
        lacks: remedies for what the model may lack and does not have yet.
    """
    shares = [one.coverage for run in runs if (one := score_channel([run])).samples]
    score = score_channel(runs)
    by_run = {"runs": len(shares), "least": min(shares, default=0.0), "most": max(shares, default=0.0)}
    verdict = judge_fit(score, channel, True, "white", lacks=lacks, together=by_run)
    return Pooled(**vars(score), channel=channel, **by_run, verdict=verdict)


def without_numbers(verdict: Finding, runs: int) -> Pooled:
    """Return a verdict on a channel of so many runs that has no numbers."""
    return Pooled(**vars(unscored(0, "")), channel=verdict.subject[0], runs=runs, least=0.0, most=0.0, verdict=verdict)


def worst(findings: Sequence[Finding]) -> Finding:
    """Return the gravest finding of a trial's channels, the first of them if several are as grave."""
    return max(findings, key=lambda one: LEVELS.index(FIT_LEVELS[one.level]))


def _judge_motion(score: Score, held_back: bool, together: bool, lacks: Sequence[str]) -> tuple | None:
    """Return code, level and remedies if little of the motion is explained: noise, ignorance or a wrong model is why."""
    if score.explained >= (0.0 if together else POOR) and not score.missing:
        return None
    if held_back and score.coefficient_share > POOR:
        return "coefficients-uncertain", "caution", "next-trial"
    if score.noise_share > POOR:
        return "noise-hides-motion", "note", "move-more"
    if held_back:
        return "motion-not-predicted", "alarm" if together else "caution", *lacks
    return "motion-not-predicted", "caution", "add-term", "add-delay", "estimated-start"
