"""Nonlinear least squares: the x with the least sum of squares |r(x)|^2, and s^2 (J^T J)^-1 about it, s^2 = |r|^2 / (m - n).

Levenberg-Marquardt by Optimistix from several starts (Marquardt, SIAM J. Appl. Math. 11, 1963; More, Lecture Notes in Math. 630,
1978), then Gauss-Newton steps by the singular values of J, which reach the digits that a comparison of sums of squares cannot see.
Derivatives are exact and forward.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import equinox
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
from jaxtyping import Array, Bool, Float, Int

from seatrial.core.errors import InputError, NumericalError

# Levenberg-Marquardt by Optimistix, damped relative to the columns of the Jacobian.
#
# Each step v has the least |J v + r|^2 + |D v|^2 / trust, where D holds the greatest length that each column of J has
# had on the way (More, Lecture Notes in Math. 630, 1978) or, as in Optimistix's own, ones. Trust is won and lost as in
# Optimistix's own.

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


Residual = Callable[[Array, Any], Array]
"""`residual(x, data)`, shape (m,); hashable, since code is compiled once for each function and shape of the data."""

TOLERANCE = 1e-8
"""Relative change of variables and residuals at which Levenberg-Marquardt stops and polishing begins."""
SINGULAR = 1e-11
"""Ratio of singular values of the Jacobian, its columns scaled to one, below which a direction is rounding error."""
POLISHING = 20
"""Most steps of polishing."""
NEGLIGIBLE = 1e-4
"""A step of this part of a standard error changes no conclusion."""


class LeastSquares(NamedTuple):
    """Where the sum of squares is least.

    Attributes:
        x: variables, shape (n,).
        rss: residual sum of squares.
        cov: covariance of x for independent errors of one unknown variance, shape (n, n).
        se: standard errors, shape (n,).
        sd: residual standard deviation, m - n degrees of freedom.
        iterations: steps of the search that won, polishing included.
        converged: whether the Gauss-Newton step still to go is negligible beside the standard errors or the rounding of x.
        status: the same in words.
    """

    x: Float[np.ndarray, " n"]
    rss: float
    cov: Float[np.ndarray, "n n"]
    se: Float[np.ndarray, " n"]
    sd: float
    iterations: int
    converged: bool
    status: str


def least_squares(
    residual: Residual,
    data: Any,
    starts: Float[np.ndarray, "*k n"],
    names: Sequence[str] | None = None,
    max_iterations: int = 2000,
) -> LeastSquares:
    """Follow every start twice and keep the least sum of squares.

    The two searches damp differently: relative to the columns of the Jacobian, which does not depend on the units of x, and
    relative to the start, which holds back a variable without effect where it begins. Each fails where the other does not.

    Args:
        residual: `residual(x, data)`, with more components than x.
        data: pytree of arrays it needs.
        starts: one start, shape (n,), or several, shape (k, n).
        names: names of the variables, for messages; x1, x2, ... if left out.
        max_iterations: most steps of one search.

    Raises:
        InputError: starts of another shape, or no more residuals than variables.
        NumericalError: no start has finite residuals, or the residuals do not determine every variable.
    """
    points = np.atleast_2d(np.asarray(starts, float))
    labels = tuple(names) if names is not None else tuple(f"x{i + 1}" for i in range(points.shape[-1]))
    _check_starts(points, labels)
    begun = [(point, *_linearise(residual, point, data)) for point in points]
    _check_number(begun[0][1].size, labels)
    begun = [start for start in begun if all(np.isfinite(values).all() for values in start)]
    if not begun:
        raise NumericalError(
            f"none of {len(points)} starts of the least-squares fit has finite residuals and derivatives, "
            f"the first being {_spell(labels, points[0])}; begin elsewhere, or check units"
        )
    searches = [
        _search(residual, data, point, *_units(point, r, jacobian), by_columns, max_iterations)
        for point, r, jacobian in begun
        for by_columns in (True, False)
    ]
    x, _, steps = min(searches, key=lambda search: float(search[1]))
    return _polish(residual, data, np.asarray(x), int(steps), labels)


def _polish(residual: Residual, data: Any, x: np.ndarray, iterations: int, labels: tuple[str, ...]) -> LeastSquares:
    """Gauss-Newton steps while what the Jacobian can still explain of the residuals shrinks, and the answer there."""
    at = _solve(*_linearise(residual, x, data), labels)
    for _ in range(POLISHING):
        try:
            ahead = _solve(*_linearise(residual, x + at.step, data), labels)
        except NumericalError:  # The step left the region where the residuals say anything.
            break
        if ahead.explained >= 0.9 * at.explained or ahead.rss > 1.01 * at.rss:
            break
        x, at, iterations = x + at.step, ahead, iterations + 1
    sd = float(np.sqrt(at.rss / at.freedom))
    cov = sd**2 * at.root @ at.root.T
    se = np.sqrt(np.diag(cov))
    left = np.abs(at.step) / (se + NEGLIGIBLE * np.abs(x) + np.finfo(float).tiny)
    worst = int(left.argmax())
    converged = bool(left[worst] <= NEGLIGIBLE)
    status = (
        f"converged in {iterations} steps"
        if converged
        else f"not converged after {iterations} steps: {labels[worst]} = {x[worst]:.6g} would still move by {at.step[worst]:.2g}, "
        f"its standard error being {se[worst]:.2g}; begin nearer, or allow more iterations"
    )
    return LeastSquares(x, at.rss, cov, se, sd, iterations, converged, status)


class _Linear(NamedTuple):
    """Linear least squares about one point.

    Attributes:
        rss: residual sum of squares.
        freedom: residuals less variables.
        step: Gauss-Newton step, shape (n,).
        explained: length of the part of the residuals that the step removes.
        root: B with B B^T = (J^T J)^-1, shape (n, n).
    """

    rss: float
    freedom: int
    step: np.ndarray
    explained: float
    root: np.ndarray


def _solve(r: np.ndarray, jacobian: np.ndarray, labels: tuple[str, ...]) -> _Linear:
    """Linear least squares by the singular values of J, its columns scaled to one so that units do not matter."""
    if not (np.isfinite(r).all() and np.isfinite(jacobian).all()):
        raise NumericalError(
            "the residuals or their derivatives are not finite where the search ended; begin elsewhere"
        )
    reach = np.linalg.norm(jacobian, axis=0)
    if (reach == 0).any():
        idle = ", ".join(name for name, column in zip(labels, reach, strict=True) if column == 0)
        raise NumericalError(
            f"the residuals do not depend on {idle} at all where the search ended; fix it or leave it out"
        )
    left, values, right = np.linalg.svd(jacobian / reach, full_matrices=False)
    if values[-1] <= SINGULAR * values[0]:
        raise NumericalError(_undetermined(right[-1], reach, labels))
    root = right.T / values / reach[:, None]
    along = left.T @ r
    return _Linear(float(r @ r), r.size - reach.size, -root @ along, float(np.linalg.norm(along)), root)


def _undetermined(direction: np.ndarray, reach: np.ndarray, labels: tuple[str, ...]) -> str:
    """What changes together without effect, in the units of the variables, one unit of the most important first."""
    main = np.flatnonzero(np.abs(direction) > 1e-3 * np.abs(direction).max())
    main = main[np.argsort(-np.abs(direction[main]), kind="stable")]
    change = (direction / reach)[main] / (direction / reach)[main[0]]
    moved = ", ".join(f"{labels[i]} by {value:+.4g}" for i, value in zip(main, change, strict=True))
    return (
        f"the residuals do not tell {' and '.join(labels[i] for i in main)} apart: changing {moved} leaves every residual as it is. "
        "Fix one of them, or add data in which they differ"
    )


def _units(point: np.ndarray, r: np.ndarray, jacobian: np.ndarray) -> tuple[np.ndarray, float]:
    """Scale of the variables, their start or what would change r by its own length, and of the residuals."""
    size, reach = float(np.linalg.norm(r)) or 1.0, np.linalg.norm(jacobian, axis=0)
    return np.where(point != 0, np.abs(point), size / np.where(reach > 0, reach, size)), size


@partial(jax.jit, static_argnames=("residual", "max_iterations"))
def _search(
    residual: Residual, data: Any, start: Array, scale: Array, size: Any, by_columns: Any, max_iterations: int
) -> tuple[Array, Array, Array]:
    """Levenberg-Marquardt from one start: where it ends, the sum of squares there, and steps taken."""

    def scaled(u: Array, data: Any) -> Array:
        return residual(u * scale, data) / size

    u, steps = search(scaled, data, start / scale, by_columns, TOLERANCE, max_iterations)
    return u * scale, jnp.sum(residual(u * scale, data) ** 2), steps


@partial(jax.jit, static_argnames="residual")
def _expand(residual: Residual, x: Array, data: Any) -> tuple[Array, Array]:
    def twice(x: Array) -> tuple[Array, Array]:
        r = residual(x, data)
        return r, r

    jacobian, r = jax.jacfwd(twice, has_aux=True)(x)
    return r, jacobian


def _linearise(residual: Residual, x: np.ndarray, data: Any) -> tuple[np.ndarray, np.ndarray]:
    """Residuals, shape (m,), and their Jacobian, shape (m, n)."""
    r, jacobian = _expand(residual, jnp.asarray(x), data)
    return np.asarray(r), np.asarray(jacobian)


def _check_starts(points: np.ndarray, labels: tuple[str, ...]) -> None:
    if points.ndim != 2 or points.size == 0 or points.shape[1] != len(labels) or not np.isfinite(points).all():
        raise InputError(
            "starts of a least-squares fit",
            found=f"an array of shape {points.shape} for the variables {', '.join(labels)}",
            expected="finite numbers, a row for each start and a column for each variable",
            remedy="give each start as many numbers as there are variables",
        )


def _check_number(m: int, labels: tuple[str, ...]) -> None:
    if m <= len(labels):
        raise InputError(
            "least-squares fit",
            found=f"{m} residuals for {len(labels)} variables: {', '.join(labels)}",
            expected="more residuals than variables; the surplus tells how large the errors are",
            remedy="use more data, or fix some of the variables",
        )


def _spell(labels: tuple[str, ...], x: np.ndarray) -> str:
    return ", ".join(f"{name} = {value:.4g}" for name, value in zip(labels, x, strict=True))
