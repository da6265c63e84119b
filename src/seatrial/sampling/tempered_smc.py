"""Adaptive tempered sequential Monte Carlo (Del Moral, Doucet and Jasra 2006).

Particles start as draws from the prior, less those whose likelihood is zero, and go through p(z) L(z)^b with b from 0 to 1.

    repeat until b = 1
        b' = the largest for which the weights L^(b' - b) keep the stated effective sample size
        log Z <- log Z + log of the mean weight
        resample systematically, b <- b'
        move each particle by random-walk Metropolis, with the covariance of all of them, scaled so that about a
            quarter of the moves are accepted

A particle carries its likelihood with it: nothing is evaluated but the places that moves propose.
"""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import logsumexp
from jaxtyping import Array, Float

from seatrial.compiled.batching import map_lanes
from seatrial.compiled.programs import program
from seatrial.compiled.random_keys import fold_in, split
from seatrial.core.argument_checks import check_count, check_number
from seatrial.core.errors import NumericalError
from seatrial.core.reporter import Progress, no_progress
from seatrial.sampling.adaptive_metropolis import TARGET_ACCEPTANCE
from seatrial.sampling.target import AT_ONCE, LANES, Target, evaluate_parts
from seatrial.sampling.walk import log_ratio_of, mean_acceptance

_GAIN = 2.0  # How fast the scale of the moves follows their acceptance
_START = 1e-30  # First temperature: no finite likelihood is felt there, and one of 0 still is
_HALVINGS = 80  # Of the interval in which the next temperature lies, on a scale of logarithms: to the last bit


@dataclass(frozen=True)
class SMCSettings:
    """Size of a run.

    Attributes:
        particles: number of particles; None for max(512, 64 d).
        moves: Metropolis moves of each particle at each temperature; None for max(8, 2 d, d^2 / 5).
        target_ess: effective share of the particles each temperature step keeps, above 0 and below 1. With 0.5 the error of log Z is
            1.5 times that with 0.7, for seven tenths of the evaluations, and stated less correctly: a regression with
            unknown noise, 200 runs.

    Raises:
        InputError: a size that is none of these.
    """

    particles: int | None = None
    moves: int | None = None
    target_ess: float = 0.7

    def __post_init__(self) -> None:
        """Refuse sizes of no run."""
        if self.particles is not None:
            check_count(self.particles, "SMCSettings, particles", least=2, remedy="take a few hundred or more")
        if self.moves is not None:
            check_count(
                self.moves, "SMCSettings, moves", remedy="leave it out: it follows from the number of parameters"
            )
        check_number(self.target_ess, "SMCSettings, target_ess", above=0.0, below=1.0, remedy="0.5 to 0.9 is usual")

    def particles_for(self, dim: int) -> int:
        """Return the number of particles for a target of `dim` parameters."""
        return self.particles if self.particles is not None else max(512, 64 * dim)

    def moves_for(self, dim: int) -> int:
        """Return the number of moves at each temperature for a target of `dim` parameters.

        At 20 parameters 2 d moves bias log Z by 0.2 nats, more than the stated error; 4 d do not, measured.
        """
        return self.moves if self.moves is not None else max(8, 2 * dim, dim * dim // 5)


class Particles(NamedTuple):
    """Where particles are: z, shape (..., d), and log prior density and log-likelihood there, shape (...)."""

    z: Array
    log_prior: Array
    log_likelihood: Array


class TemperedStart(NamedTuple):
    """Equally weighted draws from p(z) L(z)^b, of shape (particles, d), b, and the share of the prior where the likelihood is not zero."""

    at: Particles
    temperature: float
    alive: float = 1.0


class SMCResult(NamedTuple):
    """Outcome of one run.

    Attributes:
        log_evidence: estimate of log of the integral of prior times likelihood.
        particles: equally weighted draws from the posterior, shape (particles, d).
        temperatures: b after each step; the last is 1.
        acceptance: mean acceptance of the moves at each temperature.
        alive: share of the draws from the prior with a finite likelihood.
        expected_variance: variance of log_evidence if particles were independent: (1 / e - 1) / N for every step that keeps a
            share e of N particles, the first draw included.
    """

    log_evidence: float
    particles: Float[np.ndarray, "particles d"]
    temperatures: Float[np.ndarray, " steps"]
    acceptance: Float[np.ndarray, " steps"]
    alive: float
    expected_variance: float


def prior_particles(target: Target, key: Array, n: int) -> TemperedStart:
    """Return draws from the prior, those whose likelihood is zero replaced by others."""
    draw_key, pick_key = split(key)
    blocks = [target.sample_prior(fold_in(draw_key, i), AT_ONCE) for i in range(-(-n // AT_ONCE))]
    drawn = np.concatenate([np.asarray(block) for block in blocks])[:n]
    at = Particles(drawn, *evaluate_parts(target, drawn))
    alive = np.flatnonzero(np.isfinite(at.log_prior + at.log_likelihood))
    if alive.size == 0:
        return TemperedStart(at, _START, 0.0)
    offset = np.random.default_rng(np.asarray(jax.random.key_data(pick_key))).uniform()
    picked = alive[(alive.size * (np.arange(n) + offset) / n).astype(int)]
    return TemperedStart(jax.tree.map(lambda array: array[picked], at), _START, alive.size / n)


def sample_tempered_smc(
    target: Target,
    key: jax.Array,
    settings: SMCSettings,
    progress: Progress = no_progress,
    max_steps: int = 500,
    start: TemperedStart | None = None,
) -> SMCResult:
    """Run one tempered SMC to the posterior, from the prior or from where an earlier run has come.

    Raises:
        NumericalError: the temperature stopped advancing, because almost no particle has a finite likelihood.
    """
    start_key, key = split(key)
    particles = settings.particles_for(target.dim)
    start = start or prior_particles(target, start_key, particles)
    alive = start.alive
    if alive == 0.0:
        raise NumericalError(
            f"none of {particles} draws from the prior has a finite likelihood: under this prior the model "
            "diverges. Narrow the prior to damping that dissipates (negative coefficients), or check units."
        )
    cloud = _Population(start.at, np.asarray(start.temperature, float), np.zeros(()))
    if alive < 1.0:  # apart what was copied into the places of others
        cloud, _, _ = _step(settings, target, cloud, fold_in(key, max_steps), start.temperature)
    log_evidence, temperatures, acceptance = float(np.log(alive)), [], []
    for iteration in range(max_steps):
        before = float(cloud.temperature)
        cloud, increment, accepted = _step(settings, target, cloud, fold_in(key, iteration), 1.0)
        temperature = float(cloud.temperature)
        log_evidence += float(increment)
        temperatures.append(temperature)
        acceptance.append(float(accepted))
        progress(round(1000 * (1 + np.log10(max(temperature, 1e-9)) / 9)), 1000)
        if temperature >= 1.0:
            lost = len(temperatures) * (1.0 / settings.target_ess - 1.0) + (1.0 / alive - 1.0)
            return SMCResult(
                log_evidence,
                np.asarray(cloud.at.z),
                np.array(temperatures),
                np.array(acceptance),
                alive,
                lost / particles,
            )
        if not np.isfinite(log_evidence) or temperature <= before:
            break
    raise NumericalError(
        f"tempered SMC stopped at temperature {temperatures[-1]:.3g} after {len(temperatures)} steps "
        f"(log evidence so far {log_evidence:.4g}): too few particles have a finite likelihood. "
        "Use more particles, or narrow the prior to values that can be simulated."
    )


class _Population(NamedTuple):
    """Equally weighted particles on their way: their places, b, and the logarithm of the scale of their moves."""

    at: Particles
    temperature: Array | np.ndarray
    log_scale: Array | np.ndarray


@program(static_argnums=0)
def _step(
    settings: SMCSettings, target: Target, cloud: _Population, key: Array, last: Array
) -> tuple[_Population, Array, Array]:
    """Take a step of temperature, to `last` at most, and move; also the log of the mean weight, and the mean acceptance."""
    pick_key, move_key = jax.random.split(key)
    n = settings.particles_for(target.dim)
    delta = _temperature_step(cloud, n * settings.target_ess, last)
    log_weights = delta * cloud.at.log_likelihood
    temperature = jnp.where(delta < last - cloud.temperature, cloud.temperature + delta, last)
    picked = _systematic(pick_key, log_weights)
    at = jax.tree.map(lambda array: array[picked], cloud.at)
    dim = at.z.shape[1]
    cov = jnp.cov(at.z, rowvar=False).reshape(dim, dim)
    # Particles that agree in a direction leave no factor of their covariance: a little is added to its diagonal.
    factor = jnp.linalg.cholesky(cov + 1e-10 * jnp.diag(jnp.diag(cov)) + 1e-300 * jnp.eye(dim))
    steps = jnp.exp(cloud.log_scale) * 2.38 / np.sqrt(target.dim) * factor
    move = partial(_move, target, settings.moves_for(target.dim), temperature, steps)
    at, accepted = map_lanes(lambda one: move(*one), (at, jax.random.split(move_key, n)), cpu=_lanes(settings, target))
    acceptance = jnp.mean(accepted)
    scale = cloud.log_scale + _GAIN * (acceptance - TARGET_ACCEPTANCE)
    return _Population(at, temperature, scale), logsumexp(log_weights) - np.log(n), acceptance


def _temperature_step(cloud: _Population, effective: float, last: Array) -> Array:
    """Return the largest step of temperature, to `last` at most, whose weights keep so many effective particles."""
    log_likelihood = cloud.at.log_likelihood
    whole = last - cloud.temperature

    def too_far(delta: Array) -> Array:
        log_weights = delta * log_likelihood
        return 2.0 * logsumexp(log_weights) - logsumexp(2.0 * log_weights) < np.log(effective)

    def halve(_: Array, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = ends
        middle = 0.5 * (low + high)
        far = too_far(jnp.exp(middle))
        return jnp.where(far, low, middle), jnp.where(far, middle, high)

    ends = jnp.log(_START * 1e-10), jnp.log(whole)
    low, _ = jax.lax.fori_loop(0, _HALVINGS, halve, ends)
    return jnp.where(too_far(whole), jnp.exp(low), whole)


def _systematic(key: Array, log_weights: Array) -> Array:
    """Return the indices of as many particles, drawn by systematic resampling (Kitagawa 1996): equal weights keep each once."""
    n = log_weights.size
    sums = jnp.cumsum(jax.nn.softmax(log_weights))
    places = (jnp.arange(n) + jax.random.uniform(key)) / n
    return jnp.minimum(jnp.searchsorted(sums / sums[-1], places), n - 1)


def _move(
    target: Target, moves: int, temperature: Array, steps: Array, at: Particles, key: Array
) -> tuple[Particles, Array]:
    """Move one particle by Metropolis steps of a covariance, whose factor is given; also the mean probability of acceptance."""

    def move(at: Particles, key: Array) -> tuple[Particles, Array]:
        step_key, accept_key = jax.random.split(key)
        proposed = _place(target, at.z + steps @ jax.random.normal(step_key, at.z.shape))
        log_ratio = log_ratio_of(_log_density(proposed, temperature), _log_density(at, temperature))
        accepted = jnp.log(jax.random.uniform(accept_key)) < log_ratio
        return jax.tree.map(lambda new, old: jnp.where(accepted, new, old), proposed, at), mean_acceptance(log_ratio)

    at, acceptance = jax.lax.scan(move, at, jax.random.split(key, moves))
    return at, jnp.mean(acceptance)


def _place(target: Target, z: Array) -> Particles:
    return Particles(z, target.log_prior(z), target.log_likelihood(z))


def _log_density(at: Particles, temperature: Array) -> Array:
    return at.log_prior + temperature * at.log_likelihood


def _lanes(settings: SMCSettings, target: Target) -> int:
    """Return how many particles go at once on a processor, so that no block is left over that would be compiled anew."""
    count = settings.particles_for(target.dim)
    return LANES if count % LANES == 0 else count
