"""Unscented Kalman filter in covariance form (Wan and van der Merwe 2000), sigma points redrawn before the update.

predict:  points from chol(P), x = sum w f(point), P = sum w (f(point) - x)(f(point) - x)^T + Q
update:   points from chol(P), S = sum w (h - y)(h - y)^T + R, P_xy = sum w (point - x)(h - y)^T
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import jax.numpy as jnp

from seatrial.compiled.batching import map_in_step
from seatrial.filters.belief import FilterState, Update, condition, gate, mask_missing, process_columns
from seatrial.filters.forms import CovarianceTriangle, StateForm
from seatrial.numerics.sigma_points import UnscentedRule, sigma_pairs
from seatrial.numerics.state_space import StateSpace
from seatrial.numerics.triangular import Scalar, Vector, cholesky, dot, plus, times, total


@dataclass(frozen=True)
class UnscentedKalmanFilter:
    """UKF with the scaled unscented rule."""

    form: ClassVar[StateForm] = CovarianceTriangle()
    rule: UnscentedRule = UnscentedRule()

    def predict(
        self, space: StateSpace, belief: FilterState, control: Vector, step: Scalar
    ) -> tuple[FilterState, Scalar]:
        """See `Filter.predict`."""
        d = space.n_dynamic
        points = self._points(belief)
        moved = at_points(lambda point: space.transition(point, control, step), points)
        images = [(*image, *point[d:]) for image, point in zip(moved, points, strict=True)]
        mean = (*weighted_mean(self.rule, len(belief.mean), [image[:d] for image in images]), *belief.mean[d:])
        deviations = [_minus(image, mean) for image in images]
        weights = self._weights(len(belief.mean))
        covariance = _moment(weights, deviations, deviations)
        noise = list(zip(*process_columns(space, belief.mean, control, step), strict=True))
        spread = tuple(
            tuple(plus(p, dot(noise[i], noise[j])) for j, p in enumerate(row[: i + 1]))
            for i, row in enumerate(covariance)
        )
        return FilterState(mean, spread), 0

    def update(
        self, space: StateSpace, belief: FilterState, control: Vector, measurement: Vector
    ) -> tuple[FilterState, Update]:
        """See `Filter.update`."""
        n = len(belief.mean)
        points = self._points(belief)
        images = at_points(lambda point: space.observe(point, control), points)
        predicted = weighted_mean(self.rule, n, images)
        masked = mask_missing(space, measurement, predicted)
        residuals = [
            tuple(gate(w, y) for w, y in zip(masked.weight, _minus(image, predicted), strict=True)) for image in images
        ]
        weights = self._weights(n)
        innovation_cov = [
            [plus(p, masked.noise_sd[i] ** 2) if i == j else p for j, p in enumerate(row)]
            for i, row in enumerate(_moment(weights, residuals, residuals))
        ]
        cross = _moment(weights, [_minus(point, belief.mean) for point in points], residuals)
        return condition(belief, cholesky(innovation_cov), [tuple(row) for row in cross], masked)

    def _points(self, belief: FilterState) -> list[Vector]:
        above, below = sigma_pairs(belief.mean, cholesky(belief.spread), self.rule.spread(len(belief.mean)))
        return [belief.mean, *above, *below]

    def _weights(self, n: int) -> list[float]:
        _, centre, other = self.rule.weights(n)
        return [centre, *[other] * (2 * n)]


def at_points(function: Callable[[Vector], Vector], points: Sequence[Vector]) -> list[Vector]:
    """Return the values of a function at the sigma points, of which the model is compiled once, and computed once."""
    values = map_in_step(function, tuple(jnp.stack(column) for column in zip(*points, strict=True)))
    return [tuple(column[p] for column in values) for p in range(len(points))]


def weighted_mean(rule: UnscentedRule, n: int, points: Sequence[Vector]) -> Vector:
    """Return the mean of transformed sigma points, the centre first.

    Taken about the centre point, so that the large weights of a small alpha do not cancel.

    Args:
        rule: spread and weights of the points.
        n: number of dimensions in which they lie.
        points: the centre, then the pairs, a tuple of scalars each.
    """
    _, _, other = rule.weights(n)
    centre = points[0]
    return tuple(plus(c, times(other, total([point[i] - c for point in points[1:]]))) for i, c in enumerate(centre))


def _minus(a: Vector, b: Vector) -> Vector:
    return tuple(0.0 if x is y else x - y for x, y in zip(a, b, strict=True))


def _moment(weights: Sequence[float], left: Sequence[Vector], right: Sequence[Vector]) -> list[list[Scalar]]:
    return [
        [
            dot([times(w, a[i]) for w, a in zip(weights, left, strict=True)], [b[j] for b in right])
            for j in range(len(right[0]))
        ]
        for i in range(len(left[0]))
    ]
