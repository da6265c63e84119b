"""The normal cut at one or two bounds, the half-normal among them, and its map from the real line.

The line t = mean + sd z, with the cut distribution's own mean and sd, bends smoothly into the bounds, which is the map of
`Uniform` (docs/decisions/0003): value = lower + c (softplus((t - lower) / c) - softplus((t - upper) / c)).
"""

from dataclasses import dataclass
from functools import cache
from math import inf, isfinite, log, pi, sqrt
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import ndtr, ndtri

from seatrial.compiled.pytrees import compiled_tree
from seatrial.core.argument_checks import check_number, check_order
from seatrial.core.errors import InputError
from seatrial.estimation.priors.box import CORNER
from seatrial.estimation.priors.normal import GIVE_BELIEF

# Share of a normal that an interval must hold: below, stating it as this normal cut is surely a mistake.
MIN_SHARE = 1e-9
MAX_DEVIATIONS = 10.0  # Beyond so many standard deviations a normal has less than 1e-21 of its mass


@compiled_tree()
@dataclass(frozen=True)
class TruncatedNormal:
    """A normal cut at its bounds; build it with `truncated_normal` or `half_normal`, which check it and work out its moments.

    Attributes:
        location: mean of the normal before the cut.
        scale: its standard deviation.
        lower: bound, or -inf.
        upper: bound, or inf.
        mean: of what is left.
        sd: likewise.
        log_share: logarithm of the share of the normal that is left.
    """

    location: float
    scale: float
    lower: float
    upper: float
    mean: float
    sd: float
    log_share: float

    @property
    def bounds(self) -> tuple[float, float]:
        """See `Prior.bounds`."""
        return self.lower, self.upper

    @property
    def edges(self) -> tuple[float, float]:
        """See `Prior.edges`."""
        return (self.lower - self.mean) / self.sd, (self.upper - self.mean) / self.sd

    def constrain(self, z: Any) -> Any:
        """See `Prior.constrain`. Written from the nearer bound, so that values close to a bound of 0 keep their digits."""
        above, below = self._distances(z)
        softplus = jax.nn.softplus
        from_lower = self.lower + self._corner * (softplus(above) - softplus(-below))
        from_upper = self.upper - self._corner * (softplus(below) - softplus(-above))
        return jnp.where(above < below, from_lower, from_upper)

    def unconstrain(self, value: Any) -> Any:
        """See `Prior.unconstrain`."""
        value = jnp.asarray(value)
        bend = jnp.log(-jnp.expm1((self.lower - value) / self._corner))
        bend = bend - jnp.log(-jnp.expm1((value - self.upper) / self._corner))
        return (value + self._corner * bend - self.mean) / self.sd

    def log_density(self, z: Any) -> Any:
        """See `Prior.log_density`. The corner is so sharp that exp(-width / c) < 1e-21 is left out of the slope."""
        x = (self.constrain(z) - self.location) / self.scale
        return self.log_slope(z) + jnp.log(self.sd / self.scale) - 0.5 * (x * x + log(2 * pi)) - self.log_share

    def log_slope(self, z: Any) -> Any:
        """Return the logarithm of the slope of the map from z to the value, over `sd`: 0 if the line is straight."""
        above, below = self._distances(z)
        return jax.nn.log_sigmoid(above) + jax.nn.log_sigmoid(below)

    def draw(self, key: jax.Array, shape: tuple[int, ...]) -> jax.Array:
        """See `Prior.draw`. By the inverse distribution function, on the side of the normal where it has all its digits."""
        low, high = (self.lower - self.location) / self.scale, (self.upper - self.location) / self.scale
        side = jnp.where(low > 0, -1.0, 1.0)
        begin, end = ndtr(jnp.where(low > 0, -high, low)), ndtr(jnp.where(low > 0, -low, high))
        x = side * ndtri(begin + (end - begin) * jax.random.uniform(key, shape, minval=1e-12))
        margin = 1e-12 * self.sd
        inside = jnp.nextafter(self.lower + margin, inf), jnp.nextafter(self.upper - margin, -inf)
        return jnp.clip(self.location + self.scale * x, *inside)

    def sample(self, key: jax.Array, shape: tuple[int, ...]) -> jax.Array:
        """See `Prior.sample`."""
        return self.unconstrain(self.draw(key, shape))

    @property
    def _corner(self) -> Any:
        """Length over which the line bends, in the parameter's unit: that of a uniform of the same sd."""
        return self.sd * (sqrt(12.0) / CORNER)

    def _distances(self, z: Any) -> tuple[Any, Any]:
        """Return how far the line is inside the lower and the upper bound, in corners."""
        t = self.mean + self.sd * z
        return (t - self.lower) / self._corner, (self.upper - t) / self._corner


def truncated_normal(location: float, scale: float, lower: float = -inf, upper: float = inf) -> TruncatedNormal:
    """Cut a normal at its bounds.

    Args:
        location: mean of the normal before the cut.
        scale: its standard deviation.
        lower: bound, or -inf.
        upper: bound, or inf; one of the two is finite.

    Returns:
        a prior of what lies between the bounds.

    Raises:
        InputError: a number that is none, no bound at all, or an interval that holds next to nothing of the normal.
    """
    check_number(location, "truncated normal prior, location")
    check_number(scale, "truncated normal prior, scale", above=0.0, remedy=GIVE_BELIEF)
    check_order(lower, upper, "truncated normal prior", is_finite=False)
    where = f"normal {location:g} ± {scale:g} between {lower:g} and {upper:g}"
    if not (isfinite(lower) or isfinite(upper)):
        raise InputError(where, found="no bound", expected="one bound at least", remedy="use a normal prior")
    low, high = (lower - location) / scale, (upper - location) / scale
    nearest = min(max(low, 0.0), high)
    reach = MAX_DEVIATIONS**2 / (abs(nearest) + sqrt(nearest**2 + MAX_DEVIATIONS**2))
    begin, end = max(low, nearest - reach), min(high, nearest + reach)
    nodes, weights = _gauss_legendre()
    x = 0.5 * (begin + end) + 0.5 * (end - begin) * nodes
    density = 0.5 * max(end - begin, 0.0) * weights * np.exp(-0.5 * (x - nearest) * (x + nearest))
    share = float(density.sum()) * np.exp(-0.5 * nearest**2) / sqrt(2 * pi)
    if not share > MIN_SHARE:
        raise InputError(
            where,
            found=f"a share of {share:.1g} of the normal between the bounds",
            expected="a support that the normal reaches",
            remedy="move the mean, widen the standard deviation or the bounds: the prior is empty",
        )
    density = density / density.sum()
    mean = float(density @ x)
    sd = float(np.sqrt(density @ (x - mean) ** 2))
    return TruncatedNormal(location, scale, lower, upper, location + scale * mean, scale * sd, log(share))


def half_normal(scale: float, *, lower: float | None = None, upper: float | None = None) -> TruncatedNormal:
    """Return half a normal of standard deviation `scale`, largest at one bound: `lower` or `upper`.

    Two draws in three (68 %) lie within `scale` of the bound.

    Args:
        scale: standard deviation of the whole normal, in the parameter's unit.
        lower: bound from which it falls off upwards; or
        upper: bound from which it falls off downwards.

    Returns:
        a prior of the values on one side of the bound.

    Raises:
        InputError: a number that is none, no bound, or two.
    """
    check_number(scale, "half-normal prior, scale", above=0.0, remedy=GIVE_BELIEF)
    if (lower is None) == (upper is None):
        raise InputError(
            "half-normal prior",
            found="no bound" if lower is None else "two bounds",
            expected="one of lower and upper",
            remedy="give the bound at which it is largest: lower = 0 for a size, upper = 0 for a damping coefficient",
        )
    if upper is None:
        assert lower is not None
        return truncated_normal(lower, scale, lower=lower)
    return truncated_normal(upper, scale, upper=upper)


@cache
def _gauss_legendre() -> tuple[np.ndarray, np.ndarray]:
    """Return 200 nodes and weights on [-1, 1]; they take 30 to 200 ms, and a campaign has a prior for each coefficient."""
    return np.polynomial.legendre.leggauss(200)
