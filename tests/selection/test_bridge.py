import jax
import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.core.errors import InputError, NumericalError
from seatrial.estimation.mode import find_mode
from seatrial.sampling.run import ChainSettings
from seatrial.sampling.sampler import SAMPLERS, sample
from seatrial.selection.bridge import _complaints, bridge_evidence
from tests.estimation_cases import linear_gaussian
from tests.selection.test_evidence import box

KEY = jax.random.key(1)


def exact_draws(problem, chains=4, length=1000, seed=0, correlation=0.0):
    """Draws of a linear-Gaussian posterior in z, independent or an autoregression of the same distribution."""
    mean, cov = problem.moments
    e = np.random.default_rng(seed).normal(size=(chains, length, mean.size))
    for t in range(1, length):
        e[:, t] = correlation * e[:, t - 1] + np.sqrt(1 - correlation**2) * e[:, t]
    return (mean + e @ np.linalg.cholesky(cov).T - problem.prior_mean) / problem.prior_sd


def metropolis(target, draws):
    mode = find_mode(target, KEY)
    values, vectors = np.linalg.eigh(mode.precision)
    cov = (vectors / np.maximum(values, 1.0)) @ vectors.T
    starts = mode.z + 0.3 * np.random.default_rng(0).multivariate_normal(np.zeros(target.dim), cov, 32)
    return sample(
        SAMPLERS["adaptive-metropolis"],
        target,
        jnp.asarray(starts),
        jnp.asarray(cov),
        KEY,
        ChainSettings(warmup=1000, draws=draws),
    ).z


@pytest.mark.parametrize("d", [1, 2, 5])
@pytest.mark.parametrize("proposal", ["normal", "t"])
def test_known_evidence(d, proposal):
    problem = linear_gaussian(d)
    found = bridge_evidence(problem.posterior, exact_draws(problem), KEY, proposal=proposal)
    assert found.status == ""
    assert 0 < found.std_error < 0.02
    assert abs(found.log_value - problem.log_evidence) < 4 * found.std_error


def test_posterior_cut_by_its_prior():
    target, exact = box()
    found = bridge_evidence(target, metropolis(target, 1000), KEY)
    assert found.status == ""
    assert abs(found.log_value - exact) < 4 * found.std_error < 0.2


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_stated_errors_are_honest(correlation):
    """Of 40 errors in units of what is stated, the root mean square has a standard error of 11 %, chains correlated or not."""
    problem = linear_gaussian(2)
    scores = []
    for i in range(40):
        draws = exact_draws(problem, length=500, seed=i, correlation=correlation)
        found = bridge_evidence(problem.posterior, draws, jax.random.key(i), proposal="t", evaluations=1000)
        scores.append((found.log_value - problem.log_evidence) / found.std_error)
    assert np.sqrt(np.mean(np.square(scores))) == pytest.approx(1.0, abs=0.5)


def test_correlated_chains_have_a_larger_error():
    """An autoregression of 0.9 is worth about 1/19 of its draws."""
    problem = linear_gaussian(2)
    free, tied = (
        bridge_evidence(problem.posterior, exact_draws(problem, correlation=c), KEY, proposal="t") for c in (0.0, 0.9)
    )
    assert tied.diagnostics["ess"] < 0.3 * free.diagnostics["ess"]
    assert "worth only" in tied.status


def test_long_chains_are_thinned():
    problem = linear_gaussian(2)
    found = bridge_evidence(problem.posterior, exact_draws(problem, length=2000), KEY, evaluations=1000)
    assert found.diagnostics["posterior_draws"] == 1000


@pytest.mark.parametrize("shape", [(4, 6, 2), (1, 8, 2)])
def test_too_few_draws(shape):
    with pytest.raises(InputError, match="more draws"):
        bridge_evidence(linear_gaussian(2).posterior, np.zeros(shape), KEY)


def test_chains_that_never_moved():
    with pytest.raises(NumericalError, match="never moved"):
        bridge_evidence(linear_gaussian(2).posterior, np.zeros((4, 100, 2)), KEY)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ((0.01, 900.0, 4), ""),
        ((0.5, 900.0, 4), "0.50 nats"),
        ((0.01, 9.0, 4), "only 9"),
        ((0.01, 900.0, 1000), "settle"),
    ],
)
def test_complaints(given, words):
    said = "; ".join(_complaints(*given))
    assert words in said
    assert bool(words) == bool(said)


def test_eight_draws_of_each_chain_are_enough():
    problem = linear_gaussian(2)
    found = bridge_evidence(problem.posterior, exact_draws(problem, chains=100, length=8), KEY)
    assert abs(found.log_value - problem.log_evidence) < 4 * found.std_error < 0.5
