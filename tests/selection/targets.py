"""Targets of known evidence that the estimators of evidence share: well-behaved ones, and two made to mislead."""

import jax.numpy as jnp
import numpy as np
from scipy import stats
from scipy.special import logsumexp

from seatrial.estimation.priors import LogUniform, Normal, Uniform
from tests.estimation_cases import linear_gaussian, posterior


def linear(d, seed=0):
    """Linear regression of known noise, and its log evidence."""
    problem = linear_gaussian(d, seed)
    return problem.posterior, problem.log_evidence


def correlated(d, rho=0.9):
    """Normal likelihood of one common correlation under standard normal priors: Z is the density of the sum of both at the centre."""
    centre, cov = np.linspace(-1.0, 1.0, d), 0.09 * (rho * np.ones((d, d)) + (1 - rho) * np.eye(d))
    data = (jnp.asarray(centre), jnp.asarray(np.linalg.inv(cov)), jnp.asarray(np.linalg.slogdet(cov)[1]))
    target = posterior({f"x{i}": Normal(0.0, 1.0) for i in range(d)}, _normal, data)
    return target, float(stats.multivariate_normal(centre, cov + np.eye(d)).logpdf(np.zeros(d)))


def _normal(values, data):
    centre, precision, log_det = data
    off = jnp.stack(list(values.values())) - centre
    return -0.5 * (off @ precision @ off + log_det + off.size * jnp.log(2 * jnp.pi))


def peaks(at, d=2, sd=0.03):
    """Two equal normal peaks at these places along the first axis under standard normal priors."""
    centres = np.zeros((2, d))
    centres[:, 0] = at
    data = tuple(map(jnp.asarray, (centres, np.full(2, sd), np.log([0.5, 0.5]))))
    target = posterior({f"x{i}": Normal(0.0, 1.0) for i in range(d)}, _mixture, data)
    each = stats.multivariate_normal(np.zeros(d), (1 + sd**2) * np.eye(d)).logpdf(centres)
    return target, float(np.logaddexp(*each) - np.log(2.0))


def far_peaks():
    """One peak on either side of the centre, far from each other: each has half of Z."""
    return peaks((-1.0, 1.0))


def one_peak():
    """Both peaks at one place: code compiled for `far_peaks` serves it."""
    return peaks((0.7, 0.7))


def unlike_peaks(d=4, half=12.0):
    """Three normal peaks far inside a box, of which the narrow one holds a fifth of Z: all methods miss it."""
    centres = np.random.default_rng(1).uniform(-7.0, 7.0, (3, d))
    data = (centres, np.array([0.15, 1.0, 0.4]), np.log([0.2, 0.5, 0.3]))
    target = posterior({f"x{i}": Uniform(-half, half) for i in range(d)}, _three, tuple(map(jnp.asarray, data)))
    return target, -d * float(np.log(2 * half))


def _three(values, data):
    centres, sd, log_weight = data
    first = _mixture(values, (centres[:2], sd[:2], log_weight[:2]))
    return jnp.logaddexp(
        first, _mixture(values, (centres[2:].repeat(2, 0), sd[2:].repeat(2), log_weight[2:].repeat(2) - jnp.log(2.0)))
    )


def spike_on_slab(d=10, spike=0.01, slab=0.1, away=0.031, weight=100.0):
    """Skilling's phase transition in the unit cube: a spike of 100 times the evidence inside a slab (Bayesian Analysis 1, 2006)."""
    data = (np.stack([np.full(d, away), np.zeros(d)]), np.array([spike, slab]), np.log([weight, 1.0]))
    target = posterior({f"x{i}": Uniform(-0.5, 0.5) for i in range(d)}, _mixture, tuple(map(jnp.asarray, data)))
    inside = [d * np.log(np.diff(stats.norm(c, s).cdf([-0.5, 0.5]))[0]) for c, s in ((away, spike), (0.0, slab))]
    return target, float(np.logaddexp(np.log(weight) + inside[0], inside[1]))


def wide_regression(rows=300, k=3, half=50.0):
    """Regression of unknown noise under priors thousands of times wider than the posterior, on regressors that are nearly one another.

    Z by quadrature over the logarithm of the noise; all of the posterior lies far inside the prior of the coefficients.
    """
    rng = np.random.default_rng(5)
    shared = rng.normal(size=(rows, 1))
    x = shared + 0.2 * rng.normal(size=(rows, k))
    y = x @ np.linspace(1.0, 2.0, k) + 0.016 * rng.normal(size=rows)
    priors = {f"x{i}": Uniform(-half, half) for i in range(k)} | {"sigma": LogUniform(0.002, 20.0)}
    square = float(np.sum((y - x @ np.linalg.lstsq(x, y, rcond=None)[0]) ** 2))
    log_sigma = np.linspace(np.log(0.002), np.log(20.0), 200_001)
    log_each = -(rows - k) * log_sigma - 0.5 * square * np.exp(-2 * log_sigma)
    log_z = float(logsumexp(log_each) - np.log(log_sigma.size - 1)) - 0.5 * (rows - k) * np.log(2 * np.pi)
    log_z -= 0.5 * np.linalg.slogdet(x.T @ x)[1] + k * np.log(2 * half)
    return posterior(priors, _regression, (jnp.asarray(x), jnp.asarray(y))), log_z


def _regression(values, data):
    x, y = data
    *coefficients, sigma = values.values()
    residual = (y - x @ jnp.stack(coefficients)) / sigma
    return -0.5 * residual @ residual - y.size * (jnp.log(sigma) + 0.5 * jnp.log(2 * jnp.pi))


def _mixture(values, data):
    """Log of a weighted sum of round normal densities."""
    centres, sd, log_weight = data
    x = jnp.stack(list(values.values()))
    square = jnp.sum(((x - centres) / sd[:, None]) ** 2, -1)
    terms = log_weight - 0.5 * square - x.size * (jnp.log(sd) + 0.5 * jnp.log(2 * jnp.pi))
    return jnp.logaddexp(terms[0], terms[1])
