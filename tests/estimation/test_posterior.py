from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from seatrial.estimation.priors import Normal, Uniform
from tests.estimation_cases import posterior


def likelihood(values, data):
    return -0.5 * ((data - values["a"]) / values["s"]) ** 2 - jnp.log(values["s"])


POSTERIOR = posterior({"a": Normal(1.0, 2.0), "s": Uniform(0.5, 3.0)}, likelihood, jnp.array(1.7))


def test_order_and_size():
    assert POSTERIOR.names == ("a", "s")
    assert POSTERIOR.dim == 2


def test_density_is_that_of_the_values_times_the_slopes():
    """In the middle of the box z is the standardised value, so the slopes are the prior standard deviations."""
    a, s = -0.4, 1.75
    z = POSTERIOR.unconstrain(jnp.array([a, s]))
    assert float(POSTERIOR.log_likelihood(z)) == pytest.approx(-0.5 * ((1.7 - a) / s) ** 2 - np.log(s), abs=1e-12)
    slopes = np.log(2.0) + np.log(2.5 / np.sqrt(12))
    expected = stats.norm(1, 2).logpdf(a) - np.log(2.5) + slopes
    assert float(POSTERIOR.log_prior(z)) == pytest.approx(expected, abs=1e-9)
    assert float(POSTERIOR.log_density(z)) == pytest.approx(expected + float(POSTERIOR.log_likelihood(z)), abs=1e-9)


def test_batches_pass_through_the_maps():
    z = jnp.asarray(np.random.default_rng(0).normal(size=(4, 3, 2)))
    values = POSTERIOR.constrain(z)
    assert values.shape == (4, 3, 2)
    assert np.allclose(values[2, 1], POSTERIOR.constrain(z[2, 1]), rtol=1e-15)
    assert np.allclose(POSTERIOR.unconstrain(values), z, atol=1e-7)


def test_prior_draws_are_independent():
    values = np.asarray(POSTERIOR.constrain(POSTERIOR.sample_prior(jax.random.key(0), 10_000)))
    assert values.shape == (10_000, 2)
    assert abs(np.corrcoef(values.T)[0, 1]) < 0.04
    assert stats.kstest(values[:, 0], stats.norm(1, 2).cdf).pvalue > 0.01
    assert stats.kstest(values[:, 1], stats.uniform(0.5, 2.5).cdf).pvalue > 0.01


def test_numbers_of_priors_and_data_are_the_leaves():
    """So that one compiled sampler serves all data of the same shape under priors of the same kind."""
    assert jax.tree.leaves(POSTERIOR) == [1.0, 2.0, 0.5, 3.0, POSTERIOR.data]
    traces = []

    @jax.jit
    def density(target, z):
        traces.append(1)
        return target.log_density(z)

    z = jnp.zeros(2)
    first = density(POSTERIOR, z)
    other = posterior({"a": Normal(1.5, 2.5), "s": Uniform(0.4, 3.5)}, likelihood, jnp.array(0.0))
    assert density(other, z) != first
    assert len(traces) == 1


def test_an_absent_parameter_is_zero_and_its_z_standard_normal():
    """The others keep their priors and their density, as if it were not among them."""
    priors = {"a": Normal(1.0, 2.0), "b": Uniform(5.0, 6.0), "s": Uniform(0.5, 3.0)}

    def shifted(values, data):
        return likelihood({"a": values["a"] + values["b"], "s": values["s"]}, data)

    target = replace(posterior(priors, shifted, jnp.array(1.7)), present=np.array([1.0, 0.0, 1.0]))
    z = np.asarray(target.sample_prior(jax.random.key(1), 10_000))
    values = np.asarray(target.constrain(jnp.asarray(z)))
    assert stats.kstest(z[:, 1], stats.norm.cdf).pvalue > 0.01
    assert stats.kstest(values[:, 0], stats.norm(1, 2).cdf).pvalue > 0.01
    assert stats.kstest(values[:, 2], stats.uniform(0.5, 2.5).cdf).pvalue > 0.01
    assert np.abs(np.corrcoef(z.T) - np.eye(3)).max() < 0.04
    assert not values[:, 1].any()
    found, known = (jax.jit(jax.vmap(one.log_density)) for one in (target, POSTERIOR))
    np.testing.assert_allclose(found(z), known(z[:, [0, 2]]) + stats.norm.logpdf(z[:, 1]), atol=1e-9)
