import jax
import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.estimation.priors import Normal
from seatrial.sampling.metropolis import TARGET_ACCEPTANCE, advance_chains, start_chains
from seatrial.sampling.run import ChainSettings, is_finished
from seatrial.sampling.sampler import SAMPLERS, sample
from tests.estimation_cases import linear_gaussian, posterior

KEY = jax.random.key(3)


def test_acceptance_is_tuned():
    problem = linear_gaussian(2)
    starts = jax.random.normal(jax.random.key(9), (32, 2))
    draws = sample(SAMPLERS["metropolis"], problem.posterior, starts, 0.1 * jnp.eye(2), KEY, ChainSettings(draws=2000))
    assert draws.acceptance == pytest.approx(TARGET_ACCEPTANCE, abs=0.05)


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
