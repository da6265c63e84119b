"""Filters as textbooks print them, with matrices and loops; a channel that is NaN is struck from every matrix.

Jazwinski (1970) section 8.3; Wan and van der Merwe (2000), sigma points redrawn before the update; for the constrained
form Kandepu, Foss and Imsland (2008).
"""

from typing import NamedTuple

import numpy as np
from scipy.stats import multivariate_normal


class Run(NamedTuple):
    means: np.ndarray
    covs: np.ndarray
    innovations: np.ndarray
    nis: np.ndarray
    clipped: np.ndarray
    log_likelihood: float


class Problem(NamedTuple):
    """x' = f(x, c, h) + w, y = h(x, c) + v, on arrays."""

    mean: np.ndarray
    cov: np.ndarray
    transition: object
    observe: object
    process_cov: np.ndarray
    measurement_cov: np.ndarray


def complex_step_jacobian(function, x):
    """Exact derivative of a function that also accepts a tiny imaginary part."""
    tiny = 1e-30
    return np.column_stack([np.imag(function(x + 1j * tiny * unit)) / tiny for unit in np.eye(x.size)])


def extended(problem, control, measurement, step):
    def predict(mean, cov, c, h):
        jacobian = complex_step_jacobian(lambda x: problem.transition(x, c, h), mean)
        return problem.transition(mean, c, h), jacobian @ cov @ jacobian.T + problem.process_cov, 0

    def moments(mean, cov, c):
        jacobian = complex_step_jacobian(lambda x: problem.observe(x, c), mean)
        return mean, cov, problem.observe(mean, c), jacobian @ cov @ jacobian.T, cov @ jacobian.T, 0

    return _run(problem, predict, moments, control, measurement, step)


def unscented(problem, control, measurement, step, alpha=1.0, beta=2.0, kappa=0.0, bounds=None):
    n = problem.mean.size
    lam = alpha**2 * (n + kappa) - n
    mean_weights = np.array([lam / (n + lam), *[0.5 / (n + lam)] * (2 * n)])
    cov_weights = mean_weights + np.array([1 - alpha**2 + beta, *[0] * (2 * n)])

    def draw(mean, cov):
        columns = (np.sqrt(n + lam) * np.linalg.cholesky(cov)).T
        points = np.array([mean, *(mean + columns), *(mean - columns)])
        inside = points if bounds is None else np.clip(points, *bounds)
        return inside, (inside != points).any(axis=1).sum()

    def spread(left, right):
        return sum(w * np.outer(a, b) for w, a, b in zip(cov_weights, left, right, strict=True))

    def predict(mean, cov, c, h):
        points, clipped = draw(mean, cov)
        images = np.array([problem.transition(point, c, h) for point in points])
        average = mean_weights @ images
        return average, spread(images - average, images - average) + problem.process_cov, clipped

    def moments(mean, cov, c):
        points, clipped = draw(mean, cov)
        images = np.array([problem.observe(point, c) for point in points])
        average, expected = mean_weights @ points, mean_weights @ images
        about, errors = points - average, images - expected
        return average, spread(about, about), expected, spread(errors, errors), spread(about, errors), clipped

    return _run(problem, predict, moments, control, measurement, step, bounds)


def _run(problem, predict, moments, control, measurement, step, bounds=None):
    mean, cov, clipped_before, total, rows = problem.mean, problem.cov, 0, 0.0, []
    for c, y, h in zip(control, measurement, step, strict=True):
        mean, cov, expected, output_cov, cross, clipped = moments(mean, cov, c)
        seen = np.isfinite(y)
        innovation, nis = y - expected, 0.0
        if seen.any():
            s = (output_cov + problem.measurement_cov)[np.ix_(seen, seen)]
            gain = cross[:, seen] @ np.linalg.inv(s)
            nis = innovation[seen] @ np.linalg.solve(s, innovation[seen])
            total += multivariate_normal.logpdf(innovation[seen], cov=s)
            mean, cov = mean + gain @ innovation[seen], cov - gain @ s @ gain.T
        mean = mean if bounds is None else np.clip(mean, *bounds)
        rows.append((mean, cov, innovation, nis, clipped + clipped_before))
        mean, cov, clipped_before = predict(mean, cov, c, h)
    return Run(*map(np.array, zip(*rows, strict=True)), total)
