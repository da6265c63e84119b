"""Evidence by stepping-stone and thermodynamic integration over one ladder of tempered chains.

    log Z = sum_k log E_k[L^(b_k+1 - b_k)]      Xie et al., Systematic Biology 60, 2011
    log Z = int_0^1 E_b[log L] db               Friel and Pettitt, J. R. Stat. Soc. B 70, 2008

with E_k over p L^b_k. Copies of the whole ladder run side by side and exchange nothing once tuned, so that the error is that of
the spread of the copies (jackknife), whatever the correlation along chains and rungs.

What it cannot see: a narrow peak of small prior mass that no chain meets before the cold rungs have closed about a broad one
(a phase transition), or a mode that the prior draws never lead to. A peak met by some copies shows as an error or a drift.

The chains swap neighbours, p(z) L(z)^b for 0 = b_0 < ... < b_K = 1:

    for each iteration t
        move every chain by random-walk Metropolis; at b = 0 draw from the prior
        for every second pair of neighbours k, k + 1, the even and the odd ones in turn
            swap with probability min(1, (L_k / L_k+1)^(b_k+1 - b_k))

after Syed, Bouchard-Cote, Deligiannidis and Doucet (J. R. Stat. Soc. B 84, 2022), whose rule also spreads the ladder during
warm-up, so that every pair refuses alike. Covariances and scales of the moves are learnt from all copies and frozen with the
ladder.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float
from scipy.interpolate import PchipInterpolator
from scipy.special import logsumexp

from seatrial.core.batching import map_lanes
from seatrial.core.errors import InputError, NumericalError
from seatrial.core.programs import program
from seatrial.core.progress import Progress, no_progress
from seatrial.sampling.target import LANES, Target
from seatrial.selection.evidence import ALIVE, Evidence

BLOCK = 250
"""Iterations between two looks at the ladder."""
FIRST = 1e-8
"""First temperature above 0 of the untuned ladder, which rises by equal factors."""
TARGET_ACCEPTANCE = 0.3
DEAD = -1e100
"""Stands for log 0: 0 * (-inf) would be NaN."""
MIN_SWAP = 0.1
"""Acceptance of swaps below which neighbours on the ladder hardly overlap."""
MIN_SHARE = 0.02
"""Share of a rung's draws that count towards the next below which a few of them carry the ratio."""
MAX_DRIFT = 4.0
"""Difference of the two halves of a run, in its errors, that chance does not explain."""
MAX_CUT = 0.1
"""Discretisation error, nats, above which the integral is not believed."""


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


_USUAL = LadderSettings()


def sample_ladder(
    target: Target, key: jax.Array, settings: LadderSettings = LadderSettings(), progress: Progress = no_progress
) -> Ladder:
    """Run the tempered chains.

    Args:
        target: density, prior and likelihood kept apart.
        key: random key.
        settings: size of the run.
        progress: told how many iterations are done.

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


def stepping_stone(ladder: Ladder) -> Evidence:
    """Return the evidence from the ratios of neighbouring rungs."""
    step = np.diff(ladder.temperatures)[:, None]
    values, weights = ladder.log_likelihood, step * ladder.log_likelihood[:, :-1]
    heaviest = np.exp(weights - weights.max((0, 2), keepdims=True))
    share = (heaviest.sum((0, 2)) ** 2 / (heaviest**2).sum((0, 2))) / (weights.size / step.size)

    def combine(draws: slice) -> np.ndarray:
        return np.array([row.sum() for row in _leave_one_out(step * values[draws, :-1])])

    log_value, error, drift = _judged(combine, len(values))
    diagnostics = _diagnostics(ladder, drift) | {"lowest_share": float(share.min())}
    complaints = _complaints(ladder, drift)
    if share.min() < MIN_SHARE:
        complaints.append(
            f"a few draws carry the step between two rungs ({share.min():.1%} of them count): use more rungs"
        )
    return Evidence(log_value, error, "stepping-stone", diagnostics, "; ".join(complaints))


def thermodynamic(ladder: Ladder) -> Evidence:
    """Return the evidence from the integral of the mean log-likelihood, by the trapezoid with corrected ends of every step.

    The stated error adds, squared, the error of the integration: an eighth of what taking every second rung changes. The rule
    is of fourth order in a ladder that changes slowly, so that a sixteenth is to be expected.
    """
    values = ladder.log_likelihood

    def integrals(draws: slice, every: int = 1) -> np.ndarray:
        return _integrals(ladder.temperatures[::every], values[draws, ::every])

    log_value, error, drift = _judged(integrals, len(values))
    cut = abs(log_value - float(integrals(slice(None), 2)[0])) / 8.0
    complaints = _complaints(ladder, drift)
    if cut > MAX_CUT:
        complaints.append(f"the integral over the ladder is uncertain by {cut:.2f} nats: use more rungs")
    diagnostics = _diagnostics(ladder, drift) | {"monte_carlo_error": error, "discretisation_error": cut}
    return Evidence(
        log_value, float(np.hypot(error, cut)), "thermodynamic integration", diagnostics, "; ".join(complaints)
    )


def _check(settings: LadderSettings) -> None:
    whole = settings.warmup % BLOCK == 0 and settings.draws % BLOCK == 0
    if settings.rungs < 5 or settings.rungs % 2 == 0 or settings.copies < 4 or not whole or settings.draws < BLOCK:
        raise InputError(
            "tempered ladder, settings",
            found=str(settings),
            expected=f"an odd number of at least 5 rungs, 4 copies or more, warm-up and draws in blocks of {BLOCK}",
            remedy="leave the settings out for 33 rungs, 16 copies and 1000 + 1000 iterations",
        )


def _densities(target: Target, z: Array) -> tuple[Array, Array]:
    """Return the log prior and log-likelihood of chains of shape (rungs, copies, d)."""
    prior, likelihood = map_lanes(
        lambda one: (target.log_prior(one), target.log_likelihood(one)), z.reshape(-1, z.shape[-1]), LANES
    )
    return prior.reshape(z.shape[:2]), jnp.maximum(jnp.nan_to_num(likelihood, nan=DEAD), DEAD).reshape(z.shape[:2])


@program(static_argnames=("rungs", "copies"))
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


@program(static_argnames="moves")
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


def _integrals(b: Float[np.ndarray, " rungs"], values: Float[np.ndarray, "draws rungs copies"]) -> np.ndarray:
    """Corrected trapezoid of all copies first, then without each of them, relative to the part of the prior alive."""
    alive = values > DEAD
    centre = np.mean(values, (0, 2), where=alive)[:, None]
    off = np.where(alive, values - centre, 0.0)
    sums = np.stack([alive.sum(0), off.sum(0), (off * off).sum(0)])
    count, first, second = np.concatenate([sums.sum(2)[..., None], sums.sum(2)[..., None] - sums], 2)
    mean, variance = centre + first / count, second / count - (first / count) ** 2
    step = np.diff(b)
    area = step @ (mean[1:] + mean[:-1]) / 2 - step**2 @ np.diff(variance, axis=0) / 12
    return np.log(count[0] / count[1]) + area


def _leave_one_out(logs: Float[np.ndarray, "draws pairs copies"]) -> Float[np.ndarray, "rows pairs"]:
    """Return the log mean of exponentials over draws and copies: of all copies first, then without each of them."""
    draws, _, copies = logs.shape
    each = np.asarray(logsumexp(logs, 0))
    rows = [logsumexp(each, 1) - np.log(copies * draws)]
    rows += [logsumexp(np.delete(each, m, 1), 1) - np.log((copies - 1) * draws) for m in range(copies)]
    return np.array(rows)


def _judged(estimate: Callable[[slice], np.ndarray], draws: int) -> tuple[float, float, float]:
    """Return the value, its jackknife error over the copies, and the difference of the halves of the run in its own error."""
    rows = estimate(slice(None))
    change = estimate(slice(draws // 2)) - estimate(slice(draws // 2, None))
    return float(rows[0]), _jackknife(rows), float(abs(change[0])) / max(_jackknife(change), 1e-12)


def _jackknife(rows: np.ndarray) -> float:
    """Return the standard error from leave-one-out values, which follow the first, widened as Student's t at 95 %."""
    n = rows.size - 1
    widened = scipy.stats.t.ppf(0.975, n - 1) / scipy.stats.norm.ppf(0.975)
    return float(np.sqrt((n - 1) * np.var(rows[1:])) * widened)


def _diagnostics(ladder: Ladder, drift: float) -> dict[str, Any]:
    return {
        "rungs": ladder.temperatures.size,
        "lowest_swap": float(ladder.swap.min()),
        "arrivals": ladder.arrivals,
        "drift": drift,
        "alive": float(np.mean(ladder.log_likelihood[:, 0] > DEAD)),
    }


def _complaints(ladder: Ladder, drift: float) -> list[str]:
    """Return what is wrong with the chains, in words."""
    said, alive = [], float(np.mean(ladder.log_likelihood[:, 0] > DEAD))
    if ladder.swap.min() < MIN_SWAP:
        k = int(ladder.swap.argmin())
        said.append(
            f"the ladder is too coarse: between temperatures {ladder.temperatures[k]:.2g} and {ladder.temperatures[k + 1]:.2g} "
            f"only {ladder.swap[k]:.0%} of the swaps were accepted, use more rungs"
        )
    if ladder.arrivals < 1.0:
        said.append(
            "hardly any draw came from the prior all the way to the posterior: use more rungs and longer chains"
        )
    if drift > MAX_DRIFT:
        said.append(f"the two halves of the run differ by {drift:.1f} of their errors: use a longer warm-up")
    if alive < ALIVE:
        said.append(f"only {alive:.1%} of the prior can be simulated: narrow it to damping that dissipates")
    return said
