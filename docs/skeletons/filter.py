"""Skeleton of a filter: copy to `src/seatrial/filters/`, name it, and add it to `FILTERS` of tests/filters/test_linear.py.

This one is an extended Kalman filter on arrays, by forward derivatives. State here the recursion and its source:

predict:  x = f(x),  P = F P F^T + Q
update:   S = H P H^T + R,  K = P H^T S^-1,  x = x + K (y - h(x)),  P = P - K S K^T
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import jax
import jax.numpy as jnp

from seatrial.filters.belief import FilterState, Update, condition, mask_missing, process_covariance
from seatrial.filters.forms import CovarianceTriangle, StateForm
from seatrial.numerics.state_space import StateSpace
from seatrial.numerics.triangular import Scalar, Vector, cholesky, to_triangle


@dataclass(frozen=True)
class SkeletonFilter:
    """Its fields are its settings: plain numbers, so that it can be hashed and shares compiled code."""

    form: ClassVar[StateForm] = CovarianceTriangle()
    """How the belief is held: covariance or Cholesky factor, scalars or arrays."""

    def predict(
        self, space: StateSpace, belief: FilterState, control: Vector, step: Scalar
    ) -> tuple[FilterState, Scalar]:
        """See `Filter.predict`; states from `n_dynamic` on are constants, which `transition` does not return."""
        mean = jnp.stack(belief.mean)

        def move(state: Any) -> Any:
            moved = space.transition(tuple(state), control, step)
            return jnp.concatenate([jnp.stack(moved), state[space.n_dynamic :]])

        slope = jax.jacfwd(move)(mean)
        noise = process_covariance(space, belief.mean, control, step)
        return FilterState(tuple(move(mean)), to_triangle(slope @ _full(belief) @ slope.T + noise)), 0

    def update(
        self, space: StateSpace, belief: FilterState, control: Vector, measurement: Vector
    ) -> tuple[FilterState, Update]:
        """See `Filter.update`; a channel that was not measured has weight 0 and drops out exactly."""
        mean = jnp.stack(belief.mean)

        def see(state: Any) -> Any:
            return jnp.stack(space.observe(tuple(state), control))

        masked = mask_missing(space, measurement, tuple(see(mean)))
        slope = jax.jacfwd(see)(mean) * jnp.stack(masked.weight)[:, None]
        cross = _full(belief) @ slope.T
        spread = slope @ cross + jnp.diag(jnp.stack(masked.noise_sd) ** 2)
        return condition(belief, cholesky(to_triangle(spread)), [tuple(row) for row in cross], masked)


def _full(belief: FilterState) -> Any:
    lower = jnp.stack([jnp.stack([*row, *[jnp.zeros(())] * (len(belief.spread) - len(row))]) for row in belief.spread])
    return lower + jnp.tril(lower, -1).T
