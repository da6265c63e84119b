"""Square-root unscented Kalman filter, plain and constrained (van der Merwe and Wan 2001; Kandepu, Foss and Imsland 2008).

    predict:  S = triangularise [ sqrt(w) (f(point) - x), sqrt(Q) ]
    update:   [[S_y, 0], [B, S]] = triangularise [[ sqrt(w) (h - y), sqrt(R) ], [ sqrt(w) (point - x), 0 ]]
              x = x + B S_y^-1 (measured - y)

One triangularisation of the joint deviations replaces the published filter's downdates by the columns of K S_y: it is
the same covariance in exact arithmetic, and stays positive where points were clipped. Only a negative centre weight
(alpha well below 1) still needs a downdate; where that fails the update is flagged.

For states too many for scalars the same equations run on arrays, compiled in seconds at any size. A factor then comes from the
Cholesky decomposition of the sum of squares: half the digits of a triangularisation, and an eighth of its time at 15 states. A
negative centre weight may leave no factor; the update is flagged then, too.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import ClassVar

import jax.numpy as jnp
from jax.scipy.linalg import solve_triangular
from jaxtyping import Array, Float

from seatrial.filters.belief import (
    LOG_2PI,
    Filter,
    FilterState,
    Update,
    gate,
    mask_missing,
    process_columns,
    process_covariance,
    whiten,
)
from seatrial.filters.forms import FactorArray, FactorTriangle, StateForm
from seatrial.filters.unscented import at_points, weighted_mean
from seatrial.numerics.sigma_points import UnscentedRule, sigma_pairs
from seatrial.numerics.state_space import StateSpace
from seatrial.numerics.triangular import (
    Scalar,
    Triangle,
    Vector,
    cholesky_of_array,
    dot,
    is_zero,
    rank_one_downdate,
    times,
    triangular_factor,
)

Bounds = tuple[tuple[float, float], ...]
MAX_UNROLLED_STATES = 6  # States up to which scalars are faster to run and not slow to compile


@dataclass(frozen=True)
class SquareRootUnscentedKalmanFilter:
    """SR-UKF; with `bounds`, sigma points outside are moved back to the boundary before they are used.

    Attributes:
        rule: unscented rule.
        bounds: (lower, upper) of every state, infinite if free; None for the unconstrained filter.
    """

    form: ClassVar[StateForm] = FactorTriangle()
    rule: UnscentedRule = UnscentedRule()
    bounds: Bounds | None = None

    def predict(
        self, space: StateSpace, belief: FilterState, control: Vector, step: Scalar
    ) -> tuple[FilterState, Scalar]:
        """See `Filter.predict`."""
        d, n = space.n_dynamic, len(belief.mean)
        points, clipped = self._points(belief)
        images = at_points(lambda point: space.transition(point, control, step), points)
        if self.bounds:
            images = [(*image, *point[d:]) for image, point in zip(images, points, strict=True)]
        moved = weighted_mean(self.rule, n, images)
        steady = belief.spread[len(moved) :]
        pairs, others, centre = self._rows([_minus(image, moved) for image in images], steady)
        spread, failed = _factor([*pairs, *others, *process_columns(space, belief.mean, control, step)], centre)
        if not is_zero(failed):
            spread = tuple(tuple(jnp.where(failed, jnp.nan, entry) for entry in row) for row in spread)
        return FilterState((*moved, *belief.mean[len(moved) :]), spread), clipped

    def update(
        self, space: StateSpace, belief: FilterState, control: Vector, measurement: Vector
    ) -> tuple[FilterState, Update]:
        """See `Filter.update`."""
        m, n = len(measurement), len(belief.mean)
        points, clipped = self._points(belief)
        outputs = at_points(lambda point: space.observe(point, control), points)
        predicted = weighted_mean(self.rule, n, outputs)
        masked = mask_missing(space, measurement, predicted)
        residuals = [tuple(map(gate, masked.weight, _minus(output, predicted))) for output in outputs]
        noise = [(*[0.0] * i, entry) for i, entry in enumerate(masked.noise_sd)]
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
        return FilterState(self._inside(shifted), tuple(row[m:] for row in factor[m:])), update

    def _points(self, belief: FilterState) -> tuple[list[Vector], Scalar]:
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
        """Return the rows whose sum of row^T row is the weighted covariance of the deviations and, behind them, steady components.

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


@dataclass(frozen=True)
class LargeUnscentedKalmanFilter:
    """SR-UKF on arrays.

    Attributes:
        rule: unscented rule.
    """

    form: ClassVar[StateForm] = FactorArray()
    rule: UnscentedRule = UnscentedRule()

    def predict(
        self, space: StateSpace, belief: FilterState, control: Vector, step: Scalar
    ) -> tuple[FilterState, Scalar]:
        """See `Filter.predict`."""
        points = self._points(belief)
        moved = space.transition(tuple(points.T), control, step)
        images = jnp.concatenate([_columns(moved, len(points)), points[:, len(moved) :]], axis=1)
        mean, away = self._about_mean(images)
        spread = self._squares(away) + process_covariance(space, belief.mean, control, step)
        return FilterState(mean, cholesky_of_array(spread)), 0

    def update(
        self, space: StateSpace, belief: FilterState, control: Vector, measurement: Vector
    ) -> tuple[FilterState, Update]:
        """See `Filter.update`."""
        m, points = len(measurement), self._points(belief)
        predicted, away = self._about_mean(_columns(space.observe(tuple(points.T), control), len(points)))
        masked = mask_missing(space, measurement, tuple(predicted))
        joint = jnp.concatenate([away * jnp.stack(masked.weight), points - belief.mean], axis=1)
        noise = jnp.concatenate([jnp.stack(masked.noise_sd), jnp.zeros(belief.mean.size)])
        factor = cholesky_of_array(self._squares(joint) + jnp.diag(noise**2))
        white = solve_triangular(factor[:m, :m], jnp.stack(masked.innovation), lower=True)
        nis, n_measured = white @ white, sum(masked.weight)
        log_likelihood = -0.5 * (nis + n_measured * LOG_2PI) - jnp.log(jnp.diag(factor)[:m]).sum()
        failed, sizes = ~jnp.isfinite(log_likelihood), jnp.diag(factor)[:m]
        residual, variance = tuple(white * sizes), tuple(sizes**2)
        report = Update(log_likelihood, nis, n_measured, masked.reported, failed, 0, residual, variance)
        return FilterState(belief.mean + factor[m:, :m] @ white, factor[m:, m:]), report

    def _points(self, belief: FilterState) -> Float[Array, "p n"]:
        away = self.rule.spread(belief.mean.size) * belief.spread.T
        return belief.mean + jnp.concatenate([jnp.zeros_like(away[:1]), away, -away])

    def _about_mean(self, values: Float[Array, "p k"]) -> tuple[Float[Array, " k"], Float[Array, "p k"]]:
        """Return the weighted mean, taken about the centre so that large weights do not cancel, and deviations from it."""
        *_, other = self.rule.weights(len(values) // 2)
        mean = values[0] + other * (values[1:] - values[0]).sum(0)
        return mean, values - mean

    def _squares(self, away: Float[Array, "p k"]) -> Float[Array, "k k"]:
        _, centre, other = self.rule.weights(len(away) // 2)
        return other * away[1:].T @ away[1:] + centre * jnp.outer(away[0], away[0])


def unscented_filter(n_states: int) -> Filter:
    """Return the square-root unscented filter for so many states, in the form that suits them."""
    return SquareRootUnscentedKalmanFilter() if n_states <= MAX_UNROLLED_STATES else LargeUnscentedKalmanFilter()


def _factor(rows: Sequence[Vector], removed: Vector) -> tuple[Triangle, Scalar]:
    """Return the lower factor of the rows less one that is removed, and whether that failed; short rows end in zeros."""
    factor = triangular_factor(rows)
    return rank_one_downdate(factor, (*removed, *[0.0] * (len(factor) - len(removed)))) if removed else (factor, False)


def _minus(a: Vector, b: Vector) -> Vector:
    return tuple(x - y for x, y in zip(a, b, strict=True))


def _transpose(factor: Triangle) -> list[Vector]:
    return [(*[0.0] * j, *(row[j] for row in factor[j:])) for j in range(len(factor))]


def _columns(values: Vector, points: int) -> Float[Array, "p k"]:
    """Return the values at the points side by side; what does not depend on the point is the same at all."""
    return jnp.stack([jnp.broadcast_to(value, (points,)) for value in values], axis=1)
