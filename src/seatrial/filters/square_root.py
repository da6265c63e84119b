"""Square-root unscented Kalman filter, plain and constrained (van der Merwe and Wan 2001; Kandepu, Foss and Imsland 2008).

    predict:  S = triangularise [ sqrt(w) (f(point) - x), sqrt(Q) ]
    update:   [[S_y, 0], [B, S]] = triangularise [[ sqrt(w) (h - y), sqrt(R) ], [ sqrt(w) (point - x), 0 ]]
              x = x + B S_y^-1 (measured - y)

One triangularisation of the joint deviations replaces the published filter's downdates by the columns of K S_y: it is
the same covariance in exact arithmetic, and stays positive where points were clipped. Only a negative centre weight
(alpha well below 1) still needs a downdate; where that fails the update is flagged.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import ClassVar

import jax.numpy as jnp

from seatrial.core.state_space import StateSpace
from seatrial.filters.belief import Belief, Update, gate, mask_missing, whiten
from seatrial.filters.forms import FactorTriangle, Form
from seatrial.filters.unscented import at_points, weighted_mean
from seatrial.numerics.sigma_points import UnscentedRule, sigma_pairs
from seatrial.numerics.triangular import (
    Scalar,
    Triangle,
    Vector,
    dot,
    is_zero,
    rank_one_downdate,
    times,
    triangular_factor,
)

Bounds = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class SquareRootUnscentedKalmanFilter:
    """SR-UKF; with `bounds`, sigma points outside are moved back to the boundary before they are used.

    Attributes:
        rule: unscented rule.
        bounds: (lower, upper) of every state, infinite where free; None for the unconstrained filter.
    """

    form: ClassVar[Form] = FactorTriangle()
    rule: UnscentedRule = UnscentedRule()
    bounds: Bounds | None = None

    def predict(self, space: StateSpace, belief: Belief, control: Vector, step: Scalar) -> tuple[Belief, Scalar]:
        """See `Filter.predict`."""
        d, n = space.n_dynamic, len(belief.mean)
        points, clipped = self._points(belief)
        images = at_points(lambda point: space.transition(point, control, step), points)
        if self.bounds:
            images = [(*image, *point[d:]) for image, point in zip(images, points, strict=True)]
        moved = weighted_mean(self.rule, n, images)
        steady = belief.spread[len(moved) :]
        pairs, others, centre = self._rows([_minus(image, moved) for image in images], steady)
        spread, failed = _factor([*pairs, *others, *_diagonal(tuple(space.process_sd))], centre)
        if not is_zero(failed):
            spread = tuple(tuple(jnp.where(failed, jnp.nan, entry) for entry in row) for row in spread)
        return Belief((*moved, *belief.mean[len(moved) :]), spread), clipped

    def update(self, space: StateSpace, belief: Belief, control: Vector, measurement: Vector) -> tuple[Belief, Update]:
        """See `Filter.update`."""
        m, n = len(measurement), len(belief.mean)
        points, clipped = self._points(belief)
        outputs = at_points(lambda point: space.observe(point, control), points)
        predicted = weighted_mean(self.rule, n, outputs)
        masked = mask_missing(space, measurement, predicted)
        residuals = [tuple(map(gate, masked.weight, _minus(output, predicted))) for output in outputs]
        noise = _diagonal(masked.noise_sd)
        if self.bounds:
            mean = weighted_mean(self.rule, n, points)
            joint = [(*r, *_minus(point, mean)) for r, point in zip(residuals, points, strict=True)]
            pairs, others, centre = self._rows(joint, ())
            others = [*others, *noise]
        else:
            mean = belief.mean
            pairs, others, centre = self._rows(residuals, belief.spread)
            # Rows that are zero for every state become as many as there are channels: half the work that follows.
            others = _transpose(triangular_factor([*others, *noise]))
        factor, failed = _factor([*pairs, *others], centre)
        white, update = whiten(factor[:m], masked, failed, clipped)
        shifted = tuple(x + dot(row[:m], white) for x, row in zip(mean, factor[m:], strict=True))
        return Belief(self._inside(shifted), tuple(row[m:] for row in factor[m:])), update

    def _points(self, belief: Belief) -> tuple[list[Vector], Scalar]:
        above, below = sigma_pairs(belief.mean, belief.spread, self.rule.spread(len(belief.mean)))
        points = [belief.mean, *above, *below]
        if self.bounds is None:
            return points, 0
        inside = [self._inside(point) for point in points]
        moved = [sum((x != y) * 1 for x, y in zip(a, b, strict=True)) > 0 for a, b in zip(points, inside, strict=True)]
        return inside, sum(m * 1 for m in moved)

    def _inside(self, point: Vector) -> Vector:
        if self.bounds is None:
            return point
        return tuple(
            x if lower == -jnp.inf and upper == jnp.inf else jnp.clip(x, lower, upper)
            for x, (lower, upper) in zip(point, self.bounds, strict=True)
        )

    def _rows(self, deviations: Sequence[Vector], steady: Triangle) -> tuple[list[Vector], list[Vector], Vector]:
        """Rows whose sum of row^T row is the weighted covariance of the deviations and, behind them, steady components.

        The rows of the two points of a pair are turned by 45 degrees into their difference and their sum. A component
        is steady if the points still lie where its factor put them: the differences are then the columns of that
        factor and the sums are zero. Rows may end early, in zeros.

        Args:
            deviations: of every sigma point from the mean, the centre first.
            steady: rows of the belief's factor for the steady components.

        Returns:
            Differences, sums (with the centre unless its weight is negative), and the centre if it is.
        """
        n = (len(deviations) - 1) // 2
        _, centre_weight, weight = self.rule.weights(n)
        root, pairs = sqrt(0.5 * weight), list(zip(deviations[1 : n + 1], deviations[n + 1 :], strict=True))
        columns = [tuple(row[j] if j < len(row) else 0.0 for row in steady) for j in range(n)]
        differences = [
            (*(root * (a - b) for a, b in zip(*pair, strict=True)), *column)
            for pair, column in zip(pairs, columns, strict=True)
        ]
        sums = [tuple(root * (a + b) for a, b in zip(*pair, strict=True)) for pair in pairs]
        centre = tuple(times(sqrt(abs(centre_weight)), entry) for entry in deviations[0])
        return (differences, [*sums, centre], ()) if centre_weight >= 0 else (differences, sums, centre)


def _factor(rows: Sequence[Vector], removed: Vector) -> tuple[Triangle, Scalar]:
    """Lower factor of the rows less one that is removed, and whether that failed; short rows end in zeros."""
    factor = triangular_factor(rows)
    return rank_one_downdate(factor, (*removed, *[0.0] * (len(factor) - len(removed)))) if removed else (factor, False)


def _minus(a: Vector, b: Vector) -> Vector:
    return tuple(x - y for x, y in zip(a, b, strict=True))


def _diagonal(entries: Sequence[Scalar]) -> list[Vector]:
    return [(*[0.0] * i, entry) for i, entry in enumerate(entries)]


def _transpose(factor: Triangle) -> list[Vector]:
    return [(*[0.0] * j, *(row[j] for row in factor[j:])) for j in range(len(factor))]
