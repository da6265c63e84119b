"""Expected information gain of one design under the whole prior: mutual information of the coefficients c and the data y, nats.

    EIG = E[log p(y | c) - log p(y)],  c from the prior, y = outputs(c) + noise          Lindley, Ann. Math. Stat. 27, 1956

The noise is normal and white, of the standard deviations that the plan states, which are known. An autopilot sees it, and p(y | c) is then
that of the outputs given the controls that were logged, as in the fit. Two estimates, of the same prior draws:

- Laplace: the posterior taken as normal at each prior draw, E[0.5 ln det(I + N F)] (Long et al., CMAME 259, 2013), with F
  the information about z and N the entropy power of its prior; for one coefficient that y shows linearly it is a lower bound for
  any prior, and exact for a normal one.
- nested Monte Carlo: log p(y) of simulated data by importance draws about its posterior mode (Ryan, J. Comput. Graph. Stat. 12,
  2003; Beck et al., CMAME 334, 2018). The Laplace gain, whose mean is known far better, takes most of the noise out of it.

The same key gives the same coefficients and the same noise for every design.

Importance draws come from a multivariate t at the posterior mode, p(y) = E_q[p(y | c) p(c) / q(c)]; the mode is found by
damped Gauss-Newton steps from the coefficients that made the data, which lie close to it.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from math import lgamma, log, pi
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float, Int

from seatrial.compiled.batching import map_lanes
from seatrial.compiled.programs import program
from seatrial.core.errors import NumericalError
from seatrial.design.prior_belief import Belief, draw_z, entropies, log_priors, outputs_of, values_of
from seatrial.design.sweep import in_blocks
from seatrial.design.trial_plan import TrialPlan
from seatrial.numerics.triangular import cholesky_of_array

# Degrees of freedom of the multivariate t from which importance draws come: its tails are never lighter than those of
# a posterior
FREEDOM = 8
# An estimate is refused if more than this share of its outer draws rest on fewer than so many effective inner draws
MIN_ESS, MAX_POOR_SHARE = 8.0, 0.05


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


class _Slopes(NamedTuple):
    """At one z: information J^T J, pull J^T noise, and precision of a posterior there."""

    information: Array
    pull: Array
    precision: Array


class _Peak(NamedTuple):
    """The best point so far: z, its height, precision of a posterior there and the step from here."""

    z: Array
    height: Array
    precision: Array
    step: Array


MAX_CURVATURE = 10.0  # Curvature of a prior that the normal about a peak follows at most, per square of z


@dataclass(frozen=True)
class Gain:
    """Expected information gain of one design.

    Attributes:
        value: estimate, nats.
        std_error: its Monte Carlo standard error.
        diagnostics: numbers for its reliability.
        status: empty if healthy, else why not to use it.
    """

    value: float
    std_error: float
    diagnostics: dict[str, Any] = field(default_factory=dict)
    status: str = ""


@dataclass(frozen=True)
class GainSettings:
    """Size of a run.

    Attributes:
        draws: prior draws of the Laplace gain.
        outer: of these, how many are simulated with noise, a multiple of `sweep.LANES` for speed.
        inner: importance draws for each of them, an even number.
        climbs: Gauss-Newton steps from the generating coefficients to the posterior mode.
    """

    draws: int = 1600
    outer: int = 160
    inner: int = 64
    climbs: int = 8


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
    result = _explain(plan, belief, control, z, noise, t, climbs)
    log_prior, log_weight, origin = jax.tree.map(np.asarray, result)
    total, double = (np.asarray(scipy.special.logsumexp(times * log_weight, axis=1)) for times in (1.0, 2.0))
    ess = np.exp(2.0 * total - double)
    return Explained(np.log(inner) - total, _chance(np.asarray(z), origin) - log_prior, ess)


def noise_of(key: jax.Array, which: Int[Array, " m"], size: int) -> Float[np.ndarray, "m size"]:
    """White noise of each outer draw, the same for every design and however many draws there are.

    Args:
        key: random key.
        which: number of each outer draw.
        size: numbers of each.
    """
    return np.stack([random.normal(size=size) for random in _generators(key, which)])


def importance_gain(
    plan: TrialPlan,
    belief: Belief,
    control: Float[np.ndarray, "n c"],
    key: jax.Array,
    settings: GainSettings = GainSettings(),
) -> Gain:
    """Return the expected information gain by nested Monte Carlo with importance draws about each posterior mode.

    What it cannot see: a second mode of a posterior, far from the coefficients that made the data; the gain is then too large, by
    ln 2 at most where there are two.

    Args:
        plan: vehicle, start and sensors; the standard deviations of the noise are taken as known.
        belief: what is known of the coefficients before the trial.
        control: every control, held from each sample to the next, SI.
        key: random key of the prior draws.
        settings: sizes; the first of the prior draws are those that are simulated with noise.

    Raises:
        NumericalError: the simulation diverges for some of the prior draws; it says how many.

    Returns:
        The gain. Its diagnostics hold `laplace`, the Laplace gain of the same draws, the `correction` to it with its error, and
        the effective inner draws of the median outer draw and of the one at the share `MAX_POOR_SHARE` from below.
    """
    z, local = _local_gains(plan, belief, control, key, settings.draws)
    m, held = settings.outer, jax.device_put(np.asarray(control, float))
    key = jax.random.fold_in(key, 1)
    result, chance, ess = in_blocks(
        lambda which, point: explain(plan, belief, held, key, which, point, settings.inner, settings.climbs),
        np.arange(m),
        z[:m],
    )
    if not np.isfinite(result).all():
        raise NumericalError(
            f"for {np.sum(~np.isfinite(result))} of {m} simulated trials no importance draw about the posterior mode can be "
            "simulated: narrow the prior, or excite less"
        )
    correction = result - (local[:m] + chance - np.sum(entropies(belief)))
    value, joint = float(local.mean() + correction.mean()), np.cov(local[:m], correction)
    variance = local.var(ddof=1) / settings.draws + joint[1, 1] / m + 2.0 * joint[0, 1] / settings.draws
    diagnostics = {
        "draws": settings.draws,
        "outer": m,
        "inner": settings.inner,
        "laplace": float(local.mean()),
        "correction": float(correction.mean()),
        "correction_error": float(np.sqrt(joint[1, 1] / m)),
        "median_ess": float(np.median(ess)),
        "low_ess": float(np.quantile(ess, MAX_POOR_SHARE)),
    }
    return Gain(value, float(np.sqrt(variance)), diagnostics, _refusal(ess, settings.inner))


def _generators(key: jax.Array, which: Array) -> list[np.random.Generator]:
    return [np.random.default_rng([*np.asarray(jax.random.key_data(key)), i]) for i in np.asarray(which)]


def _student(random: np.random.Generator, n: int, d: int) -> np.ndarray:
    """Return the draws of the standard multivariate t in opposite pairs, which cancel skewness."""
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


@program(static_argnums=6)
def _explain(
    plan: TrialPlan, belief: Belief, control: Array, z: Array, noise: Array, t: Array, climbs: int
) -> tuple[Array, Array, _Slopes]:
    """Return the log prior density of each z, log weights of its importance draws, and slopes at it."""
    given_controls = replace(plan, autopilot=None)

    def made(z: Array, noise: Array) -> tuple[Array, Array]:
        """Return the controls that are logged, and all measurements; an autopilot sees the sensors with their noise."""
        logged = plan.applied(values_of(belief, z), control, noise.reshape(plan.weight.shape))
        return logged, outputs_of(given_controls, belief, logged, z) + noise

    def about(z: Array, noise: Array) -> _Slopes:
        """Slopes along the motion that perfect sensors would make, so that they do not depend on the noise."""
        logged = plan.applied(values_of(belief, z), control)
        slope = jax.jacfwd(partial(outputs_of, given_controls, belief, logged))(z)
        information = slope.T @ slope
        return _Slopes(information, slope.T @ noise, _with_prior(belief, z, information)[0])

    def climbed(z: Array, logged: Array, measured: Array, noise: Array) -> _Peak:
        return _climb(partial(outputs_of, given_controls, belief, logged), belief, climbs, z, measured, noise)

    logged, measured = jax.vmap(made)(z, noise)
    peak = jax.vmap(climbed)(z, logged, measured, noise)

    def weigh(args: tuple) -> Array:
        peak, logged, measured, noise, t = args
        factor = jnp.linalg.cholesky(peak.precision)
        points = peak.z + jax.scipy.linalg.solve_triangular(factor, t.T, lower=True, trans=1).T
        shown = jax.vmap(partial(outputs_of, given_controls, belief, logged))(points)
        height = jax.vmap(lambda point, shown: _height(belief, shown, point, measured, noise))(points, shown)
        log_weight = height - _log_student(t) - jnp.sum(jnp.log(jnp.diag(factor)))
        return jnp.where(jnp.isnan(log_weight), -jnp.inf, log_weight)  # diverged: it cannot have made the data

    log_prior = jnp.sum(jax.vmap(partial(log_priors, belief))(z), 1)
    return log_prior, map_lanes(weigh, (peak, logged, measured, noise, t)), jax.vmap(about)(z, noise)


def _log_student(t: Array) -> Array:
    d = t.shape[1]
    power = 0.5 * (FREEDOM + d)
    constant = lgamma(power) - lgamma(0.5 * FREEDOM) - 0.5 * d * log(FREEDOM * pi)
    return constant - power * jnp.log1p(jnp.sum(t**2, 1) / FREEDOM)


def _height(belief: Belief, shown: Array, z: Array, measured: Array, noise: Array) -> Array:
    """Return the log prior density plus log-likelihood of z, less that of the coefficients that made the data."""
    return jnp.sum(log_priors(belief, z)) - 0.5 * jnp.sum((measured - shown) ** 2 - noise**2)


def _climb(
    outputs: Callable[[Array], Array], belief: Belief, climbs: int, origin: Array, measured: Array, noise: Array
) -> _Peak:
    """Damped Gauss-Newton steps from the coefficients that made the data."""

    def both(z: Array) -> tuple[Array, Array]:
        shown = outputs(z)
        return shown, shown

    def visit(carry: tuple, _: None) -> tuple[tuple, None]:
        best, candidate = carry
        slope, shown = jax.jacfwd(both, has_aux=True)(candidate)
        information, pull = slope.T @ slope, slope.T @ (measured - shown)
        precision, rise = _with_prior(belief, candidate, information)
        peak = _Peak(
            candidate,
            _height(belief, shown, candidate, measured, noise),
            precision,
            jax.scipy.linalg.cho_solve((cholesky_of_array(precision), True), pull + rise),
        )
        better = peak.height > best.height
        shorter = best._replace(step=0.25 * best.step)
        best = jax.tree.map(partial(jnp.where, better), peak, shorter)
        return (best, best.z + best.step), None

    k = origin.size
    nowhere = _Peak(origin, jnp.asarray(-jnp.inf), jnp.eye(k), jnp.zeros(k))
    (best, _), _ = jax.lax.scan(visit, (nowhere, origin), None, length=climbs + 1)
    return best


def _with_prior(belief: Belief, z: Array, information: Array) -> tuple[Array, Array]:
    """Precision of the posterior and slope of the log prior, which has unit variance also if it has no curvature.

    Within the corner of a box it bends by hundreds, over some hundredths of z: a normal as narrow as that would miss what is inside.
    """

    def total(z: Array) -> Array:
        return jnp.sum(log_priors(belief, z))

    rise, curvature = jax.jvp(jax.grad(total), (z,), (jnp.ones_like(z),))
    return information + jnp.diag(jnp.clip(-curvature, 1.0, MAX_CURVATURE)), rise


def _local_gains(
    plan: TrialPlan, belief: Belief, control: np.ndarray, key: jax.Array, n: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the prior draws z, shape (n, k), and 0.5 ln det(I + N F) at each."""
    z, held = draw_z(belief, key, n), jax.device_put(np.asarray(control, float))
    information = in_blocks(lambda point: (_information(plan, belief, held, point),), z)[0]
    _refuse_divergence(belief, plan, z, np.isfinite(information).all((1, 2)))
    width = np.exp(entropies(belief)) / np.sqrt(2.0 * np.pi * np.e)
    return z, 0.5 * np.linalg.slogdet(np.eye(len(width)) + information * np.outer(width, width))[1]


@program
def _information(plan: TrialPlan, belief: Belief, control: Array, z: Array) -> Array:
    """Return the information about z."""

    def one(z: Array) -> Array:
        slope = jax.jacfwd(partial(values_of, belief))(z)
        return slope.T @ plan.information(values_of(belief, z), control) @ slope

    return jax.vmap(one)(z)


def _refusal(ess: np.ndarray, inner: int) -> str:
    share = float(np.mean(~(ess >= MIN_ESS)))
    if share <= MAX_POOR_SHARE:
        return ""
    return (
        f"refused: {share:.0%} of {ess.size} outer draws rest on fewer than {MIN_ESS:.0f} effective of {inner} inner draws "
        f"(median {np.median(ess):.1f}): use more of them"
    )


def _refuse_divergence(belief: Belief, plan: TrialPlan, z: np.ndarray, finite: np.ndarray) -> None:
    if finite.all():
        return
    first = np.asarray(values_of(belief, z[np.argmin(finite)]))
    at = ", ".join(f"{name} = {x:.4g}" for name, x in zip(plan.names, first, strict=True))
    raise NumericalError(
        f"the simulation diverges for {np.sum(~finite)} of {finite.size} draws from the prior, first at {at} (SI), so the gain of this "
        f"design is not defined. Narrow the prior to damping that dissipates, or excite less"
    )
