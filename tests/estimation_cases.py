"""Cases shared by estimation, sampling, selection and design: the golden trial, and a problem with closed-form answers.

The golden trial is the paper's surge vehicle under repeated doublets of 200 rpm and 10 s, its speed computed by a plain
loop of the midpoint rule, which is how its published numbers were made.
"""

from functools import cache
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy import stats

from seatrial.core.record import Record, make_record
from seatrial.estimation.posterior.output_error import output_error
from seatrial.estimation.posterior.posterior import Parameter, Posterior
from seatrial.estimation.priors import Normal, Uniform
from tests.cases import CHANNELS, PROVENANCE, TRUTH, U0, naive_rk4, paper_model, surge_rate

SIGMA = 0.0757
GOLDEN_LOG_EVIDENCE = {"M-1": 6951.178, "M-0 wide": 6950.357, "M-0 narrow": 6951.164}
THRUST_UNIT = 1e-2 / (2 * np.pi) ** 2
"""SI value of the unit in which the golden thrust coefficient is printed, 1e-2 N/(rev/s)^2."""


def naive_midpoint(rate, x, h):
    """One step of the midpoint rule, as in any textbook."""
    return x + h * rate(x + h / 2 * rate(x))


def naive_doublets(time, amplitude, period, active=40.0, start=1.0):
    """Propeller speed, rev/s, of whole doublets of `amplitude` rpm about 12.5 rev/s, read off phase by phase."""
    phase = (time - start) / period + 1e-9
    running = (phase >= 0) & (phase < np.floor(active / period + 1e-9))
    return 12.5 + np.where(running, np.where(phase % 1 < 0.5, 1.0, -1.0), 0.0) * amplitude / 60


def naive_speed(rev_per_s, step, start=U0, method=naive_rk4, **coefficients):
    """Surge speed at every sample by a Python loop, propeller speed held over each step."""
    speed = [start]
    for n, h in zip(rev_per_s[:-1], step, strict=False):
        speed.append(method(lambda u, n=n: surge_rate(u, n, **coefficients), speed[-1], h))
    return np.array(speed)


def make_trial(time, rev_per_s, label="trial", **measured) -> Record:
    """Record of a propeller speed in rev/s and measured channels."""
    channels = tuple(channel for channel in CHANNELS if channel.name in ("n", *measured))
    return make_record(time, {"n": 2 * np.pi * rev_per_s, **measured}, channels, PROVENANCE, label)


@cache
def golden_motion():
    """Time, propeller speed in rev/s and noise-free surge speed of the golden trial, X_du3 = 0.1."""
    time = np.arange(6000) * 0.01
    rev_per_s = naive_doublets(time, 200, 10)
    return time, rev_per_s, naive_speed(rev_per_s, np.full(6000, 0.01), method=naive_midpoint, cubic=0.1)


def golden_noise():
    """White noise of the golden evidence."""
    return np.random.default_rng(1).normal(size=6000) * SIGMA


def golden_posterior(model: str) -> Posterior:
    """Posterior of the golden trial: `M-1` is the paper's model, `M-0` adds X_du3 with a `narrow` or `wide` prior."""
    time, rev_per_s, speed = golden_motion()
    record = make_trial(time, rev_per_s, u=speed + golden_noise())
    true = TRUTH if model == "M-1" else {**TRUTH, "X_du3": 0.1}
    priors = {name: Uniform(0.5 * x - 2 * abs(x), 0.5 * x + 2 * abs(x)) for name, x in true.items()}
    if model == "M-0 wide":
        priors["X_du3"] = Uniform(-50.0, 50.0)
    likelihood, data = output_error(paper_model(*true), [record], ["u"], [[U0]])
    return posterior({**priors, "sigma_u": Uniform(0.0, 2 * SIGMA)}, likelihood, data)


def short_posterior(*free: str, seed=4) -> Posterior:
    """Posterior of a 6 s surge trial in which only the terms `free` are unknown, of known noise."""
    time = np.arange(120) * 0.05
    rev_per_s = naive_doublets(time, 300, 2, active=4)
    speed = naive_speed(rev_per_s, np.full(120, 0.05)) + np.random.default_rng(seed).normal(size=120) * 0.01
    likelihood, data = output_error(paper_model(), [make_trial(time, rev_per_s, u=speed)], ["u"], [[U0]])
    priors = {name: Uniform(*sorted((0.2 * TRUTH[name], 2.5 * TRUTH[name]))) for name in free}
    known = {**TRUTH, "sigma_u": 0.01}
    return posterior(priors, PartlyKnown(likelihood, tuple((k, v) for k, v in known.items() if k not in free)), data)


class PartlyKnown(NamedTuple):
    """A likelihood with some of its values given."""

    likelihood: object
    known: tuple

    def __call__(self, values, data):
        return self.likelihood({**dict(self.known), **values}, data)


def posterior(priors, likelihood, data=None) -> Posterior:
    """Posterior from priors by name."""
    return Posterior(tuple(Parameter(name, "1", name, prior) for name, prior in priors.items()), likelihood, data)


def slow_noise(rng, time, tau):
    """Draw an Ornstein-Uhlenbeck process of variance one and correlation time tau at any times."""
    values, normal = np.empty(time.size), rng.normal(size=time.size)
    values[0] = normal[0]
    for k, rho in enumerate(np.exp(-np.diff(time) / tau), 1):
        values[k] = rho * values[k - 1] + np.sqrt(1 - rho**2) * normal[k]
    return values


def quadratic(values, data):
    """Log of a normal density by its centre and precision, so that tests of the same kinds of priors share compiled code."""
    centre, precision = data
    distance = jnp.stack(list(values.values())) - centre
    return -0.5 * distance @ precision @ distance


def normal_about(priors, centre, precision) -> Posterior:
    """Posterior of a normal likelihood, whose precision may be singular."""
    return posterior(priors, quadratic, (jnp.asarray(centre, float), jnp.asarray(precision, float)))


class LinearGaussian(NamedTuple):
    """y = A c + e, e ~ N(0, sd^2 I), c ~ N(prior_mean, prior_sd^2 I): everything is known in closed form."""

    design: np.ndarray
    measured: np.ndarray
    sd: float
    prior_mean: float
    prior_sd: float

    @property
    def posterior(self) -> Posterior:
        names = [f"c{i}" for i in range(self.design.shape[1])]
        data = (jnp.asarray(self.design), jnp.asarray(self.measured), jnp.asarray(self.sd))
        return posterior({name: Normal(self.prior_mean, self.prior_sd) for name in names}, linear_log_likelihood, data)

    @property
    def log_evidence(self) -> float:
        """Log density of the data under their marginal normal distribution."""
        cov = self.prior_sd**2 * self.design @ self.design.T + self.sd**2 * np.eye(self.measured.size)
        mean = self.design.sum(1) * self.prior_mean
        return float(stats.multivariate_normal(mean, cov).logpdf(self.measured))

    @property
    def moments(self) -> tuple[np.ndarray, np.ndarray]:
        """Posterior mean and covariance by the normal equations."""
        d = self.design.shape[1]
        cov = np.linalg.inv(self.design.T @ self.design / self.sd**2 + np.eye(d) / self.prior_sd**2)
        return cov @ (self.design.T @ self.measured / self.sd**2 + self.prior_mean / self.prior_sd**2), cov


def linear_gaussian(d: int, seed=0) -> LinearGaussian:
    """Return a random linear-Gaussian problem of d correlated coefficients and 20 measurements."""
    rng = np.random.default_rng(seed)
    design = rng.normal(size=(20, d)) + rng.normal(size=(20, 1))
    return LinearGaussian(design, design @ np.linspace(-1, 1, d) + 0.5 * rng.normal(size=20), 0.5, 0.3, 2.0)


def linear_log_likelihood(values, data):
    """Independent normal residuals of a linear model."""
    design, measured, sd = data
    residual = (measured - design @ jnp.stack(list(values.values()))) / sd
    return -0.5 * jnp.sum(residual**2) - measured.size * (jnp.log(sd) + 0.5 * jnp.log(2 * jnp.pi))
