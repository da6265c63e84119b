"""Models of what the simulation leaves over in one channel, each a running sum inside the time loop and a log-likelihood at its end."""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jax.scipy.special import gammaln
from jaxtyping import Array, Float

LOG_2PI = 1.8378770664093453


class White(NamedTuple):
    """Independent residuals of standard deviation `sd`; carries their sum of squares."""

    sd: Any
    counts: Float[Array, " k"]

    def empty(self) -> Any:
        """Return the sum before the first sample."""
        return jnp.zeros(())

    def absorb(self, total: Any, e: Any, present: Any, kind: Any) -> Any:
        """Add the residual `e` of one sample; `present` is 1 where it was measured, else 0."""
        return total + present * (e * e)

    def log_likelihood(self, total: Any) -> Any:
        """Return the log density of all residuals."""
        return -jnp.sum(self.counts) * (jnp.log(self.sd) + 0.5 * LOG_2PI) - 0.5 * total / (self.sd * self.sd)


class Heavy(NamedTuple):
    """Independent residuals of Student's t with scale `sd` and `dof` degrees of freedom: an outlier costs the logarithm of its size.

    Carries sum log(1 + e^2 / (dof sd^2)).
    """

    sd: Any
    dof: Any
    counts: Float[Array, " k"]

    def empty(self) -> Any:
        """Return the sum before the first sample."""
        return jnp.zeros(())

    def absorb(self, total: Any, e: Any, present: Any, kind: Any) -> Any:
        """Add the residual `e` of one sample; `present` is 1 where it was measured, else 0."""
        loss = jnp.log1p(e * e / (self.dof * self.sd * self.sd))
        return total + present * loss

    def log_likelihood(self, total: Any) -> Any:
        """Return the log density of all residuals."""
        half = 0.5 * self.dof
        each = gammaln(half + 0.5) - gammaln(half) - 0.5 * jnp.log(self.dof * jnp.pi) - jnp.log(self.sd)
        return jnp.sum(self.counts) * each - (half + 0.5) * total


class Coloured(NamedTuple):
    """Ornstein-Uhlenbeck residuals; carries the last one measured and the sum of squared innovations over their variances.

    Attributes:
        sd: standard deviation of the process.
        counts: number of measurements after each distinct gap.
        memory: correlation across each distinct gap.
        weight: process variance over innovation variance for each distinct gap.
    """

    sd: Any
    counts: Float[Array, " k"]
    memory: Float[Array, " k"]
    weight: Float[Array, " k"]

    def empty(self) -> Any:
        """Return the sum before the first sample."""
        return (jnp.zeros(()), jnp.zeros(()))

    def absorb(self, carry: Any, e: Any, present: Any, kind: Any) -> Any:
        """Add the residual `e` of one sample; `present` is 1 where it was measured, else 0."""
        before, total = carry
        innovation = e - self.memory[kind] * before
        gain = self.weight[kind] * (innovation * innovation)
        return before + present * (e - before), total + present * gain

    def log_likelihood(self, carry: Any) -> Any:
        """Return the log density of all residuals."""
        spread = jnp.log(self.sd) + 0.5 * LOG_2PI - 0.5 * jnp.log(self.weight)
        return -jnp.sum(self.counts * spread) - 0.5 * carry[1] / (self.sd * self.sd)


class Drifting(NamedTuple):
    """White residuals on top of an Ornstein-Uhlenbeck process, which a Kalman filter of one state follows.

    Carries the mean and variance of the process at the last measured sample, and the log density so far.

    Attributes:
        sd: standard deviation of the white part.
        drift: standard deviation of the process.
        memory: correlation of the process across each distinct gap.
    """

    sd: Any
    drift: Any
    memory: Float[Array, " k"]

    def empty(self) -> Any:
        """Return what is known before the first sample."""
        return (jnp.zeros(()), jnp.zeros(()), jnp.zeros(()))

    def absorb(self, carry: Any, e: Any, present: Any, kind: Any) -> Any:
        """Add the residual `e` of one sample; `present` is 1 where it was measured, else 0."""
        mean, variance, total = carry
        memory = self.memory[kind]
        expected = memory * mean
        before = memory * memory * variance + self.drift * self.drift * (1.0 - memory * memory)
        spread = before + self.sd * self.sd
        innovation = e - expected
        gain = before / spread
        density = -0.5 * (jnp.log(spread) + LOG_2PI + innovation * innovation / spread)
        after = (expected + gain * innovation, before * (1.0 - gain))
        return mean + present * (after[0] - mean), variance + present * (after[1] - variance), total + present * density

    def log_likelihood(self, carry: Any) -> Any:
        """Return the log density of all residuals."""
        return carry[2]
