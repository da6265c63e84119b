"""Tempered chains that swap neighbours: p(z) L(z)^b for 0 = b_0 < ... < b_K = 1, many copies of the ladder in step.

    for each iteration t
        move every chain by random-walk Metropolis; at b = 0 draw from the prior
        for every second pair of neighbours k, k + 1, the even and the odd ones in turn
            swap with probability min(1, (L_k / L_k+1)^(b_k+1 - b_k))

after Syed, Bouchard-Cote, Deligiannidis and Doucet (J. R. Stat. Soc. B 84, 2022), whose rule also spreads the ladder during
warm-up, so that every pair refuses alike. Covariances and scales of the moves are learnt from all copies and frozen with the
ladder; the copies exchange nothing afterwards.
"""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.interpolate import PchipInterpolator

from seatrial.core.batching import map_lanes
from seatrial.core.errors import InputError, NumericalError
from seatrial.core.progress import Progress, no_progress
from seatrial.sampling.target import LANES, Target

BLOCK = 250
"""Iterations between two looks at the ladder."""
FIRST = 1e-8
"""First temperature above 0 of the untuned ladder, which rises by equal factors."""
TARGET_ACCEPTANCE = 0.3
DEAD = -1e100
"""Stands for log 0: 0 * (-inf) would be NaN."""


@dataclass(frozen=True)
class LadderSettings:
    """Size of a run.

    Attributes:
        rungs: temperatures, 0 and 1 included; odd, since the integral is also taken over every second one.
        copies: independent copies of the ladder.
        warmup: iterations that tune ladder and moves and are dropped, a multiple of 250.
        draws: iterations after them, a multiple of 250.
        moves: Metropolis moves before each swap; None for max(2, d / 2).
    """

    rungs: int = 33
    copies: int = 16
    warmup: int = 1000
    draws: int = 1000
    moves: int | None = None


class Ladder(NamedTuple):
    """Outcome of the chains.

    Attributes:
        temperatures: b_k from 0 to 1.
        log_likelihood: at every rung, shape (draws, rungs, copies); -1e100 where it is -inf.
        swap: mean acceptance of the swaps of each pair of neighbours.
        arrivals: how often, for each copy, a fresh draw of the prior came all the way to b = 1.
        highest: largest log posterior density met at b = 1.
    """

    temperatures: Float[np.ndarray, " rungs"]
    log_likelihood: Float[np.ndarray, "draws rungs copies"]
    swap: Float[np.ndarray, " pairs"]
    arrivals: float
    highest: float


def sample_ladder(
    target: Target, key: jax.Array, settings: LadderSettings = LadderSettings(), progress: Progress = no_progress
) -> Ladder:
    """Run the tempered chains.

    Raises:
        InputError: a ladder of an even number or fewer than 5 rungs, fewer than 4 copies, or iterations not in blocks of 250.
        NumericalError: no draw of the prior has a finite likelihood, or cold chains never left where it is zero.
    """
    _check(settings)
    rungs, copies, total = settings.rungs, settings.copies, (settings.warmup + settings.draws) // BLOCK
    moves = settings.moves if settings.moves is not None else max(2, target.dim // 2)
    ladder = np.concatenate([[0.0], np.geomspace(FIRST, 1.0, rungs - 1)])
    start_key, key = jax.random.split(key)
    state = _start(target, start_key, rungs, copies)
    if float(state.log_likelihood.max()) <= DEAD:
        raise NumericalError(
            f"none of {rungs * copies} draws from the prior has a finite likelihood: under this prior the model diverges. "
            "Narrow the prior to damping that dissipates (negative coefficients), or check units."
        )
    kept, swaps, arrivals = [], [], 0.0
    for block in range(total):
        tuning = block * BLOCK < settings.warmup
        state, out = _block(target, state, jax.random.fold_in(key, block), jnp.asarray(ladder), tuning, moves)
        swap = np.asarray(out.swap)
        if tuning:
            ladder = spread(ladder, 1.0 - swap) if (block + 1) * BLOCK < settings.warmup else ladder
        else:
            kept.append(np.asarray(out.log_likelihood))
            swaps.append(swap)
            arrivals += float(out.arrivals) / copies
        progress(block + 1, total)
    log_likelihood = np.concatenate(kept)
    if log_likelihood[:, 1:].min() <= DEAD:
        raise NumericalError(
            "tempered chains stayed where the likelihood is zero: use a longer warm-up, or a prior under which the model "
            "can be simulated"
        )
    return Ladder(ladder, log_likelihood, np.mean(swaps, 0), arrivals, float(out.highest))


def spread(ladder: Float[np.ndarray, " rungs"], refusal: Float[np.ndarray, " pairs"]) -> Float[np.ndarray, " rungs"]:
    """Ladder of as many rungs whose pairs would refuse alike, from the share refused by each pair of the old one."""
    barrier = np.concatenate([[0.0], np.cumsum(np.maximum(refusal, 1e-3))])
    new = np.asarray(PchipInterpolator(barrier, ladder)(np.linspace(0.0, barrier[-1], ladder.size)))
    new[0], new[-1] = 0.0, 1.0
    return new


def _check(settings: LadderSettings) -> None:
    whole = settings.warmup % BLOCK == 0 and settings.draws % BLOCK == 0
    if settings.rungs < 5 or settings.rungs % 2 == 0 or settings.copies < 4 or not whole or settings.draws < BLOCK:
        raise InputError(
            "tempered ladder, settings",
            found=str(settings),
            expected=f"an odd number of at least 5 rungs, 4 copies or more, warm-up and draws in blocks of {BLOCK}",
            remedy="leave the settings out for 33 rungs, 16 copies and 1000 + 1000 iterations",
        )


class _State(NamedTuple):
    """Chains, shapes (rungs, copies, ...), whether each came from the prior, and the moves of each rung."""

    z: Array
    log_prior: Array
    log_likelihood: Array
    fresh: Array
    mean: Array
    cov: Array
    log_scale: Array


class _Out(NamedTuple):
    log_likelihood: Array
    swap: Array
    arrivals: Array
    highest: Array


def _densities(target: Target, z: Array) -> tuple[Array, Array]:
    """Log prior and log-likelihood of chains of shape (rungs, copies, d)."""
    prior, likelihood = map_lanes(
        lambda one: (target.log_prior(one), target.log_likelihood(one)), z.reshape(-1, z.shape[-1]), LANES
    )
    return prior.reshape(z.shape[:2]), jnp.maximum(jnp.nan_to_num(likelihood, nan=DEAD), DEAD).reshape(z.shape[:2])


@partial(jax.jit, static_argnames=("rungs", "copies"))
def _start(target: Target, key: Array, rungs: int, copies: int) -> _State:
    z = target.sample_prior(key, rungs * copies).reshape(rungs, copies, -1)
    d = z.shape[2]
    flat = z.reshape(-1, d)
    cov = jnp.cov(flat, rowvar=False).reshape(d, d)
    prior, likelihood = _densities(target, z)
    return _State(
        z,
        prior,
        likelihood,
        jnp.zeros(prior.shape, bool),
        jnp.broadcast_to(flat.mean(0), (rungs, d)),
        jnp.broadcast_to(cov, (rungs, d, d)),
        jnp.full(rungs, jnp.log(2.38 / jnp.sqrt(d))),
    )


@partial(jax.jit, static_argnames="moves")
def _block(target: Target, state: _State, key: Array, ladder: Array, tuning: bool, moves: int):
    rungs, copies, d = state.z.shape
    b = ladder[:, None]

    def move(factor: Array, carry, t_key: Array):
        state, accepted_before = carry
        prior_key, step_key, accept_key = jax.random.split(t_key, 3)
        step = jnp.einsum("kij,kmj->kmi", factor, jax.random.normal(step_key, (rungs, copies, d)))
        proposal = state.z + jnp.exp(state.log_scale)[:, None, None] * step
        proposal = proposal.at[0].set(target.sample_prior(prior_key, copies))
        prior, likelihood = _densities(target, proposal)
        ratio = prior + b * likelihood - state.log_prior - b * state.log_likelihood
        ratio = jnp.where(jnp.isfinite(ratio), ratio, -jnp.inf).at[0].set(0.0)
        accepted = jnp.log(jax.random.uniform(accept_key, ratio.shape)) < ratio
        moved = state._replace(
            z=jnp.where(accepted[..., None], proposal, state.z),
            log_prior=jnp.where(accepted, prior, state.log_prior),
            log_likelihood=jnp.where(accepted, likelihood, state.log_likelihood),
            fresh=state.fresh.at[0].set(True),
        )
        return (moved, accepted_before + jnp.exp(jnp.minimum(ratio, 0.0)).mean(1) / moves), None

    def iterate(state: _State, t: Array):
        move_key, swap_key = jax.random.split(jax.random.fold_in(key, t))
        factor = jnp.linalg.cholesky(state.cov + 1e-12 * jax.vmap(lambda c: jnp.diag(jnp.diag(c)))(state.cov))
        (state, acceptance), _ = jax.lax.scan(
            partial(move, factor), (state, jnp.zeros(rungs)), jax.random.split(move_key, moves)
        )
        values = state.log_likelihood
        arrived = state.fresh[-1].sum()
        highest = (state.log_prior + values)[-1].max()
        state = state._replace(fresh=state.fresh.at[-1].set(False))
        odds = jnp.exp(jnp.minimum(jnp.diff(ladder)[:, None] * (values[:-1] - values[1:]), 0.0))
        swapped = (jnp.arange(rungs - 1) % 2 == t % 2)[:, None] & (jax.random.uniform(swap_key, odds.shape) < odds)
        none = jnp.zeros((1, copies), bool)
        above, below = jnp.concatenate([swapped, none]), jnp.concatenate([none, swapped])

        def exchange(x: Array) -> Array:
            shape = above.shape + (1,) * (x.ndim - 2)
            up, down = jnp.roll(x, -1, 0), jnp.roll(x, 1, 0)
            return jnp.where(above.reshape(shape), up, jnp.where(below.reshape(shape), down, x))

        z, prior, likelihood, fresh = map(exchange, state[:4])
        gain = jnp.where(tuning, (t + 1.0) ** -0.6, 0.0)
        weight = jnp.where(tuning, 2.0 / (t + 50.0), 0.0)
        mean = state.mean + weight * (z.mean(1) - state.mean)
        off = z - mean[:, None]
        cov = state.cov + weight * (jnp.einsum("kmi,kmj->kij", off, off) / copies - state.cov)
        log_scale = state.log_scale + gain * (acceptance - TARGET_ACCEPTANCE)
        return _State(z, prior, likelihood, fresh, mean, cov, log_scale), (values, odds.mean(1), arrived, highest)

    state, (values, swap, arrived, highest) = jax.lax.scan(iterate, state, jnp.arange(BLOCK))
    return state, _Out(values, swap.mean(0), arrived.sum(), highest.max())
