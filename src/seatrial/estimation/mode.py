"""The fast answer: posterior mode by trust-region Newton with exact derivatives, and the normal approximation there.

Derivatives are forward: through thousands of time steps and a handful of parameters they cost a few simulations and no memory.
"""

from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import minimize

from seatrial.core.errors import NumericalError
from seatrial.core.programs import program
from seatrial.estimation.posterior import Posterior, as_key
from seatrial.sampling.target import AT_ONCE, evaluate

if TYPE_CHECKING:
    from pandas import DataFrame

FLAT = 1e-2
"""Curvature in unconstrained space, where every prior has unit spread, that would make the posterior ten times wider than its prior."""


class Mode(NamedTuple):
    """Posterior mode in unconstrained space and the Laplace approximation about it.

    Attributes:
        z: mode, shape (d,).
        precision: negative Hessian of the log posterior density, shape (d, d).
        cov: its inverse, shape (d, d).
        log_density: unnormalised log posterior density at the mode.
        log_evidence: Laplace approximation of the log evidence.
        values: the mode in the parameters' own units, shape (d,).
        sd: delta-method standard deviations of `values`, shape (d,).
        flat: whether a direction had no curvature, so that its variance was set to the prior's.
        names: of the parameters.
        units: theirs, SI.
    """

    z: Float[np.ndarray, " d"]
    precision: Float[np.ndarray, "d d"]
    cov: Float[np.ndarray, "d d"]
    log_density: float
    log_evidence: float
    values: Float[np.ndarray, " d"]
    sd: Float[np.ndarray, " d"]
    flat: bool
    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()

    @property
    def by_name(self) -> dict[str, float]:
        """The mode by parameter name, SI."""
        return dict(zip(self.names, map(float, self.values), strict=True))

    def summary(self) -> "DataFrame":
        """Return a table with a row for each parameter: unit, value at the mode, and standard deviation of the normal approximation."""
        from pandas import DataFrame

        return DataFrame({"unit": self.units, "mode": self.values, "sd": self.sd}, index=list(self.names))


def find_mode(posterior: Posterior, key: jax.Array | int = 0, starts: int = 512, tries: int = 3) -> Mode:
    """Maximise the posterior density from the best of many prior draws, and from the best of them moved to the posterior's guess.

    Args:
        posterior: density to maximise.
        key: random key of the prior draws, or a seed.
        starts: prior draws that are evaluated.
        tries: of these, how many of the best are followed to their maximum. One from which the density only rises on the
            straight way to a maximum already found is not: it has nothing else to show.

    Raises:
        NumericalError: no prior draw has a finite likelihood, or no maximum was found.
    """
    candidates = np.asarray(posterior.sample_prior(as_key(key), starts))
    drawn = _best(evaluate(posterior, candidates))[:tries]
    followed = [*_guessed(posterior, candidates), *candidates[drawn]]
    if not followed:
        raise NumericalError(
            f"none of {starts} draws from the prior gives a finite likelihood: under this prior the model diverges, for example at "
            f"{_point(posterior, candidates[0])}. Narrow the prior to damping that dissipates (negative coefficients), or check units."
        )
    results: list[tuple[np.ndarray, float]] = []
    lost = None
    for start in followed:
        if not any(rises(posterior, start, z) for z, _ in results):
            try:
                results.append(_climb(posterior, start))
            except NumericalError as error:
                lost = error
    if lost is not None and not results:
        raise lost
    z, log_density = max(results, key=lambda pair: pair[1])
    if not np.isfinite(log_density):
        raise NumericalError("the search for the posterior mode left the region of finite likelihood; narrow the prior")
    return _about(posterior, z, log_density)


def climb(posterior: Posterior, start: Float[np.ndarray, " d"]) -> Mode:
    """Follow one start to the mode above it.

    Raises:
        NumericalError: the log-likelihood has no finite derivative on the way.
    """
    return _about(posterior, *_climb(posterior, start))


def rises(posterior: Posterior, start: Float[np.ndarray, " d"], end: Float[np.ndarray, " d"]) -> bool:
    """Return whether the density never falls on the straight way, looked at in as many places as are computed at once.

    Args:
        posterior: whose density is followed.
        start: where the way begins, z, shape (d,).
        end: where it ends, z, shape (d,).
    """
    way = np.linspace(0.0, 1.0, AT_ONCE)[:, None]
    height = evaluate(posterior, start + way * (end - start))
    return bool(np.isfinite(height).all() and (np.diff(height) > 0).all())


def _about(posterior: Posterior, z: np.ndarray, log_density: float) -> Mode:
    """Normal approximation about a mode."""
    hessian = np.asarray(_expand(posterior, jnp.asarray(z)).hessian)
    precision = -0.5 * (hessian + hessian.T)
    cov, log_volume, flat = _invert(precision)
    slope = np.asarray(_slope(posterior, jnp.asarray(z)))
    return Mode(
        z,
        precision,
        cov,
        log_density,
        log_density + 0.5 * posterior.dim * np.log(2 * np.pi) + log_volume,
        np.asarray(posterior.constrain(jnp.asarray(z))),
        np.abs(slope) * np.sqrt(np.diag(cov)),
        flat,
        posterior.names,
        tuple(parameter.unit for parameter in posterior.parameters),
    )


def _best(densities: np.ndarray) -> np.ndarray:
    """Places of the finite densities, the largest first."""
    order = np.argsort(-densities)
    return order[np.isfinite(densities[order])]


def _guessed(posterior: Posterior, candidates: np.ndarray) -> np.ndarray:
    """Return the best candidate with what the posterior guesses in place of what was drawn, shape (1, d); none without a guess."""
    if posterior.guess is None or np.isnan(posterior.guess).all():
        return candidates[:0]
    known = ~np.isnan(posterior.guess)
    z = np.asarray(posterior.unconstrain(jnp.where(known, posterior.guess, posterior.constrain(candidates[0]))))
    moved = np.where(known, z, candidates)
    return moved[_best(evaluate(posterior, moved))[:1]]


class _Expansion(NamedTuple):
    """Log density at one point, its gradient, shape (d,), and its Hessian, shape (d, d)."""

    value: Array
    gradient: Array
    hessian: Array


@program
def _expand(posterior: Posterior, z: Array) -> _Expansion:
    """Return all three at once: one program to compile instead of three, and compiling is most of the time."""

    def value_twice(z: Array) -> tuple[Array, Array]:
        value = posterior.log_density(z)
        return value, value

    def gradient_twice(z: Array) -> tuple[Array, tuple[Array, Array]]:
        gradient, value = jax.jacfwd(value_twice, has_aux=True)(z)
        return gradient, (gradient, value)

    hessian, (gradient, value) = jax.jacfwd(gradient_twice, has_aux=True)(z)
    return _Expansion(value, gradient, hessian)


@program
def _slope(posterior: Posterior, z: Array) -> Array:
    """Return the derivative of each parameter's value with respect to its own z."""
    return jax.jvp(posterior.constrain, (z,), (jnp.ones_like(z),))[1]


def _climb(posterior: Posterior, start: np.ndarray) -> tuple[np.ndarray, float]:
    """Follow one start to its maximum; steps that end where the likelihood is zero are refused by the trust region."""
    expand = lru_cache(maxsize=2)(lambda z: _expand(posterior, jnp.asarray(z)))

    def height(z: np.ndarray) -> float:
        density = float(expand(tuple(z)).value)
        return -density if np.isfinite(density) else 1e100

    def derivative(z: np.ndarray, order: str) -> np.ndarray:
        values = -np.asarray(getattr(expand(tuple(z)), order))
        if not np.isfinite(values).all():
            at = _point(posterior, z)
            raise NumericalError(f"the log-likelihood has no finite derivative at {at}; narrow the priors around there")
        return values

    result = minimize(
        height,
        start,
        method="trust-exact",
        jac=lambda z: derivative(z, "gradient"),
        hess=lambda z: derivative(z, "hessian"),
        options={"gtol": 1e-6, "maxiter": 300},
    )
    return result.x, -float(result.fun)


def _point(posterior: Posterior, z: np.ndarray) -> str:
    """Return the values of the parameters there, in words."""
    values = np.asarray(posterior.constrain(jnp.asarray(z)))
    return ", ".join(f"{name} = {value:.4g}" for name, value in zip(posterior.names, values, strict=True))


def _invert(precision: np.ndarray) -> tuple[np.ndarray, float, bool]:
    """Inverse, half its log-determinant, and whether a direction without curvature was given unit precision, the prior's order."""
    values, vectors = np.linalg.eigh(precision)
    flat = bool((values <= FLAT).any())
    values = np.where(values <= FLAT, 1.0, values)
    return (vectors / values) @ vectors.T, -0.5 * float(np.log(values).sum()), flat
