"""Gradients of a log density: forward through the time loop where the parameters are few, backward where they are many.

forward:   d tangents ride along in one pass; memory does not grow with the steps
backward:  one pass there and one back over every stored step; memory grows with steps x chains
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from seatrial.sampling.target import Target

FORWARD_UP_TO = 20
"""Parameters up to which forward is no dearer, whatever the rule of integration."""


def forward_is_cheaper(dim: int) -> bool:
    """Whether a gradient of `dim` parameters is taken forward."""
    return dim <= FORWARD_UP_TO


def log_density_for_gradients(target: Target) -> Callable[[Float[Array, " d"]], Float[Array, ""]]:
    """Log density for callers of `jax.grad`, which get its gradient by the cheaper way.

    NaN counts as zero density, and a derivative that is not finite as zero: a trajectory that comes there has diverged.
    """

    def plain(z: Array) -> Array:
        return target.log_prior(z) + target.log_likelihood(z)

    def twice(z: Array) -> tuple[Array, Array]:
        value = plain(z)
        return value, value

    def value_and_gradient(z: Array) -> tuple[Array, Array]:
        if forward_is_cheaper(target.dim):
            gradient, value = jax.jacfwd(twice, has_aux=True)(z)
        else:
            value, gradient = jax.value_and_grad(plain)(z)
        return _or_zero_density(value), jnp.where(jnp.isfinite(gradient), gradient, 0.0)

    @jax.custom_vjp
    def log_density(z: Array) -> Array:
        return _or_zero_density(plain(z))

    log_density.defvjp(value_and_gradient, lambda gradient, change: (change * gradient,))
    return log_density


def _or_zero_density(value: Array) -> Array:
    return jnp.where(jnp.isnan(value), -jnp.inf, value)
