import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from seatrial.design.entropy import entropy_reduction
from seatrial.numerics.gaussian import Gaussian


def random_gaussian(seed, n=4, scale=1.0):
    rng = np.random.default_rng(seed)
    return Gaussian(
        jnp.asarray(rng.normal(size=n)), scale * jnp.asarray(np.tril(rng.normal(size=(n, n))) + 3 * np.eye(n))
    )


def cov(gaussian):
    factor = np.asarray(gaussian.chol_cov)
    return factor @ factor.T


@pytest.mark.parametrize("n_dynamic", [0, 1, 3])
def test_against_determinants(n_dynamic):
    """0.5 ln(|P_before| / |P_after|) of the block of the coefficients."""
    before, after = random_gaussian(0, scale=5.0), random_gaussian(1)
    blocks = [cov(g)[n_dynamic:, n_dynamic:] for g in (before, after)]
    expected = 0.5 * np.log(np.linalg.det(blocks[0]) / np.linalg.det(blocks[1]))
    assert float(entropy_reduction(before, after, n_dynamic)) == pytest.approx(expected, rel=1e-12)


def test_against_the_entropies_of_scipy():
    before, after = random_gaussian(2, scale=1e4), random_gaussian(3)
    entropies = [stats.multivariate_normal(cov=cov(g)[1:, 1:]).entropy() for g in (before, after)]
    assert float(entropy_reduction(before, after, 1)) == pytest.approx(entropies[0] - entropies[1], rel=1e-12)


def test_batch():
    before, afters = random_gaussian(7, scale=4.0), [random_gaussian(seed) for seed in range(3)]
    batch = jax.tree.map(lambda *x: jnp.stack(x), *afters)
    assert np.allclose(
        entropy_reduction(before, batch, 1), [entropy_reduction(before, g, 1) for g in afters], rtol=1e-13
    )
