"""How well a vehicle's prior explains data that it made itself: log p(y | c) - log p(y), by importance draws about the mode.

    p(y) = int p(y | c) p(c) dc = E_q[p(y | c) p(c) / q(c)],  q a multivariate t at the posterior mode

The mode is found by damped Gauss-Newton steps from the coefficients that made the data, which lie close to it.
"""

from collections.abc import Callable
from functools import partial
from math import lgamma, log, pi
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.special import logsumexp

from seatrial.core.batching import map_lanes
from seatrial.design.prior_belief import Belief, log_priors, outputs_of
from seatrial.design.trial_plan import TrialPlan

FREEDOM = 8
"""Degrees of freedom of the multivariate t from which importance draws come: its tails are never lighter than those of a posterior."""


class Explained(NamedTuple):
    """Of m simulated data sets.

    Attributes:
        gain: log p(y | c) - log p(y), shape (m,).
        chance: the part of the gain that this very noise and this very c are expected to make, from a linear model at c, shape
            (m,). Its mean is exactly the entropy of z before the trial, whatever the model: a control variate.
        ess: effective importance draws, shape (m,).
    """

    gain: Float[np.ndarray, " m"]
    chance: Float[np.ndarray, " m"]
    ess: Float[np.ndarray, " m"]


def explain(
    plan: TrialPlan,
    belief: Belief,
    control: Float[Array, "n c"],
    key: jax.Array,
    which: Int[Array, " m"],
    z: Float[Array, "m k"],
    inner: int,
    climbs: int,
) -> Explained:
    """Simulate data at every z and explain them.

    Args:
        plan: vehicle, start and sensors.
        belief: what is known of the coefficients.
        control: every control, held from each sample to the next, SI.
        key: random key of the noise and of the importance draws.
        which: number of each outer draw: the same number gives the same noise.
        z: of the coefficients that make the data.
        inner: importance draws for each, an even number.
        climbs: Gauss-Newton steps.
    """
    noise_key, draw_key = jax.random.split(key)
    noise = noise_of(noise_key, which, plan.weight.size)
    t = np.stack([_student(random, inner, z.shape[1]) for random in _generators(draw_key, which)])
    found = _explain(plan, belief, control, z, jnp.asarray(noise), jnp.asarray(t), climbs)
    log_prior, log_weight, origin = jax.tree.map(np.asarray, found)
    total = logsumexp(log_weight, axis=1)
    ess = np.exp(2.0 * total - logsumexp(2.0 * log_weight, axis=1))
    return Explained(np.log(inner) - total, _chance(np.asarray(z), origin) - log_prior, ess)


def noise_of(key: jax.Array, which: Int[Array, " m"], size: int) -> Float[np.ndarray, "m size"]:
    """White noise of each outer draw, the same for every design and however many draws there are."""
    return np.stack([random.normal(size=size) for random in _generators(key, which)])


def _generators(key: jax.Array, which: Array) -> list[np.random.Generator]:
    return [np.random.default_rng([*np.asarray(jax.random.key_data(key)), i]) for i in np.asarray(which)]


def _student(random: np.random.Generator, n: int, d: int) -> np.ndarray:
    """Draws of the standard multivariate t in opposite pairs, which cancel skewness."""
    half = random.normal(size=(n // 2, d)) * np.sqrt(FREEDOM / random.chisquare(FREEDOM, (n // 2, 1)))
    return np.concatenate([half, -half])


def _chance(z: np.ndarray, origin: "_Slopes") -> np.ndarray:
    """`Explained.chance` but for -log p(z).

    With slopes J at the origin z, g = J^T noise and S = (J^T J + prior precision)^-1, a linear model with a normal prior gains
    0.5 ln det S^-1 - log p(z) - 0.5 g^T S g + g^T S z and terms that the noise does not enter. Over the noise g has mean 0 and
    covariance J^T J.
    """
    spread = np.linalg.inv(origin.precision)
    turned = np.einsum("mij,mj->mi", spread, origin.pull)
    expected = np.einsum("mij,mji->m", spread, origin.information)
    return 0.5 * (expected - (origin.pull * turned).sum(1)) + (turned * z).sum(1)


class _Slopes(NamedTuple):
    """At one z: information J^T J, pull J^T (measured - shown), and precision of a posterior there."""

    information: Array
    pull: Array
    precision: Array


class _Peak(NamedTuple):
    """The best point so far: z, its height, precision of a posterior there and the step from here."""

    z: Array
    height: Array
    precision: Array
    step: Array


@partial(jax.jit, static_argnums=6)
def _explain(
    plan: TrialPlan, belief: Belief, control: Array, z: Array, noise: Array, t: Array, climbs: int
) -> tuple[Array, Array, _Slopes]:
    """Log prior density of each z, log weights of its importance draws, and slopes at it."""
    outputs = partial(outputs_of, plan, belief, control)
    measured = jax.vmap(outputs)(z) + noise
    peak, origin = jax.vmap(partial(_climb, outputs, belief, climbs))(z, measured, noise)

    def weigh(args: tuple) -> Array:
        peak, measured, noise, t = args
        factor = jnp.linalg.cholesky(peak.precision)
        points = peak.z + jax.scipy.linalg.solve_triangular(factor, t.T, lower=True, trans=1).T
        height = jax.vmap(lambda point: _height(belief, outputs(point), point, measured, noise))(points)
        log_weight = height - _log_student(t) - jnp.sum(jnp.log(jnp.diag(factor)))
        return jnp.where(jnp.isnan(log_weight), -jnp.inf, log_weight)  # diverged: it cannot have made the data

    log_prior = jnp.sum(jax.vmap(partial(log_priors, belief))(z), 1)
    return log_prior, map_lanes(weigh, (peak, measured, noise, t)), origin


def _log_student(t: Array) -> Array:
    d = t.shape[1]
    power = 0.5 * (FREEDOM + d)
    constant = lgamma(power) - lgamma(0.5 * FREEDOM) - 0.5 * d * log(FREEDOM * pi)
    return constant - power * jnp.log1p(jnp.sum(t**2, 1) / FREEDOM)


def _height(belief: Belief, shown: Array, z: Array, measured: Array, noise: Array) -> Array:
    """Log prior density plus log-likelihood of z, less that of the coefficients that made the data."""
    return jnp.sum(log_priors(belief, z)) - 0.5 * jnp.sum((measured - shown) ** 2 - noise**2)


def _climb(
    outputs: Callable[[Array], Array], belief: Belief, climbs: int, origin: Array, measured: Array, noise: Array
) -> tuple[_Peak, _Slopes]:
    """Damped Gauss-Newton steps from the coefficients that made the data, and the slopes there."""

    def both(z: Array) -> tuple[Array, Array]:
        shown = outputs(z)
        return shown, shown

    def visit(carry: tuple, _: None) -> tuple[tuple, _Slopes]:
        best, candidate = carry
        slope, shown = jax.jacfwd(both, has_aux=True)(candidate)
        information, pull = slope.T @ slope, slope.T @ (measured - shown)
        precision, rise = _with_prior(belief, candidate, information)
        there = _Peak(
            candidate,
            _height(belief, shown, candidate, measured, noise),
            precision,
            jax.scipy.linalg.cho_solve((jnp.linalg.cholesky(precision), True), pull + rise),
        )
        better = there.height > best.height
        shorter = best._replace(step=0.25 * best.step)
        best = jax.tree.map(partial(jnp.where, better), there, shorter)
        return (best, best.z + best.step), _Slopes(information, pull, precision)

    k = origin.size
    nowhere = _Peak(origin, jnp.asarray(-jnp.inf), jnp.eye(k), jnp.zeros(k))
    (best, _), slopes = jax.lax.scan(visit, (nowhere, origin), None, length=climbs + 1)
    return best, jax.tree.map(lambda x: x[0], slopes)


def _with_prior(belief: Belief, z: Array, information: Array) -> tuple[Array, Array]:
    """Precision of the posterior and slope of the log prior, which has unit variance also where it has no curvature."""

    def total(z: Array) -> Array:
        return jnp.sum(log_priors(belief, z))

    rise, curvature = jax.jvp(jax.grad(total), (z,), (jnp.ones_like(z),))
    return information + jnp.diag(jnp.maximum(-curvature, 1.0)), rise
