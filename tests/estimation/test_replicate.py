"""Simulated measurements against the distribution that each likelihood states."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from seatrial.estimation.posterior.filter_error import filter_error
from seatrial.estimation.posterior.output_error import output_error
from seatrial.estimation.posterior.replicate import motions, replicate
from seatrial.estimation.simulation.sensor_errors import Sensor
from tests.cases import TRUTH, U0, paper_model
from tests.estimation.test_filter_error import LINEAR, MEASURED, REV, SPEED, TIME, N, dense, record
from tests.estimation_cases import make_trial, naive_speed

REPLICATES = 300
KEYS = jax.random.split(jax.random.key(3), REPLICATES)
VALUES = {**TRUTH, "sigma_u": 0.05}
U = np.where(np.arange(N) % 9 == 4, np.nan, MEASURED)
THERE = np.isfinite(U)


def drawn(likelihood, data, values):
    """Measurements of many replicates, shape (replicates, measured samples)."""
    values = {name: jnp.asarray(float(value)) for name, value in values.items()}
    many = jax.vmap(lambda key: replicate(likelihood, values, data, key).channels[0].measured)(KEYS)
    assert np.all(np.asarray(many)[:, 0, ~THERE] == 0)
    return np.asarray(many)[:, 0, THERE]


def output(sensor, values):
    return drawn(*output_error(paper_model(), [record(u=U)], [sensor], [(U0,)]), values)


@pytest.mark.parametrize(
    ("noise", "more", "law"),
    [
        ("white", {}, stats.norm(0, 0.05)),
        ("heavy", {"dof_u": 3.0}, stats.t(3.0, 0, 0.05)),
        ("proportional", {"share_u": 0.1}, stats.norm(0, np.hypot(0.05, 0.1 * SPEED[THERE]))),
    ],
)
def test_independent_noise(noise, more, law):
    residual = output(Sensor("u", noise), {**VALUES, **more}) - SPEED[THERE]
    assert stats.kstest(law.cdf(residual).ravel(), "uniform").pvalue > 1e-3
    assert np.abs(np.corrcoef(residual[:, :-1].ravel(), residual[:, 1:].ravel())[0, 1]) < 4 / np.sqrt(residual.size)


def assert_normal(sample, mean, cov):
    """Squared lengths of the whitened samples follow the chi-squared law, and their mean is zero."""
    white = np.linalg.solve(np.linalg.cholesky(cov), (sample - mean).T)
    assert stats.kstest((white**2).sum(0), stats.chi2(len(mean)).cdf).pvalue > 1e-3
    assert np.abs(white.mean()) < 4 / np.sqrt(white.size)


@pytest.mark.parametrize(
    ("noise", "more", "sd", "white"),
    [("coloured", {"tau_u": 0.8}, 0.05, 0.0), ("drifting", {"drift_u": 0.1, "drift_time_u": 0.8}, 0.1, 0.05)],
)
def test_slow_noise(noise, more, sd, white):
    sample = output(Sensor("u", noise), {**VALUES, **more})
    time = TIME[THERE]
    cov = sd**2 * np.exp(-np.abs(np.subtract.outer(time, time)) / 0.8) + white**2 * np.eye(time.size)
    assert_normal(sample, SPEED[THERE], cov)


def test_process_noise():
    """The linear vehicle, whose measurements are jointly normal."""
    likelihood, data = filter_error(paper_model(), [record(u=U)], ["u"], [(U0,)], [0.05])
    sample = drawn(likelihood, data, LINEAR)
    mean, cov = dense(U, moments=True)
    assert_normal(sample, mean, cov)


def test_sensors_and_trials_of_their_own():
    records = [make_trial(TIME, REV, label, u=U) for label in "ab"]
    likelihood, data = output_error(paper_model(), records, [Sensor("u", bias=True)], [(U0,)] * 2, own=["bias_u"])
    values = {**VALUES, "sigma_u": 1e-9, "bias_u[a]": 0.1, "bias_u[b]": -0.2}
    made = replicate(likelihood, {name: jnp.asarray(float(x)) for name, x in values.items()}, data, KEYS[0])
    clean = naive_speed(REV, np.diff(TIME))[THERE]
    assert np.allclose(np.asarray(made.channels[0].measured)[:, THERE] - clean, [[0.1], [-0.2]], atol=1e-6)


def test_the_start_is_drawn_with_the_spread_that_the_filter_gives_it():
    """Before any process noise has acted: normal about the trim, within 4 standard errors of 4000 draws."""
    likelihood, data = filter_error(paper_model(), [record(u=U)], ["u"], [(U0,)], [0.4])
    values = {name: jnp.asarray(float(value)) for name, value in LINEAR.items()}
    keys = jax.random.split(jax.random.key(8), 4000)
    first = np.asarray(jax.vmap(lambda key: motions(likelihood, values, data, key)[0, 0, 0])(keys))
    assert first.mean() == pytest.approx(U0, abs=4 * 0.4 / np.sqrt(4000))
    assert first.std() == pytest.approx(0.4, rel=4 / np.sqrt(8000))
