import numpy as np
import pytest
from filterpy.kalman import MerweScaledSigmaPoints

from seatrial.numerics.sigma_points import UnscentedRule, sigma_pairs
from seatrial.numerics.triangular import to_triangle

RULES = [UnscentedRule(), UnscentedRule(1.0, 2.0, -1.0), UnscentedRule(0.5, 2.0, 0.0), UnscentedRule(1e-3, 2.0, 0.0)]
RNG = np.random.default_rng(5)
MEAN, FACTOR = RNG.normal(size=4), np.tril(RNG.normal(size=(4, 4))) + 2 * np.eye(4)
MATRIX, OFFSET, CURVATURE = RNG.normal(size=(3, 4)), RNG.normal(size=3), RNG.normal(size=(4, 4))


def transform(rule):
    """Points, one to a row, with their weights in means and in covariances."""
    above, below = sigma_pairs(tuple(MEAN), to_triangle(FACTOR), rule.spread(4))
    centre_mean, centre_cov, other = rule.weights(4)
    return np.array([MEAN, *above, *below]), np.array([centre_mean, *[other] * 8]), np.array([centre_cov, *[other] * 8])


@pytest.mark.parametrize("rule", RULES)
def test_points_and_weights_are_those_of_filterpy(rule):
    peer = MerweScaledSigmaPoints(4, rule.alpha, rule.beta, rule.kappa)
    points, mean_weights, cov_weights = transform(rule)
    assert np.allclose(points, peer.sigma_points(MEAN, FACTOR @ FACTOR.T), atol=1e-12)
    assert np.allclose(mean_weights, peer.Wm, rtol=1e-9)
    assert np.allclose(cov_weights, peer.Wc, rtol=1e-9)


@pytest.mark.parametrize("rule", RULES)
def test_moments_of_a_linear_map_are_exact(rule):
    points, mean_weights, cov_weights = transform(rule)
    images = points @ MATRIX.T + OFFSET
    mean = MATRIX @ MEAN + OFFSET
    accuracy = 1e-14 * np.abs(mean_weights).max() + 1e-12
    assert mean_weights.sum() == pytest.approx(1, abs=accuracy)
    assert np.allclose(mean_weights @ images, mean, atol=10 * accuracy)
    cov = (images - mean).T * cov_weights @ (images - mean)
    assert np.allclose(cov, MATRIX @ FACTOR @ FACTOR.T @ MATRIX.T, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("rule", RULES[:3])
def test_mean_of_a_quadratic_is_exact(rule):
    points, mean_weights, _ = transform(rule)
    expected = MEAN @ CURVATURE @ MEAN + np.trace(CURVATURE @ FACTOR @ FACTOR.T)
    assert mean_weights @ np.einsum("ki,ij,kj->k", points, CURVATURE, points) == pytest.approx(expected, rel=1e-12)
