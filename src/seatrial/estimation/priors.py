"""Priors of scalar parameters, and the smooth map from the real line to their support.

Samplers work on the unconstrained z, of mean 0 and standard deviation 1 under the prior; `log_density(z)` is the prior's
density of z, the log-Jacobian included. Priors are pytrees of their numbers: code compiled for one serves all of its kind.
"""

from dataclasses import dataclass
from math import exp, log, log1p, sqrt
from typing import Any, Protocol

import jax
import jax.numpy as jnp


class Prior(Protocol):
    """What every prior offers; implementations are frozen dataclasses of plain numbers, registered as pytrees."""

    @property
    def bounds(self) -> tuple[float, float]:
        """Support in the parameter's own unit."""
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
        """Parameter value of an unconstrained z, elementwise."""
        ...

    def unconstrain(self, value: Any) -> Any:
        """The z of a parameter value inside the support, elementwise."""
        ...

    def log_density(self, z: Any) -> Any:
        """Log density of z, elementwise."""
        ...

    def draw(self, key: jax.Array, shape: tuple[int, ...]) -> jax.Array:
        """Draws of the parameter's value."""
        ...

    def sample(self, key: jax.Array, shape: tuple[int, ...]) -> jax.Array:
        """Draws of z."""
        ...


CORNER = 50.0
"""Sharpness of the bend where the box map leaves the line: within 1/50 of the width of a bound."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Uniform:
    """Uniform between two bounds.

    With t = z / sqrt(12) + 1/2 and the sharpness k, the share of the width is y = (softplus(k t) - softplus(k (t - 1))) / k:
    a straight line inside the box that bends smoothly to its bounds. A posterior that is nearly normal in the parameter
    stays so in z; the usual logistic map turns the long thin ridges of correlated drag coefficients into bananas.
    """

    lower: float
    upper: float

    @property
    def bounds(self) -> tuple[float, float]:
        """See `Prior.bounds`."""
        return self.lower, self.upper

    @property
    def mean(self) -> float:
        """See `Prior.mean`."""
        return 0.5 * (self.lower + self.upper)

    @property
    def sd(self) -> float:
        """See `Prior.sd`."""
        return (self.upper - self.lower) / sqrt(12.0)

    def constrain(self, z: Any) -> Any:
        """See `Prior.constrain`."""
        t = z / sqrt(12.0) + 0.5
        bend = jax.nn.softplus(-CORNER * t) - jax.nn.softplus(CORNER * (t - 1.0))
        return self.lower + (self.upper - self.lower) * jnp.clip(t + bend / CORNER, 0.0, 1.0)

    def unconstrain(self, value: Any) -> Any:
        """See `Prior.unconstrain`."""
        y = (jnp.asarray(value) - self.lower) / (self.upper - self.lower)
        bend = jnp.log(-jnp.expm1(-CORNER * y)) - jnp.log(-jnp.expm1(-CORNER * (1.0 - y)))
        return (y + bend / CORNER - 0.5) * sqrt(12.0)

    def log_density(self, z: Any) -> Any:
        """See `Prior.log_density`."""
        t = z / sqrt(12.0) + 0.5
        slope = jax.nn.log_sigmoid(CORNER * t) + jax.nn.log_sigmoid(CORNER * (1.0 - t))
        return slope + (log1p(-exp(-CORNER)) - 0.5 * log(12.0))

    def draw(self, key: jax.Array, shape: tuple[int, ...]) -> jax.Array:
        """See `Prior.draw`."""
        return self.lower + (self.upper - self.lower) * jax.random.uniform(key, shape, minval=1e-12)

    def sample(self, key: jax.Array, shape: tuple[int, ...]) -> jax.Array:
        """See `Prior.sample`."""
        return self.unconstrain(self.draw(key, shape))


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class LogUniform:
    """Uniform in the logarithm between two positive bounds: for scales, such as noise or a correlation time."""

    lower: float
    upper: float

    @property
    def bounds(self) -> tuple[float, float]:
        """See `Prior.bounds`."""
        return self.lower, self.upper

    @property
    def mean(self) -> float:
        """See `Prior.mean`."""
        return (self.upper - self.lower) / log(self.upper / self.lower)

    @property
    def sd(self) -> float:
        """See `Prior.sd`."""
        return sqrt((self.upper**2 - self.lower**2) / (2.0 * log(self.upper / self.lower)) - self.mean**2)

    @property
    def _log(self) -> Uniform:
        return Uniform(jnp.log(self.lower), jnp.log(self.upper))

    def constrain(self, z: Any) -> Any:
        """See `Prior.constrain`."""
        return jnp.exp(self._log.constrain(z))

    def unconstrain(self, value: Any) -> Any:
        """See `Prior.unconstrain`."""
        return self._log.unconstrain(jnp.log(value))

    def log_density(self, z: Any) -> Any:
        """See `Prior.log_density`."""
        return self._log.log_density(z)

    def draw(self, key: jax.Array, shape: tuple[int, ...]) -> jax.Array:
        """See `Prior.draw`."""
        return jnp.exp(self._log.draw(key, shape))

    def sample(self, key: jax.Array, shape: tuple[int, ...]) -> jax.Array:
        """See `Prior.sample`."""
        return self._log.sample(key, shape)


@jax.tree_util.register_dataclass
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
