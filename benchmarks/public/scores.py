"""Scores of predicted runs: each channel of each run, and all held-back runs of a channel together.

Pooled over runs the explained share is 1 - sum SSE / sum SST, each run about its own mean; CRPS, log score and coverage are means over
samples. A coverage is held against the binomial distribution of as many samples as the errors are worth
(`seatrial.estimation.prediction.prediction_scores.independent_samples`); below ten of these it cannot be judged.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from jaxtyping import Float

from seatrial.estimation.prediction.prediction_scores import (
    DIVERGES,
    LOG_2PI,
    coverage,
    crps_normal,
    independent_samples,
)

FEWEST_EFFECTIVE = 10.0
"""Effective samples below which a coverage is not judged."""
RANGE = 0.95
"""Probability of the binomial range of a coverage."""
BAND, HALF_BAND = 0.9, 0.5
"""Probabilities of the two bands."""


@dataclass(frozen=True)
class RunScore:
    """How one channel of one run was predicted; numbers are None where they do not exist, and `missing` says why.

    Attributes:
        run: its label.
        channel: measured signal.
        samples: predicted samples that were measured.
        effective: independent ones that the errors are worth.
        squares: sum of squared errors, and of squared distances from the mean, SI.
        explained: share of the variance explained.
        crps: mean continuous ranked probability score, SI.
        log_score: mean log density, nats, of the channel in SI.
        coverage_50: share of samples inside the 50 % band.
        coverage_90: share of samples inside the 90 % band.
        missing: empty, or why there are no scores.
    """

    run: str
    channel: str
    samples: int
    effective: float
    squares: tuple[float, float] | None
    explained: float | None
    crps: float | None
    log_score: float | None
    coverage_50: float | None
    coverage_90: float | None
    missing: str = ""


@dataclass(frozen=True)
class PooledScore:
    """How one channel was predicted over all held-back runs; see `RunScore`.

    Attributes:
        channel: measured signal.
        runs: how many were scored.
        failed: runs whose prediction diverges.
        samples: of all runs.
        effective: of all runs.
        explained: share of the variance explained.
        crps: SI.
        log_score: nats.
        coverage_50: share inside the 50 % band.
        coverage_90: share inside the 90 % band.
        range_90: where the latter lies with 95 % probability if 90 % is right; None where it cannot be judged.
    """

    channel: str
    runs: int
    failed: int
    samples: int
    effective: float
    explained: float | None
    crps: float | None
    log_score: float | None
    coverage_50: float | None
    coverage_90: float | None
    range_90: tuple[float, float] | None

    @property
    def holds(self) -> bool | None:
        """Whether the 90 % band holds as often as it says, by its binomial range; None where that cannot be judged."""
        if self.coverage_90 is None or self.range_90 is None:
            return None
        low, high = self.range_90
        return low <= self.coverage_90 <= high


def score_run(
    run: str,
    channel: str,
    time: Float[np.ndarray, " n"],
    measured: Float[np.ndarray, " n"],
    mean: Float[np.ndarray, " n"],
    sd: Float[np.ndarray, " n"],
) -> RunScore:
    """Score a normal prediction of one channel of one run.

    Args:
        run: label.
        channel: name.
        time: s, strictly increasing.
        measured: SI, NaN where nothing was measured.
        mean: predicted, SI; NaN where nothing was predicted.
        sd: its standard deviation, noise included, SI.
    """
    there = np.isfinite(measured) & ~np.isnan(mean)
    if not there.any():
        return _without(run, channel, 0, "nothing was measured or predicted")
    time, measured, mean, sd = time[there], measured[there], mean[there], sd[there]
    if not (np.isfinite(mean).all() and np.isfinite(sd).all() and (sd > 0).all()):
        return _without(run, channel, int(measured.size), DIVERGES)
    z = (measured - mean) / sd
    squares = float(np.sum((measured - mean) ** 2)), float(np.sum((measured - measured.mean()) ** 2))
    return RunScore(
        run,
        channel,
        int(measured.size),
        independent_samples([(time, z)]),
        squares,
        1.0 - squares[0] / squares[1] if squares[1] > 0 else None,
        float(crps_normal(measured, mean, sd).mean()),
        float(np.mean(-0.5 * z * z - np.log(sd)) - 0.5 * LOG_2PI),
        coverage(z, HALF_BAND),
        coverage(z, BAND),
    )


def pool(scores: Sequence[RunScore]) -> PooledScore:
    """Return the scores of one channel over several runs; runs whose prediction diverges are counted and no numbers are given."""
    channel = scores[0].channel
    failed = sum(score.missing == DIVERGES for score in scores)
    there = [score for score in scores if not score.missing]
    samples, effective = sum(score.samples for score in there), float(sum(score.effective for score in there))
    if failed or not there:
        return PooledScore(channel, len(there), failed, samples, effective, *(None,) * 6)
    errors, total = (sum(score.squares[i] for score in there if score.squares) for i in (0, 1))

    def mean(name: str) -> float:
        return float(sum(getattr(score, name) * score.samples for score in there) / samples)

    return PooledScore(
        channel,
        len(there),
        0,
        samples,
        effective,
        1.0 - errors / total if total > 0 else None,
        mean("crps"),
        mean("log_score"),
        mean("coverage_50"),
        mean("coverage_90"),
        binomial_range(effective, BAND),
    )


def binomial_range(effective: float, share: float) -> tuple[float, float] | None:
    """Return where the share of so many independent samples lies with 95 % probability; None below ten samples."""
    if effective < FEWEST_EFFECTIVE:
        return None
    count = int(effective)
    low, high = scipy.stats.binom.interval(RANGE, count, share)
    return float(low) / count, float(high) / count


def _without(run: str, channel: str, samples: int, why: str) -> RunScore:
    return RunScore(run, channel, samples, 0.0, *(None,) * 6, missing=why)
