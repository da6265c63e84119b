"""Adaptive tempered sequential Monte Carlo (Del Moral, Doucet and Jasra 2006), by BlackJAX.

Particles start as draws from the prior, less those whose likelihood is zero, and move through p(z) L(z)^b with b from 0 to
1, each step of b chosen so that the weights keep a stated effective sample size; in between they move by random-walk
Metropolis with the covariance of the particles, scaled so that about a quarter of the moves are accepted. The product of
the mean weights estimates the evidence.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.core.argument_checks import check_count, check_number
from seatrial.core.batching import lanes_at_once
from seatrial.core.errors import NumericalError
from seatrial.core.programs import program
from seatrial.core.progress import Progress, no_progress
from seatrial.core.random_keys import fold_in, split
from seatrial.sampling.adaptive_metropolis import TARGET_ACCEPTANCE
from seatrial.sampling.target import AT_ONCE, LANES, Target, evaluate

_FLOOR = -1e100
"""Stands for log 0 while tempering: 0 * (-inf) would be NaN."""
_GAIN = 2.0
"""How fast the scale of the moves follows their acceptance."""
_START = 1e-30
"""First temperature: no finite likelihood is felt there, and one of 0 still is."""


@dataclass(frozen=True)
class SMCSettings:
    """Size of a run.

    Attributes:
        particles: number of particles; None for max(512, 64 d).
        moves: Metropolis moves of each particle at each temperature; None for max(8, 2 d, d^2 / 5).
        target_ess: effective share of the particles each temperature step keeps, above 0 and below 1.

    Raises:
        InputError: a size that is none of these.
    """

    particles: int | None = None
    moves: int | None = None
    target_ess: float = 0.5

    def __post_init__(self) -> None:
        """Refuse sizes of no run."""
        if self.particles is not None:
            check_count(self.particles, "SMCSettings, particles", least=2, remedy="take a few hundred or more")
        if self.moves is not None:
            check_count(
                self.moves, "SMCSettings, moves", remedy="leave it out: it follows from the number of parameters"
            )
        check_number(self.target_ess, "SMCSettings, target_ess", above=0.0, below=1.0, remedy="0.5 is usual")

    def particles_for(self, dim: int) -> int:
        """Return the number of particles for a target of `dim` parameters."""
        return self.particles if self.particles is not None else max(512, 64 * dim)

    def moves_for(self, dim: int) -> int:
        """Return the number of moves at each temperature for a target of `dim` parameters.

        At 20 parameters 2 d moves bias log Z by 0.2 nats, more than the stated error; 4 d do not, measured.
        """
        return self.moves if self.moves is not None else max(8, 2 * dim, dim * dim // 5)


class Start(NamedTuple):
    """Equally weighted draws from p(z) L(z)^b, shape (particles, d), b, and the share of the prior where the likelihood is not zero."""

    particles: Float[np.ndarray, "particles d"]
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


def prior_particles(target: Target, key: Array, n: int) -> Start:
    """Return draws from the prior, those whose likelihood is zero replaced by others."""
    draw_key, pick_key = split(key)
    blocks = [target.sample_prior(fold_in(draw_key, i), AT_ONCE) for i in range(-(-n // AT_ONCE))]
    drawn = np.concatenate([np.asarray(block) for block in blocks])[:n]
    alive = np.flatnonzero(np.isfinite(evaluate(target, drawn)))
    if alive.size == 0:
        return Start(drawn, _START, 0.0)
    offset = np.random.default_rng(np.asarray(jax.random.key_data(pick_key))).uniform()
    return Start(drawn[alive[(alive.size * (np.arange(n) + offset) / n).astype(int)]], _START, alive.size / n)


def sample_tempered_smc(
    target: Target,
    key: jax.Array,
    settings: SMCSettings,
    progress: Progress = no_progress,
    max_steps: int = 500,
    start: Start | None = None,
) -> SMCResult:
    """Run one tempered SMC to the posterior, from the prior or from where an earlier run has come.

    Raises:
        NumericalError: the temperature stopped advancing, because almost no particle has a finite likelihood.
    """
    start_key, key = split(key)
    particles = settings.particles_for(target.dim)
    start = start or prior_particles(target, start_key, particles)
    alive = start.alive
    cloud = _begin(settings, target, start.particles, start.temperature)
    if alive == 0.0:
        raise NumericalError(
            f"none of {particles} draws from the prior has a finite likelihood: under this prior the model "
            "diverges. Narrow the prior to damping that dissipates (negative coefficients), or check units."
        )
    log_evidence, temperatures, acceptance = float(np.log(alive)), [], []
    log_scale = np.zeros(())
    for iteration in range(max_steps):
        before = float(cloud.temperature)
        step_key = fold_in(key, iteration)
        cloud, log_scale, increment, accepted = _step(settings, target, cloud, log_scale, step_key)
        temperature = float(cloud.temperature)
        log_evidence += float(increment)
        temperatures.append(temperature)
        acceptance.append(float(accepted))
        progress(round(1000 * (1 + np.log10(max(temperature, 1e-9)) / 9)), 1000)
        if temperature >= 1.0:
            resampled = _resample(cloud, fold_in(key, max_steps))
            lost = len(temperatures) * (1.0 / settings.target_ess - 1.0) + (1.0 / alive - 1.0)
            return SMCResult(
                log_evidence,
                np.asarray(resampled),
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
        "Use more particles, or a prior under which the model can be simulated."
    )


class _Cloud(NamedTuple):
    """Particles on their way, arrays only.

    Attributes:
        particles: positions, shape (particles, d).
        weights: theirs, shape (particles,).
        temperature: b.
        factor: Cholesky factor of the steps' covariance, shape (1, d, d).
    """

    particles: Array
    weights: Array
    temperature: Array
    factor: Array


@program(static_argnums=0)
def _begin(settings: SMCSettings, target: Target, particles: Array, temperature: Array) -> _Cloud:
    weights = _kernel(settings, target).init(particles).sampler_state.weights
    return _Cloud(particles, weights, jnp.asarray(temperature, float), _factor_of(particles))


@program(static_argnums=0)
def _step(settings: SMCSettings, target: Target, cloud: _Cloud, log_scale: Array, key: Array):
    kernel = _kernel(settings, target)
    state = kernel.init(cloud.particles)
    begun = state.sampler_state._replace(weights=cloud.weights, tempering_param=cloud.temperature)
    state = state._replace(sampler_state=begun, parameter_override={"factor": cloud.factor})
    (after, override), info = kernel.step(key, state)
    acceptance = jnp.mean(info.update_info.acceptance_rate)
    log_scale = log_scale + _GAIN * (acceptance - TARGET_ACCEPTANCE)
    moved = _Cloud(after.particles, after.weights, after.tempering_param, jnp.exp(log_scale) * override["factor"])
    return moved, log_scale, info.log_likelihood_increment, acceptance


@program
def _resample(cloud: _Cloud, key: Array) -> Array:
    from blackjax.smc.resampling import systematic

    return cloud.particles[systematic(key, cloud.weights, cloud.particles.shape[0])]


def _factor_of(particles: Array) -> Array:
    dim = particles.shape[1]
    cov = jnp.cov(particles, rowvar=False).reshape(dim, dim)
    return jnp.linalg.cholesky(cov + 1e-10 * jnp.diag(jnp.diag(cov)) + 1e-300 * jnp.eye(dim))[None]


def _kernel(settings: SMCSettings, target: Target) -> Any:
    """Return BlackJAX's algorithm; only compiled functions use it, so that it is not loaded where their programs are ready."""
    import blackjax
    from blackjax.smc.resampling import systematic

    walk, dim = blackjax.additive_step_random_walk.build_kernel(), target.dim
    scale, count = 2.38 / np.sqrt(dim), settings.particles_for(dim)
    whole = LANES if count % LANES == 0 else count

    def move(key: Array, state: Any, log_density: Any, factor: Array):
        return walk(key, state, log_density, lambda k, z: scale * factor @ jax.random.normal(k, z.shape))

    def weighted_factor(key: Array, state: Any, info: Any) -> dict[str, Array]:
        return {"factor": _factor_of(state.particles[systematic(key, state.weights, count)])}

    return blackjax.inner_kernel_tuning(
        blackjax.adaptive_tempered_smc,
        target.log_prior,
        lambda z: jnp.maximum(target.log_likelihood(z), _FLOOR),
        move,
        blackjax.additive_step_random_walk.init,
        systematic,
        weighted_factor,
        initial_parameter_value={},
        num_mcmc_steps=settings.moves_for(dim),
        target_ess=settings.target_ess,
        batch_size=lanes_at_once(jax.vmap(target.log_likelihood), jax.ShapeDtypeStruct((count, dim), float), cpu=whole),
    )
