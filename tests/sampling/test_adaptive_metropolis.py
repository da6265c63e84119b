from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.core.errors import NumericalError
from seatrial.estimation.mode import find_mode
from seatrial.estimation.priors import Normal, Uniform
from seatrial.sampling.adaptive_metropolis import (
    BLOCK,
    TARGET_ACCEPTANCE,
    ChainState,
    MetropolisSettings,
    Run,
    advance_chains,
    finish,
    is_finished,
    sample_adaptive_metropolis,
    start_chains,
)
from seatrial.sampling.diagnostics import complaints, diagnose
from tests.estimation_cases import THRUST_UNIT, golden_posterior, linear_gaussian, posterior

KEY = jax.random.key(3)
SHORT = MetropolisSettings(chains=32, warmup=300, draws=400)


def sample(target, settings, spread=1.0, cov=0.1, key=KEY):
    """Chains from dispersed starts and an isotropic first covariance; values in the parameters' own units."""
    starts = spread * jax.random.normal(jax.random.key(9), (settings.chains, target.dim))
    draws = sample_adaptive_metropolis(target, starts, cov * jnp.eye(target.dim), key, settings)
    return draws, np.asarray(target.constrain(jnp.asarray(draws.z)))


def assert_moments(values, mean, sd):
    """Within 4 Monte Carlo errors: sd / sqrt(ESS) of a mean, and at most twice sd / sqrt(2 ESS) of an sd."""
    health = diagnose(values)
    ess = np.minimum(health.ess_bulk, health.ess_tail)
    assert (ess > 400).all()
    assert (np.abs(values.mean((0, 1)) - mean) < 4 * sd / np.sqrt(ess)).all()
    assert (np.abs(values.std((0, 1)) - sd) < 8 * sd / np.sqrt(2 * ess)).all()


@pytest.mark.parametrize("d", [pytest.param(1, marks=pytest.mark.thorough), 2, 5])
def test_correlated_normal(d):
    problem = linear_gaussian(d)
    mean, cov = problem.moments
    draws, values = sample(problem.posterior, MetropolisSettings(draws=3000))
    assert draws.z.shape == (32, 3000, d)
    assert_moments(values, mean, np.sqrt(np.diag(cov)))
    assert np.abs(np.corrcoef(values.reshape(-1, d).T) - cov / np.sqrt(np.outer(*[np.diag(cov)] * 2))).max() < 0.05
    assert draws.acceptance == pytest.approx(TARGET_ACCEPTANCE, abs=0.06)
    assert complaints(problem.posterior.names, diagnose(values)) == []


def grid_moments(log_density, *axes):
    """Means and standard deviations of a density on a dense grid."""
    points = np.meshgrid(*axes, indexing="ij")
    weight = np.exp(log_density(*points))
    weight /= weight.sum()
    means = np.array([(weight * x).sum() for x in points])
    return means, np.sqrt([(weight * (x - m) ** 2).sum() for x, m in zip(points, means, strict=True)])


def test_banana_against_quadrature():
    def bent(a, b):
        return -0.5 * ((b - a**2) / 0.4) ** 2

    target = posterior({"a": Normal(0.0, 1.0), "b": Normal(0.0, 2.0)}, lambda v, data: bent(v["a"], v["b"]))
    _, values = sample(target, MetropolisSettings(draws=4000))
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
    draws = sample_adaptive_metropolis(target, starts, 0.1 * jnp.eye(2), KEY, MetropolisSettings(draws=4000))
    values = np.asarray(target.constrain(jnp.asarray(draws.z)))
    a, b = np.linspace(0, 1, 801), np.linspace(-4, -2.5, 801)
    assert_moments(values, *grid_moments(inside, a, b))
    assert (values[..., 1] < -2.5).all()


def test_log_density_belongs_to_the_draws():
    target = linear_gaussian(2).posterior
    draws, _ = sample(target, SHORT)
    again = jax.vmap(target.log_density)(jnp.asarray(draws.z.reshape(-1, 2)))
    assert np.allclose(draws.log_density.ravel(), again, rtol=1e-12)


def test_same_key_same_bits_and_another_key_others():
    target = linear_gaussian(2).posterior
    (first, _), (again, _), (other, _) = (sample(target, SHORT, key=key) for key in (KEY, KEY, jax.random.key(4)))
    assert first.z.tobytes() == again.z.tobytes()
    assert first.log_density.tobytes() == again.log_density.tobytes()
    assert not (first.z == other.z).any()


def test_longer_run_begins_with_the_shorter():
    target = linear_gaussian(2).posterior
    short, _ = sample(target, SHORT)
    long, _ = sample(target, MetropolisSettings(32, 300, 600))
    assert (long.z[:, :400] == short.z).all()


def test_thinned_run_keeps_every_so_many_draws():
    problem = linear_gaussian(2)
    every, _ = sample(problem.posterior, SHORT)
    some, _ = sample(problem.posterior, replace(SHORT, thin=5))
    np.testing.assert_array_equal(some.z, every.z[:, 4::5])


@pytest.mark.parametrize("blocks", [1, 3, 5])
def test_run_resumed_from_a_file_gives_the_same_bits(blocks, tmp_path):
    target = linear_gaussian(2).posterior
    starts = jax.random.normal(jax.random.key(9), (32, 2))
    run = start_chains(target, starts, 0.1 * jnp.eye(2))
    for _ in range(blocks):
        run = advance_chains(target, run, KEY, SHORT)
    np.savez(tmp_path / "run.npz", *map(np.asarray, (*run.state, *run[1:])))
    with np.load(tmp_path / "run.npz") as stored:
        arrays = list(stored.values())
    run = Run(ChainState(*map(jnp.asarray, arrays[:5])), int(arrays[5]), *arrays[6:])
    while not is_finished(run, SHORT):
        run = advance_chains(target, run, KEY, SHORT)
    uninterrupted = sample_adaptive_metropolis(target, starts, 0.1 * jnp.eye(2), KEY, SHORT)
    resumed = finish(run)
    assert resumed.z.tobytes() == uninterrupted.z.tobytes()
    assert resumed.log_density.tobytes() == uninterrupted.log_density.tobytes()
    assert resumed.acceptance == uninterrupted.acceptance


def test_proposal_is_frozen_after_warm_up():
    target = linear_gaussian(2).posterior
    run = start_chains(target, jnp.zeros((32, 2)), jnp.eye(2))
    states = []
    while not is_finished(run, SHORT):
        run = advance_chains(target, run, KEY, SHORT)
        states.append(run.state)
    warm, end = SHORT.warmup // BLOCK - 1, states[-1]
    for i, state in enumerate(states):
        frozen = [(a == b).all() for a, b in zip(state[2:], end[2:], strict=True)]
        assert frozen == [i >= warm] * 3


def test_dead_starts_are_refused():
    target = posterior({"a": Uniform(0.0, 1.0)}, lambda values, data: jnp.where(values["a"] < 0.5, 0.0, -jnp.inf), ())
    with pytest.raises(NumericalError, match="1 of 2 chains start where the density is zero"):
        start_chains(target, jnp.array([[-1.0], [1.0]]), jnp.eye(1))


def test_progress_is_told():
    seen = []
    sample_adaptive_metropolis(
        linear_gaussian(2).posterior,
        jnp.zeros((32, 2)),
        jnp.eye(2),
        KEY,
        SHORT,
        lambda done, total: seen.append((done, total)),
    )
    assert seen == [(100 * i, 700) for i in range(1, 8)]


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
    draws = sample_adaptive_metropolis(target, starts, jnp.asarray(mode.cov), KEY, MetropolisSettings())
    values = np.asarray(target.constrain(jnp.asarray(draws.z)))
    k = len(means)
    scaled = values[:, :, :k] / np.array([1.0, 1.0, THRUST_UNIT, 1.0])[:k]
    assert complaints(target.names, diagnose(values)) == []
    assert np.abs((scaled.mean((0, 1)) - means) / sds).max() < 0.1
    assert scaled.std((0, 1)) == pytest.approx(sds, rel=0.03)
