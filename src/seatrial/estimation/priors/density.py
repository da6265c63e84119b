"""A prior from any log density between two bounds, on the map of the truncated normal (docs/decisions/0003)."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from seatrial.compiled.pytrees import compiled_tree
from seatrial.core.argument_checks import check_order, shown
from seatrial.core.errors import InputError
from seatrial.estimation.priors.truncated import TruncatedNormal

CELLS = 4096  # Cells of the table from which draws are taken; between its points the density is constant
PASSES = 4  # Quadratures, each on cells placed by the mean and standard deviation of the one before
# Largest difference between the totals on all cells and on half of them, relative: evidences are right to 0.01 nat.
MAX_DISAGREEMENT = 1e-3


@compiled_tree("log_pdf")
@dataclass(frozen=True)
class DensityPrior:
    """A prior with the log density that a function gives; build it with `Prior.from_logpdf`, which finds its total and its moments.

    Attributes:
        line: map from z to the value.
        log_total: logarithm of the integral of the density, which need not be normalised.
        log_pdf: log density of one value per unit of the parameter, written with `jax.numpy`.
    """

    line: TruncatedNormal
    log_total: float
    log_pdf: Callable[[Any], Any]

    @property
    def bounds(self) -> tuple[float, float]:
        """See `Prior.bounds`."""
        return self.line.bounds

    @property
    def edges(self) -> tuple[float, float]:
        """See `Prior.edges`."""
        return self.line.edges

    @property
    def mean(self) -> float:
        """See `Prior.mean`."""
        return self.line.mean

    @property
    def sd(self) -> float:
        """See `Prior.sd`."""
        return self.line.sd

    def constrain(self, z: Any) -> Any:
        """See `Prior.constrain`."""
        return self.line.constrain(z)

    def unconstrain(self, value: Any) -> Any:
        """See `Prior.unconstrain`."""
        return self.line.unconstrain(value)

    def log_density(self, z: Any) -> Any:
        """See `Prior.log_density`."""
        value = self._inside(self.constrain(jnp.asarray(z, float)))
        return jnp.vectorize(self.log_pdf)(value) - self.log_total + self.line.log_slope(z) + jnp.log(self.sd)

    def draw(self, key: jax.Array, shape: tuple[int, ...]) -> jax.Array:
        """See `Prior.draw`. By the inverse of the distribution function on cells that are closest about the mean."""
        t = jnp.linspace(*_ends(*self.bounds, self.mean, self.sd, jnp), CELLS + 1)
        edges = self.mean + self.sd * jnp.sinh(t)
        middle = 0.5 * (edges[1:] + edges[:-1])
        mass = jnp.exp(jnp.vectorize(self.log_pdf)(middle) - self.log_total) * jnp.diff(edges)
        below = jnp.concatenate([jnp.zeros(1), jnp.cumsum(mass)])
        value = jnp.interp(jax.random.uniform(key, shape, minval=1e-12), below / below[-1], edges)
        return self._inside(value)

    def sample(self, key: jax.Array, shape: tuple[int, ...]) -> jax.Array:
        """See `Prior.sample`."""
        return self.unconstrain(self.draw(key, shape))

    def _inside(self, value: Any) -> Any:
        """Return values clear of the bounds, where a log density may be infinite and has no derivative."""
        margin = 1e-12 * self.sd
        return jnp.clip(value, self.bounds[0] + margin, self.bounds[1] - margin)


def prior_of_density(log_pdf: Callable[[Any], Any], lower: float, upper: float) -> DensityPrior:
    """Build a prior from a log density.

    Args:
        log_pdf: log density of one value of the parameter, up to a constant, written with `jax.numpy`.
        lower: bound in the parameter's unit; the density outside the bounds is 0.
        upper: likewise, above the lower one.

    Raises:
        InputError: bounds that are not finite or not in order, a function that gives no number, or a density that has no total or is too
            narrow for its bounds.
    """
    place = "prior of a density"
    check_order(lower, upper, place, remedy="give bounds that hold nearly all of its probability")
    try:
        density = jax.jit(jnp.vectorize(log_pdf))
        density(np.array([0.5 * (lower + upper)]))
    except Exception as error:  # whatever the user's function raises
        raise InputError(
            place,
            found=f"{type(error).__name__}: {str(error).partition(chr(10))[0]}",
            expected="a function of one value that JAX can compile",
            remedy="write it with jax.numpy, for example lambda x: -0.5 * ((x + 10.0) / 2.0) ** 2",
        ) from error
    mean, sd = 0.5 * (lower + upper), (upper - lower) / 12**0.5
    half = log_total = np.nan
    for _ in range(PASSES):
        half, *_ = _moments(density, lower, upper, mean, sd, CELLS // 32)
        log_total, mean, sd = _moments(density, lower, upper, mean, sd, CELLS // 16)
        if not np.isfinite(log_total):
            raise InputError(
                place,
                found=f"a density without a finite total between {lower:g} and {upper:g}",
                expected="a log density that is a number, or -inf for an impossible value",
                remedy=f"look at the values of {shown(log_pdf)} between the bounds",
            )
        if not sd > 0:
            break
    if not (sd > 0 and abs(half - log_total) < MAX_DISAGREEMENT):
        raise InputError(
            place,
            found=f"a density that is much narrower than {lower:g} to {upper:g}, or has a jump",
            expected="one that varies slowly over a thousandth of its standard deviation",
            remedy="move the bounds to the density",
        )
    return DensityPrior(TruncatedNormal(mean, sd, lower, upper, mean, sd, 0.0), log_total, log_pdf)


def _moments(
    density: Any, lower: float, upper: float, mean: float, sd: float, cells: int
) -> tuple[float, float, float]:
    """Return the log total, mean and standard deviation by 16 Gauss-Legendre nodes in each cell, which are closest about `mean`."""
    edges = np.linspace(*_ends(lower, upper, mean, sd, np), cells + 1)
    nodes, weights = np.polynomial.legendre.leggauss(16)
    t = 0.5 * (edges[1:] + edges[:-1])[:, None] + 0.5 * np.diff(edges)[:, None] * nodes
    value = np.clip(mean + sd * np.sinh(t), lower, upper)
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = np.asarray(density(value)) + np.log(0.5 * np.diff(edges)[:, None] * weights * sd * np.cosh(t))
        peak = logs.max()
        mass = np.exp(logs - peak)
        share = mass / mass.sum()
        mean = float((share * value).sum())
        variance = float((share * (value - mean) ** 2).sum())
        return float(np.log(mass.sum()) + peak), mean, variance**0.5


def _ends(lower: Any, upper: Any, mean: Any, sd: Any, numpy: Any) -> tuple[Any, Any]:
    """Return where the bounds lie on the line of t, with value = mean + sd sinh(t)."""
    return numpy.arcsinh((lower - mean) / sd), numpy.arcsinh((upper - mean) / sd)
