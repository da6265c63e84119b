"""Whether stated bands hold on all held-back runs of a channel taken together, where one run alone tells too little.

Of N effective samples the share c lies inside a band of probability 0.9. With k = c N (no whole number) its range is that of
Clopper and Pearson (Biometrika 26, 1934), and the probability of so few inside is the binomial one:

    I^-1(k, N - k + 1; 0.025) .. I^-1(k + 1, N - k; 0.975),        P(X <= k) = I(N - k, k + 1; 0.1),

I the regularised incomplete beta function. n residuals of which those k intervals apart have the correlation r_k about zero are worth
N = n / (1 + 2 sum_k p_k r_k^2 / n), p_k the pairs in all runs, the sum ending before the first r_k that is not positive: whether a
residual lies inside a band is a question about its square, whose correlation is at most r_k^2 (Kish, Survey Sampling, 1965, section
5.4). About zero, where right bands have their mean, and not about the mean of each run: a run that is shifted as a whole is one error.
Two samples of the motion that are uncertain together have the mean squared correlation s, in one run and in two. Where the shares c_i
of three runs or more scatter by more than that, N is what their scatter leaves, c (1 - c) / var(c), as where runs are rough or quiet
as a whole. The factor by which bands have to be widened is the 0.9 quantile of the absolute normalised residuals over that of a normal law.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import betainc, betaincinv, chdtrc, ndtri

from seatrial.core.findings import Finding, Value
from seatrial.estimation.prediction.fit_verdict import (
    BROKEN,
    BURST,
    FIT_LEVELS,
    LACKS,
    NARROWER,
    ONE_SAMPLE,
    POOR,
    RARE,
    TAME,
    WIDE,
    FitLevel,
)
from seatrial.estimation.prediction.prediction_scores import LaggedProducts, coverage, lagged_products

# Effective samples from which on all runs together may pass: of ten, slow errors twice those stated leave 85 % inside
# by chance too often (docs/held_back.md). A failure needs no number, since the tests know how few they are.
MIN_POOLED_SAMPLES = 20.0
BAND = 0.9  # Probability of the band that is tested
TAIL = 0.025  # Probability on either side of a range


@dataclass(frozen=True, eq=False)
class RunResiduals:
    """What the pooled judgement needs of one channel of one run; n measured samples.

    Attributes:
        z: residuals over their predicted standard deviation, noise included, shape (n,); not finite where the prediction diverges.
        lagged: products of these about zero, by how many intervals they are apart.
        motion_share: mean share of the predicted variance that is uncertainty of the motion.
        squares: sum of squared errors, SI.
        total: sum of squares of the measurements about their own mean, SI.
        noise: sum of squares that the noise of the fit alone would leave, SI.
    """

    z: Float[np.ndarray, " n"]
    lagged: LaggedProducts
    motion_share: float
    squares: float
    total: float
    noise: float


@dataclass(frozen=True)
class Pooled:
    """All held-back runs of one channel, judged together. Numbers are 0 where there is nothing to judge.

    Attributes:
        channel: measured channel.
        runs: that have measurements of it.
        samples: measured samples of all runs.
        effective: independent ones that they are worth.
        coverage: share of samples inside the 90 % band.
        lower: lower end of the 95 % range of that share.
        upper: upper end.
        least: share inside the band in the run with the fewest.
        most: share in the run with the most.
        p_value: probability that bands as stated hold so few, of all runs or of the worst of them, or leave such errors.
        explained: share of the variance about the runs' own means that is explained; negative is worse than those means.
        variance: mean square of the normalised residuals, 1 where errors are as large as stated.
        widen: factor on the half-width of the bands with which 90 % of the samples would lie inside.
        widen_lower: lower end of its 95 % range.
        widen_upper: upper end.
        verdict: what the numbers mean.
    """

    channel: str
    runs: int
    samples: int
    effective: float
    coverage: float
    lower: float
    upper: float
    least: float
    most: float
    p_value: float
    explained: float
    variance: float
    widen: float
    widen_lower: float
    widen_upper: float
    verdict: Finding

    @property
    def level(self) -> FitLevel:
        """Pass, unjudged, caution or fail."""
        return FIT_LEVELS[self.verdict.level]


def run_residuals(
    time: Float[np.ndarray, " n"],
    measured: Float[np.ndarray, " n"],
    mean: Float[np.ndarray, " n"],
    motion_sd: Float[np.ndarray, " n"],
    noise_sd: float,
) -> RunResiduals:
    """Return what the pooled judgement needs of one predicted run; arguments as `score_channel`.

    Args:
        time: s, strictly increasing.
        measured: SI, NaN where nothing was measured.
        mean: predicted, SI.
        motion_sd: standard deviation of the prediction without noise, SI.
        noise_sd: standard deviation of the noise, SI.
    """
    there = np.isfinite(measured)
    time, measured, mean, motion_sd = (column[there] for column in (time, measured, mean, motion_sd))
    sd = np.hypot(motion_sd, noise_sd)
    error = measured - mean
    with np.errstate(over="ignore", invalid="ignore"):
        squares, spread = float(error @ error), float(motion_sd @ motion_sd)
    if not (np.isfinite(squares) and np.isfinite(spread)):
        return RunResiduals(
            np.full(measured.size, np.inf), lagged_products(time, np.zeros(time.size)), 0.0, np.inf, 0.0, 0.0
        )
    return RunResiduals(
        z=error / sd,
        lagged=lagged_products(time, error / sd),
        motion_share=float(np.mean((motion_sd / sd) ** 2)) if measured.size else 0.0,
        squares=squares,
        total=float(np.sum((measured - measured.mean()) ** 2)) if measured.size else 0.0,
        noise=noise_sd**2 * measured.size,
    )


def pooled_verdict(
    runs: Sequence[RunResiduals], channel: str, shared: float | None = None, lacks: Sequence[str] = LACKS
) -> Pooled:
    """Judge the stated bands of one channel by all held-back runs together; a fail is an alarm.

    Args:
        runs: residuals of every held-back run, each predicted without having been fitted.
        channel: its name.
        shared: mean squared correlation of two samples, of whichever runs, that comes from the motion being uncertain; by default
            that motion is taken as one error that all runs share, which judges least.
        lacks: remedies for what the model may lack and does not have yet.
    """
    runs = [run for run in runs if run.z.size]
    z = np.concatenate([run.z for run in runs]) if runs else np.empty(0)
    if not z.size or not np.isfinite(z).all():
        verdict = (
            Finding("runs-diverge", "alarm", (channel,), {}, ("tame-priors",))
            if z.size
            else Finding("runs-not-measured", "note", (channel,))
        )
        return without_numbers(verdict, len(runs), z.size)
    sizes = np.array([run.z.size for run in runs], float)
    if shared is None:
        shared = float(np.average([run.motion_share for run in runs], weights=sizes)) ** 2
    pairs = _padded([run.lagged.pairs for run in runs])
    squared = _squared_correlation(_padded([run.lagged.products for run in runs]).sum(0), pairs.sum(0))
    within, among = np.maximum(pairs @ squared, shared * sizes**2), sizes.sum() ** 2 - np.sum(sizes**2)
    worth = sizes**2 / within
    n = min(float(sizes.sum() ** 2 / (within.sum() + shared * among)), _worth_by_scatter(runs, sizes))
    total = sum(run.total for run in runs)
    inside, variance = coverage(z, BAND), float(np.mean(z**2))
    lower, upper = share_range(inside, n)
    shares = [coverage(run.z, BAND) for run in runs]
    alone = [probability_of_so_few(share, one) for share, one in zip(shares, worth, strict=True)]
    numbers = {
        "channel": channel,
        "runs": len(runs),
        "samples": z.size,
        "effective": n,
        "coverage": inside,
        "lower": lower,
        "upper": upper,
        "least": min(shares),
        "most": max(shares),
        "p_value": min(probability_of_so_few(inside, n), len(runs) * min(alone), _probability_of_so_large(variance, n)),
        "explained": 1.0 - sum(run.squares for run in runs) / total if total > 0 else 0.0,
        "variance": variance,
        **dict(zip(("widen", "widen_lower", "widen_upper"), band_factor(z, n), strict=True)),
    }
    noisy = sum(run.noise for run in runs) > POOR * total
    uncertain = float(np.average([run.motion_share for run in runs], weights=sizes)) > POOR
    unjudged = Pooled(**numbers, verdict=Finding("bands-agree", "pass", (channel,)))
    return replace(unjudged, verdict=_judge(unjudged, noisy or uncertain, tuple(lacks)))


class MotionProducts(NamedTuple):
    """Sums over the measured samples of one channel of one run, from which the correlation of its uncertain motion follows.

    Attributes:
        products: of every pair of draws, the sum of the products of their departures from the mean motion, in predicted standard
            deviations, shape (draws, draws).
        samples: measured ones.
    """

    products: Float[np.ndarray, "draws draws"]
    samples: int


def motion_products(
    motions: Float[np.ndarray, "draws n m"], sd: Float[np.ndarray, "n m"], measured: Float[np.ndarray, "n m"]
) -> list[MotionProducts]:
    """Return for every channel what `shared_motion` needs of one run.

    Args:
        motions: outputs under each draw of the posterior, without noise, SI.
        sd: predicted standard deviation, noise included, SI.
        measured: SI, NaN where nothing was measured.
    """
    result = []
    with np.errstate(invalid="ignore"):
        departures = (motions - motions.mean(axis=0)) / sd
    for of_channel, there in zip(np.moveaxis(departures, 2, 0), np.isfinite(measured).T, strict=True):
        own = of_channel[:, there]
        result.append(MotionProducts(own @ own.T, int(there.sum())))
    return result


def shared_motion(runs: Sequence[MotionProducts]) -> float:
    """Return the mean squared correlation of two samples, of whichever of the runs, that comes from the motion being uncertain.

    Of draws X it is |X X'|^2 / (draws samples)^2 summed over the runs, the same draws of the coefficients in each.
    """
    samples = sum(run.samples for run in runs)
    products = sum(run.products for run in runs)
    if not samples or not np.isfinite(products).all():
        return 1.0
    return float(min(1.0, np.sum(products**2) / (len(products) * samples) ** 2))


def share_range(share: float, n: float) -> tuple[float, float]:
    """Return the 95 % range of a probability of which this share was found among n samples; n need not be whole."""
    k = share * n
    lower = float(betaincinv(k, n - k + 1, TAIL)) if share > 0 else 0.0
    upper = float(betaincinv(k + 1, n - k, 1 - TAIL)) if share < 1 else 1.0
    return lower, upper


def probability_of_so_few(share: float, n: float) -> float:
    """Return the probability that n samples, each inside a 90 % band with probability 0.9, are inside by this share or less."""
    return float(betainc(n * (1 - share), n * share + 1, 1 - BAND)) if share < 1 else 1.0


def band_factor(z: Float[np.ndarray, " n"], n: float) -> tuple[float, float, float]:
    """Return the factor by which 90 % bands have to be widened to hold 90 % of the samples, and its 95 % range.

    The ends are the quantiles of |z| at the ends of the range of a share of 0.9 among n samples.

    Args:
        z: normalised residuals of all runs.
        n: independent samples that they are worth.
    """
    result = np.quantile(np.abs(z), [BAND, *share_range(BAND, n)]) / ndtri(0.5 + 0.5 * BAND)
    factor, lower, upper = map(float, result)
    return factor, lower, upper


def _probability_of_so_large(variance: float, n: float) -> float:
    """Return the probability that errors as stated have such a mean square; 1 for one that would not matter."""
    return float(chdtrc(max(n, 1.0), max(n, 1.0) * variance)) if variance > BURST else 1.0


def _padded(rows: Sequence[Float[np.ndarray, " _"]]) -> Float[np.ndarray, "runs k"]:
    """Return rows of several lengths as one table, with zeros at their ends."""
    return np.stack([np.pad(row, (0, max(map(len, rows)) - len(row))) for row in rows])


def _squared_correlation(products: Float[np.ndarray, " k"], pairs: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """Return the weight of each lag in the number of samples: 1 for none, 2 r^2 up to the first that is not positive, 0 from there."""
    if not products[0] > 0:
        return np.full(products.size, 2.0) - (np.arange(products.size) == 0)
    correlation = np.minimum(products / np.maximum(pairs, 1.0) / (products[0] / pairs[0]), 1.0)
    weight = 2.0 * np.where(np.cumsum(correlation <= 0) > 0, 0.0, correlation) ** 2
    weight[0] = 1.0
    return weight


def _worth_by_scatter(runs: Sequence[RunResiduals], sizes: Float[np.ndarray, " runs"]) -> float:
    """Return the samples that the scatter of the runs' shares inside the band leaves; infinite where there are too few runs to tell."""
    shares, weights = np.array([coverage(run.z, BAND) for run in runs]), sizes / sizes.sum()
    mean = float(weights @ shares)
    among = float(weights @ (shares - mean) ** 2)
    if len(runs) < 3 or among == 0:
        return np.inf
    spread = float(weights @ weights)
    return max(1.0, mean * (1 - mean) * (1 - spread) / (among * spread))


def _judge(pooled: Pooled, excused: bool, lacks: tuple[str, ...]) -> Finding:
    """Judge the numbers; `excused` where noise or uncertain coefficients explain the errors, `lacks` as `pooled_verdict`."""
    n, subject = max(pooled.effective, 1.0), (pooled.channel,)
    names = ("runs", "coverage", "lower", "upper", "effective", "least", "most", "p_value", "explained")
    values: dict[str, Value] = {name: getattr(pooled, name) for name in (*names, "widen", "widen_lower", "widen_upper")}
    large = _probability_of_so_large(pooled.variance, n) < RARE
    short = (pooled.upper < BAND and pooled.coverage < NARROWER) or (pooled.least < BROKEN and pooled.p_value < RARE)
    if short or large or pooled.variance >= ONE_SAMPLE:
        return Finding("bands-too-narrow", "alarm", subject, values, ("widen-bands", *lacks))
    if n < MIN_POOLED_SAMPLES:
        return Finding("runs-too-few", "note", subject, values, ("hold-back-more",))
    if pooled.explained < 0:
        if not excused:
            return Finding("motion-not-predicted", "alarm", subject, values, lacks)
        return Finding("little-motion-predicted", "caution", subject, values, ("hold-back-moving",))
    if pooled.coverage < NARROWER:
        return Finding("bands-doubtful", "note", subject, values, ("hold-back-more", *lacks))
    if pooled.lower > BAND and pooled.coverage > WIDE and pooled.variance < TAME:
        return Finding("bands-too-wide", "caution", subject, values)
    return Finding("bands-agree", "pass", subject, values)


def without_numbers(verdict: Finding, runs: int, samples: int = 0) -> Pooled:
    """Return a verdict on a channel of so many runs that has no numbers."""
    numbers: dict[str, Any] = {field.name: 0.0 for field in fields(Pooled)}
    own = {"channel": verdict.subject[0], "runs": runs, "samples": samples, "verdict": verdict}
    return Pooled(**{**numbers, **own})
