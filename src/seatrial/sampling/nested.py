"""Nested slice sampling (Skilling, Bayesian Analysis 1, 2006), by BlackJAX: the evidence and draws of the posterior at once.

Live points drawn from the prior are replaced, lowest likelihood first, by draws of the prior above that likelihood; each
removal from n points shrinks the enclosed prior mass by a factor exp(-1/n) on average, so that

    Z = sum_i w_i,  w_i = L_i (X_i-1 - X_i)

and the points removed, taken with probability w_i / Z, are draws of the posterior.
"""

from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float

from seatrial.compiled.programs import program
from seatrial.core.errors import NumericalError
from seatrial.core.reporter import Progress, no_progress
from seatrial.sampling.target import Target

ALIVE_DRAWS = 64  # Prior draws for each live point after which a prior that hardly ever simulates is given up

# Information that a parameter gains, nats, for the remaining time: a standard deviation of a six hundredth of the
# prior's.
GUESSED_INFORMATION = 6.0


class NestedRun(NamedTuple):
    """Outcome of one run.

    Attributes:
        log_evidence: estimate, the last live points included.
        information: H, mean over the posterior of log(posterior / prior), nats.
        removed: points removed.
        alive: share of the prior with a finite likelihood.
        stuck: share of the slice moves that found no new point.
        z: all points, shape (n, d).
        share: of the posterior that each stands for, shape (n,).
    """

    log_evidence: float
    information: float
    removed: int
    alive: float
    stuck: float
    z: Float[np.ndarray, "n d"]
    share: Float[np.ndarray, " n"]

    def draws(self, count: int, key: jax.Array) -> Float[np.ndarray, "count d"]:
        """Equally weighted draws of the posterior, in random order: systematic resampling of the points."""
        first, shuffle = jax.random.split(key)
        at = (np.arange(count) + float(jax.random.uniform(first))) / count
        chosen = np.minimum(np.searchsorted(np.cumsum(self.share), at), len(self.share) - 1)
        return self.z[np.asarray(jax.random.permutation(shuffle, chosen))]


def sample_nested(
    target: Target,
    key: jax.Array,
    *,
    live: int = 500,
    moves: int | None = None,
    remaining: float = 0.01,
    max_steps: int = 5000,
    progress: Progress = no_progress,
) -> NestedRun:
    """Run once, until the live points hold no more than `remaining` nats of the evidence.

    Progress is told in thousandths of an end that is guessed, at 6 nats of information for each parameter.

    Draws of zero likelihood are dropped beforehand: ties cannot be ordered.

    Raises:
        NumericalError: hardly any prior draw simulates, or the end is not reached in `max_steps` steps of live / 8 points.
    """
    start_key, key = jax.random.split(key)
    batch = batch_of(live)
    start, advance = _compiled(live, batch, moves_for(target.dim) if moves is None else moves)
    points, alive = _living(target, start_key, live)
    state = start(target, points)
    dead, left, rejected = [], [], []
    for step in range(max_steps):
        state, removed, accepted = advance(target, state, jax.random.fold_in(key, step))
        order = np.argsort(np.asarray(removed.loglikelihood))
        dead.append(np.asarray(removed.loglikelihood)[order])
        left.append(np.asarray(removed.position)[order])
        rejected.append(1.0 - float(accepted))
        progress(min(990, round(1000 * batch * len(dead) / (live * GUESSED_INFORMATION * target.dim))), 1000)
        if np.logaddexp(0.0, float(state.integrator.logZ_live - state.integrator.logZ)) < remaining:
            log_evidence, information, share = _integrate(dead, np.asarray(state.particles.loglikelihood))
            z = np.concatenate([*left, np.asarray(state.particles.position)])
            stuck = float(np.mean(rejected))
            return NestedRun(log_evidence + np.log(alive), information, batch * len(dead), alive, stuck, z, share)
    raise NumericalError(
        f"nested sampling did not end within {max_steps * batch} points: the likelihood still rises, use tempered SMC"
    )


def batch_of(live: int) -> int:
    """Return the points that are replaced at once."""
    return max(1, live // 8)


def moves_for(dim: int) -> int:
    """Slice moves of each new point: in many parameters a slice along one of them changes little."""
    return max(5, 2 * dim, dim * dim // 4)


def _living(target: Target, key: jax.Array, live: int) -> tuple[Array, float]:
    """Return the draws of the prior with a finite likelihood, and their share."""
    kept, drawn, result = [], 0, 0
    while result < live:
        z = target.sample_prior(jax.random.fold_in(key, drawn), live)
        finite = np.isfinite(np.asarray(_log_likelihoods(target, z)))
        kept.append(np.asarray(z)[finite])
        drawn, result = drawn + live, result + int(finite.sum())
        if drawn >= ALIVE_DRAWS * live:
            raise NumericalError(
                f"only {result} of {drawn} draws from the prior have a finite likelihood: under this prior the model diverges. "
                "Narrow the prior to damping that dissipates (negative coefficients), or check units."
            )
    return jnp.asarray(np.concatenate(kept)[:live]), result / drawn


def _integrate(
    dead: list[Float[np.ndarray, " k"]], last: Float[np.ndarray, " live"]
) -> tuple[float, float, Float[np.ndarray, " n"]]:
    """Return the log evidence, information and share of each point, from the likelihoods of those removed, in order, and of those left.

    Within a batch the points leave in turn without replacement, from n, n - 1, ... points.
    """
    live, batch = last.size, dead[0].size
    shrink = np.tile(-1.0 / np.arange(live, live - batch, -1), len(dead))
    log_mass = np.cumsum(shrink)
    log_shell = log_mass - shrink + np.log(-np.expm1(shrink))
    log_likelihood = np.concatenate([*dead, last])
    log_term = np.concatenate([log_shell, np.full(live, log_mass[-1] - np.log(live))]) + log_likelihood
    log_evidence = float(scipy.special.logsumexp(log_term))
    share = np.exp(log_term - log_evidence)
    return log_evidence, float(share @ (log_likelihood - log_evidence)), share


@program
def _log_likelihoods(target: Target, z: Array) -> Array:
    return jax.vmap(target.log_likelihood)(z)


@lru_cache(maxsize=8)
def _compiled(live: int, batch: int, moves: int):
    """Compiled start and step for this many points."""
    import blackjax

    def sampler(target: Target) -> Any:
        return blackjax.nss(target.log_prior, target.log_likelihood, num_inner_steps=moves, num_delete=batch)

    @program
    def start(target: Target, points: Array):
        return sampler(target).init(points)

    @program
    def advance(target: Target, state, key: Array):
        state, info = sampler(target).step(key, state)
        return state, info.particles, jnp.mean(info.update_info.is_accepted)

    return start, advance
