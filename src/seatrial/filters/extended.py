"""Extended Kalman filter, with exact Jacobians by forward differentiation (Jazwinski 1970, section 8.3).

predict:  x = f(x),  P = F P F^T + Q
update:   S = H P H^T + R,  K = P H^T S^-1,  x = x + K (y - h(x)),  P = P - K S K^T
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import jax

from seatrial.core.state_space import StateSpace
from seatrial.filters.belief import Belief, Update, condition, gate, mask_missing
from seatrial.filters.forms import CovarianceTriangle, Form
from seatrial.numerics.triangular import Scalar, Triangle, Vector, cholesky, dot


@dataclass(frozen=True)
class ExtendedKalmanFilter:
    """EKF; the derivative by a coefficient is its regressor, carried exactly through the integrator."""

    form: ClassVar[Form] = CovarianceTriangle()

    def predict(self, space: StateSpace, belief: Belief, control: Vector, step: Scalar) -> tuple[Belief, Scalar]:
        """See `Filter.predict`."""
        d, n = space.n_dynamic, len(belief.mean)
        moved, jacobian = _linearise(lambda x: space.transition(x, control, step), belief.mean)
        covariance = _symmetric(belief.spread)
        carried = [tuple(dot(gradient, column) for column in covariance) for gradient in jacobian]
        rows = [[dot(carried[i], jacobian[j]) for j in range(i + 1)] for i in range(d)]
        rows += [[carried[j][i] if j < d else covariance[i][j] for j in range(i + 1)] for i in range(d, n)]
        spread = tuple(
            tuple(p + space.process_sd[i] ** 2 if i == j else p for j, p in enumerate(row))
            for i, row in enumerate(rows)
        )
        return Belief((*moved, *belief.mean[d:]), spread), 0

    def update(self, space: StateSpace, belief: Belief, control: Vector, measurement: Vector) -> tuple[Belief, Update]:
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


def _linearise(function: Callable[[Vector], Vector], point: Vector) -> tuple[Vector, list[Vector]]:
    """Return the value and rows of the Jacobian. One derivative per state, the others held, so that no zero is differentiated."""
    columns = []
    value: Vector = ()
    for i, x in enumerate(point):
        value, column = jax.jvp(
            lambda xi, i=i: function((*point[:i], xi, *point[i + 1 :])), (x,), (jax.numpy.ones_like(x),)
        )
        columns.append(column)
    return value, [tuple(column[i] for column in columns) for i in range(len(value))]


def _symmetric(lower: Triangle) -> list[Vector]:
    n = len(lower)
    return [tuple(lower[max(i, j)][min(i, j)] for j in range(n)) for i in range(n)]
