"""Accelerations from forces, M nudot = tau, with everything exploited that is known before compilation.

Axes that no entry couples are solved apart. A constant matrix is inverted once; one with estimated entries is eliminated on scalars,
without pivoting: a mass matrix is positive definite.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Float

from seatrial.core.coefficients import CoefficientName
from seatrial.numerics.rotations import dot, times, total
from seatrial.vehicles.hull import added_mass_entry

Solve = Callable[[Mapping[str, Any], Sequence[Any]], list[Any]]


def mass_solver(constant: Float[np.ndarray, "6 6"], free: Sequence[CoefficientName], moving: Sequence[int]) -> Solve:
    """Return `solve(values, forces)`: accelerations of the moving axes for the forces on all six.

    Args:
        constant: rigid body and fixed added mass.
        free: added masses among the values.
        moving: indices of the axes that move; the others stay at rest.
    """
    named: dict[tuple[int, int], list[str]] = {}
    for name in free:
        named.setdefault(added_mass_entry(name), []).append(name.text)
    groups = _coupled_groups(lambda i, j: constant[i, j] != 0 or (i, j) in named, moving)
    inverses = {
        group: np.linalg.inv(constant[np.ix_(group, group)])
        for group in groups
        if len(group) > 1 and not any((i, j) in named for i in group for j in group)
    }

    def solve(values: Mapping[str, Any], forces: Sequence[Any]) -> list[Any]:
        found: dict[int, Any] = {}
        for group in groups:
            right = [forces[i] if len(group) == 1 else _computed_once(forces[i]) for i in group]
            if group in inverses:
                rates = [dot((float(entry) for entry in row), right) for row in inverses[group]]
            else:
                rows = [[_entry(float(constant[i, j]), named.get((i, j), ()), values) for j in group] for i in group]
                rates = _eliminate(rows, right)
            found.update(zip(group, rates, strict=True))
        return [found[i] for i in moving]

    return solve


def _computed_once(force: Any) -> Any:
    """The same number, which the compiler keeps although several accelerations need it.

    Cheap expressions are computed anew wherever they are used, a quotient never is (decision 2); that this divisor is 1 it cannot know.
    Batched steps of six degrees of freedom take half the time.
    """
    if not isinstance(force, Tracer):
        return force
    return force / jax.lax.stop_gradient(jnp.minimum(jnp.abs(force) + 1.0, 1.0))


def _entry(constant: float, names: Sequence[str], values: Mapping[str, Any]) -> Any:
    result: Any = constant
    for name in names:
        result = result - values[name]
    return result


def _coupled_groups(coupled: Callable[[int, int], bool], moving: Sequence[int]) -> list[tuple[int, ...]]:
    """Connected groups of axes, each in ascending order."""
    left, groups = list(moving), []
    while left:
        group = [left.pop(0)]
        for i in group:
            joined = [j for j in left if coupled(i, j) or coupled(j, i)]
            group += joined
            left = [j for j in left if j not in joined]
        groups.append(tuple(sorted(group)))
    return groups


def _eliminate(rows: list[list[Any]], right: list[Any]) -> list[Any]:
    """Gaussian elimination on scalars; zeros that are Python numbers cost nothing."""
    n = len(right)
    rows, right = [list(row) for row in rows], list(right)
    for k in range(n):
        for i in range(k + 1, n):
            if isinstance(rows[i][k], float) and rows[i][k] == 0.0:
                continue
            share = rows[i][k] / rows[k][k]
            for j in range(k + 1, n):
                rows[i][j] = total((rows[i][j], -times(share, rows[k][j])))
            right[i] = total((right[i], -times(share, right[k])))
    found: list[Any] = [0.0] * n
    for i in reversed(range(n)):
        known = (-times(rows[i][j], found[j]) for j in range(i + 1, n))
        found[i] = total((right[i], *known)) / rows[i][i]
    return found
