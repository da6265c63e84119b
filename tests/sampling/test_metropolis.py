import jax
import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.core.errors import NumericalError
from seatrial.estimation.priors import Normal, Uniform
from seatrial.sampling.adaptive_metropolis import BLOCK, ChainState, MetropolisSettings, Run, finish, is_finished
from seatrial.sampling.diagnostics import complaints, diagnose
from seatrial.sampling.metropolis import TARGET_ACCEPTANCE, advance_chains, sample_metropolis, start_chains
from tests.estimation_cases import linear_gaussian, posterior

KEY = jax.random.key(3)
SHORT = MetropolisSettings(chains=32, warmup=300, draws=400)


def sample(target, settings, key=KEY, cov=0.1):
    starts = jax.random.normal(jax.random.key(9), (settings.chains, target.dim))
    return sample_metropolis(target, starts, cov * jnp.eye(target.dim), key, settings)


def assert_moments(values, mean, sd):
    """Within 4 Monte Carlo errors: sd / sqrt(ESS) of a mean, and at most twice sd / sqrt(2 ESS) of an sd."""
    health = diagnose(values)
    ess = np.minimum(health.ess_bulk, health.ess_tail)
    assert (ess > 400).all()
    assert (np.abs(values.mean((0, 1)) - mean) < 4 * sd / np.sqrt(ess)).all()
    assert (np.abs(values.std((0, 1)) - sd) < 8 * sd / np.sqrt(2 * ess)).all()


@pytest.mark.parametrize("d", [1, 3, pytest.param(6, marks=pytest.mark.thorough)])
def test_correlated_normal(d):
    problem = linear_gaussian(d)
    mean, cov = problem.moments
    draws = sample(problem.posterior, MetropolisSettings(draws=3000))
    values = np.asarray(problem.posterior.constrain(jnp.asarray(draws.z)))
    assert draws.z.shape == (32, 3000, d)
    assert_moments(values, mean, np.sqrt(np.diag(cov)))
    assert np.abs(np.corrcoef(values.reshape(-1, d).T) - cov / np.sqrt(np.outer(*[np.diag(cov)] * 2))).max() < 0.05
    assert draws.acceptance == pytest.approx(TARGET_ACCEPTANCE, abs=0.05)
    assert complaints(problem.posterior.names, diagnose(values)) == []


def test_posterior_cut_by_the_box_against_closed_form():
    """A triangular density 2a on the unit interval: mean 2/3, variance 1/18; b is free."""
    target = posterior({"a": Uniform(0.0, 1.0), "b": Normal(2.0, 0.5)}, lambda values, data: jnp.log(values["a"]))
    values = np.asarray(target.constrain(jnp.asarray(sample(target, MetropolisSettings(draws=3000)).z)))
    assert_moments(values, np.array([2 / 3, 2.0]), np.array([np.sqrt(1 / 18), 0.5]))


def test_scales_of_very_different_variables_are_tuned_each():
    """Optimal scales are 2.38 sds of each variable; a thousandfold wrong start is forgotten in warm-up."""
    target = posterior(
        {"a": Normal(0.0, 1.0), "b": Normal(0.0, 1.0)}, lambda v, data: -0.5 * (v["b"] / 1e-3) ** 2 + 0 * v["a"]
    )
    run = start_chains(target, jnp.zeros((32, 2)), jnp.diag(jnp.array([1e-3, 1.0])))
    settings = MetropolisSettings(warmup=1000, draws=100)
    while not is_finished(run, settings):
        run = advance_chains(target, run, KEY, settings)
    scales = np.sqrt(np.diag(run.state.cov))
    assert scales == pytest.approx([2.4, 2.4e-3], rel=0.15)


def test_run_resumed_from_a_file_gives_the_same_bits(tmp_path):
    target = linear_gaussian(2).posterior
    starts = jax.random.normal(jax.random.key(9), (32, 2))
    run = start_chains(target, starts, 0.1 * jnp.eye(2))
    for _ in range(4):
        run = advance_chains(target, run, KEY, SHORT)
    np.savez(tmp_path / "run.npz", *map(np.asarray, (*run.state, *run[1:])))
    with np.load(tmp_path / "run.npz") as stored:
        arrays = list(stored.values())
    run = Run(ChainState(*map(jnp.asarray, arrays[:5])), int(arrays[5]), *arrays[6:])
    while not is_finished(run, SHORT):
        run = advance_chains(target, run, KEY, SHORT)
    resumed, whole = finish(run), sample(target, SHORT)
    assert resumed.z.tobytes() == whole.z.tobytes()
    assert resumed.log_density.tobytes() == whole.log_density.tobytes()
    assert resumed.acceptance == whole.acceptance


def test_another_key_gives_other_draws_and_thinning_keeps_some():
    target = linear_gaussian(2).posterior
    every, other = sample(target, SHORT), sample(target, SHORT, jax.random.key(4))
    some = sample(target, MetropolisSettings(32, 300, 400, thin=5))
    assert not (every.z == other.z).any()
    np.testing.assert_array_equal(some.z, every.z[:, 4::5])
    np.testing.assert_array_equal(some.log_density, every.log_density[:, 4::5])


def test_proposal_is_frozen_after_warm_up():
    target = linear_gaussian(2).posterior
    run = start_chains(target, jnp.zeros((32, 2)), jnp.eye(2))
    covs = []
    while not is_finished(run, SHORT):
        run = advance_chains(target, run, KEY, SHORT)
        covs.append(np.asarray(run.state.cov))
    warm = SHORT.warmup // BLOCK - 1
    assert [bool((cov == covs[-1]).all()) for cov in covs] == [i >= warm for i in range(len(covs))]
    assert all(cov[0, 1] == 0 for cov in covs)


def test_log_density_belongs_to_the_draws():
    target = linear_gaussian(2).posterior
    draws = sample(target, SHORT)
    again = jax.vmap(target.log_density)(jnp.asarray(draws.z.reshape(-1, 2)))
    assert np.allclose(draws.log_density.ravel(), again, rtol=1e-12)


def test_dead_starts_are_refused():
    target = posterior({"a": Uniform(0.0, 1.0)}, lambda values, data: jnp.where(values["a"] < 0.5, 0.0, -jnp.inf), ())
    with pytest.raises(NumericalError, match="1 of 2 chains start where the density is zero"):
        start_chains(target, jnp.array([[-1.0], [1.0]]), jnp.eye(1))
