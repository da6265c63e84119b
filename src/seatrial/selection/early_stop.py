"""Log-likelihoods of many draws of which most cannot matter, each simulated only as long as it might.

With independent residuals a simulation can only lose likelihood as it goes on: with the sum of squares so far,
-N log(s sqrt(2 pi)) - SSE / (2 s^2) bounds the log-likelihood from above. Draws whose bound lies 60 nats below the best
likelihood found are left there; n of them together change the average by less than n e^-60 of it.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.core.lanes import lanes_at_once, map_lanes
from seatrial.estimation.output_error import OutputError
from seatrial.estimation.posterior import Posterior
from seatrial.estimation.residuals import White
from seatrial.estimation.sensors import noise_name
from seatrial.estimation.trial_data import TrialData
from seatrial.numerics.integrate import rk4_step
from seatrial.sampling.target import LANES

MARGIN = 60.0
"""Nats below the best likelihood at which a draw cannot change a printed digit."""
PIECE = 100
"""Samples simulated between the first looks at the bounds; later, an eighth of what is done."""
PROMISING = 64
"""Draws simulated to the end at each look, for the best likelihood."""
_NEVER = -1e100
"""Stands for log 0 in arithmetic."""


def log_likelihoods(
    posterior: Posterior, values: Float[Array, "n d"], *, early_stop: bool = True
) -> Float[np.ndarray, " n"]:
    """Log-likelihood of each draw of the parameters' values, -inf for those that stopped early.

    Early stops need the output-error likelihood with white residuals and no unknowns beside coefficients and noise; any other
    is computed in full.
    """
    likelihood = posterior.likelihood
    if not (early_stop and isinstance(likelihood, OutputError) and likelihood.is_plain):
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
            promising = draw[np.argpartition(-extrapolated, min(PROMISING, draw.size) - 1)[:PROMISING]]
            best = max(best, float(np.max(_log_likelihoods(posterior, values[promising]))))
        kept = np.flatnonzero(bound >= best - MARGIN)
        draw, bound = draw[kept], bound[kept]
    found = np.full(n, -np.inf)
    found[draw] = np.where(bound > _NEVER, bound, -np.inf)
    return found


@jax.jit
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
    """Log-likelihood if every residual still to come were zero."""
    noises = zip(posterior.likelihood.channels, posterior.data.channels, squares, strict=True)
    return sum(
        (White(values[noise_name(name)], channel.counts).log_likelihood(sse) for name, channel, sse in noises),
        jnp.zeros(()),
    )


@partial(jax.jit, static_argnames="size")
def _begin(posterior: Posterior, draws: Array, size: int) -> _Lanes:
    filled = jnp.pad(draws, ((0, -draws.shape[0] % size), (0, 0)), mode="edge")
    values = {name: filled[:, i] for i, name in enumerate(posterior.names)}
    zero = jnp.zeros(filled.shape[0])
    squares = (zero,) * len(posterior.likelihood.channels)
    state = (zero,) * len(posterior.likelihood.model.states)
    return _Lanes(values, state, squares, jax.vmap(partial(_bound, posterior))(values, squares))


@partial(jax.jit, donate_argnums=2, static_argnames="size")
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
            return (rk4_step(lambda x: model.derivative(values, x, held), state, step), squares), None

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
