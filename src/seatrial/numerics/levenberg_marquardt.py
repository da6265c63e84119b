"""Levenberg-Marquardt by Optimistix, damped relative to the columns of the Jacobian.

Each step v has the least |J v + r|^2 + |D v|^2 / trust, where D holds the greatest length that each column of J has had on the
way (More, Lecture Notes in Math. 630, 1978) or, as in Optimistix's own, ones. Trust is won and lost as in Optimistix's own.
"""

from collections.abc import Callable
from typing import Any

import equinox
import jax
import jax.numpy as jnp
import optimistix
from jaxtyping import Array, Bool, Float, Int

FIRST_DAMPING = 0.01
"""Square of the damping relative to the columns of J where the search begins."""
REFUSALS = 50
"""Steps refused one after the other that end the search: each is a quarter of the one before."""


def search(
    residual: Callable[[Array, Any], Array],
    data: Any,
    start: Float[Array, " n"],
    by_columns: Bool[Array, ""] | bool,
    tolerance: float,
    max_iterations: int,
) -> tuple[Float[Array, " n"], Int[Array, ""]]:
    """Where the search from one start ends, and how many steps it took.

    Args:
        residual: `residual(x, data)`, of the order of one at the start, as x should be where `by_columns` is false.
        data: pytree of arrays it needs.
        start: x at the beginning, with finite residuals; points without are refused on the way.
        by_columns: whether D is taken from the columns of J.
        tolerance: change of x and of the residuals, relative and absolute, at which to end.
        max_iterations: most steps.
    """
    solver = LevenbergMarquardt(
        tolerance,
        tolerance,
        optimistix.max_norm,
        Damping(jnp.asarray(by_columns)),
        optimistix.ClassicalTrustRegion(),
        lambda **_: None,
    )
    found = optimistix.least_squares(residual, solver, start, data, max_steps=max_iterations, throw=False)
    return found.value, found.stats["num_steps"]


class Linear(equinox.Module):
    """Residuals, their Jacobian and the greatest length of each of its columns so far."""

    residual: Float[Array, " m"]
    jacobian: Float[Array, "m n"]
    reach: Float[Array, " n"]


class Damping(optimistix.AbstractDescent):
    """The damped step, by QR of J with the damping below it."""

    by_columns: Array

    def init(self, y: Any, f_info_struct: Any) -> Linear:
        """Nothing is known."""
        m, n = f_info_struct.residual.shape[0], y.shape[0]
        return Linear(jnp.zeros(m), jnp.zeros((m, n)), jnp.zeros(n))

    def query(self, y: Any, f_info: Any, state: Linear) -> Linear:
        """Take in a new point."""
        jacobian = f_info.jac.as_matrix()
        return Linear(f_info.residual, jacobian, jnp.maximum(state.reach, jnp.linalg.norm(jacobian, axis=0)))

    def step(self, step_size: Any, state: Linear) -> tuple[Array, Any]:
        """Step for a given trust; none where the trust is below rounding, so that the search ends."""
        reach = jnp.where(state.reach > 0, FIRST_DAMPING**0.5 * state.reach, 1.0)
        unit = jnp.where(self.by_columns, reach, 1.0)
        damping = jnp.where(step_size > 1e-16, 1.0 / jnp.sqrt(step_size), 1e150)
        q, upper = jnp.linalg.qr(jnp.concatenate([state.jacobian / unit, damping * jnp.eye(unit.size)]))
        along = q.T @ jnp.concatenate([state.residual, jnp.zeros(unit.size)])
        return -jax.scipy.linalg.solve_triangular(upper, along) / unit, optimistix.RESULTS.successful


class LevenbergMarquardt(optimistix.AbstractGaussNewton):
    """Optimistix's Levenberg-Marquardt with this damping."""

    rtol: float
    atol: float
    norm: Callable
    descent: Damping
    search: optimistix.ClassicalTrustRegion
    verbose: Callable

    def terminate(self, fn: Any, y: Any, args: Any, options: Any, state: Any, tags: Any) -> tuple[Any, Any]:
        """End also where rounding refuses every step."""
        return state.terminate | (state.num_steps_since_acceptance > REFUSALS), state.result
