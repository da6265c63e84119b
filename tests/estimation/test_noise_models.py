"""Residuals of one channel, sample by sample, against the joint density of all of them."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from seatrial.compiled.batching import filled
from seatrial.estimation.posterior.output_error import OutputError
from seatrial.estimation.simulation.noise_models import Drifting, Heavy, Proportional, White
from seatrial.estimation.simulation.sensor_errors import Sensor
from seatrial.estimation.simulation.simulator import Simulator
from seatrial.estimation.simulation.trial_data import FOREVER, channel_data

PATTERNS = {
    "complete": np.ones(30),
    "some missing": (np.arange(30) % 7 != 3).astype(float),
    "every third": (np.arange(30) % 3 == 0).astype(float),
    "first missing": (np.arange(30) > 3).astype(float),
    "one": (np.arange(30) == 4).astype(float),
}
EVEN, UNEVEN = np.arange(30) * 0.2, np.cumsum(np.random.default_rng(5).uniform(0.05, 0.5, 30))
RESIDUALS = np.random.default_rng(2).normal(size=30)
POINTS = [(0.3, 0.7, 0.5), (0.5, 0.5, 2.0), (1e-3, 0.7, 40.0), (0.7, 1e-3, 0.02), (0.7, 0.1, 1e4)]


def slow_density(kind, logs, channel):
    """Log density of `RESIDUALS` by the model of the noise, sample by sample."""
    sensor = Sensor("u", kind)
    values = dict(
        zip(("sigma_u", "drift_u", f"{'drift_time' if kind == 'drifting' else 'tau'}_u"), jnp.exp(logs), strict=True)
    )
    noise = OutputError(Simulator(None, (sensor,)), ("a",)).noise(values, sensor, channel)
    samples = (RESIDUALS, np.zeros(RESIDUALS.size), channel.present, channel.kind)
    carry, _ = jax.lax.scan(lambda carry, sample: (noise.absorb(carry, *sample), None), noise.empty(), samples)
    return noise.log_likelihood(carry)


def dense_density(kind, logs, time, present):
    """The same by the covariance sd^2 exp(-|t - s| / tau), white noise added where it drifts, of the samples that are there."""
    sd, drift, tau = jnp.exp(logs)
    slow = (drift if kind == "drifting" else sd) ** 2 * jnp.exp(-jnp.abs(time[:, None] - time) / tau)
    cov = slow + (sd**2 * jnp.eye(time.size) if kind == "drifting" else 0.0)
    there = present[:, None] * present > 0
    density = jax.scipy.stats.multivariate_normal.logpdf
    # What is missing is of unit variance here, and 0.
    whole = density(RESIDUALS * present, jnp.zeros(time.size), jnp.where(there, cov, jnp.eye(time.size)))
    return whole + 0.5 * jnp.log(2 * jnp.pi) * jnp.sum(1.0 - present)


@partial(jax.jit, static_argnums=(0, 1))
def expansion(density, kind, point, *data):
    """Value, gradient and Hessian, forward over reverse, along the logarithms of the parameters."""

    def gradient_and_value(logs):
        value, gradient = jax.value_and_grad(lambda logs: density(kind, logs, *data))(logs)
        return gradient, (gradient, value)

    hessian, (gradient, value) = jax.jacfwd(gradient_and_value, has_aux=True)(jnp.log(point))
    return value, gradient, hessian


@pytest.mark.parametrize("present", PATTERNS.values(), ids=PATTERNS)
@pytest.mark.parametrize("time", [EVEN, UNEVEN], ids=["even", "uneven"])
@pytest.mark.parametrize("kind", ["coloured", "drifting"])
def test_slow_residuals_are_jointly_normal(kind, time, present):
    channel = channel_data(time, np.where(present > 0, RESIDUALS, np.nan))
    if channel.gaps.size > 2:  # of one shape, so that it is compiled once
        channel = channel._replace(gaps=filled(channel.gaps, 30, FOREVER), counts=filled(channel.counts, 30, 0.0))
    for point in POINTS:
        found = expansion(slow_density, kind, np.array(point), channel)
        exact = expansion(dense_density, kind, np.array(point), time, present)
        size = max(1.0, np.abs(exact[2]).max())
        for one, other in zip(found, exact, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-7, atol=1e-7 * size)


def test_a_long_product_of_variances_does_not_overflow():
    """Of 20 000 samples after two gaps by turns, against the plain recursion of variances: their product is e^282 000."""
    time = np.cumsum(np.where(np.arange(20_000) % 2, 1.0, 2.0))
    channel = channel_data(time, np.zeros(time.size))
    sd, drift, tau = 1e-4, 1.0, 10.0
    noise = Drifting(sd, (drift / sd) ** 2, time.size, -channel.gaps / tau, jnp.exp(-channel.gaps / tau))
    carry, _ = jax.lax.scan(
        lambda carry, kind: (noise.absorb(carry, 0.0, 0.0, 1.0, kind), None), noise.empty(), jnp.asarray(channel.kind)
    )
    before, total = drift**2, 0.0
    for memory in np.exp(-np.diff(time, append=np.inf) / tau):
        total -= 0.5 * np.log(2 * np.pi * (before + sd**2))
        after = before * sd**2 / (before + sd**2)
        before = memory**2 * after + drift**2 * (1 - memory**2)
    assert float(noise.log_likelihood(carry)) == pytest.approx(total, rel=1e-11)


@pytest.mark.parametrize("complete", [True, False])
@pytest.mark.parametrize(
    ("shape", "law"),
    [
        (White(0.7, np.array([2.0, 5.0])), stats.norm(0, 0.7)),
        (Heavy(0.7, 3.5, np.array([2.0, 5.0])), stats.t(3.5, 0, 0.7)),
        (Proportional(0.7, 0.3, np.array([2.0, 5.0])), stats.norm(0, np.hypot(0.7, 0.3 * 4.0))),
    ],
    ids=["white", "heavy", "proportional"],
)
def test_independent_residuals_are_sums_of_their_log_densities(shape, law, complete):
    """Of seven measurements about 4, in two groups by the gap before them; what is missing does not count."""
    e = np.random.default_rng(3).normal(size=10)
    present = np.ones(10) if complete else (np.arange(10) % 3 != 1).astype(float)
    e, present = (e[:7], present[:7]) if complete else (e, present)
    total = shape.empty()
    for one, there in zip(e, present, strict=True):
        total = shape.absorb(total, one, 4.0, there, 0)
    assert int(present.sum()) == 7
    assert float(shape.log_likelihood(total)) == pytest.approx(law.logpdf(e[present > 0]).sum(), rel=1e-12)


def test_gaps_that_agree_to_the_nanosecond_are_one():
    """Of gaps 1, 1 + 0.3 ns, 1 + 3 ns and 2 s the first two are one, their mean."""
    time = np.cumsum([0.0, 1.0, 1.0 + 3e-10, 1.0 + 3e-9, 2.0])
    found = channel_data(time, np.zeros(5))
    assert found.counts.tolist() == [2.0, 1.0, 1.0, 1.0]
    np.testing.assert_allclose(found.gaps - [1.0, 1.0, 2.0, FOREVER], [1.5e-10, 3e-9, 0.0, 0.0], atol=1e-12)
    assert found.kind.tolist() == [3, 0, 0, 1, 2]
