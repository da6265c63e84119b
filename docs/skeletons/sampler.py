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
from jaxtyping import Array, Float

from seatrial.sampling.run import BLOCK, ChainRun, ChainSettings, begin, keep
from seatrial.sampling.run import finish as finish
from seatrial.sampling.target import Target, log_densities
from seatrial.sampling.walk import first_log_scale, live_densities, log_ratio_of, mean_acceptance, step_factor


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


def start_chains(target: Target, starts: Float[Array, "chains d"], cov: Float[Array, "d d"]) -> ChainRun:
    """Begin a run.

    Raises:
        NumericalError: a start of zero density.
    """
    factor = jnp.exp(first_log_scale(target.dim)) * step_factor(cov)
    return begin(State(starts, live_densities(target, starts), factor))


def advance_chains(target: Target, run: ChainRun, key: jax.Array, settings: ChainSettings) -> ChainRun:
    """Advance a run by one block of iterations; draws of the warm-up are not kept."""
    state, drawn = _block(target, run.state, key, run.iteration)
    return keep(run, state, drawn, settings)


@jax.jit
def _block(target: Target, state: State, key: jax.Array, start: int):
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
