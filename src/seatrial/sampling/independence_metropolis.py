"""Fresh draws or a random walk, as they are accepted: Metropolis with two proposals, many chains in step.

    for each iteration t
        with probability f, a fresh draw    propose z' ~ q = t_k(m, C),  k = max(5, d),  accept with min(1, p(z') q(z) / (p(z) q(z')))
        else a step of the walk             propose z' = z + exp(s) L e,  e ~ N(0, I),  L L^T = C,  accept with min(1, p(z') / p(z))
        while warming up
            m <- m + g (mean of all chains - m),  g = 6 / (t + 100)
            C <- C + g (spread of all chains about m - C)
            f <- f + g (acceptance of fresh draws - f), kept within 0.1 and 0.9
            s <- s + (t + 1)^-0.6 (acceptance of the walk - 0.234)

Where records leave a posterior that is nearly normal, a draw of its normal twin, tails widened, is accepted four times in five
and forgets all before it (Tierney, Annals of Statistics 22, 1994). The radius of a normal varies less and less with the dimension d, and
the tails narrow with it: of 27 parameters one draw in five is accepted with k = 5, and two with k = d. Where a posterior is not normal,
f falls and the walk goes on as it would alone.
What is learnt is learnt from all chains together and frozen after warm-up.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import ndtr
from jaxtyping import Array, Float

from seatrial.compiled.programs import program
from seatrial.sampling.run import BLOCK
from seatrial.sampling.target import Target, evaluate, log_densities
from seatrial.sampling.walk import (
    TARGET_ACCEPTANCE,
    first_log_scale,
    gain_at,
    learn_moments,
    log_ratio_of,
    mean_acceptance,
    step_factor,
)

# Iterations' worth of trust in what was given, and the pace at which it is forgotten: after t of them, (100 / (t +
# 100))^6.
PRIOR_WEIGHT, PACE = 100, 6.0
# Degrees of freedom of the fresh draws of few parameters: tails that the posterior's cannot exceed for long.
MIN_FREEDOM = 5
# Share of fresh draws at the start, and its bounds: both moves are always made.
FIRST_SHARE, MIN_SHARE, MAX_SHARE = 0.5, 0.1, 0.9


class State(NamedTuple):
    """Everything the next iteration needs; arrays only, so that it can be stored and resumed.

    Attributes:
        z: positions, shape (chains, d).
        log_density: at the positions, shape (chains,).
        mean: running mean of all chains, shape (d,).
        cov: their covariance, shape (d, d).
        fresh: f.
        log_scale: s.
    """

    z: Float[Array, "chains d"]
    log_density: Float[Array, " chains"]
    mean: Float[Array, " d"]
    cov: Float[Array, "d d"]
    fresh: Float[Array, ""]
    log_scale: Float[Array, ""]


def first_state(target: Target, starts: Float[Array, "chains d"], cov: Float[Array, "d d"]) -> State:
    """Return the state at the starts; `cov` is the first covariance of fresh draws."""
    log_density, log_scale = evaluate(target, np.asarray(starts)), first_log_scale(target.dim)
    return State(starts, log_density, starts.mean(0), cov, FIRST_SHARE, log_scale)


@program
def advance_block(target: Target, state: State, key: jax.Array, start: int, warmup: int):
    """See `Sampler.advance_block`."""

    def iterate(state: State, t: Array):
        chains, d = state.z.shape
        freedom, factor = _freedom(d), step_factor(state.cov)
        # Every random number of an iteration comes from one array of normal ones: each way to draw is a program of its own to compile.
        noise = jax.random.normal(jax.random.fold_in(key, t), (chains, d + freedom + 2))
        step, square = noise[:, :d] @ factor.T, (noise[:, d:-2] ** 2).sum(1, keepdims=True)
        chance, fresh = ndtr(noise[:, -2]), ndtr(noise[0, -1]) < state.fresh
        widened = jnp.sqrt(freedom / square)
        proposal = jnp.where(fresh, state.mean + widened * step, state.z + jnp.exp(state.log_scale) * step)
        log_density = log_densities(target, proposal)
        correction = _log_fresh(state.z, state.mean, factor) - _log_fresh(proposal, state.mean, factor)
        log_ratio = log_ratio_of(log_density, state.log_density) + jnp.where(fresh, correction, 0.0)
        accepted = chance < jnp.exp(log_ratio)
        z = jnp.where(accepted[:, None], proposal, state.z)
        kept = jnp.where(accepted, log_density, state.log_density)
        acceptance = mean_acceptance(log_ratio)
        weight = jnp.where(t < warmup, PACE / (t + PRIOR_WEIGHT), 0.0)
        mean, cov = learn_moments(state.mean, state.cov, z, weight)
        share = jnp.clip(state.fresh + weight * (acceptance - state.fresh), MIN_SHARE, MAX_SHARE)
        log_scale = state.log_scale + gain_at(t, warmup) * (acceptance - TARGET_ACCEPTANCE)
        learnt = jnp.where(fresh, share, state.fresh), jnp.where(fresh, state.log_scale, log_scale)
        return State(z, kept, mean, cov, *learnt), (z, kept, acceptance)

    return jax.lax.scan(iterate, state, start + jnp.arange(BLOCK))


def _log_fresh(z: Float[Array, "chains d"], mean: Array, factor: Array) -> Float[Array, " chains"]:
    """Return the log density of a fresh draw, up to a constant."""
    white = jax.scipy.linalg.solve_triangular(factor, (z - mean).T, lower=True)
    d, freedom = z.shape[1], _freedom(z.shape[1])
    return -0.5 * (freedom + d) * jnp.log1p(jnp.sum(white**2, axis=0) / freedom)


def _freedom(d: int) -> int:
    return max(MIN_FREEDOM, d)
