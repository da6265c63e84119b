"""Evidence as the plain average of likelihoods over draws from the prior: Listing 1 of the paper, with what it leaves out.

The paper is "Experiment Design, Bayesian Estimation and Model Selection of an Autonomous Underwater Vehicle".

    Z = mean_i L(z_i),  z_i ~ p(z),  P(M_j) = p_j Z_j / sum_k p_k Z_k.

Unbiased, and useless where few draws come near the posterior: the effective sample size (sum L)^2 / sum L^2 says how many
did, and below 400 of them no verdict is given.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple
from zlib import crc32

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.special import logsumexp, softmax

from seatrial.compiled.batching import lanes_at_once, map_lanes
from seatrial.compiled.programs import program
from seatrial.core.argument_checks import check_count
from seatrial.core.errors import InputError, NumericalError
from seatrial.core.reporter import Progress, no_progress
from seatrial.estimation.posterior.output_error import OutputError
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.estimation.simulation.noise_models import White
from seatrial.estimation.simulation.sensor_errors import Sensor, noise_name
from seatrial.estimation.simulation.simulator import Simulator
from seatrial.estimation.simulation.trial_data import TrialData
from seatrial.sampling.diagnostics import MIN_ESS
from seatrial.sampling.target import LANES
from seatrial.selection.verdict import Evidence
from seatrial.vehicles.simulate import move_by

# Log-likelihoods of many draws of which most cannot matter, each simulated only as long as it might.
#
# With independent residuals a simulation can only lose likelihood as it goes on: with the sum of squares so far,
# -N log(s sqrt(2 pi)) - SSE / (2 s^2) bounds the log-likelihood from above. Draws whose bound lies 60 nats below the best
# likelihood found are left there; n of them together change the average by less than n e^-60 of it.

MARGIN = 60.0  # Nats below the best likelihood at which a draw cannot change a printed digit
PIECE = 100  # Samples simulated between the first looks at the bounds; later, an eighth of what is done
PROMISING_DRAWS = 64  # Draws simulated to the end at each look, for the best likelihood
_NEVER = -1e100  # Stands for log 0 in arithmetic


def log_likelihoods(
    posterior: Posterior, values: Float[Array, "n d"], *, early_stop: bool = True
) -> Float[np.ndarray, " n"]:
    """Return the log-likelihood of each draw of the parameters' values, -inf for those that stopped early.

    Early stops need the output-error likelihood with white residuals and no unknowns beside coefficients and noise; any other
    is computed in full.

    Args:
        posterior: whose likelihood is evaluated.
        values: draws of all parameters in their order, SI, shape (n, d).
        early_stop: whether a draw may stop once it can no longer matter.
    """
    likelihood = posterior.likelihood
    plain = isinstance(likelihood, OutputError) and likelihood == OutputError(
        Simulator(likelihood.simulator.model, tuple(map(Sensor, likelihood.channels))), likelihood.labels
    )
    if not (early_stop and plain):
        return np.asarray(_log_likelihoods(posterior, values))
    pieces = _cut(posterior.data)
    rows, n = pieces.first.size, values.shape[0]
    size = lanes_at_once(partial(_log_likelihoods, posterior), values, cpu=LANES)
    lanes = _begin(posterior, values, size)
    start = np.array(lanes.bound)
    draw, kept, best, done, refreshed = np.arange(n), np.arange(n), -np.inf, 0, 0
    while done < rows:
        row, done = done, min(rows, done + max(1, done // 8))
        groups = -(-kept.size // size)
        slots = np.pad(kept.astype(np.int32), (0, -(-n // size) * size - kept.size), mode="edge")
        lanes = _go_on(posterior, pieces, lanes, slots, groups, row, done, size)
        bound = np.fmax(np.asarray(lanes.bound)[: draw.size], _NEVER)
        if done >= 2 * refreshed:
            refreshed = done
            extrapolated = start[draw] - (start[draw] - bound) * (rows / done)
            promising = draw[np.argpartition(-extrapolated, min(PROMISING_DRAWS, draw.size) - 1)[:PROMISING_DRAWS]]
            best = max(best, float(np.max(_log_likelihoods(posterior, values[promising]))))
        kept = np.flatnonzero(bound >= best - MARGIN)
        draw, bound = draw[kept], bound[kept]
    result = np.full(n, -np.inf)
    result[draw] = np.where(bound > _NEVER, bound, -np.inf)
    return result


@program
def _log_likelihoods(posterior: Posterior, values: Array) -> Array:
    def of_one(draw: Array) -> Array:
        return posterior.likelihood(dict(zip(posterior.names, draw, strict=True)), posterior.data)

    return map_lanes(of_one, values, LANES)


class _Pieces(NamedTuple):
    """Samples of all trials, `PIECE` to a row, and whether a row is the first of its trial.

    The last row of a trial is filled up with samples that take no time and measure nothing.
    """

    control: tuple[Array, ...]
    measured: tuple[Array, ...]
    present: tuple[Array, ...]
    step: Array
    initial: Array
    first: Array


class _Lanes(NamedTuple):
    """Draws on their way: parameter values, states, sums of squares of each channel, and bounds, each of shape (n,)."""

    values: dict[str, Array]
    state: tuple[Array, ...]
    squares: tuple[Array, ...]
    bound: Array


def _cut(data: TrialData) -> _Pieces:
    trials, n = data.step.shape
    rows = -(-n // PIECE)

    def cut(x: Array) -> Array:
        return jnp.pad(x, ((0, 0), (0, rows * PIECE - n))).reshape(trials * rows, PIECE)

    return _Pieces(
        tuple(map(cut, data.control)),
        tuple(cut(channel.measured) for channel in data.channels),
        tuple(cut(channel.present) for channel in data.channels),
        cut(data.step),
        jnp.repeat(data.initial, rows, 0),
        jnp.arange(trials * rows) % rows == 0,
    )


def _bound(posterior: Posterior, values: dict[str, Array], squares: tuple[Array, ...]) -> Array:
    """Return the log-likelihood if every residual still to come were zero."""
    noises = zip(posterior.likelihood.channels, posterior.data.channels, squares, strict=True)
    return sum(
        (White(values[noise_name(name)], channel.counts).log_likelihood(sse) for name, channel, sse in noises),
        jnp.zeros(()),
    )


@program(static_argnames="size")
def _begin(posterior: Posterior, draws: Array, size: int) -> _Lanes:
    filled = jnp.pad(draws, ((0, -draws.shape[0] % size), (0, 0)), mode="edge")
    values = {name: filled[:, i] for i, name in enumerate(posterior.names)}
    zero = jnp.zeros(filled.shape[0])
    squares = (zero,) * len(posterior.likelihood.channels)
    state = (zero,) * len(posterior.likelihood.model.states)
    return _Lanes(values, state, squares, jax.vmap(partial(_bound, posterior))(values, squares))


@program(donate_argnums=2, static_argnames="size")
def _go_on(
    posterior: Posterior, pieces: _Pieces, lanes: _Lanes, slots: Array, groups: int, begin: int, end: int, size: int
) -> _Lanes:
    """Simulate the lanes in the first groups of slots, so many in each, through some rows, and move them to the front in that order.

    Slots ascend, so no lane is overwritten before it is read.
    """
    model, channels = posterior.likelihood.model, posterior.likelihood.channels

    def through(values: dict[str, Array], row: Array, carry: tuple) -> tuple:
        piece = jax.tree.map(lambda x: x[row], pieces)

        def advance(carry: tuple, sample: tuple):
            state, squares = carry
            held, measured, present, step = sample
            squares = tuple(
                sse + here * (y - model.output(name, values, state, held)) ** 2
                for sse, name, y, here in zip(squares, channels, measured, present, strict=True)
            )
            return (move_by(model, values)(state, held, step), squares), None

        state = tuple(jnp.where(piece.first, piece.initial[i], x) for i, x in enumerate(carry[0]))
        samples = (piece.control, piece.measured, piece.present, piece.step)
        return jax.lax.scan(advance, (state, carry[1]), samples)[0]

    def lane_on(lane: _Lanes) -> _Lanes:
        carry = (lane.state, lane.squares)
        state, squares = jax.lax.fori_loop(begin, end, partial(through, lane.values), carry)
        return _Lanes(lane.values, state, squares, _bound(posterior, lane.values, squares))

    def group_on(g: Array, lanes: _Lanes) -> _Lanes:
        which = jax.lax.dynamic_slice(slots, (g * size,), (size,))
        moved = jax.vmap(lane_on)(jax.tree.map(lambda x: x[which], lanes))
        return jax.tree.map(lambda x, new: jax.lax.dynamic_update_slice(x, new, (g * size,)), lanes, moved)

    return jax.lax.fori_loop(0, groups, group_on, lanes)


@dataclass(frozen=True)
class ListingOne:
    """Models compared as in the paper.

    Attributes:
        evidences: one for each model, all repeats pooled.
        probability: posterior probability of each model in each repeat.
        status: empty where the probabilities may be used, else why no verdict is given.
    """

    evidences: tuple[Evidence, ...]
    probability: Float[np.ndarray, "repeats m"]
    status: str


def prior_evidence(
    posterior: Posterior, key: jax.Array, *, draws: int = 100_000, repeats: int = 1, early_stop: bool = True
) -> Evidence:
    """Return the evidence of one model; see `listing_one`."""
    return listing_one([posterior], key, draws=draws, repeats=repeats, early_stop=early_stop).evidences[0]


def listing_one(
    posteriors: Sequence[Posterior],
    key: jax.Array,
    *,
    draws: int = 100_000,
    repeats: int = 1,
    shared: bool = False,
    early_stop: bool = True,
    prior_probability: Sequence[float] | None = None,
    progress: Progress = no_progress,
) -> ListingOne:
    """Return the posterior probabilities of several models from the same data, with their spread over repeats.

    Args:
        posteriors: models.
        key: random key.
        draws: prior draws of each model in each repeat.
        repeats: independent repeats.
        shared: whether parameters of the same name take the same draws in every model, as nodes shared between models do;
            their errors then cancel in part, which flatters the agreement of repeats and mends nothing.
        early_stop: leave draws that cannot matter before their simulation ends, where the likelihood allows it.
        prior_probability: prior probability of each model, up to a factor; equal if not given.
        progress: called with the repeats done and in all.

    Raises:
        InputError: no draws, or prior probabilities that are not one positive number for each model.
        NumericalError: a repeat in which no draw of a model has a finite likelihood.
    """
    weight = np.ones(len(posteriors)) if prior_probability is None else np.asarray(prior_probability, float)
    if weight.shape != (len(posteriors),) or not (weight > 0).all():
        raise InputError(
            "Listing 1, prior_probability",
            found=str(prior_probability),
            expected=f"{len(posteriors)} positive numbers, one for each model",
            remedy="leave it out for equal probabilities",
        )
    check_count(draws, "Listing 1, draws")
    check_count(repeats, "Listing 1, repeats")
    log_mean, ess = np.empty((repeats, len(posteriors))), np.empty((repeats, len(posteriors)))
    for repeat in range(repeats):
        for j, posterior in enumerate(posteriors):
            stream = jax.random.fold_in(jax.random.fold_in(key, repeat), 0 if shared else j)
            values = draw_by_name(posterior, stream, draws)
            log_mean[repeat, j], ess[repeat, j] = _average(log_likelihoods(posterior, values, early_stop=early_stop))
        progress(repeat + 1, repeats)
    log_odds = log_mean + np.log(weight)
    evidences = tuple(_pool(log_mean[:, j], ess[:, j], draws) for j in range(len(posteriors)))
    return ListingOne(evidences, np.asarray(softmax(log_odds, axis=1)), _refusal(ess, draws))


@program(static_argnums=2)
def draw_by_name(posterior: Posterior, key: jax.Array, n: int) -> Float[Array, "n d"]:
    """Prior draws of the parameters' values; a parameter's draws depend on the key and its name only, not on the other parameters.

    Args:
        posterior: whose priors are drawn from.
        key: random key.
        n: number of draws.
    """
    return jnp.stack(
        [p.prior.draw(jax.random.fold_in(key, crc32(p.name.encode())), (n,)) for p in posterior.parameters], -1
    )


def _average(log_likelihood: Float[np.ndarray, " n"]) -> tuple[float, float]:
    """Return the log of the mean likelihood, the largest taken out before exponentiating, and the effective sample size."""
    top = log_likelihood.max()
    if not np.isfinite(top):
        raise NumericalError(
            f"none of {log_likelihood.size} draws from the prior has a finite likelihood: under this prior the model diverges. "
            "Narrow the prior to damping that dissipates (negative coefficients), or check units."
        )
    likelihood = np.exp(log_likelihood - top)
    return float(top + np.log(likelihood.mean())), float(likelihood.sum() ** 2 / (likelihood**2).sum())


def _pool(log_mean: Float[np.ndarray, " repeats"], ess: Float[np.ndarray, " repeats"], draws: int) -> Evidence:
    """Return the evidence of one model: the mean of its repeats, and the larger of the errors from weights and from spread."""
    repeats = log_mean.size
    within = float(np.sqrt(np.mean(1.0 / ess - 1.0 / draws) / repeats))
    spread = float(log_mean.std(ddof=1)) if repeats > 1 else 0.0
    diagnostics = {"log_values": log_mean.tolist(), "spread": spread, "ess": ess.tolist(), "draws": draws}
    return Evidence(
        float(logsumexp(log_mean) - np.log(repeats)),
        max(within, spread / float(np.sqrt(repeats))),
        "average over the prior (Listing 1)",
        diagnostics,
        _refusal(ess, draws),
    )


def _refusal(ess: Float[np.ndarray, "..."], draws: int) -> str:
    """Return why no verdict is given; empty where it may be."""
    if ess.min() >= MIN_ESS:
        return ""
    return (
        f"no verdict: of {draws} prior draws only {ess.min():.1f} count (median over repeats {np.median(ess):.1f}, at least "
        f"{MIN_ESS:.0f} needed); use importance sampling or tempered SMC"
    )
