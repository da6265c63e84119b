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

import jax.numpy as jnp

from seatrial.core.state_space import StateSpace
from seatrial.filters.belief import Belief, Update, gate, mask_missing, whiten
from seatrial.filters.unscented import weighted_mean
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

    rule: UnscentedRule = UnscentedRule()
    bounds: Bounds | None = None
    square_root: bool = True

    def predict(self, space: StateSpace, belief: Belief, control: Vector, step: Scalar) -> tuple[Belief, Scalar]:
        """See `Filter.predict`."""
        d, n = space.n_dynamic, len(belief.mean)
        points, clipped = self._points(belief)
        images = [(*space.transition(point, control, step), *point[d:]) for point in points]
        mean = (
            weighted_mean(self.rule, n, images)
            if self.bounds
            else (*weighted_mean(self.rule, n, [image[:d] for image in images]), *belief.mean[d:])
        )
        noise = [[space.process_sd[i] if i == j else 0.0 for j in range(n)] for i in range(n)]
        spread, failed = self._factor(images, mean, noise, steady=slice(d, n))
        poisoned = (
            tuple(tuple(jnp.where(failed, jnp.nan, entry) for entry in row) for row in spread)
            if not is_zero(failed)
            else spread
        )
        return Belief(mean, poisoned), clipped

    def update(self, space: StateSpace, belief: Belief, control: Vector, measurement: Vector) -> tuple[Belief, Update]:
        """See `Filter.update`."""
        m, n = len(measurement), len(belief.mean)
        points, clipped = self._points(belief)
        outputs = [space.observe(point, control) for point in points]
        predicted = weighted_mean(self.rule, n, outputs)
        masked = mask_missing(space, measurement, predicted)
        gated = [
            tuple(gate(w, y - p) for w, y, p in zip(masked.weight, output, predicted, strict=True))
            for output in outputs
        ]
        mean = weighted_mean(self.rule, n, points) if self.bounds else belief.mean
        joint = [(*residual, *point) for residual, point in zip(gated, points, strict=True)]
        noise = [[masked.noise_sd[i] if i == j else 0.0 for j in range(m + n)] for i in range(m)]
        factor, failed = self._factor(joint, (*[0.0] * m, *mean), noise, steady=slice(m, m + n))
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

    def _factor(
        self, points: Sequence[Vector], mean: Vector, noise: list[list[Scalar]], steady: slice
    ) -> tuple[Triangle, Scalar]:
        """Lower factor of the weighted deviations and the noise; `steady` components are still symmetric about the mean.

        Unclipped, the two points of a pair lie symmetrically about the mean in their steady components. Turning each
        pair by 45 degrees leaves its sum with zeros there and its difference with the old factor: half the work.
        """
        n = (len(points) - 1) // 2
        _, centre_weight, weight = self.rule.weights(n)
        symmetric = self.bounds is None
        indices = range(len(mean))
        still = set(indices[steady]) if symmetric else set()
        centre = [0.0 if i in still else points[0][i] - mean[i] for i in indices]
        rows: list[list[Scalar]] = []
        for above, below in zip(points[1 : n + 1], points[n + 1 :], strict=True):
            if symmetric:
                root = sqrt(0.5 * weight)
                rows.append([times(root, _difference(above[i], below[i])) for i in indices])
                rows.append(
                    [0.0 if i in still else root * ((above[i] - mean[i]) + (below[i] - mean[i])) for i in indices]
                )
            else:
                root = sqrt(weight)
                rows += [[root * (point[i] - mean[i]) for i in indices] for point in (above, below)]
        root = sqrt(abs(centre_weight))
        centre = [times(root, entry) for entry in centre]
        if centre_weight > 0:
            rows.append(centre)
        factor = triangular_factor(rows + noise)
        if centre_weight >= 0:
            return factor, False
        return rank_one_downdate(factor, centre)


def _difference(a: Scalar, b: Scalar) -> Scalar:
    """A - b, a structural zero where both are the same object: a component no sigma point of the pair moves."""
    return 0.0 if a is b else a - b
