"""Adaptive tempered sequential Monte Carlo (Del Moral, Doucet and Jasra 2006), by BlackJAX.

Particles start as draws from the prior, less those whose likelihood is zero, and move through p(z) L(z)^b with b from 0 to
1, each step of b chosen so that the weights keep a stated effective sample size; in between they move by random-walk
Metropolis with the covariance of the particles, scaled so that about a quarter of the moves are accepted. The product of
the mean weights estimates the evidence.
"""

from dataclasses import dataclass
from functools import lru_cache
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
    draw_key, pick_key = jax.random.split(key)
    blocks = [target.sample_prior(jax.random.fold_in(draw_key, i), AT_ONCE) for i in range(-(-n // AT_ONCE))]
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
    start_key, key = jax.random.split(key)
    particles = settings.particles_for(target.dim)
    begin, step, resample = _steps(settings, target.dim)
    start = start or prior_particles(target, start_key, particles)
    alive = start.alive
    state = begin(target, start.particles, start.temperature)
    if alive == 0.0:
        raise NumericalError(
            f"none of {particles} draws from the prior has a finite likelihood: under this prior the model "
            "diverges. Narrow the prior to damping that dissipates (negative coefficients), or check units."
        )
    log_evidence, temperatures, acceptance = float(np.log(alive)), [], []
    log_scale = jnp.zeros(())
    for iteration in range(max_steps):
        before = float(state.sampler_state.tempering_param)
        state, log_scale, increment, accepted = step(target, state, log_scale, jax.random.fold_in(key, iteration))
        temperature = float(state.sampler_state.tempering_param)
        log_evidence += float(increment)
        temperatures.append(temperature)
        acceptance.append(float(accepted))
        progress(round(1000 * (1 + np.log10(max(temperature, 1e-9)) / 9)), 1000)
        if temperature >= 1.0:
            resampled = resample(state.sampler_state, jax.random.fold_in(key, max_steps))
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


@lru_cache(maxsize=8)
def _steps(settings: SMCSettings, dim: int):
    import blackjax
    import blackjax.smc.resampling

    walk = blackjax.additive_step_random_walk.build_kernel()
    scale, count = 2.38 / np.sqrt(dim), settings.particles_for(dim)

    def move(key: Array, state: Any, log_density: Any, factor: Array):
        return walk(key, state, log_density, lambda k, z: scale * factor @ jax.random.normal(k, z.shape))

    def factor_of(particles: Array) -> dict[str, Array]:
        cov = jnp.cov(particles, rowvar=False).reshape(dim, dim)
        return {"factor": jnp.linalg.cholesky(cov + 1e-10 * jnp.diag(jnp.diag(cov)) + 1e-300 * jnp.eye(dim))[None]}

    def log_likelihood(target: Target, z: Array) -> Array:
        return jnp.maximum(target.log_likelihood(z), _FLOOR)

    def weighted_factor(key: Array, state: Any, info: Any) -> dict[str, Array]:
        drawn = blackjax.smc.resampling.systematic(key, state.weights, count)
        return factor_of(state.particles[drawn])

    def lanes(target: Target) -> int:
        particles = jax.ShapeDtypeStruct((count, dim), float)
        whole = LANES if count % LANES == 0 else count
        return lanes_at_once(jax.vmap(target.log_likelihood), particles, cpu=whole)

    def kernel(target: Target) -> Any:
        return blackjax.inner_kernel_tuning(
            blackjax.adaptive_tempered_smc,
            target.log_prior,
            lambda z: log_likelihood(target, z),
            move,
            blackjax.additive_step_random_walk.init,
            blackjax.smc.resampling.systematic,
            weighted_factor,
            initial_parameter_value={},
            num_mcmc_steps=settings.moves_for(dim),
            target_ess=settings.target_ess,
            batch_size=lanes(target),
        )

    @program
    def begin(target: Target, particles: Array, temperature: Array):
        state = kernel(target).init(particles)
        begun = state.sampler_state._replace(tempering_param=jnp.asarray(temperature, float))
        return state._replace(sampler_state=begun, parameter_override=factor_of(particles))

    @program
    def step(target: Target, state: Any, log_scale: Array, key: Array):
        state, info = kernel(target).step(key, state)
        acceptance = jnp.mean(info.update_info.acceptance_rate)
        log_scale = log_scale + _GAIN * (acceptance - TARGET_ACCEPTANCE)
        tuned = {"factor": jnp.exp(log_scale) * state.parameter_override["factor"]}
        return state._replace(parameter_override=tuned), log_scale, info.log_likelihood_increment, acceptance

    @program
    def resample(state: Any, key: Array) -> Array:
        return state.particles[blackjax.smc.resampling.systematic(key, state.weights, state.particles.shape[0])]

    return begin, step, resample
