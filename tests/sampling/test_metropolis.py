import jax
import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.estimation.priors import Normal, Uniform
from seatrial.sampling.diagnostics import complaints, diagnose
from seatrial.sampling.metropolis import TARGET_ACCEPTANCE, advance_chains, start_chains
from seatrial.sampling.run import ChainSettings, is_finished
from seatrial.sampling.sampler import SAMPLERS, sample
from tests.estimation_cases import linear_gaussian, posterior
from tests.sampling.moments import assert_moments

KEY = jax.random.key(3)


def chains_of(target, settings, key=KEY, cov=0.1):
    starts = jax.random.normal(jax.random.key(9), (settings.chains, target.dim))
    return sample(SAMPLERS["metropolis"], target, starts, cov * jnp.eye(target.dim), key, settings)


@pytest.mark.parametrize("d", [1, 3, pytest.param(6, marks=pytest.mark.thorough)])
def test_correlated_normal(d):
    problem = linear_gaussian(d)
    mean, cov = problem.moments
    draws = chains_of(problem.posterior, ChainSettings(draws=3000))
    values = np.asarray(problem.posterior.constrain(jnp.asarray(draws.z)))
    assert draws.z.shape == (32, 3000, d)
    assert_moments(values, mean, np.sqrt(np.diag(cov)))
    assert np.abs(np.corrcoef(values.reshape(-1, d).T) - cov / np.sqrt(np.outer(*[np.diag(cov)] * 2))).max() < 0.05
    assert draws.acceptance == pytest.approx(TARGET_ACCEPTANCE, abs=0.05)
    assert complaints(problem.posterior.names, diagnose(values)) == []


def test_posterior_cut_by_the_box_against_closed_form():
    """A triangular density 2a on the unit interval: mean 2/3, variance 1/18; b is free."""
    target = posterior({"a": Uniform(0.0, 1.0), "b": Normal(2.0, 0.5)}, lambda values, data: jnp.log(values["a"]))
    values = np.asarray(target.constrain(jnp.asarray(chains_of(target, ChainSettings(draws=3000)).z)))
    assert_moments(values, np.array([2 / 3, 2.0]), np.array([np.sqrt(1 / 18), 0.5]))


def test_scales_of_very_different_variables_are_tuned_each():
    """Optimal scales are 2.38 sds of each variable; a thousandfold wrong start is forgotten in warm-up."""
    target = posterior(
        {"a": Normal(0.0, 1.0), "b": Normal(0.0, 1.0)}, lambda v, data: -0.5 * (v["b"] / 1e-3) ** 2 + 0 * v["a"]
    )
    run = start_chains(target, jnp.zeros((32, 2)), jnp.diag(jnp.array([1e-3, 1.0])))
    settings = ChainSettings(warmup=1000, draws=100)
    while not is_finished(run, settings):
        run = advance_chains(target, run, KEY, settings)
    scales = np.sqrt(np.diag(run.state.cov))
    assert run.state.cov[0, 1] == 0
    assert scales == pytest.approx([2.4, 2.4e-3], rel=0.15)
