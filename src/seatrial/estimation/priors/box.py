"""Priors between two bounds: uniform, and uniform in the logarithm; see docs/decisions/0003 for the map to the real line."""

from dataclasses import dataclass
from math import exp, log, log1p, sqrt
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from seatrial.compiled.pytrees import compiled_tree
from seatrial.core.argument_checks import check_number, check_order, is_traced

CORNER = 200.0  # Sharpness of the bend where the box map leaves the line: within 1/200 of the width of a bound
BEND_LENGTH = sqrt(12.0) / CORNER  # Of z, over which it bends
_GIVE_BOUNDS = "give the smallest and the largest plausible value"


@compiled_tree()
@dataclass(frozen=True)
class Uniform:
    """Uniform between two finite bounds, the lower one below the upper one.

    With t = z / sqrt(12) + 1/2 and the sharpness k, the share of the width is y = (softplus(k t) - softplus(k (t - 1))) / k:
    a straight line inside the box that bends smoothly to its bounds. A posterior that is nearly normal in the parameter
    stays so in z; the usual logistic map turns the long thin ridges of correlated drag coefficients into bananas.

    Attributes:
        lower: bound, in the parameter's unit.
        upper: likewise.

    Raises:
        InputError: a bound that is no finite number, or nothing between them.
    """

    lower: float
    upper: float

    def __post_init__(self) -> None:
        """Refuse bounds with nothing between them."""
        if not is_traced(self.lower, self.upper):
            check_order(self.lower, self.upper, "Uniform prior", remedy=_GIVE_BOUNDS)

    @property
    def bounds(self) -> tuple[float, float]:
        """See `Prior.bounds`."""
        return self.lower, self.upper

    @property
    def edges(self) -> tuple[float, float]:
        """See `Prior.edges`."""
        return -sqrt(3.0), sqrt(3.0)

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


@compiled_tree()
@dataclass(frozen=True)
class LogUniform:
    """Uniform in the logarithm between two positive bounds: for scales, such as noise or a correlation time.

    Attributes:
        lower: bound above 0, in the parameter's unit.
        upper: likewise, above the lower one.

    Raises:
        InputError: a bound that is no finite number above 0, or nothing between them.
    """

    lower: float
    upper: float

    def __post_init__(self) -> None:
        """Refuse bounds with nothing between them."""
        if not is_traced(self.lower, self.upper):
            check_number(self.lower, "LogUniform prior, lower", above=0.0, remedy="give the smallest relevant size")
            check_order(self.lower, self.upper, "LogUniform prior", remedy=_GIVE_BOUNDS)

    @property
    def bounds(self) -> tuple[float, float]:
        """See `Prior.bounds`."""
        return self.lower, self.upper

    @property
    def edges(self) -> tuple[float, float]:
        """See `Prior.edges`."""
        return -sqrt(3.0), sqrt(3.0)

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


def straightened(z: Float[np.ndarray, "*batch d"], edges: Float[np.ndarray, "d 2"]) -> Float[np.ndarray, "*batch d"]:
    """Return z on the straight lines that the maps of the priors bend into the bounds; as it is if there are no edges."""
    line = np.array(z, float)
    for place in np.flatnonzero(np.isfinite(edges).any(1)):
        low, high = edges[place]
        above, below = (line[..., place] - low) / BEND_LENGTH, (high - line[..., place]) / BEND_LENGTH
        # From the nearer edge, so that what is close to it keeps its digits; the other may be infinite.
        with np.errstate(invalid="ignore"):
            from_low = low + BEND_LENGTH * (np.logaddexp(0.0, above) - np.logaddexp(0.0, -below))
            from_high = high - BEND_LENGTH * (np.logaddexp(0.0, below) - np.logaddexp(0.0, -above))
        line[..., place] = np.where(above < below, from_low, from_high)
    return line


def bent(line: Float[np.ndarray, "*batch d"], edges: Float[np.ndarray, "d 2"]) -> Float[np.ndarray, "*batch d"]:
    """Return z of places on the straight lines, the inverse of `straightened`."""
    inside = np.clip(line, np.nextafter(edges[:, 0], np.inf), np.nextafter(edges[:, 1], -np.inf))
    low, high = (
        np.log(-np.expm1((edges[:, 0] - inside) / BEND_LENGTH)),
        np.log(-np.expm1((inside - edges[:, 1]) / BEND_LENGTH)),
    )
    return inside + BEND_LENGTH * (low - high)


def log_slopes(z: Float[np.ndarray, "*batch d"], edges: Float[np.ndarray, "d 2"]) -> Float[np.ndarray, "*batch d"]:
    """Return the log of the slope of the straight line over z, by component."""
    return -np.logaddexp(0.0, (edges[:, 0] - z) / BEND_LENGTH) - np.logaddexp(0.0, (z - edges[:, 1]) / BEND_LENGTH)
