r"""A measured signal and its rate of change by smoothing, each with a standard deviation.

The rate of the signal x wanders as a Wiener process, and the sensor's noise is white:

    dx = v dt,   dv = sigma sqrt(q) dW,   y_i = x(t_i) + sigma e_i

with nothing known of x and v at the start. The posterior mean of x is the cubic smoothing spline of smoothness 1/q (Wahba,
J. R. Stat. Soc. B 40, 1978). The rate is continuous but may turn at once, as an acceleration does when a force is switched; one
order more would make the rate itself smooth, and ring about every switched force.

Sigma follows in closed form for each q, and q has the largest likelihood of innovations (Harvey, Forecasting, Structural Time
Series Models and the Kalman Filter, 1989, section 4.2). For samples h apart the smoother passes slow motion, and loses that beyond
the angular frequency 1/tau, tau = (h/q)^(1/4): its gain is 1/(1 + (omega tau)^4). Both are taken as known in the standard
deviations that are stated.

A filter of inverse covariances runs from either end, so that knowing nothing is a matrix of zeros, and samples may be anywhere.
"""

from dataclasses import dataclass
from math import inf

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float

from seatrial.compiled.programs import program
from seatrial.core.display_units import plain
from seatrial.core.errors import InputError

MIN_SAMPLES = 12  # Measured samples from which noise and smoothness can be told apart at all
MIN_TAU_STEPS = 0.2  # Least tau, in usual steps, at which the smoother leaves every sample as it is
TRIED_TAUS = 24  # Values of tau tried before the best is refined
LAGS = 20  # Lags of the innovations that are looked at, at most
CHANCE = 4.0  # Standard deviations of an estimate by chance that are let pass
RELEVANT = 0.1  # A correlation of innovations below this does no harm, however significant
HEAVY = 6.0  # Kurtosis of the innovations, 3 for normal ones, from which outliers are told
NOISE_HIDDEN = (
    "noise and motion cannot be separated, because the motion changes from sample to sample: give the sensor's noise"
)
STILL = "the channel moves only along a straight line, to within the noise"
BLOCK = 512  # Samples are filled up to a multiple of this, so that records of like length share compiled code


@dataclass(frozen=True, eq=False)
class Smoothed:
    """A signal and its rate at n instants.

    Attributes:
        value: signal, in its unit, shape (n,).
        value_sd: its standard deviation, shape (n,).
        rate: time derivative, in its unit over s, shape (n,).
        rate_sd: its standard deviation, shape (n,).
        noise: standard deviation of the sensor's noise, found or given, in the unit of the signal.
        time_scale: tau, s.
        hidden: whether the noise was to be found, and cannot be told from the motion.
        innovations: of the measured samples from the third on, over their standard deviations, shape (m - 2,).
        complaints: why the standard deviations cannot be believed, in words; empty if nothing speaks against them.
    """

    value: Float[np.ndarray, " n"]
    value_sd: Float[np.ndarray, " n"]
    rate: Float[np.ndarray, " n"]
    rate_sd: Float[np.ndarray, " n"]
    noise: float
    time_scale: float
    hidden: bool
    innovations: Float[np.ndarray, " m-2"]
    complaints: tuple[str, ...]

    @property
    def bandwidth(self) -> float:
        """Frequency at which half of the motion is passed, Hz."""
        return 1.0 / (2 * np.pi * self.time_scale)


def smooth(
    time: Float[np.ndarray, " n"],
    values: Float[np.ndarray, " n"],
    noise: float | None = None,
    time_scale: float | None = None,
    where: str = "signal",
) -> Smoothed:
    """Smooth one signal.

    Args:
        time: s, strictly increasing, shape (n,).
        values: NaN if not measured, shape (n,); angles unwrapped.
        noise: standard deviation of the sensor's noise, in the unit of the signal; None to find it.
        time_scale: tau, s; None to find it.
        where: what the signal is, for errors.

    Raises:
        InputError: too few measured samples, or noise or a time scale that is not positive.
    """
    is_measured = np.isfinite(values)
    if is_measured.sum() < MIN_SAMPLES or np.ptp(values[is_measured]) == 0:
        raise InputError(
            where,
            found=f"{is_measured.sum()} measured samples"
            if is_measured.sum() < MIN_SAMPLES
            else "the same value in every sample",
            expected=f"at least {MIN_SAMPLES}, not all the same",
            remedy="choose a longer record, or another channel",
        )
    for name, given in (("noise", noise), ("time scale", time_scale)):
        if given is not None and not 0 < given < inf:
            raise InputError(
                where, found=f"a {name} of {given}", expected="more than 0", remedy="leave it out to estimate it"
            )
    usual = float(np.median(np.diff(time[is_measured])))
    straight = np.polynomial.Polynomial.fit(time[is_measured], values[is_measured], 1)
    line = straight(time)
    unit = float(np.std(values[is_measured] - line[is_measured])) or float(np.ptp(values[is_measured]))
    data = _filled(time, np.where(is_measured, values - line, 0.0) / unit, is_measured)
    sigma = None if noise is None else noise / unit
    ends = (MIN_TAU_STEPS * usual, 0.5 * float(np.ptp(time[is_measured])))
    tau = _most_likely(data, usual, sigma, *ends) if time_scale is None else time_scale
    mean, var, z, is_predicted = (np.asarray(part)[..., : time.size] for part in _smoothed(data, usual, tau))
    scale = float(np.sqrt(np.mean(z[is_predicted] ** 2))) if sigma is None else sigma
    innovations = z[is_predicted] / scale
    sd = unit * scale * np.sqrt(var)
    result = time_scale is None
    hidden, still = result and noise is None and tau < 1.1 * ends[0], result and tau > 0.9 * ends[1]
    return Smoothed(
        line + unit * mean[0],
        sd[0],
        straight.deriv()(time) + unit * mean[1],
        sd[1],
        unit * scale,
        tau,
        hidden,
        innovations,
        (*[NOISE_HIDDEN] * hidden, *[STILL] * still, *_innovation_complaints(innovations)),
    )


def _filled(time: np.ndarray, values: np.ndarray, is_measured: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time since the sample before, value and whether it was measured, up to a whole block; what is added takes no time."""
    missing = -time.size % BLOCK
    columns = (np.diff(time, prepend=time[0]), values, is_measured.astype(float))
    step, values, is_measured = (np.pad(column, (0, missing)) for column in columns)
    return step, values, is_measured


def _most_likely(
    data: tuple[np.ndarray, np.ndarray, np.ndarray], usual: float, sigma: float | None, shortest: float, longest: float
) -> float:
    """Return tau of the greatest likelihood, s: the best of a grid, then between its neighbours."""
    given = 0.0 if sigma is None else sigma
    tried = np.linspace(np.log(shortest), np.log(longest), TRIED_TAUS)
    losses = np.asarray(_losses(data, usual, np.exp(tried), given))
    best = int(np.argmin(losses))
    around = tried[[max(best - 1, 0), min(best + 1, TRIED_TAUS - 1)]]
    result = scipy.optimize.minimize_scalar(
        lambda tau: float(_losses(data, usual, np.exp([tau]), given)[0]),
        bounds=tuple(around),
        method="bounded",
        options={"xatol": 0.01},
    )
    return float(np.exp(result.x if result.fun < losses[best] else tried[best]))


@program
def _losses(data: tuple, usual: float, taus: Float[Array, " k"], sigma: float) -> Float[Array, " k"]:
    """Return minus twice the log-likelihood of each tau; that of the best noise where sigma is 0."""

    def loss(tau: Array) -> Array:
        _, _, mean, var, is_predicted = _pass(data, usual, tau)
        squares = jnp.where(is_predicted, (data[1] - mean) ** 2 / var, 0.0)
        count, logs = is_predicted.sum(), jnp.where(is_predicted, jnp.log(var), 0.0).sum()
        profiled = count * jnp.log(jnp.maximum(squares.sum() / count, 1e-30))
        known = squares.sum() / jnp.where(sigma > 0, sigma**2, 1.0)
        return logs + jnp.where(sigma > 0, known, profiled)

    return jax.vmap(loss)(taus)


@program
def _smoothed(data: tuple, usual: float, tau: float) -> tuple[Array, Array, Array, Array]:
    """Means and variances of signal and rate, shape (2, n), in units of sigma^2; innovations over their deviations, and where told.

    What came before an instant, with its sample, and what comes after it without: their inverse covariances add up. The later part is
    the same filter with time turned round, which turns the rate round too.
    """
    step, y, is_measured = data
    turned = (jnp.append(jnp.zeros(1), step[:0:-1]), y[::-1], is_measured[::-1])
    _, earlier, mean, var, is_predicted = _pass(data, usual, tau)
    later, *_ = _pass(turned, usual, tau)
    a, b, c, e, f = (
        one + sign * other[::-1] for one, other, sign in zip(earlier, later, (1, -1, 1, 1, -1), strict=True)
    )
    det = a * c - b * b
    means = jnp.stack([(c * e - b * f) / det, (a * f - b * e) / det / tau])
    return means, jnp.stack([c / det, a / det / tau**2]), (y - mean) / jnp.sqrt(var), is_predicted


def _pass(data: tuple, usual: float, tau: Array | float) -> tuple[tuple, tuple, Array, Array, Array]:
    """Filter in units of tau and sigma: what is known of (x, v) before each sample and with it, and what the sample was to be.

    Known are the inverse covariance ((a, b), (b, c)) and its product with the mean, (e, f); d = ac - b^2 is carried along, so that it
    is zero as long as less than two samples are known. Over a step, with F = ((1, s), (0, 1)) and the process noise Q, and
    M = F^-T ((a, b), (b, c)) F^-1,

        (M^-1 + Q)^-1 = (M + det(M) adj(Q)) / (1 + tr(M Q) + det(M) det(Q))

    in which nothing is inverted.

    Returns:
        a, b, c, e, f before each sample; the same with it; mean and variance of each sample; whether they are finite and it was measured.
    """
    q = usual / tau

    def advance(known: tuple, sample: tuple) -> tuple[tuple, tuple]:
        (a, b, c, d, e, f), (s, y, is_measured) = known, sample
        c = c - s * (2 * b - a * s)
        b, f = b - a * s, f - e * s
        xx, xv, vv = q * s**3 / 3, q * s**2 / 2, q * s
        over = 1.0 / (1.0 + a * xx + 2 * b * xv + c * vv + d * (xx * vv - xv**2))
        g, h = c * e - b * f, a * f - b * e
        e, f = (e + vv * g - xv * h) * over, (f - xv * g + xx * h) * over
        a, b, c, d = (a + d * vv) * over, (b - d * xv) * over, (c + d * xx) * over, d * over
        is_predicted = (d > 0) & (is_measured > 0)
        safe = jnp.where(d > 0, d, 1.0)
        shown = ((c * e - b * f) / safe, 1.0 + c / safe, is_predicted)
        with_it = (a + is_measured, b, c, d + is_measured * c, e + is_measured * y, f)
        return with_it, ((a, b, c, e, f), (*with_it[:3], *with_it[4:]), *shown)

    step, y, is_measured = data
    zero = jnp.zeros(())
    return jax.lax.scan(advance, (zero,) * 6, (jnp.asarray(step) / tau, jnp.asarray(y), jnp.asarray(is_measured)))[1]


def _innovation_complaints(z: np.ndarray) -> list[str]:
    """Return whether what each sample adds is independent of what was known, of the size stated, and free of outliers."""
    messages, centred = [], z - z.mean()
    lags = np.arange(1, min(LAGS, z.size // 4) + 1)
    result = np.array([centred[lag:] @ centred[:-lag] for lag in lags]) / (centred @ centred)
    worst = int(np.argmax(np.abs(result)))
    if abs(result[worst]) > max(RELEVANT, CHANCE / np.sqrt(z.size)):
        messages.append(
            f"the innovations are not white (correlation {result[worst]:+.2f} at lag {lags[worst]}): noise or motion has more "
            f"correlation in time than the model. The standard deviations are not reliable"
        )
    kurtosis = float(np.mean(centred**4) / np.mean(centred**2) ** 2)
    if kurtosis > HEAVY:
        messages.append(
            f"the innovations have outliers (kurtosis {kurtosis:.0f}): look at the picture before you use the standard deviations"
        )
    size = float(np.sqrt(np.mean(z**2)))
    if abs(np.log(size)) > max(np.log(1.2), CHANCE / np.sqrt(2 * z.size)):
        messages.append(f"the innovations are {plain(size)} times as large as expected from the given noise")
    return messages
