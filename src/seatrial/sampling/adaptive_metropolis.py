"""Adaptive Metropolis, many chains in step (Haario, Saksman and Tamminen, Bernoulli 7, 2001).

    for each iteration t
        propose z' = z + exp(s) L e,  e ~ N(0, I),  L L^T = C
        accept with probability min(1, p(z') / p(z))
        while warming up
            C <- C + 2 / (t + 100) (spread of all chains about their running mean - C)
            s <- s + (t + 1)^-0.6 (mean acceptance - 0.234)

The covariance is learnt from all chains together and frozen after warm-up, so that what is kept is plain Metropolis.
Iteration t uses the key folded with t: a run cut into blocks, stopped and resumed, gives the same bits.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.core.errors import NumericalError
from seatrial.sampling.target import Progress, Target, log_densities, no_progress

TARGET_ACCEPTANCE = 0.234
BLOCK = 100
PRIOR_WEIGHT = 100
"""Iterations' worth of trust in the first covariance."""


@dataclass(frozen=True)
class MetropolisSettings:
    """Size of a run.

    Attributes:
        chains: chains in step.
        warmup: iterations that adapt and are dropped, a multiple of 100.
        draws: iterations after them, a multiple of 100.
        thin: every how many-th of these is kept, a divisor of 100.
    """

    chains: int = 32
    warmup: int = 1000
    draws: int = 4000
    thin: int = 1


class ChainState(NamedTuple):
    """Everything the next iteration needs; arrays only, so that it can be stored and resumed.

    Attributes:
        z: positions, shape (chains, d).
        log_density: at the positions, shape (chains,).
        mean: running mean of all chains, shape (d,).
        cov: proposal covariance, shape (d, d).
        log_scale: s.
    """

    z: Float[Array, "chains d"]
    log_density: Float[Array, " chains"]
    mean: Float[Array, " d"]
    cov: Float[Array, "d d"]
    log_scale: Float[Array, ""]


class Draws(NamedTuple):
    """Draws of z after warm-up, shape (chains, draws, d), their log densities, and the mean acceptance probability."""

    z: Float[np.ndarray, "chains draws d"]
    log_density: Float[np.ndarray, "chains draws"]
    acceptance: float


class Run(NamedTuple):
    """A run so far: the state, iterations done and what was kept; what a checkpoint holds."""

    state: ChainState
    iteration: int
    z: Float[np.ndarray, "kept chains d"]
    log_density: Float[np.ndarray, "kept chains"]
    acceptance: Float[np.ndarray, " kept"]


def start_chains(target: Target, starts: Float[Array, "chains d"], cov: Float[Array, "d d"]) -> Run:
    """Begin a run.

    Args:
        target: density to sample.
        starts: one position for each chain, of finite density.
        cov: first proposal covariance before scaling, for example the Laplace covariance.

    Raises:
        NumericalError: a start of zero density.
    """
    d = target.dim
    log_density = log_densities(target, starts)
    if not np.isfinite(log_density).all():
        bad = int(np.sum(~np.isfinite(log_density)))
        raise NumericalError(
            f"{bad} of {len(log_density)} chains start where the density is zero: start them inside the support"
        )
    state = ChainState(starts, log_density, starts.mean(0), cov, jnp.asarray(np.log(2.38 / np.sqrt(d))))
    chains = starts.shape[0]
    return Run(state, 0, np.empty((0, chains, d)), np.empty((0, chains)), np.empty(0))


def advance_chains(target: Target, run: Run, key: jax.Array, settings: MetropolisSettings) -> Run:
    """Advance a run by one block of iterations; draws of the warm-up are not kept."""
    state, drawn = _block(target, run.state, key, run.iteration, settings.warmup)
    return keep(run, state, drawn, settings)


def keep(run: Run, state: ChainState, drawn: tuple[Array, Array, Array], settings: MetropolisSettings) -> Run:
    """Append the positions, log densities and acceptances of one block to a run, thinned, unless it is still warming up."""
    drawn[-1].block_until_ready()
    iteration = run.iteration + BLOCK
    if iteration <= settings.warmup:
        return run._replace(state=state, iteration=iteration)
    so_far = (run.z, run.log_density, run.acceptance)
    kept = [
        np.concatenate([old, np.asarray(new)[settings.thin - 1 :: settings.thin]])
        for old, new in zip(so_far, drawn, strict=True)
    ]
    return Run(state, iteration, *kept)


def is_finished(run: Run, settings: MetropolisSettings) -> bool:
    """Whether the run has all its draws."""
    return run.iteration >= settings.warmup + settings.draws


def finish(run: Run) -> Draws:
    """Draws of a finished run."""
    return Draws(np.swapaxes(run.z, 0, 1), run.log_density.T, float(run.acceptance.mean()))


def sample_adaptive_metropolis(
    target: Target,
    starts: Float[Array, "chains d"],
    cov: Float[Array, "d d"],
    key: jax.Array,
    settings: MetropolisSettings,
    progress: Progress = no_progress,
) -> Draws:
    """Sample without checkpoints: `start_chains`, then `advance_chains` until `is_finished`."""
    run = start_chains(target, starts, cov)
    while not is_finished(run, settings):
        run = advance_chains(target, run, key, settings)
        progress(run.iteration, settings.warmup + settings.draws)
    return finish(run)


@jax.jit
def _block(target: Target, state: ChainState, key: jax.Array, start: int, warmup: int):
    def iterate(state: ChainState, t: Array):
        chains, d = state.z.shape
        step_key, accept_key = jax.random.split(jax.random.fold_in(key, t))
        factor = jnp.linalg.cholesky(state.cov + 1e-12 * jnp.diag(jnp.diag(state.cov)))
        proposal = state.z + jnp.exp(state.log_scale) * jax.random.normal(step_key, (chains, d)) @ factor.T
        log_density = log_densities(target, proposal)
        log_ratio = jnp.where(jnp.isfinite(log_density), log_density, -jnp.inf) - state.log_density
        accepted = jnp.log(jax.random.uniform(accept_key, (chains,))) < log_ratio
        z = jnp.where(accepted[:, None], proposal, state.z)
        kept = jnp.where(accepted, log_density, state.log_density)
        acceptance = jnp.mean(jnp.exp(jnp.minimum(log_ratio, 0.0)))
        gain = jnp.where(t < warmup, (t + 1.0) ** -0.6, 0.0)
        weight = jnp.where(t < warmup, 2.0 / (t + PRIOR_WEIGHT), 0.0)
        mean = state.mean + weight * (z.mean(0) - state.mean)
        spread = z - mean
        cov = state.cov + weight * (spread.T @ spread / chains - state.cov)
        log_scale = state.log_scale + gain * (acceptance - TARGET_ACCEPTANCE)
        return ChainState(z, kept, mean, cov, log_scale), (z, kept, acceptance)

    return jax.lax.scan(iterate, state, start + jnp.arange(BLOCK))
