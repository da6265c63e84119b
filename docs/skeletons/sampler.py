"""Skeleton of a sampler: copy to `src/seatrial/sampling/`, add it to `SAMPLERS` and its name to names.py.

This one is random-walk Metropolis with a fixed proposal. State here the recursion and its source (Metropolis et al. 1953):

    for each iteration t
        propose z' = z + 2.38 / sqrt(d) L e,  e ~ N(0, I),  L L^T = C
        accept with probability min(1, p(z') / p(z))

Iteration t uses the key folded with t, so that a run cut into blocks, stored and resumed gives the same bits.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.sampling.run import BLOCK
from seatrial.sampling.target import Target, evaluate, log_densities
from seatrial.sampling.walk import first_log_scale, log_ratio_of, mean_acceptance, step_factor


class State(NamedTuple):
    """Everything the next iteration needs, arrays only: what a checkpoint holds.

    Attributes:
        z: positions, shape (chains, d).
        log_density: at the positions, shape (chains,).
        factor: of the step, shape (d, d).
    """

    z: Float[Array, "chains d"]
    log_density: Float[Array, " chains"]
    factor: Float[Array, "d d"]


def first_state(target: Target, starts: Float[Array, "chains d"], cov: Float[Array, "d d"]) -> State:
    """Return the state at the starts; `cov` is the covariance of a step before scaling."""
    factor = jnp.exp(first_log_scale(target.dim)) * step_factor(cov)
    return State(starts, evaluate(target, np.asarray(starts)), factor)


@jax.jit
def advance_block(target: Target, state: State, key: jax.Array, start: int, warmup: int):
    """Return the state after a block of iterations and what each drew; this sampler learns nothing while `warmup` lasts."""

    def iterate(state: State, t: Array):
        step_key, accept_key = jax.random.split(jax.random.fold_in(key, t))
        proposal = state.z + jax.random.normal(step_key, state.z.shape) @ state.factor.T
        proposed = log_densities(target, proposal)
        log_ratio = log_ratio_of(proposed, state.log_density)
        accepted = jnp.log(jax.random.uniform(accept_key, log_ratio.shape)) < log_ratio
        z = jnp.where(accepted[:, None], proposal, state.z)
        log_density = jnp.where(accepted, proposed, state.log_density)
        return State(z, log_density, state.factor), (z, log_density, mean_acceptance(log_ratio))

    return jax.lax.scan(iterate, state, start + jnp.arange(BLOCK))
