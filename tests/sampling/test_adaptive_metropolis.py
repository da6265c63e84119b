import jax
import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.estimation.priors import Normal
from seatrial.sampling.adaptive_metropolis import TARGET_ACCEPTANCE
from seatrial.sampling.run import ChainSettings
from seatrial.sampling.sampler import SAMPLERS, sample
from tests.estimation_cases import linear_gaussian, posterior
from tests.sampling.moments import assert_moments, grid_moments

KEY = jax.random.key(3)


def chains_of(target, settings, spread=1.0, cov=0.1, key=KEY):
    """Chains from dispersed starts and an isotropic first covariance; values in the parameters' own units."""
    starts = spread * jax.random.normal(jax.random.key(9), (settings.chains, target.dim))
    draws = sample(SAMPLERS["adaptive-metropolis"], target, starts, cov * jnp.eye(target.dim), key, settings)
    return draws, np.asarray(target.constrain(jnp.asarray(draws.z)))


def test_acceptance_is_tuned():
    draws, _ = chains_of(linear_gaussian(2).posterior, ChainSettings(warmup=1000, draws=3000))
    assert draws.acceptance == pytest.approx(TARGET_ACCEPTANCE, abs=0.06)


def test_banana_against_quadrature():
    def bent(a, b):
        return -0.5 * ((b - a**2) / 0.4) ** 2

    target = posterior({"a": Normal(0.0, 1.0), "b": Normal(0.0, 2.0)}, lambda v, data: bent(v["a"], v["b"]))
    _, values = chains_of(target, ChainSettings(warmup=1000, draws=4000))
    axis = np.linspace(-8, 8, 801)
    assert_moments(values, *grid_moments(lambda a, b: bent(a, b) - 0.5 * (a**2 + b**2 / 4), axis, axis))
