"""What a sampler sees: a density on the real vector space, prior and likelihood kept apart."""

from collections.abc import Callable
from typing import Protocol, TypeVar

import jax
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


TargetT = TypeVar("TargetT", bound=Target)


def no_progress(done: int, total: int) -> None:
    """Progress nobody watches."""
