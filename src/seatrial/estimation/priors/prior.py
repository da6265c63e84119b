"""What every prior of a scalar parameter offers, and priors cut to the physical side of a coefficient.

Damping dissipates, and mass plus added mass is positive. A force c phi(s) along the vehicle's own velocity s takes power
-c s phi(s) out of the motion. Where phi is odd in s, as s, s|s| and s^3 are, s phi(s) >= 0, so the term dissipates if and only
if c < 0. An even phi (s^2), a change from trim (`X_du3`) or another signal has no sign of its own. The inertia m - X_udot is
positive if and only if X_udot < m.
"""

from collections.abc import Callable, Sequence
from math import inf, sqrt
from typing import TYPE_CHECKING, Any, Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from seatrial.core.coefficients import AXES, CoefficientName, Factor
from seatrial.core.errors import InputError
from seatrial.core.signals import RATES
from seatrial.estimation.priors.box import LogUniform, Uniform
from seatrial.estimation.priors.density import prior_of_density
from seatrial.estimation.priors.normal import LogNormal, Normal
from seatrial.estimation.priors.truncated import TruncatedNormal, truncated_normal

CURVE = 241  # Points of a prior's curve
MIN_SLOPE = 1e-9  # Slope of the map to values, over its largest, below which their last digits are lost
# Axis of a force or moment to the velocity along it: X to u, …, N to r; both lists are in that order.
_VELOCITY = dict(zip(AXES, RATES, strict=False))


class Prior(Protocol):
    """Interface of every prior; implementations are frozen dataclasses of plain numbers, registered as pytrees."""

    @property
    def bounds(self) -> tuple[float, float]:
        """Support in the parameter's own unit."""
        ...

    @property
    def edges(self) -> tuple[float, float]:
        """Where the line of z bends into the bounds; infinite for a map without such corners (docs/decisions/0003)."""
        ...

    @property
    def mean(self) -> float:
        """Prior mean."""
        ...

    @property
    def sd(self) -> float:
        """Prior standard deviation."""
        ...

    def constrain(self, z: Any) -> Any:
        """Return the parameter value of an unconstrained z, elementwise."""
        ...

    def unconstrain(self, value: Any) -> Any:
        """Return the z of a parameter value inside the support, elementwise."""
        ...

    def log_density(self, z: Any) -> Any:
        """Return the log density of z, elementwise."""
        ...

    def draw(self, key: jax.Array, shape: tuple[int, ...]) -> jax.Array:
        """Return the draws of the parameter's value."""
        ...

    def sample(self, key: jax.Array, shape: tuple[int, ...]) -> jax.Array:
        """Return the draws of z."""
        ...

    if not TYPE_CHECKING:  # no member that a prior must have: it builds one
        from_logpdf = staticmethod(prior_of_density)


def by_kind(priors: Sequence[Prior], function: Callable[..., Any], *columns: Array) -> Any:
    """Return a function of each prior and its own columns, the last axis, compiled once for each kind of prior and not for each.

    Args:
        priors: of which the numbers are traced.
        function: of a prior and of a column of each of the arrays; an array, or a tree of them.
        columns: arrays whose last axis is that of the priors.
    """
    kinds: dict[Any, list[int]] = {}
    for i, prior in enumerate(priors):
        kinds.setdefault(jax.tree.structure(prior), []).append(i)
    order = np.argsort([i for members in kinds.values() for i in members])
    parts = []
    for members in kinds.values():
        numbers = jax.tree.map(lambda *leaves: jnp.stack(leaves), *(priors[i] for i in members))
        own = [column[..., np.array(members)] for column in columns]
        parts.append(jax.vmap(function, (0, *[-1] * len(own)), -1)(numbers, *own))
    return jax.tree.map(lambda *each: jnp.concatenate(each, -1)[..., order], *parts)


def nominal(prior: Prior) -> float:
    """Return the value that stands for a prior where a vehicle needs one: its mean, or the median of a log-normal or log-uniform one.

    The mean of a log-normal is far beyond what is likely: with a factor of 8 it is 8.7 times the median.
    """
    if isinstance(prior, LogNormal):
        return prior.median
    if isinstance(prior, LogUniform):
        return sqrt(prior.lower * prior.upper)
    return prior.mean


def prior_curve(prior: Prior) -> tuple[jax.Array, jax.Array]:
    """Return values over nearly all of a prior's support, and the log density per unit of the value there, shape (241,)."""
    z = jnp.linspace(-4.0, 4.0, CURVE)
    ones = jnp.ones_like(z)
    _, slope = jax.jvp(prior.constrain, (z,), (ones,))
    is_resolved = jnp.abs(slope) > MIN_SLOPE * jnp.abs(slope).max()  # beyond, a value is rounded to the bound
    z = jnp.clip(z, z[jnp.argmax(is_resolved)], z[-1 - jnp.argmax(is_resolved[::-1])])
    value, slope = jax.jvp(prior.constrain, (z,), (ones,))
    return value, prior.log_density(z) - jnp.log(jnp.abs(slope))


def physical_support(term: CoefficientName, inertia: float) -> tuple[float, float] | None:
    """Return the interval in which a coefficient is physical; None if its sign is not its own.

    Args:
        term: coefficient.
        inertia: mass, or moment of inertia, along its axis; 1 for coefficients per unit of it.
    """
    own = _VELOCITY.get(term.axis)
    if own is None or any(factor.signal != own or factor.change for factor in term.factors) or not term.factors:
        return None
    if term.is_added_mass:
        return (-inf, inertia) if term.factors == (Factor(own, derivative=True),) else None
    odd = sum(factor.power for factor in term.factors if not factor.modulus) % 2 == 1
    return (-inf, 0.0) if odd else None


def restricted(prior: Prior, lower: float, upper: float) -> Prior:
    """Cut a prior to an interval: what lies outside is impossible, inside nothing changes but the total.

    A uniform stays uniform and a normal becomes a truncated normal; a prior that lies inside already is returned as it is.

    Args:
        prior: normal, uniform or a kind cut already.
        lower: bound in the unit of the parameter; -inf for none.
        upper: likewise; inf for none.

    Raises:
        InputError: next to nothing of the prior lies inside, or a log-normal, which cannot be cut.
    """
    below, above = prior.bounds
    if lower <= below and above <= upper:
        return prior
    first, last = max(below, lower), min(above, upper)
    where = f"support {below:g} to {above:g}"
    if not first < last:
        raise InputError(
            where,
            found=f"nothing between {lower:g} and {upper:g}",
            expected="a prior that allows physical values",
            remedy="move the prior to the physical side",
        )
    match prior:
        case Uniform() | LogUniform():
            return type(prior)(first, last)
        case Normal(mean, sd):
            return truncated_normal(mean, sd, first, last)
        case TruncatedNormal():
            return truncated_normal(prior.location, prior.scale, first, last)
        case _:
            raise InputError(
                where,
                found=f"a {type(prior).__name__} that reaches beyond {lower:g} to {upper:g}",
                expected="a uniform, normal or truncated normal prior, which can be cut",
                remedy="use one of these",
            )
