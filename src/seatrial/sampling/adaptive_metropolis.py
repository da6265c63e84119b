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

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
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

PRIOR_WEIGHT = 100  # Iterations' worth of trust in the first covariance


class State(NamedTuple):
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


def first_state(target: Target, starts: Float[Array, "chains d"], cov: Float[Array, "d d"]) -> State:
    """Return the state at the starts; `cov` is the first proposal covariance before scaling."""
    return State(starts, evaluate(target, np.asarray(starts)), starts.mean(0), cov, first_log_scale(target.dim))


@program
def advance_block(target: Target, state: State, key: jax.Array, start: int, warmup: int):
    """See `Sampler.advance_block`."""

    def iterate(state: State, t: Array):
        chains, d = state.z.shape
        step_key, accept_key = jax.random.split(jax.random.fold_in(key, t))
        step = jax.random.normal(step_key, (chains, d)) @ step_factor(state.cov).T
        proposal = state.z + jnp.exp(state.log_scale) * step
        log_density = log_densities(target, proposal)
        log_ratio = log_ratio_of(log_density, state.log_density)
        accepted = jnp.log(jax.random.uniform(accept_key, (chains,))) < log_ratio
        z = jnp.where(accepted[:, None], proposal, state.z)
        kept = jnp.where(accepted, log_density, state.log_density)
        acceptance = mean_acceptance(log_ratio)
        weight = jnp.where(t < warmup, 2.0 / (t + PRIOR_WEIGHT), 0.0)
        mean, cov = learn_moments(state.mean, state.cov, z, weight)
        log_scale = state.log_scale + gain_at(t, warmup) * (acceptance - TARGET_ACCEPTANCE)
        return State(z, kept, mean, cov, log_scale), (z, kept, acceptance)

    return jax.lax.scan(iterate, state, start + jnp.arange(BLOCK))
