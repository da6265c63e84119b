"""Models of what the simulation leaves over in one channel, each a running sum inside the time loop and a log-likelihood at its end."""

from math import log
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax.scipy.special import gammaln
from jaxtyping import Array, Float

LOG_2PI = 1.8378770664093453
# A product of variances that exceeds so much is divided by it, and its logarithm kept: rarely, and far from where derivatives overflow.
LARGE = 2.0**200
LOG_LARGE = 200.0 * log(2.0)


class White(NamedTuple):
    """Independent residuals of standard deviation `sd`; carries their sum of squares."""

    sd: Any
    counts: Float[Array, " k"]

    def empty(self) -> Any:
        """Return the sum before the first sample."""
        return jnp.zeros(())

    def absorb(self, total: Any, e: Any, shown: Any, present: Any, kind: Any) -> Any:
        """Add the residual `e` of one sample about `shown`; `present` is 1 if it was measured, else 0."""
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

    def absorb(self, total: Any, e: Any, shown: Any, present: Any, kind: Any) -> Any:
        """Add the residual `e` of one sample about `shown`; `present` is 1 if it was measured, else 0."""
        loss = jnp.log1p(e * e / (self.dof * self.sd * self.sd))
        return total + present * loss

    def log_likelihood(self, total: Any) -> Any:
        """Return the log density of all residuals."""
        half = 0.5 * self.dof
        each = gammaln(half + 0.5) - gammaln(half) - 0.5 * jnp.log(self.dof * jnp.pi) - jnp.log(self.sd)
        return jnp.sum(self.counts) * each - (half + 0.5) * total


class Proportional(NamedTuple):
    """Independent normal residuals of variance sd^2 + (share x)^2, x being the signal that is shown without noise.

    The measured signal instead of x would leave a density that does not integrate to one, and favour motions whose noise happens to
    point to zero. Carries sum log(1 + (share x / sd)^2) + e^2 / variance.
    """

    sd: Any
    share: Any
    counts: Float[Array, " k"]

    def empty(self) -> Any:
        """Return the sum before the first sample."""
        return jnp.zeros(())

    def absorb(self, total: Any, e: Any, shown: Any, present: Any, kind: Any) -> Any:
        """Add the residual `e` of one sample about `shown`; `present` is 1 if it was measured, else 0."""
        excess = (self.share * shown / self.sd) ** 2
        return total + present * (jnp.log1p(excess) + (e / self.sd) ** 2 / (1.0 + excess))

    def log_likelihood(self, total: Any) -> Any:
        """Return the log density of all residuals."""
        return -jnp.sum(self.counts) * (jnp.log(self.sd) + 0.5 * LOG_2PI) - 0.5 * total


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

    def absorb(self, carry: Any, e: Any, shown: Any, present: Any, kind: Any) -> Any:
        """Add the residual `e` of one sample about `shown`; `present` is 1 if it was measured, else 0."""
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

    In units of the white variance, r the variance of the process, m its correlation across a gap and v the variance of an innovation,

        v' = 1 + r (1 - m^2) + m^2 (1 - 1 / v),    mean' = e - (e - m mean) / v'

    so that a sample costs one division. The determinant of all residuals is the product D of every v. With one gap throughout it obeys a
    linear recursion, and with the larger root k of its polynomial it is after n samples

        D'' = s D' - m^2 D,    k^2 = s k - m^2,    s = 1 + m^2 + r (1 - m^2),    q = m^2 / k^2
        D = k^n (1 + (1 + r - k) / k (1 - q^n) / (1 - q))

    Where gaps differ the loop carries it, and its logarithm is taken at the end.

    Carries, at the last measured sample, the mean of the process, 1 / v, the sum of squared innovations over v, and the product.

    Attributes:
        sd: standard deviation of the white part.
        ratio: variance of the process over that of the white part.
        count: number of measurements.
        rate: logarithm of the correlation of the process across each distinct gap; a number where there is one gap throughout.
        memory: that correlation.
    """

    sd: Any
    ratio: Any
    count: Any
    rate: Float[Array, "*k"]
    memory: Float[Array, "*k"]

    @property
    def is_even(self) -> bool:
        """Whether there is one gap throughout."""
        return jnp.ndim(self.rate) == 0

    def empty(self) -> Any:
        """Return what is known before the first sample, where the process has the same variance after any gap."""
        return (jnp.zeros(()), 1.0 - self.ratio, jnp.zeros(()), *(() if self.is_even else (jnp.ones(()),)))

    def absorb(self, carry: Any, e: Any, shown: Any, present: Any, kind: Any) -> Any:
        """Add the residual `e` of one sample about `shown`; `present` is 1 if it was measured, else 0."""
        mean, inverse, total, *product = carry
        memory = self.memory if self.is_even else self.memory[kind]
        squared, absent = memory * memory, 1.0 - present
        spread = 1.0 + self.ratio * (1.0 - squared) + squared - squared * inverse
        after = 1.0 / spread
        innovation = e - memory * mean
        share = innovation * after
        # Multiplied by `present`, since a choice between arrays takes the processor twice as long.
        moved = (present * (e - share) + absent * mean, present * after + absent * inverse)
        total = total + present * (innovation * share)
        if self.is_even:
            return *moved, total
        grown = product[0] * (present * spread + absent)
        is_large = grown > LARGE
        total = total + jnp.where(is_large, LOG_LARGE * self.sd * self.sd, 0.0)
        return *moved, total, jnp.where(is_large, grown / LARGE, grown)

    def log_likelihood(self, carry: Any) -> Any:
        """Return the log density of all residuals."""
        squares, *product = carry[2:]
        log_product = self._log_product() if self.is_even else jnp.log(product[0])
        return -self.count * (jnp.log(self.sd) + 0.5 * LOG_2PI) - 0.5 * (log_product + squares / (self.sd * self.sd))

    def _log_product(self) -> Any:
        faded = -jnp.expm1(2.0 * self.rate)
        fresh = self.ratio * faded
        above = 0.5 * (fresh - faded + jnp.sqrt((fresh - faded) ** 2 + 4.0 * fresh))  # k - 1
        log_root = jnp.log1p(above)
        log_q = 2.0 * (self.rate - log_root)
        transient = (self.ratio - above) / (1.0 + above) * jnp.expm1(self.count * log_q) / jnp.expm1(log_q)
        return self.count * log_root + jnp.log1p(transient)


NoiseModel = White | Heavy | Proportional | Coloured | Drifting
INDEPENDENT = (White, Heavy, Proportional)  # Models of residuals that know nothing of each other
