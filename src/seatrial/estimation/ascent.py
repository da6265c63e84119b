"""Climb the log-likelihood from many starts at once, inside the prior's bounds, with a parameter held in each.

Newton's method with exact derivatives in scaled parameters: (|H| + damping) step = gradient, the damping raised where a step
does not climb (Levenberg, 1944); parameters pushed against a bound stay there.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from seatrial.estimation.information import expand_likelihood
from seatrial.estimation.mode import Mode
from seatrial.estimation.posterior import Posterior

FAR = 6.0
"""Prior standard deviations taken for a bound where a prior has none."""
ITERATIONS = 60
GAIN = 1e-7
"""Promised gain in log-likelihood below which a climb has arrived."""


class Slope(NamedTuple):
    """Posterior with the scale of each parameter and its bounds, a hair inside the prior's."""

    posterior: Posterior
    scale: np.ndarray
    lower: np.ndarray
    upper: np.ndarray


class Maxima(NamedTuple):
    """Maxima found: parameter values, shape (n, d), and log-likelihoods, shape (n,)."""

    values: np.ndarray
    height: np.ndarray


def bounded_slope(posterior: Posterior, mode: Mode) -> Slope:
    """A posterior's likelihood to climb inside its prior's bounds."""
    ends = []
    for parameter in posterior.parameters:
        low, high = (float(bound) for bound in parameter.prior.bounds)
        mean, far = float(parameter.prior.mean), FAR * float(parameter.prior.sd)
        low, high = (low if np.isfinite(low) else mean - far), (high if np.isfinite(high) else mean + far)
        hair = 1e-6 * (high - low)
        ends.append((low + hair, high - hair))
    lower, upper = np.array(ends).T
    scale = np.minimum(np.maximum(mode.sd, 1e-9 * (upper - lower)), (upper - lower) / 4)
    return Slope(posterior, scale, lower, upper)


def climb(problem: Slope, starts: np.ndarray, held: Sequence[int | None]) -> Maxima:
    """Maximise over all parameters but the held one of each row; a row whose likelihood is zero at its start stays there."""
    points = np.clip(starts, problem.lower, problem.upper)
    expansion = expand_likelihood(problem.posterior, points)
    height, gradient, hessian = (np.array(part) for part in expansion)
    height = np.where(np.isfinite(height), height, -np.inf)
    damping, active = np.full(len(points), 1e-6), np.isfinite(height)
    for _ in range(ITERATIONS):
        rows = np.flatnonzero(active).tolist()
        moved, promised = points.copy(), np.zeros(len(points))
        for row in rows:
            step, promised[row] = _newton(problem, points[row], gradient[row], hessian[row], held[row], damping[row])
            moved[row] = np.clip(points[row] + step, problem.lower, problem.upper)
        active[rows] = promised[rows] > GAIN
        rows = np.flatnonzero(active).tolist()
        if not rows:
            break
        tried = expand_likelihood(problem.posterior, moved[rows])
        for row, value, slope, bend in zip(rows, *tried, strict=True):
            if np.isfinite(value) and value >= height[row] and np.isfinite(bend).all():
                points[row], height[row], gradient[row], hessian[row] = moved[row], value, slope, bend
                damping[row] = max(damping[row] / 10, 1e-6)
            else:
                damping[row] = max(10 * damping[row], 1e-2)
                active[row] = damping[row] < 1e12
    return Maxima(points, height)


def _newton(
    problem: Slope, point: np.ndarray, gradient: np.ndarray, hessian: np.ndarray, held: int | None, damping: float
) -> tuple[np.ndarray, float]:
    """Step uphill in scaled parameters, those left out that are held or pushed against a bound, and the gain it promises."""
    scale = problem.scale
    slope, bend = gradient * scale, -hessian * np.outer(scale, scale)
    stuck = ((point <= problem.lower) & (slope < 0)) | ((point >= problem.upper) & (slope > 0))
    if held is not None:
        stuck[held] = True
    free = np.flatnonzero(~stuck)
    if free.size == 0:
        return np.zeros(point.size), 0.0
    eigenvalues, vectors = np.linalg.eigh(bend[np.ix_(free, free)])
    stiff = np.maximum(np.abs(eigenvalues), 1e-4) + damping * max(1.0, np.abs(eigenvalues).max())
    along = (vectors.T @ slope[free]) / stiff
    step = np.zeros(point.size)
    step[free] = vectors @ along
    return step * scale, float(0.5 * along @ (vectors.T @ slope[free]))
