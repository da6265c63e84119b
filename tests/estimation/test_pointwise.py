from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from seatrial.core.errors import InputError
from seatrial.estimation.posterior.output_error import output_error
from seatrial.estimation.posterior.pointwise import MAX_ENTRIES, pointwise_log_likelihood, thin_draws
from seatrial.estimation.priors import Normal
from seatrial.estimation.simulation.sensor_errors import Sensor
from tests.cases import TRUTH, U0, paper_model, surge_rate
from tests.estimation_cases import linear_gaussian, make_trial, naive_speed, posterior

NOISE = {"sigma_u": 0.05, "sigma_udot": 0.02}


@cache
def two_trials(noise="white"):
    """Trials of different lengths and steps, both channels with gaps."""
    rng = np.random.default_rng(6)
    records, motions = [], []
    for label, n in (("a", 40), ("b", 25)):
        time = np.cumsum(rng.uniform(0.1, 0.4, n))
        rev = rng.uniform(5, 20, n)
        speed = naive_speed(rev, np.diff(time, append=time[-1] + 1))
        clean = np.stack([speed, surge_rate(speed, rev)])
        measured = clean + np.array([[0.05], [0.02]]) * rng.normal(size=clean.shape)
        measured[rng.random(clean.shape) < 0.3] = np.nan
        records.append(make_trial(time, rev, label, u=measured[0], udot=measured[1]))
        motions.append((time, rev, measured))
    sensors = [Sensor(channel, noise) for channel in ("u", "udot")]
    likelihood, data = output_error(paper_model(), records, sensors, [[U0], [U0]])
    more = {"heavy": {"dof_u": 4.0, "dof_udot": 9.0}, "proportional": {"share_u": 0.1, "share_udot": 0.2}}
    named = {**TRUTH, **NOISE, **more.get(noise, {})}
    priors = {name: Normal(value, 0.05 * abs(value)) for name, value in named.items()}
    return posterior(priors, likelihood, data), motions


def some_draws(target, chains=2, n=5):
    return np.array(target.constrain(jax.random.normal(jax.random.key(0), (chains, n, target.dim))))


def test_each_measurement_by_hand():
    target, motions = two_trials()
    draws = some_draws(target)
    table = pointwise_log_likelihood(target, draws)
    x_u, x_uu, thrust, *sds = draws[1, 3]
    expected = []
    for time, rev, measured in motions:
        known = {"x_u": x_u, "x_uu": x_uu, "thrust": thrust * (2 * np.pi) ** 2}
        speed = naive_speed(rev, np.diff(time, append=time[-1] + 1), **known)
        for y, clean, sd in zip(measured, (speed, surge_rate(speed, rev, **known)), sds, strict=True):
            expected.append(stats.norm(clean, sd).logpdf(y)[np.isfinite(y)])
    assert np.allclose(table[1, 3], np.concatenate(expected), rtol=1e-9)


def assert_sums_to_the_log_likelihood(target, draws):
    z = target.unconstrain(jnp.asarray(draws.reshape(-1, target.dim)))
    expected = np.asarray(jax.vmap(target.log_likelihood)(z)).reshape(draws.shape[:2])
    for n in (1, 50, 70):
        table = pointwise_log_likelihood(target, draws[:, :n])
        assert np.allclose(table.sum(2), expected[:, :n], rtol=1e-11)


@pytest.mark.parametrize("noise", ["white", "heavy", "proportional"])
def test_sum_is_the_log_likelihood(noise):
    """More draws and fewer than are simulated at once."""
    target, _ = two_trials(noise)
    assert_sums_to_the_log_likelihood(target, some_draws(target, 2, 70))


@pytest.mark.proof
def test_estimated_initial_states_and_delay():
    rng = np.random.default_rng(7)
    time, rev = np.arange(50) * 0.1, rng.uniform(5, 20, 50)
    record = make_trial(time, rev, "a", u=naive_speed(rev, np.full(50, 0.1)) + 0.05 * rng.normal(size=50))
    likelihood, data = output_error(paper_model(), [record], ["u"], [[U0]], delay=True, free_initial=True)
    centres = {**TRUTH, "delay": 0.23, "sigma_u": 0.05, "u_0[a]": 1.4}
    target = posterior({name: Normal(value, 0.05 * abs(value)) for name, value in centres.items()}, likelihood, data)
    assert_sums_to_the_log_likelihood(target, some_draws(target))


def test_diverging_draw_has_zero_density():
    target, _ = two_trials()
    draws = some_draws(target, 1, 1)
    draws[..., 1] = 1e4
    table = pointwise_log_likelihood(target, draws)
    assert (table == -np.inf).any()
    assert not np.isnan(table).any()


@pytest.mark.parametrize(("n", "most", "kept"), [(1000, 100, 25), (1001, 100, 25), (10, 2000, 10), (10, 1, 1)])
def test_thinning(n, most, kept):
    draws = np.broadcast_to(np.arange(n)[None, :, None], (4, n, 2))
    thinned = thin_draws(draws, most)
    assert thinned.shape[0] == 4
    assert kept - 1 <= thinned.shape[1] <= kept
    assert len(set(np.diff(thinned[0, :, 0]))) <= 1


def test_what_is_refused():
    coloured, _ = two_trials(noise="coloured")
    with pytest.raises(InputError, match="coloured residuals"):
        pointwise_log_likelihood(coloured, np.zeros((1, 1, 5)))
    with pytest.raises(InputError, match="another likelihood"):
        pointwise_log_likelihood(linear_gaussian(2).posterior, np.zeros((1, 1, 2)))
    white, _ = two_trials()
    with pytest.raises(InputError, match="thin the draws to"):
        pointwise_log_likelihood(white, np.zeros((1, MAX_ENTRIES // 40, 5)))
