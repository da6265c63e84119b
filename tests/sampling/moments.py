"""Moments of draws against what they should be."""

import numpy as np

from seatrial.sampling.diagnostics import diagnose


def assert_moments(values, mean, sd):
    """Within 4 Monte Carlo errors: sd / sqrt(ESS) of a mean, and at most twice sd / sqrt(2 ESS) of an sd."""
    health = diagnose(values)
    ess = np.minimum(health.ess_bulk, health.ess_tail)
    assert (ess > 400).all()
    assert (np.abs(values.mean((0, 1)) - mean) < 4 * sd / np.sqrt(ess)).all()
    assert (np.abs(values.std((0, 1)) - sd) < 8 * sd / np.sqrt(2 * ess)).all()


def grid_moments(log_density, *axes):
    """Means and standard deviations of a density on a dense grid."""
    points = np.meshgrid(*axes, indexing="ij")
    weight = np.exp(log_density(*points))
    weight /= weight.sum()
    means = np.array([(weight * x).sum() for x in points])
    return means, np.sqrt([(weight * (x - m) ** 2).sum() for x, m in zip(points, means, strict=True)])
