import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from seatrial.core.errors import InputError, NumericalError
from seatrial.estimation.posterior.mode import find_mode
from seatrial.sampling.run import ChainSettings
from seatrial.sampling.sampler import SAMPLERS, sample
from seatrial.sampling.target import evaluate
from studies.remus100.bridge import _complaints, bridge_evidence
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
    mode = find_mode(target, key=KEY)
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


def test_chains_that_never_moved():
    with pytest.raises(NumericalError, match="never moved"):
        bridge_evidence(linear_gaussian(2).posterior, np.zeros((4, 100, 2)), KEY)


def test_eight_draws_of_each_chain_are_enough():
    problem = linear_gaussian(2)
    found = bridge_evidence(problem.posterior, exact_draws(problem, chains=100, length=8), KEY)
    assert abs(found.log_value - problem.log_evidence) < 4 * found.std_error < 0.5


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ((0.19, 401.0, 999), ""),
        ((0.21, 401.0, 999), "0.21 nats"),
        ((0.19, 399.0, 999), "only 399"),
        ((0.19, 401.0, 1000), "settle"),
    ],
)
def test_complaints_from_both_sides(given, words):
    said = _complaints(*given)
    assert len(said) == bool(words)
    assert words in "".join(said)


@pytest.mark.parametrize("proposal", ["normal", "t"])
def test_value_and_error_by_the_definition(proposal):
    """Z solves E_g[h p L] = Z E_post[h g], h = 1 / (s1 p L / Z + s2 g), g fitted to the first half of each chain."""
    problem = linear_gaussian(2)
    draws = exact_draws(problem, length=401)
    found = bridge_evidence(problem.posterior, draws, KEY, proposal=proposal, evaluations=2000)
    first, rest = draws[:, :200].reshape(-1, 2), draws[:, 200:].reshape(-1, 2)
    mean, cov = first.mean(0), np.cov(first.T)
    g = stats.multivariate_normal(mean, cov) if proposal == "normal" else stats.multivariate_t(mean, 0.6 * cov, 5)
    drawn = g.rvs(2000, random_state=np.random.default_rng(np.asarray(jax.random.key_data(KEY))))
    (post, prop), (g_post, g_prop) = (
        [of(z) for z in (rest, drawn)] for of in (lambda z: evaluate(problem.posterior, z), g.logpdf)
    )
    z, ess = np.exp(found.log_value), found.diagnostics["ess"]
    assert found.diagnostics["posterior_draws"] == 804
    assert found.diagnostics["proposal_draws"] == 2000
    assert ess == pytest.approx(804, rel=0.35)
    best: tuple = ()
    for s1 in [n / (n + 2000) for n in np.linspace(400, 804, 405)]:
        of_g = np.exp(prop) / (s1 * np.exp(prop) / z + (1 - s1) * np.exp(g_prop))
        of_post = np.exp(g_post) / (s1 * np.exp(post) / z + (1 - s1) * np.exp(g_post))
        gap = abs(np.log(of_g.mean() / of_post.mean()) - found.log_value)
        best = min(best or (np.inf,), (gap, s1, of_g, of_post), key=lambda x: x[0])
    gap, _, of_g, of_post = best
    assert gap < 1e-5
    error = np.sqrt(of_g.var() / of_g.mean() ** 2 / 2000 + of_post.var() / of_post.mean() ** 2 / ess)
    assert found.std_error == pytest.approx(error, rel=1e-3)


@pytest.mark.parametrize(
    ("shape", "enough"), [((1, 8, 2), False), ((1, 10, 2), True), ((2, 7, 2), False), ((2, 9, 2), True)]
)
def test_eight_draws_and_four_for_each_parameter_are_enough(shape, enough):
    problem = linear_gaussian(2)
    draws = exact_draws(problem, chains=shape[0], length=shape[1])
    if enough:
        assert np.isfinite(bridge_evidence(problem.posterior, draws, KEY).log_value)
    else:
        with pytest.raises(InputError, match=f"{shape[0]} chains of {shape[1]} draws of 2 parameters"):
            bridge_evidence(problem.posterior, draws, KEY)
