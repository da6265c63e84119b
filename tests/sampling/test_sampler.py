"""What every sampler of the family must do."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.core.errors import NumericalError
from seatrial.estimation.priors import Normal, Uniform
from seatrial.messages.render import statement
from seatrial.sampling import adaptive_metropolis, metropolis
from seatrial.sampling.diagnostics import chain_findings, diagnose
from seatrial.sampling.names import DEFAULT
from seatrial.sampling.run import (
    ChainSettings,
    arrays_of_run,
    finish,
    is_finished,
    run_from_arrays,
    unnamed_draws,
)
from seatrial.sampling.sampler import SAMPLERS, advance_chains, sample, start_chains
from tests.estimation_cases import linear_gaussian, posterior
from tests.sampling.moments import assert_moments, grid_moments

KEY = jax.random.key(3)
SHORT = ChainSettings(chains=32, warmup=200, draws=200)
LONG = {
    "independence-metropolis": ChainSettings(draws=1000),
    "metropolis": ChainSettings(draws=2000),
    "adaptive-metropolis": ChainSettings(draws=2000),
    "de-metropolis": ChainSettings(draws=2000),
    "nuts": ChainSettings(warmup=300, draws=400),
}
each = pytest.mark.parametrize("name", SAMPLERS)
default = pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.proof] * (name != DEFAULT)) for name in SAMPLERS]
)
"""The default here, all others with the proofs."""


def starts_of(target, chains):
    return jax.random.normal(jax.random.key(9), (chains, target.dim))


def draw(name, target, settings, key=KEY, **kwargs):
    starts = starts_of(target, settings.chains)
    return sample(SAMPLERS[name], target, starts, 0.1 * jnp.eye(target.dim), key, settings, **kwargs)


@cache
def usual(name):
    """The draws that most tests look at, drawn once."""
    return draw(name, linear_gaussian(2).posterior, SHORT)


def test_every_sampler_is_tried_here():
    assert set(LONG) == set(SAMPLERS)
    assert DEFAULT in SAMPLERS


@default
@pytest.mark.parametrize("d", [2, pytest.param(1, marks=pytest.mark.proof)])
def test_correlated_normal(name, d):
    """More parameters, up to ten, are in test_reference_posteriors.py."""
    problem = linear_gaussian(d)
    mean, cov = problem.moments
    draws = draw(name, problem.posterior, LONG[name])
    values = np.asarray(problem.posterior.constrain(jnp.asarray(draws.z)))
    assert_moments(values, mean, np.sqrt(np.diag(cov)))
    sd = np.sqrt(np.diag(cov))
    assert np.abs(np.corrcoef(values.reshape(-1, d).T) - cov / np.outer(sd, sd)).max() < 0.05
    assert chain_findings(problem.posterior.names, diagnose(values)) == []
    assert draws.faults() == []


@default
def test_box_and_region_of_zero_likelihood_against_quadrature(name):
    """A triangular density 2a cut off at its highest by its box, and a wall through the bulk: nothing is drawn behind either."""

    def walled(values, data):
        return jnp.where(values["a"] + values["b"] < 2.8, jnp.log(values["a"]), -jnp.inf)

    target = posterior({"a": Uniform(0.0, 1.0), "b": Normal(2.0, 0.5)}, walled)
    starts = target.unconstrain(jnp.column_stack([jnp.linspace(0.3, 0.9, 32), jnp.full(32, 1.6)]))
    draws = sample(SAMPLERS[name], target, starts, 0.1 * jnp.eye(2), KEY, LONG[name])
    values = np.asarray(target.constrain(jnp.asarray(draws.z)))
    assert ((values[..., 0] > 0) & (values[..., 0] < 1) & (values.sum(-1) < 2.8)).all()
    a, b = (np.arange(2000) + 0.5) / 2000, np.linspace(-1.0, 2.8, 3801)
    with np.errstate(divide="ignore"):
        exact = grid_moments(lambda a, b: np.log(a * (a + b < 2.8)) - 2 * (b - 2) ** 2, a, b)
    assert_moments(values, *exact)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.proof] * (name == "nuts")) for name in SAMPLERS]
)
def test_run_stored_and_restored_after_every_block_gives_the_same_bits(name, tmp_path):
    target, sampler = linear_gaussian(2).posterior, SAMPLERS[name]
    starts = starts_of(target, SHORT.chains)
    run, stops = start_chains(sampler, target, starts, 0.1 * jnp.eye(2)), 0
    while not is_finished(run, SHORT):
        np.savez(tmp_path / "run.npz", **arrays_of_run(run))
        with np.load(tmp_path / "run.npz", allow_pickle=False) as stored:
            run = run_from_arrays(sampler.State, dict(stored))
        run, stops = advance_chains(sampler, target, run, KEY, SHORT), stops + 1
    assert stops == 4
    resumed, whole = finish(run), usual(name)
    assert resumed.z.tobytes() == whole.z.tobytes()
    assert resumed.log_density.tobytes() == whole.log_density.tobytes()
    assert (resumed.acceptance, resumed.divergences) == (whole.acceptance, whole.divergences)


@each
def test_state_is_arrays_only(name):
    """And of the same types after a block, so that one program serves all blocks."""
    target = linear_gaussian(2).posterior
    run = start_chains(SAMPLERS[name], target, starts_of(target, 32), 0.1 * jnp.eye(2))
    assert type(run.state) is SAMPLERS[name].State
    for field in run.state:
        assert isinstance(field, jax.Array)
        assert field.dtype in (jnp.float64, jnp.int64)
    after = advance_chains(SAMPLERS[name], target, run, KEY, SHORT)
    assert jax.tree.map(jax.typeof, after.state) == jax.tree.map(jax.typeof, run.state)


@each
def test_shapes_thinning_and_log_densities(name):
    target = linear_gaussian(2).posterior
    every, some = usual(name), draw(name, target, ChainSettings(32, 200, 200, thin=5))
    assert every.z.shape == (32, 200, 2)
    assert every.log_density.shape == (32, 200)
    np.testing.assert_array_equal(some.z, every.z[:, 4::5])
    again = jax.vmap(target.log_density)(jnp.asarray(every.z.reshape(-1, 2)))
    np.testing.assert_allclose(every.log_density.ravel(), again, rtol=1e-12)


@each
def test_seeds(name):
    target = linear_gaussian(2).posterior
    again, other = draw(name, target, SHORT), draw(name, target, SHORT, jax.random.key(4))
    assert usual(name).z.tobytes() == again.z.tobytes()
    assert not (again.z == other.z).all(-1).any()


@each
def test_longer_run_begins_with_the_shorter(name):
    long = draw(name, linear_gaussian(2).posterior, ChainSettings(32, 200, 300))
    assert (long.z[:, :200] == usual(name).z).all()


@each
def test_what_was_learnt_is_frozen_after_warm_up(name):
    target, sampler = linear_gaussian(2).posterior, SAMPLERS[name]
    run = start_chains(sampler, target, starts_of(target, 32), jnp.eye(2))
    moving = {"z", "log_density", "gradient", "divergences", "steps"}
    learnt = []
    while not is_finished(run, SHORT):
        run = advance_chains(sampler, target, run, KEY, SHORT)
        learnt.append({k: np.asarray(v) for k, v in run.state._asdict().items() if k not in moving})
    same = [all((one[k] == learnt[-1][k]).all() for k in one) for one in learnt]
    assert same == [False, True, True, True]


@pytest.mark.parametrize("sampler", [metropolis, adaptive_metropolis], ids=["metropolis", "adaptive"])
def test_acceptance_is_tuned(sampler):
    target = linear_gaussian(2).posterior
    draws = sample(sampler, target, starts_of(target, 32), 0.1 * jnp.eye(2), KEY, ChainSettings(draws=2000))
    assert draws.acceptance == pytest.approx(sampler.TARGET_ACCEPTANCE, abs=0.06)


def test_metropolis_tunes_the_scale_of_each_variable():
    """Optimal scales are 2.38 sds of each; a thousandfold wrong start is forgotten in warm-up."""
    target = posterior(
        {"a": Normal(0.0, 1.0), "b": Normal(0.0, 1.0)}, lambda v, data: -0.5 * (v["b"] / 1e-3) ** 2 + 0 * v["a"]
    )
    run = start_chains(metropolis, target, jnp.zeros((32, 2)), jnp.diag(jnp.array([1e-3, 1.0])))
    settings = ChainSettings(warmup=1000, draws=100)
    while not is_finished(run, settings):
        run = advance_chains(metropolis, target, run, KEY, settings)
    assert run.state.cov[0, 1] == 0
    assert np.sqrt(np.diag(run.state.cov)) == pytest.approx([2.4, 2.4e-3], rel=0.15)


def test_adaptive_metropolis_on_a_banana_against_quadrature():
    def bent(a, b):
        return -0.5 * ((b - a**2) / 0.4) ** 2

    target = posterior({"a": Normal(0.0, 1.0), "b": Normal(0.0, 2.0)}, lambda v, data: bent(v["a"], v["b"]))
    draws = draw("adaptive-metropolis", target, ChainSettings(warmup=1000, draws=4000))
    axis = np.linspace(-8, 8, 801)
    exact = grid_moments(lambda a, b: bent(a, b) - 0.5 * (a**2 + b**2 / 4), axis, axis)
    assert_moments(np.asarray(target.constrain(jnp.asarray(draws.z))), *exact)


@each
def test_dead_starts_are_refused(name):
    target = posterior({"a": Uniform(0.0, 1.0)}, lambda values, data: jnp.where(values["a"] < 0.5, 0.0, -jnp.inf), ())
    with pytest.raises(NumericalError, match="1 of 2 chains start outside the support"):
        start_chains(SAMPLERS[name], target, jnp.array([[-1.0], [1.0]]), jnp.eye(1))


@default
def test_chain_on_a_spike_is_told(name):
    """One chain starts on a spike that no step finds again; NUTS, which may fall off it, knows the edge by its energy."""

    def spike(values, data):
        return jnp.where(jnp.abs(values["a"] - 0.5) < 1e-9, 1e5, 0.0)

    target = posterior({"a": Normal(0.0, 1.0)}, spike, ())
    starts = jnp.linspace(-1.0, 1.0, 32)[:, None].at[2].set(0.5)
    said = sample(SAMPLERS[name], target, starts, jnp.eye(1), KEY, SHORT).faults()
    expected = "transitions diverged" if name == "nuts" else "1 of 32 chains never moved in 200 draws (chain 3): "
    assert any(expected in statement(one) for one in said)


def test_divergences_are_told():
    z = np.random.default_rng(0).normal(size=(2, 10, 1))
    (said,) = unnamed_draws(z, z[..., 0], 0.8, 3).faults()
    assert statement(said).startswith("3 of 20 transitions diverged: ")


def test_progress_is_told():
    seen = []
    draw(DEFAULT, linear_gaussian(2).posterior, SHORT, progress=lambda done, total: seen.append((done, total)))
    assert seen == [(100, 400), (200, 400), (300, 400), (400, 400)]
