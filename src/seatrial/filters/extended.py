"""Extended Kalman filter, with exact Jacobians by forward differentiation (Jazwinski 1970, section 8.3).

predict:  x = f(x),  P = F P F^T + Q
update:   S = H P H^T + R,  K = P H^T S^-1,  x = x + K (y - h(x)),  P = P - K S K^T

For states too many for scalars the same equations run on arrays, compiled in seconds at any size. Channels, whose noises are
independent, are then taken in one after the other (Maybeck 1979, section 7.4), so that S is a number and needs no factor.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from seatrial.filters.belief import (
    LOG_2PI,
    Filter,
    FilterState,
    Update,
    condition,
    gate,
    mask_missing,
    process_columns,
    process_covariance,
)
from seatrial.filters.forms import CovarianceArray, CovarianceTriangle, StateForm
from seatrial.numerics.state_space import StateSpace
from seatrial.numerics.triangular import Scalar, Triangle, Vector, cholesky, dot, plus

MAX_UNROLLED_STATES = 4  # States up to which scalars are faster to run and not slow to compile


@dataclass(frozen=True)
class ExtendedKalmanFilter:
    """EKF; the derivative by a coefficient is its regressor, carried exactly through the integrator."""

    form: ClassVar[StateForm] = CovarianceTriangle()

    def predict(
        self, space: StateSpace, belief: FilterState, control: Vector, step: Scalar
    ) -> tuple[FilterState, Scalar]:
        """See `Filter.predict`."""
        d, n = space.n_dynamic, len(belief.mean)
        moved, jacobian = _linearise(lambda x: space.transition(x, control, step), belief.mean)
        covariance = _symmetric(belief.spread)
        carried = [tuple(dot(gradient, column) for column in covariance) for gradient in jacobian]
        rows = [[dot(carried[i], jacobian[j]) for j in range(i + 1)] for i in range(d)]
        rows += [[carried[j][i] if j < d else covariance[i][j] for j in range(i + 1)] for i in range(d, n)]
        noise = list(zip(*process_columns(space, belief.mean, control, step), strict=True))
        spread = tuple(tuple(plus(p, dot(noise[i], noise[j])) for j, p in enumerate(row)) for i, row in enumerate(rows))
        return FilterState((*moved, *belief.mean[d:]), spread), 0

    def update(
        self, space: StateSpace, belief: FilterState, control: Vector, measurement: Vector
    ) -> tuple[FilterState, Update]:
        """See `Filter.update`."""
        predicted, jacobian = _linearise(lambda x: space.observe(x, control), belief.mean)
        masked = mask_missing(space, measurement, predicted)
        covariance = _symmetric(belief.spread)
        jacobian = [
            tuple(gate(w, entry) for entry in gradient) for w, gradient in zip(masked.weight, jacobian, strict=True)
        ]
        cross = [tuple(dot(row, gradient) for gradient in jacobian) for row in covariance]
        innovation_cov = [
            [
                dot(gradient, [row[j] for row in cross]) + (masked.noise_sd[i] ** 2 if i == j else 0.0)
                for j in range(i + 1)
            ]
            for i, gradient in enumerate(jacobian)
        ]
        return condition(belief, cholesky(innovation_cov), cross, masked)


@dataclass(frozen=True)
class LargeExtendedKalmanFilter:
    """EKF on arrays."""

    form: ClassVar[StateForm] = CovarianceArray()

    def predict(
        self, space: StateSpace, belief: FilterState, control: Vector, step: Scalar
    ) -> tuple[FilterState, Scalar]:
        """See `Filter.predict`."""
        moved, slope = _slopes(lambda x: (*space.transition(x, control, step), *x[space.n_dynamic :]), belief.mean)
        noise = process_covariance(space, tuple(belief.mean), control, step)
        return FilterState(moved, slope @ belief.spread @ slope.T + noise), 0

    def update(
        self, space: StateSpace, belief: FilterState, control: Vector, measurement: Vector
    ) -> tuple[FilterState, Update]:
        """See `Filter.update`."""
        predicted, slopes = _slopes(lambda x: space.observe(x, control), belief.mean)
        masked = mask_missing(space, measurement, tuple(predicted))
        gained, spread = jnp.zeros_like(belief.mean), belief.spread
        residuals, variances = [], []
        for i, (weight, noise_sd) in enumerate(zip(masked.weight, masked.noise_sd, strict=True)):
            slope = weight * slopes[i]
            cross = spread @ slope
            variance = slope @ cross + noise_sd**2
            left = masked.innovation[i] - slope @ gained
            gained = gained + cross * (left / variance)
            spread = spread - jnp.outer(cross, cross) / variance
            residuals, variances = [*residuals, left], [*variances, variance]
        left, size, n_measured = jnp.stack(residuals), jnp.stack(variances), sum(masked.weight)
        nis = (left * left / size).sum()
        log_likelihood = -0.5 * (nis + n_measured * LOG_2PI + jnp.log(size).sum())
        failed = ~jnp.isfinite(log_likelihood)
        report = Update(log_likelihood, nis, n_measured, masked.reported, failed, 0, tuple(residuals), tuple(variances))
        return FilterState(belief.mean + gained, spread), report


def extended_filter(n_states: int) -> Filter:
    """Return the extended Kalman filter for so many states, in the form that suits them."""
    return ExtendedKalmanFilter() if n_states <= MAX_UNROLLED_STATES else LargeExtendedKalmanFilter()


def _slopes(
    function: Callable[[Vector], Vector], point: Float[Array, " n"]
) -> tuple[Float[Array, " m"], Float[Array, "m n"]]:
    """Return the value and the Jacobian; the derivatives by all states side by side, of which the model is compiled once."""

    def stacked(x: Array) -> Array:
        return jnp.stack([jnp.asarray(y, float) for y in function(tuple(x))])

    return jax.vmap(lambda along: jax.jvp(stacked, (point,), (along,)), out_axes=(None, 1))(jnp.eye(point.size))


def _linearise(function: Callable[[Vector], Vector], point: Vector) -> tuple[Vector, list[Vector]]:
    """Return the value and rows of the Jacobian. One derivative per state, the others held, so that no zero is differentiated."""
    columns = []
    value: Vector = ()
    for i, x in enumerate(point):
        value, column = jax.jvp(lambda xi, i=i: function((*point[:i], xi, *point[i + 1 :])), (x,), (jnp.ones_like(x),))
        columns.append(column)
    return value, [tuple(column[i] for column in columns) for i in range(len(value))]


def _symmetric(lower: Triangle) -> list[Vector]:
    n = len(lower)
    return [tuple(lower[max(i, j)][min(i, j)] for j in range(n)) for i in range(n)]
