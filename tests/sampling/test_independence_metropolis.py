import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from seatrial.estimation.priors import Normal
from seatrial.sampling import adaptive_metropolis, independence_metropolis
from seatrial.sampling.diagnostics import diagnose
from seatrial.sampling.independence_metropolis import MAX_SHARE, MIN_SHARE
from seatrial.sampling.run import ChainSettings, finish
from seatrial.sampling.sampler import advance_chains, sample, start_chains
from tests.estimation_cases import linear_gaussian, posterior

KEY = jax.random.key(3)


def run_of(target, settings):
    starts = jax.random.normal(jax.random.key(9), (settings.chains, target.dim))
    run = start_chains(independence_metropolis, target, starts, jnp.eye(target.dim))
    while run.iteration < settings.warmup + settings.draws:
        run = advance_chains(independence_metropolis, target, run, KEY, settings)
    return run


def test_log_density_of_fresh_draws_is_that_of_a_multivariate_t():
    rng = np.random.default_rng(0)
    z, mean, root = rng.normal(size=(6, 3)), rng.normal(size=3), rng.normal(size=(3, 3))
    cov = root @ root.T + np.eye(3)
    ours = np.asarray(independence_metropolis._log_fresh(jnp.asarray(z), jnp.asarray(mean), jnp.linalg.cholesky(cov)))
    exact = stats.multivariate_t(mean, cov, df=5).logpdf(z)
    np.testing.assert_allclose(ours - ours[0], exact - exact[0], rtol=1e-12, atol=1e-12)


@pytest.mark.proof
def test_nearly_normal_posterior_takes_fresh_draws_and_forgets_at_once():
    """Four times the effective draws of the random walk alone; the share of fresh draws is what is accepted of them."""
    target, settings = linear_gaussian(2).posterior, ChainSettings(draws=1000)
    run = run_of(target, settings)
    starts = jax.random.normal(jax.random.key(9), (settings.chains, 2))
    walk = sample(adaptive_metropolis, target, starts, jnp.eye(2), KEY, settings)
    ours, theirs = (diagnose(draws.z).ess_bulk.min() for draws in (finish(run), walk))
    assert ours > 4 * theirs
    assert 0.6 < float(run.state.fresh) <= MAX_SHARE


@pytest.mark.proof
def test_two_far_modes_leave_it_to_the_walk_and_jump_all_the_same():
    """0.3 N(-6, 1) + 0.7 N(6, 1) in each of two parameters: fresh draws are rarely accepted, and set the shares right."""

    def two(values, data):
        return sum(
            jnp.logaddexp(jnp.log(0.3) - 0.5 * (x + 6) ** 2, jnp.log(0.7) - 0.5 * (x - 6) ** 2) + 0.5 * (x / 100) ** 2
            for x in values.values()
        )

    target = posterior({"a": Normal(0.0, 100.0), "b": Normal(0.0, 100.0)}, two)
    settings = ChainSettings(chains=32, warmup=1000, draws=4000)
    starts = target.unconstrain(jnp.where(jnp.arange(64).reshape(32, 2) % 3 == 0, -6.0, 6.0))
    run = start_chains(independence_metropolis, target, starts, 0.1 * jnp.eye(2))
    while run.iteration < settings.warmup + settings.draws:
        run = advance_chains(independence_metropolis, target, run, KEY, settings)
    assert MIN_SHARE <= float(run.state.fresh) < 0.4
    right = np.asarray(target.constrain(jnp.asarray(finish(run).z))) > 0
    error = np.sqrt(0.21 / diagnose(right.astype(float)).ess_bulk)
    assert (error < 0.03).all()
    assert right.mean((0, 1)) == pytest.approx(0.7, abs=4 * error.max())


@pytest.mark.proof
def test_tails_heavier_than_the_fresh_draws_own():
    """Student's t of 3 degrees of freedom: quantiles, not moments, since the draws' tails are lighter than the target's."""
    target = posterior({"a": Normal(0.0, 100.0)}, lambda values, data: _t3(values["a"]))
    run = run_of(target, ChainSettings(draws=4000))
    values = np.asarray(target.constrain(jnp.asarray(finish(run).z)))
    for share in (0.025, 0.5, 0.975):
        below = (values < stats.t(3).ppf(share)).astype(float)
        error = np.sqrt(share * (1 - share) / diagnose(below).ess_bulk[0])
        assert error < 0.01
        assert below.mean() == pytest.approx(share, abs=4 * error)


def _t3(a):
    """Log density of t_3 over that of the prior."""
    return -2.0 * jnp.log1p(a**2 / 3) + 0.5 * (a / 100) ** 2
