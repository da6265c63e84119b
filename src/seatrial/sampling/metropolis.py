"""Metropolis-Hastings, one variable at a time, many chains in step (Metropolis et al. 1953).

    for each iteration t, for each variable i in turn
        propose z'_i = z_i + s_i e,  e ~ N(0, 1), the others held
        accept with probability min(1, p(z') / p(z))
        while warming up
            log s_i <- log s_i + (t + 1)^-0.6 (mean acceptance of i - 0.44)

The paper's rival of adaptive Metropolis. The proposal is fixed but for its scales, which are tuned in warm-up only; it
knows nothing of correlation, so that it creeps along ridges, and an iteration costs as many likelihoods as there are
variables. A run has the form of `seatrial.sampling.adaptive_metropolis`: its state holds the squares of the scales as a
diagonal covariance.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from seatrial.compiled.programs import program
from seatrial.sampling import adaptive_metropolis
from seatrial.sampling.adaptive_metropolis import State as State
from seatrial.sampling.run import BLOCK
from seatrial.sampling.target import Target, log_densities
from seatrial.sampling.walk import gain_at, log_ratio_of, mean_acceptance

TARGET_ACCEPTANCE = 0.44  # Of a proposal in one dimension (Gelman, Roberts and Gilks, Bayesian Statistics 5, 1996)


def first_state(target: Target, starts: Float[Array, "chains d"], cov: Float[Array, "d d"]) -> State:
    """Return the state at the starts; of `cov` only the variances are used."""
    state = adaptive_metropolis.first_state(target, starts, jnp.diag(jnp.diag(cov)))
    return state._replace(log_scale=0.0)


class _ChainPositions(NamedTuple):
    """Positions, shape (chains, d), their log densities, and the mean acceptance of each component; what lies beyond d is dropped."""

    z: Array
    log_density: Array
    acceptance: Array


@program
def advance_block(target: Target, state: State, key: jax.Array, start: int, warmup: int):
    """See `Sampler.advance_block`."""
    chains, d = state.z.shape
    even = d + d % 2

    def decide(
        at: _ChainPositions, i: Array, proposal: Array, proposed: Array, threshold: Array
    ) -> tuple[_ChainPositions, Array]:
        log_ratio = log_ratio_of(proposed, at.log_density)
        accepted = threshold[:, i] < log_ratio
        z = jnp.where(accepted[:, None], proposal, at.z)
        log_density = jnp.where(accepted, proposed, at.log_density)
        return _ChainPositions(z, log_density, at.acceptance.at[i].set(mean_acceptance(log_ratio))), accepted

    def move_two(pair: Array, at: _ChainPositions, step: Array, threshold: Array) -> _ChainPositions:
        """Move every chain; the second component is tried after both outcomes of the first: three lanes cost little more than one."""
        i, k = 2 * pair, 2 * pair + 1
        first = at.z.at[:, i].add(step[:, i])
        after = at.z.at[:, k].add(step[:, k]), first.at[:, k].add(step[:, k])
        proposed, stayed, gone = jnp.split(log_densities(target, jnp.concatenate([first, *after])), 3)
        at, accepted = decide(at, i, first, proposed, threshold)
        second = jnp.where(accepted[:, None], after[1], after[0])
        return decide(at, k, second, jnp.where(accepted, gone, stayed), threshold)[0]

    def iterate(state: State, t: Array):
        step_key, accept_key = jax.random.split(jax.random.fold_in(key, t))
        step = jax.random.normal(step_key, (chains, d))
        threshold = jnp.log(jax.random.uniform(accept_key, (chains, d)))
        variances = jnp.diag(state.cov)
        filled = ((0, 0), (0, even - d))
        move = partial(move_two, step=jnp.pad(step * jnp.sqrt(variances), filled), threshold=jnp.pad(threshold, filled))
        begin = _ChainPositions(state.z, state.log_density, jnp.zeros(d))
        z, log_density, acceptance = jax.lax.fori_loop(0, even // 2, move, begin)
        learnt = jnp.exp(2 * gain_at(t, warmup) * (acceptance - TARGET_ACCEPTANCE))
        cov = jnp.diag(variances * learnt)
        return state._replace(z=z, log_density=log_density, cov=cov), (z, log_density, acceptance.mean())

    return jax.lax.scan(iterate, state, start + jnp.arange(BLOCK))
