"""Square-root unscented Kalman filter on arrays, for states too many for scalars: compiled in seconds at any size.

    predict:  x = sum w f(point),  S S^T = sum w (f(point) - x)(f(point) - x)^T + Q
    update:   [[S_y, 0], [B, S]] [...]^T = sum w (h - y, point - x)(h - y, point - x)^T + diag(R, 0)
              x = x + B S_y^-1 (measured - y)

The same equations as `square_root`, but a factor comes from the Cholesky decomposition of the sum of squares: half the digits of a
triangularisation, and an eighth of its time at 15 states. A negative centre weight may leave no factor; the update is then flagged.
"""

from dataclasses import dataclass
from typing import ClassVar

import jax.numpy as jnp
from jax.scipy.linalg import solve_triangular
from jaxtyping import Array, Float

from seatrial.core.state_space import StateSpace
from seatrial.filters.belief import LOG_2PI, Belief, Filter, Update, mask_missing
from seatrial.filters.forms import FactorArray, Form
from seatrial.filters.square_root import SquareRootUnscentedKalmanFilter
from seatrial.numerics.sigma_points import UnscentedRule
from seatrial.numerics.triangular import Scalar, Vector

MOST_UNROLLED = 6
"""States up to which scalars are faster to run and not slow to compile."""


def unscented_filter(n_states: int) -> Filter:
    """The square-root unscented filter for so many states, in the form that suits them."""
    return SquareRootUnscentedKalmanFilter() if n_states <= MOST_UNROLLED else LargeUnscentedKalmanFilter()


@dataclass(frozen=True)
class LargeUnscentedKalmanFilter:
    """SR-UKF on arrays.

    Attributes:
        rule: unscented rule.
    """

    form: ClassVar[Form] = FactorArray()
    rule: UnscentedRule = UnscentedRule()

    def predict(self, space: StateSpace, belief: Belief, control: Vector, step: Scalar) -> tuple[Belief, Scalar]:
        """See `Filter.predict`."""
        points = self._points(belief)
        moved = space.transition(tuple(points.T), control, step)
        images = jnp.concatenate([_columns(moved, len(points)), points[:, len(moved) :]], axis=1)
        mean, away = self._about_mean(images)
        return Belief(mean, jnp.linalg.cholesky(self._squares(away) + jnp.diag(space.process_sd**2))), 0

    def update(self, space: StateSpace, belief: Belief, control: Vector, measurement: Vector) -> tuple[Belief, Update]:
        """See `Filter.update`."""
        m, points = len(measurement), self._points(belief)
        predicted, away = self._about_mean(_columns(space.observe(tuple(points.T), control), len(points)))
        masked = mask_missing(space, measurement, tuple(predicted))
        joint = jnp.concatenate([away * jnp.stack(masked.weight), points - belief.mean], axis=1)
        noise = jnp.concatenate([jnp.stack(masked.noise_sd), jnp.zeros(belief.mean.size)])
        factor = jnp.linalg.cholesky(self._squares(joint) + jnp.diag(noise**2))
        white = solve_triangular(factor[:m, :m], jnp.stack(masked.innovation), lower=True)
        nis, n_measured = white @ white, sum(masked.weight)
        log_likelihood = -0.5 * (nis + n_measured * LOG_2PI) - jnp.log(jnp.diag(factor)[:m]).sum()
        report = Update(log_likelihood, nis, n_measured, masked.reported, ~jnp.isfinite(log_likelihood), 0)
        return Belief(belief.mean + factor[m:, :m] @ white, factor[m:, m:]), report

    def _points(self, belief: Belief) -> Float[Array, "p n"]:
        away = self.rule.spread(belief.mean.size) * belief.spread.T
        return belief.mean + jnp.concatenate([jnp.zeros_like(away[:1]), away, -away])

    def _about_mean(self, values: Float[Array, "p k"]) -> tuple[Float[Array, " k"], Float[Array, "p k"]]:
        """Weighted mean, taken about the centre so that large weights do not cancel, and deviations from it."""
        *_, other = self.rule.weights(len(values) // 2)
        mean = values[0] + other * (values[1:] - values[0]).sum(0)
        return mean, values - mean

    def _squares(self, away: Float[Array, "p k"]) -> Float[Array, "k k"]:
        _, centre, other = self.rule.weights(len(away) // 2)
        return other * away[1:].T @ away[1:] + centre * jnp.outer(away[0], away[0])


def _columns(values: Vector, points: int) -> Float[Array, "p k"]:
    """Values at the points side by side; what does not depend on the point is the same at all."""
    return jnp.stack([jnp.broadcast_to(value, (points,)) for value in values], axis=1)
