"""What a sampler sees: a density on the real vector space, prior and likelihood kept apart."""

from collections.abc import Callable
from typing import Protocol, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

Progress = Callable[[int, int], None]
"""Called with the work done and the work in all."""


class Target(Protocol):
    """A pytree whose arrays are the data, so that one compiled sampler serves every data set of the same shape.

    Densities may be -inf, never NaN.
    """

    @property
    def dim(self) -> int:
        """Number of components of z."""
        ...

    def log_prior(self, z: Float[Array, " d"]) -> Float[Array, ""]:
        """Log prior density."""
        ...

    def log_likelihood(self, z: Float[Array, " d"]) -> Float[Array, ""]:
        """Log-likelihood."""
        ...

    def sample_prior(self, key: jax.Array, n: int) -> Float[Array, "n d"]:
        """Draws from the prior."""
        ...


VECTOR = 8
"""Lanes that one vector register of 512 bits holds."""


@jax.jit
def log_densities(target: Target, z: Float[Array, "n d"]) -> Float[Array, " n"]:
    """Log densities of several positions, computed side by side.

    Fewer than a vector of them are filled up to one: the compiler leaves a part of a vector scalar, and 4 lanes then cost half
    as much again as 8.
    """
    n = z.shape[0]
    filled = jnp.concatenate([z, jnp.broadcast_to(z[:1], (VECTOR - n, z.shape[1]))]) if 1 < n < VECTOR else z
    return jax.vmap(lambda one: target.log_prior(one) + target.log_likelihood(one))(filled)[:n]


TargetT = TypeVar("TargetT", bound=Target)


def no_progress(done: int, total: int) -> None:
    """Progress nobody watches."""
