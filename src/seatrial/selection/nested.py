"""Evidence by nested slice sampling (Skilling, Bayesian Analysis 1, 2006), by BlackJAX.

Live points drawn from the prior are replaced, lowest likelihood first, by draws of the prior above that likelihood; each
removal from n points shrinks the enclosed prior mass by a factor exp(-1/n) on average, and log Z = log sum L_i (X_i-1 - X_i)
has a standard error of sqrt(H / n), H the information, nats, from prior to posterior.
"""

from functools import lru_cache
from typing import Any, NamedTuple

import blackjax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.special import logsumexp

from seatrial.core.errors import NumericalError
from seatrial.estimation.posterior import Posterior
from seatrial.sampling.target import Progress, no_progress
from seatrial.selection.evidence import Evidence

MAX_SPREAD = 4.0
"""Spread of the repeats, in their stated errors, that chance does not explain."""
ALIVE_DRAWS = 64
"""Prior draws for each live point after which a prior that hardly ever simulates is given up."""


class NestedRun(NamedTuple):
    """Outcome of one run.

    Attributes:
        log_evidence: estimate, the last live points included.
        information: H, mean over the posterior of log(posterior / prior), nats.
        removed: points removed.
        alive: share of the prior with a finite likelihood.
        stuck: share of the slice moves that found no new point.
    """

    log_evidence: float
    information: float
    removed: int
    alive: float
    stuck: float


def nested_evidence(
    posterior: Posterior,
    key: jax.Array,
    *,
    repeats: int = 2,
    live: int = 500,
    moves: int | None = None,
    progress: Progress = no_progress,
) -> Evidence:
    """Evidence by independent repeats of nested slice sampling, averaged in log Z.

    The error is the larger of that expected, sqrt(H / live / repeats), and that from the spread of the repeats.

    Args:
        posterior: density to integrate.
        key: random key.
        repeats: independent runs, at least two, since one cannot show that its points were moved too little.
        live: live points.
        moves: slice moves of each new point; None for max(5, 2 d).
        progress: called with the repeats done and in all.

    Raises:
        NumericalError: fewer than two repeats, or a run that does not end.
    """
    if repeats < 2:
        raise NumericalError(
            "nested sampling needs at least two independent runs to be judged: set repeats to 2 or more"
        )
    runs = []
    for repeat in range(repeats):
        runs.append(sample_nested(posterior, jax.random.fold_in(key, repeat), live=live, moves=moves))
        progress(repeat + 1, repeats)
    logs = np.array([run.log_evidence for run in runs])
    information = float(np.mean([run.information for run in runs]))
    alive = float(np.mean([run.alive for run in runs]))
    expected = np.sqrt((information + 1.0 / alive - 1.0) / live)
    spread = float(logs.std(ddof=1))
    stuck = float(max(run.stuck for run in runs))
    complaints = []
    if spread > MAX_SPREAD * expected:
        complaints.append(
            f"repeats differ by {spread:.1f} nats, {expected:.1f} expected: use more moves or live points"
        )
    if stuck > 0.05:
        complaints.append(
            f"{stuck:.0%} of the slice moves found no new point: the posterior is too thin, use more live points"
        )
    diagnostics = {
        "log_values": logs.tolist(),
        "spread": spread,
        "information": information,
        "removed": [run.removed for run in runs],
        "alive": alive,
        "stuck": stuck,
    }
    return Evidence(
        float(logs.mean()),
        max(float(expected), spread) / float(np.sqrt(repeats)),
        "nested slice sampling",
        diagnostics,
        "; ".join(complaints),
    )


def sample_nested(
    posterior: Posterior,
    key: jax.Array,
    *,
    live: int = 500,
    moves: int | None = None,
    remaining: float = 0.01,
    max_steps: int = 5000,
) -> NestedRun:
    """Run once, until the live points hold no more than `remaining` nats of the evidence.

    Draws of zero likelihood are dropped beforehand: ties cannot be ordered.

    Raises:
        NumericalError: hardly any prior draw simulates, or the end is not reached in `max_steps` steps of live / 8 points.
    """
    start_key, key = jax.random.split(key)
    batch = max(1, live // 8)
    start, advance = _compiled(live, batch, max(5, 2 * posterior.dim) if moves is None else moves)
    points, alive = _living(posterior, start_key, live)
    state = start(posterior, points)
    dead, rejected = [], []
    for step in range(max_steps):
        state, likelihood, accepted = advance(posterior, state, jax.random.fold_in(key, step))
        dead.append(np.asarray(likelihood))
        rejected.append(1.0 - float(accepted))
        if np.logaddexp(0.0, float(state.integrator.logZ_live - state.integrator.logZ)) < remaining:
            log_evidence, information = _integrate(dead, np.asarray(state.particles.loglikelihood))
            stuck = float(np.mean(rejected))
            return NestedRun(log_evidence + np.log(alive), information, batch * len(dead), alive, stuck)
    raise NumericalError(
        f"nested sampling did not end within {max_steps * batch} points: the likelihood still rises, use tempered SMC"
    )


def _living(posterior: Posterior, key: jax.Array, live: int) -> tuple[Array, float]:
    """Draws of the prior with a finite likelihood, and their share."""
    kept, drawn, found = [], 0, 0
    while found < live:
        z = posterior.sample_prior(jax.random.fold_in(key, drawn), live)
        finite = np.isfinite(np.asarray(_log_likelihoods(posterior, z)))
        kept.append(np.asarray(z)[finite])
        drawn, found = drawn + live, found + int(finite.sum())
        if drawn >= ALIVE_DRAWS * live:
            raise NumericalError(
                f"only {found} of {drawn} draws from the prior have a finite likelihood: under this prior the model diverges. "
                "Narrow the prior to damping that dissipates (negative coefficients), or check units."
            )
    return jnp.asarray(np.concatenate(kept)[:live]), found / drawn


def _integrate(dead: list[Float[np.ndarray, " k"]], last: Float[np.ndarray, " live"]) -> tuple[float, float]:
    """Log evidence and information from the likelihoods of the points removed, batch by batch, and of those left.

    Within a batch the points leave in turn without replacement, from n, n - 1, ... points.
    """
    live, batch = last.size, dead[0].size
    shrink = np.tile(-1.0 / np.arange(live, live - batch, -1), len(dead))
    log_mass = np.cumsum(shrink)
    log_shell = log_mass - shrink + np.log(-np.expm1(shrink))
    log_likelihood = np.concatenate([*(np.sort(batch) for batch in dead), last])
    log_term = np.concatenate([log_shell, np.full(live, log_mass[-1] - np.log(live))]) + log_likelihood
    log_evidence = float(logsumexp(log_term))
    share = np.exp(log_term - log_evidence)
    return log_evidence, float(share @ (log_likelihood - log_evidence))


@jax.jit
def _log_likelihoods(posterior: Posterior, z: Array) -> Array:
    return jax.vmap(posterior.log_likelihood)(z)


@lru_cache(maxsize=8)
def _compiled(live: int, batch: int, moves: int):
    """Compiled start and step for this many points."""

    def sampler(posterior: Posterior) -> Any:
        return blackjax.nss(posterior.log_prior, posterior.log_likelihood, num_inner_steps=moves, num_delete=batch)

    @jax.jit
    def start(posterior: Posterior, points: Array):
        return sampler(posterior).init(points)

    @jax.jit
    def advance(posterior: Posterior, state, key: Array):
        state, info = sampler(posterior).step(key, state)
        return state, info.particles.loglikelihood, jnp.mean(info.update_info.is_accepted)

    return start, advance
