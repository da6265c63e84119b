"""Scores of one channel of one predicted trial, normal prediction and stated noise given.

How many independent samples they rest on: n' = n_eff / (1 + (n_eff - 1) s), where n_eff counts the residuals' autocorrelation
and s is the mean squared correlation of two samples that comes from the motion being uncertain as a whole (Kish, Survey Sampling,
1965, section 5.4; squared, since a sum of squares of normal errors has the variance 2 sum_ij c_ij^2).

Scores of a predicted distribution once the measurement is known:

    CRPS = int (F(x) - 1{y <= x})^2 dx                   Gneiting and Raftery, JASA 102, 2007
    Q = (n + 2) / n sum_k N_k r_k^2, r_k the mean product of the N_k pairs that are k intervals apart, over the mean square

That of a normal prediction has a closed form; Q is the Ljung-Box statistic where no sample is missing, and that of
Stoffer and Toloi (Statistics and Probability Letters 13, 1992) where some are.

Whether residuals are correlated by enough to matter is judged by their sum over many lags, not by one lag: a small slow part beside white
noise hides in each r_k. The variance ratios of sums of q = 2, 4, 8 ... residuals,

    V(q) = 1 + 2 sum_k<q (1 - k / q) (r_k - E r_k),    E r_k = -1 / (n - 1) of white noise about its own mean, per pair

(Lo and MacKinlay, Rev. Financ. Stud. 1, 1988; several together: Chow and Denning, J. Econometrics 58, 1993) are compared with the
chi-square law of their mean, 1, and of their variance in white noise, 4 sum_k (1 - k / q)^2 N_k / n^2. At the q whose V is farthest
from 1 in standard deviations, 1 + 2 sum_k<q r_k estimates the integrated autocorrelation: the factor on the variance of what changes
slowly.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
import scipy
from jaxtyping import Float, Int
from scipy.special import chdtr, chdtrc, ndtr, ndtri

from seatrial.core.result_table import text_html

BINS = 10  # Bins of the histogram of the probability integral transform
LONGEST_GAP = 1000  # Intervals that a gap in a run counts as at most: no correlation is looked for across a longer one
MIN_FREEDOM = 6.0  # Degrees of freedom of a variance ratio below which its window is too long for the runs
DIVERGES = "the prediction diverges"
BEYOND = 1e6  # Largest prediction, over the largest measurement, that is no divergence
LOG_2PI = float(np.log(2 * np.pi))


class Whiteness(NamedTuple):
    """Autocorrelation of residuals and what follows from it.

    Attributes:
        lag: lags that some pair of samples has, in intervals, shape (k,).
        correlation: autocorrelation at each of them, shape (k,).
        pairs: number of pairs behind each, shape (k,); white noise stays within 2 / sqrt(pairs) at 95 % of lags.
        interval: median time between samples, s.
        p_value: probability that white noise shows as large a Q; 1 where there is nothing to test.
    """

    lag: Int[np.ndarray, " k"]
    correlation: Float[np.ndarray, " k"]
    pairs: Int[np.ndarray, " k"]
    interval: float
    p_value: float

    @property
    def neighbours(self) -> float:
        """Autocorrelation one interval apart; 0 where no two samples are neighbours."""
        return self._at(1)

    @property
    def second(self) -> float:
        """Autocorrelation two intervals apart; 0 where no two samples are."""
        return self._at(2)

    def _at(self, lag: int) -> float:
        return float(self.correlation[self.lag == lag].sum())


class SlowNoise(NamedTuple):
    """What is slow in the noise of a sensor: an Ornstein-Uhlenbeck process, white noise making up the rest.

    Attributes:
        time: correlation time, s.
        share: of the variance of the noise.
    """

    time: float
    share: float


@dataclass(frozen=True)
class Score:
    """How one channel of one trial is predicted. Numbers that do not exist are 0, and `missing` says why.

    Attributes:
        samples: measured samples.
        effective: independent ones that they are worth, n'.
        explained: share of the measured variance explained, 1 - SSE / SST; negative is worse than the trial's own mean.
        nrmse: normalised fit, 1 - sqrt(SSE / SST), as MATLAB's `compare` gives it, over 100.
        rmse: root mean square error, in the channel's unit.
        crps: mean continuous ranked probability score, in the channel's unit.
        log_score: mean log density of the measurements under their own predictions, one at a time, nats for the channel in its SI unit.
        coverage_50: share of samples inside the 50 % band.
        coverage: share of samples inside the 90 % band.
        variance: mean square of the normalised residuals, 1 where errors are as large as stated.
        pit: histogram of the probability integral transform, shares that would all be 1 / 10.
        pit_distance: its largest distance from uniform.
        correlation: autocorrelation of what should be white, one interval apart.
        second: likewise, two intervals apart.
        interval: median time between measured samples, s.
        white: probability that white noise shows such variance ratios of sums, of either side.
        sd_factor: factor by which standard deviations of what changes slowly are too small if the residuals are taken as white; below
            1 where they are too large.
        noise_share: share of the measured variance that is noise of the size the fit found; 0 without a variance.
        noise_sd: standard deviation of that noise, in the channel's SI unit.
        correlation_time: of that noise, s; 0 where it is white.
        coefficient_share: share of the predicted variance that comes from the coefficients being uncertain.
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
    variance: float
    pit: tuple[float, ...]
    pit_distance: float
    correlation: float
    second: float
    interval: float
    white: float
    sd_factor: float
    noise_share: float
    noise_sd: float
    correlation_time: float
    coefficient_share: float
    missing: str = ""

    def __repr__(self) -> str:
        """Print how much is explained, and how far the stated bands hold."""
        if self.missing:
            return f"Score: {self.samples} samples; {self.missing}"
        return (
            f"Score: {self.samples} samples, worth {self.effective:.0f} independent ones; {self.explained:.1%} of the variance explained; "
            f"rmse {self.rmse:.3g}; {self.coverage:.0%} inside the 90 % band"
        )

    _repr_html_ = text_html


def explained_share(measured: Float[np.ndarray, " n"], predicted: Float[np.ndarray, " n"]) -> float:
    """Share of variance explained, 1 - SSE / SST; NaN where the measurement never changes."""
    total = float(np.sum((measured - measured.mean()) ** 2))
    return 1.0 - float(np.sum((measured - predicted) ** 2)) / total if _moves(measured) else np.nan


def nrmse_fit(measured: Float[np.ndarray, " n"], predicted: Float[np.ndarray, " n"]) -> float:
    """Fit by normalised root mean square error, 1 - |y - f| / |y - mean y|, the percentage of MATLAB's `compare` over 100.

    It is 1 - sqrt(1 - share explained): 95 % of the variance is a fit of 78 %. NaN where the measurement never changes.
    """
    return 1.0 - float(np.sqrt(1.0 - explained_share(measured, predicted)))


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
    return sd * (z * (2 * ndtr(z) - 1) + 2 * np.exp(-0.5 * z**2 - 0.5 * LOG_2PI) - 1 / np.sqrt(np.pi))


def coverage(z: Float[np.ndarray, " n"], level: float) -> float:
    """Share of normalised residuals inside the central band of this probability."""
    return float(np.mean(np.abs(z) <= ndtri(0.5 + 0.5 * level)))


def pit_shares(z: Float[np.ndarray, " n"]) -> Float[np.ndarray, " bins"]:
    """Return the histogram of the probability integral transform, shares that would all be 1 / 10."""
    return np.histogram(ndtr(z), BINS, (0.0, 1.0))[0] / z.size


def pit_distance(z: Float[np.ndarray, " n"]) -> float:
    """Return the largest distance of the distribution of the probability integral transform from uniform (Kolmogorov and Smirnov)."""
    levels, steps = np.sort(ndtr(z)), np.arange(z.size + 1) / z.size
    return float(np.maximum(steps[1:] - levels, levels - steps[:-1]).max())


def whiteness(time: Float[np.ndarray, " n"], residual: Float[np.ndarray, " n"], lags: int = 20) -> Whiteness:
    """Return the autocorrelation and portmanteau test of the residuals that were measured; pairs across a gap count at their own lag.

    Args:
        time: s, strictly increasing.
        residual: one for each time, all present.
        lags: most lags to look at; at most a third of the samples.
    """
    interval = float(np.median(np.diff(time))) if time.size > 1 else 0.0
    values = residual - residual.mean() if residual.size else residual
    square = float(values @ values)
    if values.size < 8 or not _moves(residual):
        return Whiteness(np.empty(0, int), np.empty(0), np.empty(0, int), interval, 1.0)
    n = values.size
    sums = [_lagged(values, _grid(time), lag) for lag in range(1, min(lags, n // 3) + 1)]
    lag = np.array([k for k, (_, count) in enumerate(sums, 1) if count], int)
    pairs = np.array([count for _, count in sums if count], int)
    correlation = np.array([product / count for product, count in sums if count]) * n / square
    q = (n + 2) / n * float(np.sum(pairs * correlation**2))
    return Whiteness(lag, correlation, pairs, interval, float(chdtrc(lag.size, q)) if lag.size else 1.0)


def effective_samples(time: Float[np.ndarray, " n"], residual: Float[np.ndarray, " n"]) -> float:
    """Independent samples that these are worth, n / (1 + 2 sum_k r_k), the sum ending before the first r_k that is not positive."""
    n = residual.size
    if n < 8 or not _moves(residual):
        return float(min(n, 1))
    values, at, total = residual - residual.mean(), _grid(time), 0.0
    square = float(values @ values)
    for lag in range(1, n // 2):
        product, _ = _lagged(values, at, lag)
        if product <= 0:
            break
        total += product / square
    return n / (1 + 2 * total)


class LaggedProducts(NamedTuple):
    """Sums of products of residuals that are 0, 1, 2 ... intervals apart, and how many pairs each sums, shape (k,) both."""

    products: Float[np.ndarray, " k"]
    pairs: Float[np.ndarray, " k"]


def lagged_products(time: Float[np.ndarray, " n"], residual: Float[np.ndarray, " n"]) -> LaggedProducts:
    """Return the lagged products of residuals about zero; a gap counts as `LONGEST_GAP` intervals at most.

    Args:
        time: s, strictly increasing.
        residual: one for each time, all present.
    """
    if not time.size:
        return LaggedProducts(np.zeros(0), np.zeros(0))
    at = np.cumsum(np.minimum(np.diff(_grid(time), prepend=0), LONGEST_GAP)) if time.size > 1 else np.zeros(1, int)
    there, values = np.zeros(at[-1] + 1), np.zeros(at[-1] + 1)
    there[at], values[at] = 1.0, residual
    products, pairs = (scipy.signal.correlate(x, x, method="fft")[at[-1] :] for x in (values, there))
    return LaggedProducts(products, pairs.round())


class IntegratedCorrelation(NamedTuple):
    """Correlation of residuals over many lags.

    Attributes:
        p_value: probability that white noise shows variance ratios so far from 1, of either side; 1 where there is nothing to test.
        sd_factor: square root of the integrated autocorrelation, 1 for white noise.
    """

    p_value: float
    sd_factor: float


def integrated_correlation(
    runs: Sequence[tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]],
) -> IntegratedCorrelation:
    """Test whether sums of residuals vary as those of white noise, about the mean of each run.

    Args:
        runs: times, s, strictly increasing, and residuals at them, all present, of each run.
    """
    lagged = [
        lagged_products(time, values - values.mean()) for time, values in runs if values.size >= 8 and _moves(values)
    ]
    total = sum(float(one.products[0]) for one in lagged)
    longest = max((one.products.size for one in lagged), default=0)
    excess, scatter = np.zeros(longest), np.zeros(longest)
    for products, pairs in lagged:
        n, square = pairs[0], products[0]
        excess[: products.size] += (products + pairs * square / (n * (n - 1))) / total
        scatter[: products.size] += pairs * (square / (n * total)) ** 2
    tails, ratios, factors, window = [], [], [], 2
    while window <= longest:
        weight = 1 - np.arange(1, window) / window
        variance = 4 * float(weight**2 @ scatter[1:window])
        if variance > 2 / MIN_FREEDOM:
            break
        if variance > 0:
            ratio, freedom = max(0.0, 1 + 2 * float(weight @ excess[1:window])), 2 / variance
            tails.append(float((chdtrc if ratio > 1 else chdtr)(freedom, freedom * ratio)))
            ratios.append((ratio - 1) / np.sqrt(variance))
            factors.append(np.sqrt(max(0.0, 1 + 2 * float(excess[1:window].sum()))))
        window *= 2
    if not tails:
        return IntegratedCorrelation(1.0, 1.0)
    side = np.sign(ratios[int(np.argmin(tails))])
    return IntegratedCorrelation(
        min(1.0, 2 * len(tails) * min(tails)), float(factors[int(np.argmax(side * np.array(ratios)))])
    )


def score_channel(
    time: Float[np.ndarray, " n"],
    measured: Float[np.ndarray, " n"],
    mean: Float[np.ndarray, " n"],
    motion_sd: Float[np.ndarray, " n"],
    noise_sd: float,
    slow: SlowNoise | None = None,
    coefficient_sd: Float[np.ndarray, " n"] | None = None,
    shared: float | None = None,
) -> Score:
    """Score a normal prediction of one channel.

    Args:
        time: s, strictly increasing.
        measured: NaN where nothing was measured.
        mean: predicted.
        motion_sd: standard deviation of the prediction without noise.
        noise_sd: standard deviation of the noise.
        slow: what is slow in the noise as it is modelled; what should be white is then what is new in the residuals.
        coefficient_sd: part of `motion_sd` that comes from the coefficients being uncertain; all of it by default.
        shared: mean squared correlation of two samples that comes from the motion being uncertain; by default that is one error of
            the whole trial.
    """
    present = np.isfinite(measured)
    coefficient_sd = (motion_sd if coefficient_sd is None else coefficient_sd)[present]
    time, measured, mean, motion_sd = (column[present] for column in (time, measured, mean, motion_sd))
    if not measured.size:
        return unscored(0, "nothing was measured")
    sd = np.hypot(motion_sd, noise_sd)
    if diverges(measured, mean, sd):
        return unscored(int(measured.size), DIVERGES)
    z, explained = (measured - mean) / sd, explained_share(measured, mean)
    independent = effective_samples(time, z)
    new = new_residuals(time, z, slow)
    test, integrated = whiteness(time, new), integrated_correlation([(time, new)])
    still = bool(np.isnan(explained))
    if shared is None:
        shared = float(np.mean((motion_sd / sd) ** 2)) ** 2
    return Score(
        samples=int(measured.size),
        effective=independent / (1 + max(0.0, independent - 1) * shared),
        explained=0.0 if still else explained,
        nrmse=0.0 if still else nrmse_fit(measured, mean),
        rmse=float(np.sqrt(np.mean((measured - mean) ** 2))),
        crps=float(crps_normal(measured, mean, sd).mean()),
        log_score=float(np.mean(-0.5 * z**2 - np.log(sd)) - 0.5 * LOG_2PI),
        coverage_50=coverage(z, 0.5),
        coverage=coverage(z, 0.9),
        variance=float(np.mean(z**2)),
        pit=tuple(map(float, pit_shares(z))),
        pit_distance=pit_distance(z),
        correlation=test.neighbours,
        second=test.second,
        interval=test.interval,
        white=integrated.p_value,
        sd_factor=integrated.sd_factor,
        noise_share=0.0 if still else float(min(1.0, noise_sd**2 / measured.var())),
        noise_sd=noise_sd,
        correlation_time=slow.time if slow else 0.0,
        coefficient_share=float(np.mean((coefficient_sd / sd) ** 2)),
        missing="the measurement never changes" if still else "",
    )


def new_residuals(
    time: Float[np.ndarray, " n"], z: Float[np.ndarray, " n"], slow: SlowNoise | None
) -> Float[np.ndarray, " n"]:
    """Return what is new in normalised residuals, white where the noise is as it is modelled; all of them where that is white."""
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


def _grid(time: np.ndarray) -> np.ndarray:
    """Return which multiple of the median interval each sample falls on, counted from sample to sample so that jitter does not add up."""
    step = np.diff(time)
    return np.concatenate([[0], np.cumsum(np.maximum(1, np.round(step / np.median(step))).astype(int))])


def _lagged(values: np.ndarray, at: np.ndarray, lag: int) -> tuple[float, int]:
    """Return the sum of products of samples that are `lag` places apart, and the number of such pairs."""
    later = np.searchsorted(at, at + lag)
    result = later < at.size
    result[result] = at[later[result]] == at[result] + lag
    return float(values[result] @ values[later[result]]), int(result.sum())


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
