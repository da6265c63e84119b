"""Scores of one channel of predicted runs, normal predictions and stated noise given, and how many independent samples they rest on.

Scores of a predicted distribution once the measurement is known:

    CRPS = int (F(x) - 1{y <= x})^2 dx                   Gneiting and Raftery, JASA 102, 2007

That of a normal prediction has a closed form. Of n residuals with correlations r_k about zero the mean has 1 + 2 sum_k r_k times the
variance that white noise would give it: the root of this ratio is the factor by which stated standard deviations of what changes slowly
are too small, and n over the ratio is the number of independent samples. The sum is weighed by Bartlett's triangle up to a lag q,

    V(q) = 1 + 2 sum_k<q (1 - k / q) r_k

(Newey and West, Econometrica 55, 1987; the variance ratio of Lo and MacKinlay, Rev. Financ. Stud. 1, 1988), which a small slow part
beside white noise raises although it hides in each r_k. Of q = 2, 4, 8 ... the data choose the one whose V is farthest above 1 in standard
deviations, of a chi-square law with the mean, 1, and the variance of white noise, 4 sum_k (1 - k / q)^2 N_k / n^2, N_k the pairs k
intervals apart; the probability of the largest is times the number of q that are tried. At that q the whole sum is taken. Of several runs
products are added, so that with enough of them q reaches the length of a run: each is then one cluster.

Uncertain coefficients move all runs at once: n' = n / (1 + (n - 1) s), s the squared share of the predicted variance that they make (Kish,
Survey Sampling, 1965, section 5.4; squared, since a sum of squares of normal errors has the variance 2 sum_ij c_ij^2).

Of n' samples the share c lies inside a band of probability 0.9. With k = c n' (no whole number) its range is that of Clopper and Pearson
(Biometrika 26, 1934), and the probability of so few inside is the binomial one:

    I^-1(k, n' - k + 1; 0.025) .. I^-1(k + 1, n' - k; 0.975),        P(X <= k) = I(n' - k, k + 1; 0.1),

I the regularised incomplete beta function. The factor by which bands have to be widened is the 0.9 quantile of the absolute normalised
residuals over that of a normal law.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
import scipy
from jaxtyping import Float

from seatrial.core.result_table import text_html

BAND = 0.9  # Probability of the band that is tested
TAIL = 0.025  # Probability on either side of a range
BURST = 4.0  # Mean square of normalised residuals, of errors twice those stated, from which it counts beside the share inside a band
BINS = 10  # Bins of the histogram of the probability integral transform
LONGEST_GAP = 1000  # Intervals that a gap in a run counts as at most: no correlation is looked for across a longer one
MIN_FREEDOM = 6.0  # Degrees of freedom of V(q) below which q is too long for the runs
DIVERGES = "the prediction diverges"
BEYOND = 1e6  # Largest prediction, over the largest measurement, that is no divergence
LOG_2PI = float(np.log(2 * np.pi))


class SlowNoise(NamedTuple):
    """What is slow in the noise of a sensor: an Ornstein-Uhlenbeck process, white noise making up the rest.

    Attributes:
        time: correlation time, s.
        share: of the variance of the noise.
    """

    time: float
    share: float


class PredictedRun(NamedTuple):
    """One channel of one run as it is predicted, n samples.

    Attributes:
        time: s, strictly increasing, shape (n,).
        measured: SI, NaN if nothing was measured, shape (n,).
        mean: predicted, SI, shape (n,).
        motion_sd: standard deviation of the prediction without noise, SI, shape (n,).
        noise_sd: standard deviation of the noise, SI, shape (n,), or one number.
        slow: what is slow in the noise as it is modelled; what should be white is then what is new in the residuals.
        coefficient_sd: part of `motion_sd` that comes from the coefficients being uncertain, shape (n,); all of it by default.
    """

    time: Float[np.ndarray, " n"]
    measured: Float[np.ndarray, " n"]
    mean: Float[np.ndarray, " n"]
    motion_sd: Float[np.ndarray, " n"]
    noise_sd: Float[np.ndarray, " n"] | float
    slow: SlowNoise | None = None
    coefficient_sd: Float[np.ndarray, " n"] | None = None


class LongRunVariance(NamedTuple):
    """Variance of a mean of residuals, and whether it is that of white noise.

    Attributes:
        ratio: over its nominal value, the one of white residuals of the same mean square.
        p_value: probability that white noise shows as large a V(q); 1 if there is nothing to test.
    """

    ratio: float
    p_value: float


@dataclass(frozen=True)
class Score:
    """How one channel of one run, or of several together, is predicted. Numbers that do not exist are 0, and `missing` gives the reason.

    Attributes:
        samples: measured samples.
        effective: independent ones that they are worth, n'.
        explained: share of the variance about the runs' own means explained, 1 - SSE / SST; negative is worse than those means.
        nrmse: normalised fit, 1 - sqrt(SSE / SST), as MATLAB's `compare` gives it, over 100.
        rmse: root mean square error, in the channel's unit.
        crps: mean continuous ranked probability score, in the channel's unit.
        log_score: mean log density of the measurements under their own predictions, one at a time, nats for the channel in its SI unit.
        coverage_50: share of samples inside the 50 % band.
        coverage: share of samples inside the 90 % band.
        lower: lower end of the 95 % range of that share.
        upper: upper end.
        p_value: probability that right bands contain so few samples, or have errors so large.
        variance: mean square of the normalised residuals, 1 if errors are as large as stated.
        widen: factor on the half-width of the bands with which 90 % of the samples would lie inside.
        widen_lower: lower end of its 95 % range.
        widen_upper: upper end.
        pit: histogram of the probability integral transform, shares that would all be 1 / 10.
        white: probability that white noise is as correlated as the residuals that should be white.
        sd_factor: factor by which standard deviations of slow quantities are too small if these residuals are taken as white.
        noise_share: share of the measured variance that the fitted noise explains; 1 if the variance is zero.
        noise_sd: standard deviation of that noise, in the channel's SI unit.
        coefficient_share: share of the predicted variance that comes from the uncertainty of the coefficients.
        missing: empty, or why some numbers do not exist.
    """

    samples: int
    effective: float
    explained: float
    nrmse: float
    rmse: float
    crps: float
    log_score: float
    coverage_50: float
    coverage: float
    lower: float
    upper: float
    p_value: float
    variance: float
    widen: float
    widen_lower: float
    widen_upper: float
    pit: tuple[float, ...]
    white: float
    sd_factor: float
    noise_share: float
    noise_sd: float
    coefficient_share: float
    missing: str = ""

    def __repr__(self) -> str:
        """Print how much is explained, and how far the stated bands hold."""
        if self.missing:
            return f"Score: {self.samples} samples; {self.missing}"
        return (
            f"Score: {self.samples} samples, as informative as {self.effective:.0f} independent ones; {self.explained:.1%} of the "
            f"variance explained; rmse {self.rmse:.3g}; {self.coverage:.0%} inside the 90 % band"
        )

    _repr_html_ = text_html


def crps_normal(
    measured: Float[np.ndarray, " n"], mean: Float[np.ndarray, " n"], sd: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Continuous ranked probability score of normal predictions, in the unit of the measurement; lower is better.

    Args:
        measured: measurements, shape (n,).
        mean: predicted means, shape (n,).
        sd: predicted standard deviations, noise included, shape (n,).
    """
    z = (measured - mean) / sd
    return sd * (z * (2 * scipy.special.ndtr(z) - 1) + 2 * np.exp(-0.5 * z**2 - 0.5 * LOG_2PI) - 1 / np.sqrt(np.pi))


def coverage(z: Float[np.ndarray, " n"], level: float) -> float:
    """Share of normalised residuals inside the central band of this probability."""
    return float(np.mean(np.abs(z) <= scipy.special.ndtri(0.5 + 0.5 * level)))


def share_range(share: float, n: float) -> tuple[float, float]:
    """Return the 95 % range of a probability of which this share was found among n samples; n need not be whole."""
    k = share * n
    lower = float(scipy.special.betaincinv(k, n - k + 1, TAIL)) if share > 0 else 0.0
    upper = float(scipy.special.betaincinv(k + 1, n - k, 1 - TAIL)) if share < 1 else 1.0
    return lower, upper


def probability_of_so_few(share: float, n: float) -> float:
    """Return the probability that n samples, each inside a 90 % band with probability 0.9, are inside by this share or less."""
    return float(scipy.special.betainc(n * (1 - share), n * share + 1, 1 - BAND)) if share < 1 else 1.0


def band_factor(z: Float[np.ndarray, " n"], n: float) -> tuple[float, float, float]:
    """Return the factor by which 90 % bands have to be widened to hold 90 % of the samples, and its 95 % range.

    The ends are the quantiles of |z| at the ends of the range of a share of 0.9 among n samples.

    Args:
        z: normalised residuals of all runs.
        n: independent samples that they are worth.
    """
    factor, lower, upper = map(
        float, np.quantile(np.abs(z), [BAND, *share_range(BAND, n)]) / scipy.special.ndtri(0.5 + 0.5 * BAND)
    )
    return factor, lower, upper


def long_run_variance(
    runs: Sequence[tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]],
) -> LongRunVariance:
    """Return the variance of the mean of residuals, about zero, over its nominal value; pairs across a gap count at their own lag.

    Args:
        runs: times, s, strictly increasing, and residuals at them, all present, of each run.
    """
    lagged = [_lagged_products(time, values) for time, values in runs if values.size]
    total = sum(float(products[0]) for products, _ in lagged)
    longest = max((products.size for products, _ in lagged), default=0)
    if not total:
        return LongRunVariance(1.0, 1.0)
    correlation, scatter = np.zeros(longest), np.zeros(longest)
    for products, pairs in lagged:
        correlation[: products.size] += products / total
        scatter[: products.size] += pairs * (products[0] / (pairs[0] * total)) ** 2
    result, p_value, clearest, tried, lag = 1.0, 1.0, -np.inf, 0, 2
    # Beyond the longest run all its pairs count, by ever fuller weights.
    while lag <= 2 * longest:
        weight = np.maximum(0.0, 1 - np.arange(1, longest) / lag)
        variance = 4 * float(weight**2 @ scatter[1:])
        if variance > 2 / MIN_FREEDOM:
            break
        if variance > 0:
            ratio, freedom, tried = 1 + 2 * float(weight @ correlation[1:]), 2 / variance, tried + 1
            p_value = min(p_value, float(scipy.special.chdtrc(freedom, max(0.0, freedom * ratio))))
            if (ratio - 1) / np.sqrt(variance) > clearest:
                clearest, result = (ratio - 1) / np.sqrt(variance), 1 + 2 * float(correlation[1:lag].sum())
        lag *= 2
    return LongRunVariance(max(0.0, result), min(1.0, max(1, tried) * p_value))


def independent_samples(runs: Sequence[tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]]) -> float:
    """Return the number of independent samples that residuals about zero are worth; arguments as `long_run_variance`."""
    return sum(values.size for _, values in runs) / max(1.0, long_run_variance(runs).ratio)


def score_channel(runs: Sequence[PredictedRun]) -> Score:
    """Score normal predictions of one channel.

    Args:
        runs: one or several, judged together.
    """
    runs = [run for run in map(_measured, runs) if run.time.size]
    if not runs:
        return unscored(0, "nothing was measured")
    measured, mean, motion_sd = (
        np.concatenate(column)
        for column in zip(*((one.measured, one.mean, one.motion_sd) for one in runs), strict=True)
    )
    own_sd = [run.motion_sd if run.coefficient_sd is None else run.coefficient_sd for run in runs]
    noise_sd = np.concatenate([np.broadcast_to(run.noise_sd, run.time.shape) for run in runs])
    sd = np.hypot(motion_sd, noise_sd)
    if diverges(measured, mean, sd):
        return unscored(measured.size, DIVERGES)
    error = measured - mean
    z, own = error / sd, [(run.measured - run.mean) / np.hypot(run.motion_sd, run.noise_sd) for run in runs]
    moving = [run.measured - run.measured.mean() if _moves(run.measured) else np.zeros(1) for run in runs]
    total, squares = sum(float(one @ one) for one in moving), float(error @ error)
    unexplained = squares / total if total else 1.0
    motion_share = float(np.mean((motion_sd / sd) ** 2))
    n = independent_samples([(run.time, one) for run, one in zip(runs, own, strict=True)])
    n /= 1 + max(0.0, n - 1) * motion_share**2
    inside, variance = coverage(z, BAND), float(np.mean(z**2))
    large = float(scipy.special.chdtrc(max(n, 1.0), max(n, 1.0) * variance)) if variance > BURST else 1.0
    (lower, upper), widen = share_range(inside, n), band_factor(z, n)
    new = long_run_variance(
        [(run.time, new_residuals(run.time, one, run.slow)) for run, one in zip(runs, own, strict=True)]
    )
    return Score(
        samples=measured.size,
        effective=n,
        explained=1.0 - unexplained,
        nrmse=1.0 - float(np.sqrt(unexplained)),
        rmse=float(np.sqrt(np.mean(error**2))),
        crps=float(crps_normal(measured, mean, sd).mean()),
        log_score=float(np.mean(-0.5 * z**2 - np.log(sd)) - 0.5 * LOG_2PI),
        coverage_50=coverage(z, 0.5),
        coverage=inside,
        lower=lower,
        upper=upper,
        p_value=min(probability_of_so_few(inside, n), large),
        variance=variance,
        widen=widen[0],
        widen_lower=widen[1],
        widen_upper=widen[2],
        pit=tuple(map(float, np.histogram(scipy.special.ndtr(z), BINS, (0.0, 1.0))[0] / z.size)),
        white=new.p_value,
        sd_factor=float(np.sqrt(new.ratio)),
        noise_share=min(1.0, float(noise_sd @ noise_sd) / total) if total else 1.0,
        noise_sd=float(np.sqrt(np.mean(noise_sd**2))),
        coefficient_share=float(np.mean((np.concatenate(own_sd) / sd) ** 2)),
        missing="" if total else "the measurement never changes",
    )


def new_residuals(
    time: Float[np.ndarray, " n"], z: Float[np.ndarray, " n"], slow: SlowNoise | None
) -> Float[np.ndarray, " n"]:
    """Return what is new in normalised residuals, white where the noise is as it is modelled; all of them if that is white."""
    return z if slow is None else _innovations(time, z, slow)


def diverges(measured: Float[np.ndarray, " n"], mean: Float[np.ndarray, " n"], sd: Float[np.ndarray, " n"]) -> bool:
    """Return whether a prediction is not finite, or so far beyond all that was measured that it overflows as its run goes on.

    Args:
        measured: all present.
        mean: predicted.
        sd: its standard deviation, noise included.
    """
    if not (np.isfinite(mean).all() and np.isfinite(sd).all()):
        return True
    size = float(np.abs(measured).max(initial=0.0))
    return bool(size > 0.0 and max(np.abs(mean).max(), sd.max()) > BEYOND * size)


def unscored(samples: int, why: str) -> Score:
    """Return a score without numbers."""
    numbers: dict[str, Any] = {field.name: 0.0 for field in fields(Score)}
    return Score(**{**numbers, "samples": samples, "pit": (), "missing": why})


def _measured(run: PredictedRun) -> PredictedRun:
    """Return a run with its measured samples alone, and all its columns."""
    there = np.isfinite(run.measured)
    coefficient_sd = None if run.coefficient_sd is None else run.coefficient_sd[there]
    return run._replace(
        time=run.time[there],
        measured=run.measured[there],
        mean=run.mean[there],
        motion_sd=run.motion_sd[there],
        noise_sd=np.broadcast_to(run.noise_sd, there.shape)[there],
        coefficient_sd=coefficient_sd,
    )


def _lagged_products(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return sums of products of residuals that are 0, 1, 2 ... median intervals apart, and how many pairs each sums."""
    step = np.diff(time)
    # Counted from sample to sample, so that jitter of the clock does not add up.
    gaps = np.clip(np.round(step / np.median(step)), 1, LONGEST_GAP).astype(int) if step.size else []
    at = np.cumsum([0, *gaps])
    there, spread = np.zeros(at[-1] + 1), np.zeros(at[-1] + 1)
    there[at], spread[at] = 1.0, values
    products, pairs = (scipy.signal.correlate(one, one, method="fft")[at[-1] :] for one in (spread, there))
    return products, pairs.round()


def _moves(values: np.ndarray) -> bool:
    """Return whether values differ by more than rounding."""
    return bool(np.ptp(values) > 1e-12 * np.abs(values).max()) if values.size else False


def _innovations(time: np.ndarray, z: np.ndarray, slow: SlowNoise) -> np.ndarray:
    """Return what is new in each residual, of unit variance: a Kalman filter of one state follows what is slow."""
    memory = np.concatenate([[0.0], np.exp(-np.diff(time) / slow.time)])
    result, mean, variance = np.empty(z.size), 0.0, 0.0
    for k, (rho, value) in enumerate(zip(memory, z, strict=True)):
        mean, variance = rho * mean, rho**2 * variance + slow.share * (1 - rho**2)
        spread = variance + 1 - slow.share
        result[k] = (value - mean) / np.sqrt(spread)
        gain = variance / spread
        mean, variance = mean + gain * (value - mean), variance * (1 - gain)
    return result
