import numpy as np
import pytest
from scipy.stats import multivariate_normal

from seatrial.numerics.gaussian import Gaussian, independent

RNG = np.random.default_rng(0)
CHOL = np.tril(RNG.normal(size=(5, 4, 4))) + 2 * np.eye(4)
COV = CHOL @ np.swapaxes(CHOL, 1, 2)
BATCH = Gaussian(RNG.normal(size=(5, 4)), CHOL)


def test_moments_of_a_batch():
    assert np.allclose(BATCH.cov, COV, rtol=1e-13)
    assert np.allclose(BATCH.sd, np.sqrt(np.diagonal(COV, axis1=1, axis2=2)), rtol=1e-13)


@pytest.mark.parametrize("start", [0, 1, 3])
def test_entropy_of_a_marginal(start):
    marginal = BATCH.marginal(start)
    expected = [multivariate_normal.entropy(cov=cov[start:, start:]) for cov in COV]
    assert np.allclose(marginal.entropy(), expected, rtol=1e-12)
    assert np.allclose(marginal.cov, COV[:, start:, start:], rtol=1e-12)
    assert np.array_equal(marginal.mean, BATCH.mean[:, start:])


def test_independent_gaussian_has_a_diagonal_covariance():
    gaussian = independent([1, 2], [3, 0.5])
    assert gaussian.mean.dtype == np.float64
    assert np.array_equal(gaussian.cov, np.diag([9.0, 0.25]))
