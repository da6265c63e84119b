import jax
import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.estimation.mode import find_mode
from seatrial.estimation.priors import Normal, Uniform
from seatrial.sampling.adaptive_metropolis import TARGET_ACCEPTANCE
from seatrial.sampling.diagnostics import complaints, diagnose
from seatrial.sampling.run import ChainSettings
from seatrial.sampling.sampler import SAMPLERS, sample
from tests.estimation_cases import THRUST_UNIT, golden_posterior, linear_gaussian, posterior
from tests.sampling.moments import assert_moments, grid_moments

KEY = jax.random.key(3)


def chains_of(target, settings, spread=1.0, cov=0.1, key=KEY):
    """Chains from dispersed starts and an isotropic first covariance; values in the parameters' own units."""
    starts = spread * jax.random.normal(jax.random.key(9), (settings.chains, target.dim))
    draws = sample(SAMPLERS["adaptive-metropolis"], target, starts, cov * jnp.eye(target.dim), key, settings)
    return draws, np.asarray(target.constrain(jnp.asarray(draws.z)))


@pytest.mark.parametrize("d", [pytest.param(1, marks=pytest.mark.thorough), 2, 5])
def test_correlated_normal(d):
    problem = linear_gaussian(d)
    mean, cov = problem.moments
    draws, values = chains_of(problem.posterior, ChainSettings(warmup=1000, draws=3000))
    assert draws.z.shape == (32, 3000, d)
    assert_moments(values, mean, np.sqrt(np.diag(cov)))
    assert np.abs(np.corrcoef(values.reshape(-1, d).T) - cov / np.sqrt(np.outer(*[np.diag(cov)] * 2))).max() < 0.05
    assert draws.acceptance == pytest.approx(TARGET_ACCEPTANCE, abs=0.06)
    assert complaints(problem.posterior.names, diagnose(values)) == []


def test_banana_against_quadrature():
    def bent(a, b):
        return -0.5 * ((b - a**2) / 0.4) ** 2

    target = posterior({"a": Normal(0.0, 1.0), "b": Normal(0.0, 2.0)}, lambda v, data: bent(v["a"], v["b"]))
    _, values = chains_of(target, ChainSettings(warmup=1000, draws=4000))
    axis = np.linspace(-8, 8, 801)
    assert_moments(values, *grid_moments(lambda a, b: bent(a, b) - 0.5 * (a**2 + b**2 / 4), axis, axis))


def test_posterior_cut_by_the_box_against_quadrature():
    """Half of the likelihood lies beyond the bounds, and b is cut once more by a region of zero likelihood."""

    def inside(a, b):
        return -0.5 * ((a - 1) / 0.2) ** 2 - 0.5 * ((b + 2 + a) / 0.5) ** 2

    def cut(values, data):
        return jnp.where(values["b"] < -2.5, inside(values["a"], values["b"]), -jnp.inf)

    target = posterior({"a": Uniform(0.0, 1.0), "b": Uniform(-4.0, 1.0)}, cut)
    starts = target.unconstrain(jnp.column_stack([jnp.linspace(0.5, 0.95, 32), jnp.linspace(-3.5, -2.6, 32)]))
    draws = sample(
        SAMPLERS["adaptive-metropolis"], target, starts, 0.1 * jnp.eye(2), KEY, ChainSettings(warmup=1000, draws=4000)
    )
    values = np.asarray(target.constrain(jnp.asarray(draws.z)))
    a, b = np.linspace(0, 1, 801), np.linspace(-4, -2.5, 801)
    assert_moments(values, *grid_moments(inside, a, b))
    assert (values[..., 1] < -2.5).all()


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("model", "means", "sds"),
    [
        ("M-1", [-1.133, -2.962, 6.249], [0.103, 0.068, 0.044]),
        ("M-0 wide", [-1.683, -2.590, 6.231, -8.7], [0.38, 0.256, 0.045, 5.84]),
    ],
)
def test_golden_posterior(model, means, sds):
    target = golden_posterior(model)
    mode = find_mode(target, KEY)
    starts = jnp.asarray(mode.z) + 1.5 * jax.random.normal(KEY, (32, target.dim)) @ jnp.linalg.cholesky(mode.cov).T
    draws = sample(
        SAMPLERS["adaptive-metropolis"],
        target,
        starts,
        jnp.asarray(mode.cov),
        KEY,
        ChainSettings(warmup=1000, draws=4000),
    )
    values = np.asarray(target.constrain(jnp.asarray(draws.z)))
    k = len(means)
    scaled = values[:, :, :k] / np.array([1.0, 1.0, THRUST_UNIT, 1.0])[:k]
    assert complaints(target.names, diagnose(values)) == []
    assert np.abs((scaled.mean((0, 1)) - means) / sds).max() < 0.1
    assert scaled.std((0, 1)) == pytest.approx(sds, rel=0.03)
