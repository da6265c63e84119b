"""One-step integrators on tuples of scalars with the input held over the step, the time loop of every simulation, and held signals."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from seatrial.compiled.batching import on_accelerator

State = tuple[Any, ...]
Rate = Callable[[State], State]
Integrator = Callable[[Rate, State, Any], State]
Move = Callable[[State, tuple, Any], State]  # `(state, held, step) ->` the state one step later, the control being held
# `(state, memory, held, extra) ->` what is remembered at the next sample, and what is kept of this one.
Look = Callable[[State, Any, tuple, Any], tuple[Any, Any]]
# `(state, memory, extra) ->` the control until the next sample, and the memory: what closes a loop.
Law = Callable[[State, Any, Any], tuple[tuple, Any]]

# Number of states from which the four stages are a loop over one copy of the model, on a processor: faster, and
# compiled in a third of the time. On an accelerator each turn would be launched anew.
MIN_LOOPED_STATES = 8
# Steps of the time loop written out in one turn on an accelerator, times states: each turn is launched anew, so that 32
# steps a turn are 17 times as fast as one for one state; more states take longer to compile than they save.
WRITTEN_OUT = 32


def rk4_step(rate: Rate, state: State, step: Any, large: int = MIN_LOOPED_STATES) -> State:
    """Classical fourth-order Runge-Kutta step (Kutta, 1901).

    Args:
        rate: time derivative of the state, the input being constant.
        state: scalars.
        step: time step, s.
        large: number of states from which the stages are a loop on a processor.
    """
    written_out = len(state) < large or on_accelerator()
    return (rk4_unrolled if written_out else rk4_looped)(rate, state, step)


def rk4_for_slopes(rate: Rate, state: State, step: Any) -> State:
    """`rk4_step` whose derivatives go into a matrix: one copy of the model for any number of states on a processor.

    With the stages written out, XLA computes all of them again for each entry of the matrix: for seven states a hundred times the work.
    """
    return rk4_step(rate, state, step, large=0)


def rk4_unrolled(rate: Rate, state: State, step: Any) -> State:
    """`rk4_step` with the model written out four times: best for a few states."""
    k1 = rate(state)
    k2 = rate(_moved(state, k1, 0.5 * step))
    k3 = rate(_moved(state, k2, 0.5 * step))
    k4 = rate(_moved(state, k3, step))
    return tuple(x + step / 6.0 * (a + 2.0 * (b + c) + d) for x, a, b, c, d in zip(state, k1, k2, k3, k4, strict=True))


def rk4_looped(rate: Rate, state: State, step: Any) -> State:
    """`rk4_step` with the model written out once, in a loop over the stages: best for many states."""
    kind = jnp.result_type(float, *state)
    start = tuple(jnp.asarray(x, kind) for x in state)

    def stage(carry: tuple, shares: tuple) -> tuple:
        sums, at = carry
        share, ahead = shares
        rates = rate(at)
        sums = tuple(x + share * step * r for x, r in zip(sums, rates, strict=True))
        return (sums, _moved(start, rates, ahead * step)), None

    shares = jnp.array([1 / 6, 1 / 3, 1 / 3, 1 / 6], kind), jnp.array([0.5, 0.5, 1.0, 0.0], kind)
    (result, _), _ = jax.lax.scan(stage, (start, start), shares)
    return result


def euler_step(rate: Rate, state: State, step: Any) -> State:
    """Explicit Euler step, first order: for comparison with published results that used it."""
    return _moved(state, rate(state), step)


def time_loop(
    move: Move,
    start: State,
    control: tuple | Law,
    step: Any,
    look: Look,
    memory: Any = (),
    extra: Any = None,
) -> tuple[tuple[State, Any], Any]:
    """Follow a motion from sample to sample and look at it at each; traced, may be batched and differentiated.

    Args:
        move: takes the state to the next sample.
        start: state at the first sample.
        control: one column for each control, held from each sample to the next, or the law that gives them.
        step: time to the next sample, s, shape (n,).
        look: sees the state and the control at each sample, before it moves.
        memory: what law and look remember at the first sample.
        extra: arrays, or a tree of them, of which law and look are given each sample's own.

    Returns:
        The state after the last step and the memory, and what was kept, stacked over the samples.
    """
    law = control if callable(control) else None

    def advance(carry: tuple, sample: tuple) -> tuple[tuple, Any]:
        (state, memory), (held, h, now) = carry, sample
        if law is not None:
            held, memory = law(state, memory, now)
        moved = move(state, held, h)
        memory, kept = look(state, memory, held, now)
        return (moved, memory), kept

    unroll = max(1, WRITTEN_OUT // len(start)) if on_accelerator() else 1
    return jax.lax.scan(advance, (start, memory), (None if law else control, step, extra), unroll=unroll)


def held_mean(
    time: Float[np.ndarray, " n"], values: Float[np.ndarray, " n"], edges: Float[np.ndarray, " m1"]
) -> Float[np.ndarray, " m"]:
    """Return the mean of a held signal over each interval between neighbouring edges: exact, and without aliases of what is faster.

    Args:
        time: stamps, strictly increasing, s.
        values: from each stamp to the next; the first also before, the last without end after.
        edges: increasing, s.
    """
    change = values - values[0]  # so that what never changes comes back as it was
    total = np.concatenate([[0.0], np.cumsum(change[:-1] * np.diff(time))])
    after = change[-1] * np.maximum(edges - time[-1], 0.0)
    return values[0] + np.diff(np.interp(edges, time, total) + after) / np.diff(edges)


def _moved(state: State, rate: State, step: Any) -> State:
    return tuple(x + step * r for x, r in zip(state, rate, strict=True))
