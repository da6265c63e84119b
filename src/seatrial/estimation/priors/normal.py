"""Priors whose z is exactly standard normal: normal, and log-normal by its median and a factor."""

from dataclasses import dataclass
from math import exp, expm1, inf, log, sqrt
from typing import Any

import jax
import jax.numpy as jnp

from seatrial.core.pytrees import compiled_tree

LARGEST = 600.0
"""Logarithm of the largest multiple of its median that a log-normal gives: e^600 is near the end of double precision."""


@compiled_tree()
@dataclass(frozen=True)
class Normal:
    """Normal by mean and standard deviation; z is standard normal."""

    mean: float
    sd: float

    @property
    def bounds(self) -> tuple[float, float]:
        """See `Prior.bounds`."""
        return float("-inf"), float("inf")

    def constrain(self, z: Any) -> Any:
        """See `Prior.constrain`."""
        return self.mean + self.sd * z

    def unconstrain(self, value: Any) -> Any:
        """See `Prior.unconstrain`."""
        return (jnp.asarray(value) - self.mean) / self.sd

    def log_density(self, z: Any) -> Any:
        """See `Prior.log_density`."""
        return -0.5 * (z * z + jnp.log(2 * jnp.pi))

    def draw(self, key: jax.Array, shape: tuple[int, ...]) -> jax.Array:
        """See `Prior.draw`."""
        return self.constrain(self.sample(key, shape))

    def sample(self, key: jax.Array, shape: tuple[int, ...]) -> jax.Array:
        """See `Prior.sample`."""
        return jax.random.normal(key, shape)


@compiled_tree()
@dataclass(frozen=True)
class LogNormal:
    """Log-normal: two draws in three (68 %) lie within a `factor` of the `median`, 95 % within its square.

    With z standard normal the value is median * factor^z, or median * factor^-z for a negative median, so that it grows with z.
    It has the median's sign: damping "about -3 kg/m, give or take a factor of two" is `LogNormal(-3.0, 2.0)`.
    """

    median: float
    factor: float

    @property
    def bounds(self) -> tuple[float, float]:
        """See `Prior.bounds`."""
        return (0.0, inf) if self.median > 0 else (-inf, 0.0)

    @property
    def mean(self) -> float:
        """See `Prior.mean`."""
        return self.median * _exp(0.5 * log(self.factor) ** 2)

    @property
    def sd(self) -> float:
        """See `Prior.sd`."""
        square = log(self.factor) ** 2
        return abs(self.median) * _exp(square) * sqrt(-expm1(-square))

    def constrain(self, z: Any) -> Any:
        """See `Prior.constrain`."""
        return self.median * jnp.exp(jnp.clip(self._slope * z, -LARGEST, LARGEST))

    def unconstrain(self, value: Any) -> Any:
        """See `Prior.unconstrain`."""
        return jnp.log(jnp.asarray(value) / self.median) / self._slope

    def log_density(self, z: Any) -> Any:
        """See `Prior.log_density`."""
        return -0.5 * (z * z + jnp.log(2 * jnp.pi))

    def draw(self, key: jax.Array, shape: tuple[int, ...]) -> jax.Array:
        """See `Prior.draw`."""
        return self.constrain(self.sample(key, shape))

    def sample(self, key: jax.Array, shape: tuple[int, ...]) -> jax.Array:
        """See `Prior.sample`."""
        return jax.random.normal(key, shape)

    @property
    def _slope(self) -> Any:
        return jnp.sign(self.median) * jnp.log(self.factor)


def _exp(x: float) -> float:
    """Exponential, infinite where double precision ends."""
    return exp(x) if x < 709.0 else inf
