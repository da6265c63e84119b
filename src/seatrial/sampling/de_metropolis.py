"""Differential evolution Metropolis, many chains in step, with past states and snooker (ter Braak and Vrugt 2008, DE-MCzs).

    for each iteration t, a and b being two rows of the archive, c a third
        nine times in ten   propose z' = z + g (a - b) + e,  g = 2.38 / sqrt(2 d), or 1 in a tenth of these, e tiny
        else, the snooker   propose z' = z + g u u.(a - b),  u along z - c, g ~ U(1.2, 2.2)
        accept with probability min(1, p(z') / p(z)), times (|z' - c| / |z - c|)^(d - 1) for the snooker
        while warming up, every tenth iteration: the chains replace the oldest rows of the archive

Steps take their size and direction from differences of past states, so nothing is tuned; g = 1 carries a chain from one mode
to another where the archive holds both. The archive is frozen after warm-up, so that what is kept is plain Metropolis.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.compiled.programs import program
from seatrial.sampling.run import BLOCK
from seatrial.sampling.target import Target, evaluate, log_densities
from seatrial.sampling.walk import mean_acceptance

ROWS = 1024  # Rows of the archive, at least; and at least 32 for each chain
ARCHIVE_INTERVAL = 10  # Iterations between two entries in the archive
SNOOKER = 0.1
FULL_STEP = 0.1
JITTER = 1e-4  # Standard deviation of e, in those of the covariance given at the start: no state is out of reach


class State(NamedTuple):
    """Everything the next iteration needs; arrays only, so that it can be stored and resumed.

    Attributes:
        z: positions, shape (chains, d).
        log_density: at the positions, shape (chains,).
        archive: past states, shape (rows, d).
        jitter: standard deviation of e, shape (d,).
    """

    z: Float[Array, "chains d"]
    log_density: Float[Array, " chains"]
    archive: Float[Array, "rows d"]
    jitter: Float[Array, " d"]


def first_state(target: Target, starts: Float[Array, "chains d"], cov: Float[Array, "d d"]) -> State:
    """Return the state at the starts; the archive begins as draws about them, normal and of the covariance `cov`."""
    chains, d = starts.shape
    rows = chains * max(32, -(-ROWS // chains))
    noise = jax.random.normal(jax.random.key(0), (rows, d))
    archive = jnp.tile(starts, (rows // chains, 1)) + noise @ jnp.linalg.cholesky(jnp.asarray(cov)).T
    return State(starts, evaluate(target, np.asarray(starts)), archive, JITTER * jnp.sqrt(jnp.diag(cov)))


@program
def advance_block(target: Target, state: State, key: jax.Array, start: int, warmup: int):
    """See `Sampler.advance_block`."""
    chains, d = state.z.shape
    rows = state.archive.shape[0]

    def iterate(state: State, t: Array):
        row_key, kind_key, step_key, accept_key = jax.random.split(jax.random.fold_in(key, t), 4)
        a, b, c = state.archive[_three_rows(row_key, chains, rows)]
        kind, size = jax.random.uniform(kind_key, (2, chains))
        scale = jnp.where(size < FULL_STEP, 1.0, 2.38 / jnp.sqrt(2 * d))
        along = scale[:, None] * (a - b) + state.jitter * jax.random.normal(step_key, (chains, d))
        snooker, log_volume = _snooker(state.z, a - b, c, 1.2 + size)
        is_snooker = kind < SNOOKER
        proposal = state.z + jnp.where(is_snooker[:, None], snooker, along)
        log_density = log_densities(target, proposal)
        log_ratio = log_density - state.log_density + jnp.where(is_snooker, log_volume, 0.0)
        log_ratio = jnp.where(jnp.isfinite(log_ratio), log_ratio, -jnp.inf)
        accepted = jnp.log(jax.random.uniform(accept_key, (chains,))) < log_ratio
        z = jnp.where(accepted[:, None], proposal, state.z)
        kept = jnp.where(accepted, log_density, state.log_density)
        oldest = (t // ARCHIVE_INTERVAL * chains) % rows
        entered = jax.lax.dynamic_update_slice(state.archive, z, (oldest, 0))
        archive = jnp.where((t < warmup) & (t % ARCHIVE_INTERVAL == ARCHIVE_INTERVAL - 1), entered, state.archive)
        return state._replace(z=z, log_density=kept, archive=archive), (z, kept, mean_acceptance(log_ratio))

    return jax.lax.scan(iterate, state, start + jnp.arange(BLOCK))


def _three_rows(key: Array, chains: int, rows: int) -> Array:
    """Return the indices of three different rows for each chain, shape (3, chains)."""
    keys = jax.random.split(key, 3)
    a, b, c = (jax.random.randint(k, (chains,), 0, rows - i) for i, k in enumerate(keys))
    b = b + (b >= a)
    low, high = jnp.minimum(a, b), jnp.maximum(a, b)
    c = c + (c >= low)
    return jnp.stack([a, b, c + (c >= high)])


def _snooker(z: Array, difference: Array, c: Array, scale: Array) -> tuple[Array, Array]:
    """Step along the line through c, and the log of the change of volume; NaN, which is refused, from c itself."""
    away = z - c
    distance = jnp.linalg.norm(away, axis=1)
    unit = away / distance[:, None]
    step = scale * jnp.sum(unit * difference, axis=1)
    return step[:, None] * unit, (z.shape[1] - 1) * jnp.log(jnp.abs(distance + step) / distance)
