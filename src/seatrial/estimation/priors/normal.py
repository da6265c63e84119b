"""Priors whose z is exactly standard normal: normal, and log-normal by its median and a factor."""

from dataclasses import dataclass
from math import exp, expm1, inf, log, sqrt
from typing import Any

import jax
import jax.numpy as jnp

from seatrial.compiled.pytrees import compiled_tree
from seatrial.core.argument_checks import check_number, is_traced
from seatrial.core.errors import InputError

GIVE_BELIEF = "give a plausible value; fix a known coefficient in the vehicle instead"
# Logarithm of the largest multiple of its median that a log-normal gives: e^600 is near the end of double precision.
MAX_LOG_RATIO = 600.0


@compiled_tree()
@dataclass(frozen=True)
class Normal:
    """Normal by mean and standard deviation; z is standard normal.

    Attributes:
        mean: in the parameter's unit.
        sd: standard deviation above 0, likewise.

    Raises:
        InputError: a number that is none, or no spread.
    """

    mean: float
    sd: float

    def __post_init__(self) -> None:
        """Refuse what has no spread."""
        if not is_traced(self.mean, self.sd):
            check_number(self.mean, "Normal prior, mean")
            check_number(self.sd, "Normal prior, sd", above=0.0, remedy=GIVE_BELIEF)

    @property
    def bounds(self) -> tuple[float, float]:
        """See `Prior.bounds`."""
        return -inf, inf

    @property
    def edges(self) -> tuple[float, float]:
        """See `Prior.edges`."""
        return -inf, inf

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

    Attributes:
        median: above or below 0, in the parameter's unit.
        factor: above 1, a plain number.

    Raises:
        InputError: a median of 0, or a factor that is not above 1.
    """

    median: float
    factor: float

    def __post_init__(self) -> None:
        """Refuse a median without a sign and a factor without a spread."""
        if is_traced(self.median, self.factor):
            return
        if check_number(self.median, "LogNormal prior, median") == 0.0:
            raise InputError(
                "LogNormal prior, median",
                found="0",
                expected="a median above or below 0; all values have its sign",
                remedy="give the value that is as likely too large as too small, for example -3.0",
            )
        remedy = "2.0 means that two values in three lie between half and twice the median"
        check_number(self.factor, "LogNormal prior, factor", above=1.0, remedy=remedy)

    @property
    def bounds(self) -> tuple[float, float]:
        """See `Prior.bounds`."""
        return (0.0, inf) if self.median > 0 else (-inf, 0.0)

    @property
    def edges(self) -> tuple[float, float]:
        """See `Prior.edges`."""
        return -inf, inf

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
        return self.median * jnp.exp(jnp.clip(self._slope * z, -MAX_LOG_RATIO, MAX_LOG_RATIO))

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
    """Exponential, infinite if double precision ends."""
    return exp(x) if x < 709.0 else inf
