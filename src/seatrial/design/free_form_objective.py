"""What one free-form input teaches and where it takes the vehicle, with exact derivatives in the levels and flat memory.

    utility = mean over points of 1/2 ln det(1 + L^T I L),  P0 = L L^T,  I the Fisher information at the point

Time is cut into blocks. Derivatives of the utility run backwards and keep the state only where blocks begin; derivatives of the
course, many numbers, run forwards.
"""

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from seatrial.compiled.programs import program
from seatrial.design.integrals import joint_move, joint_start, signals_at
from seatrial.design.motion_limits import MotionLimit, limit_integrals
from seatrial.design.trial_plan import TrialPlan
from seatrial.estimation.posterior.information import controls_of, information_loop
from seatrial.numerics.integrate import time_loop


class Setup(NamedTuple):
    """Numbers of one search; n samples, c controls, m levels, P points, S draws, k coefficients.

    Attributes:
        plan: vehicle, sensors and times.
        trim: every command at trim, shape (c,).
        span: change of each command for a change of one, SI; 0 but for the one that is driven, shape (c,).
        basis: change of that control at every sample for a change of one of each level, shape (n, m).
        points: coefficients over which the utility is averaged, shape (P, k).
        factor: Cholesky factor L of the prior covariance, shape (k, k).
    """

    plan: TrialPlan
    trim: Float[Array, " c"]
    span: Float[Array, " c"]
    basis: Float[Array, "n m"]
    points: Float[Array, "P k"]
    factor: Float[Array, "k k"]


class Watched(NamedTuple):
    """What is looked at on the way.

    Attributes:
        motion: limits whose quantities are followed.
        draws: coefficients for which they must hold, shape (S, k).
    """

    motion: tuple[MotionLimit, ...]
    draws: Float[Array, "S k"]


class Course(NamedTuple):
    """Where an input takes the vehicle; B blocks of time, q quantities of all limits of the motion, one after another.

    Attributes:
        highest: largest value in each block, from its first sample to the end of its last step, shape (B, q), after draws if
            there are several.
        lowest: smallest, likewise.
    """

    highest: Array
    lowest: Array


@program(static_argnames="block")
def utility(setup: Setup, x: Float[Array, " m"], block: int) -> Float[Array, ""]:
    """Return the utility, nats, of one input: x are the levels' changes from trim over the span."""
    return _utility(setup, x, block)


@program(static_argnames="block")
def utility_slope(setup: Setup, x: Float[Array, " m"], block: int) -> Float[Array, " m"]:
    """Return the gradient of the utility in x."""
    return jax.grad(lambda x: _utility(setup, x, block))(x)


@program(static_argnames="block")
def utilities(setup: Setup, x: Float[Array, "lanes m"], block: int) -> tuple[Float[Array, " lanes"]]:
    """Return the utilities of several inputs, nats."""
    return (jax.vmap(lambda x: _utility(setup, x, block))(x),)


@program(static_argnames="block")
def courses(setup: Setup, watched: Watched, x: Float[Array, "lanes m"], block: int) -> Course:
    """Courses of several inputs for every draw: lanes and draws lead each shape."""
    return jax.vmap(lambda x: _courses(setup, watched, x, block))(x)


@program(static_argnames="block")
def worst_course(setup: Setup, watched: Watched, x: Float[Array, " m"], kept: Float[Array, " S"], block: int) -> Course:
    """Worst of the draws that are kept, number by number."""
    return _worst_course(setup, watched, x, kept, block)


@program(static_argnames="block")
def worst_course_slope(
    setup: Setup, watched: Watched, x: Float[Array, " m"], kept: Float[Array, " S"], block: int
) -> Course:
    """Its Jacobian in x, along the last axis."""
    return jax.jacfwd(lambda x: _worst_course(setup, watched, x, kept, block))(x)


def _worst_course(setup: Setup, watched: Watched, x: Array, kept: Array, block: int) -> Course:
    course = _courses(setup, watched, x, block)
    in_blocks = kept[:, None, None]
    return Course(
        jnp.where(in_blocks, course.highest, -jnp.inf).max(0),
        jnp.where(in_blocks, course.lowest, jnp.inf).min(0),
    )


def _utility(setup: Setup, x: Array, block: int) -> Array:
    control = _control(setup, x)

    def at(values: Array) -> Array:
        # `TrialPlan.information` in blocks that are computed anew on the way back.
        parts = setup.plan.model, setup.plan.channels, setup.plan.named(values), setup.plan.start
        begin, advance = information_loop(*parts, setup.plan.autopilot, setup.plan.process)
        over_block = jax.checkpoint(lambda carry, samples: jax.lax.scan(advance, carry, samples))
        (_, _, total, *_), _ = jax.lax.scan(over_block, begin, _blocks(setup.plan, control, block))
        seen = setup.factor.T @ total @ setup.factor
        return 0.5 * jnp.linalg.slogdet(jnp.eye(seen.shape[0]) + seen)[1]

    return jax.vmap(at)(setup.points).mean()


def _courses(setup: Setup, watched: Watched, x: Array, block: int) -> Course:
    control = _control(setup, x)
    return jax.vmap(lambda values: _course(setup.plan, watched, values, control, block))(watched.draws)


def _control(setup: Setup, x: Array) -> Array:
    return setup.trim + (setup.basis @ x)[:, None] * setup.span


def _course(plan: TrialPlan, watched: Watched, values: Array, control: Array, block: int) -> Course:
    integrals = limit_integrals(plan.model, watched.motion)

    def quantities(joint: tuple, held: tuple) -> Array:
        now: Mapping = signals_at(plan, integrals, joint, held)
        return jnp.stack([now[limit.signal] for limit in watched.motion] or [jnp.zeros(())])

    def widened(extremes: tuple, joint: tuple, held: tuple) -> tuple:
        result = quantities(joint, held)
        return jnp.maximum(extremes[0], result), jnp.minimum(extremes[1], result)

    decide, memory = controls_of(plan.model, plan.channels, plan.named(values), plan.autopilot)

    def law(joint: tuple, carry: tuple, sample: tuple) -> tuple[tuple, tuple]:
        held, memory = decide(joint, carry[0], *sample)
        return held, (memory, held, carry[2])

    def look(joint: tuple, carry: tuple, held: tuple, _: tuple) -> tuple[tuple, None]:
        return (*carry[:2], widened(carry[2], joint, held)), None

    move, n = joint_move(plan, integrals, values), len(plan.model.controls)

    def over_block(carry: tuple, samples: tuple) -> tuple[tuple, tuple]:
        (joint, memory), (columns, step, weight) = carry, samples
        nothing = jnp.full(max(len(watched.motion), 1), jnp.inf)
        begin = memory, (jnp.zeros(()),) * n, (-nothing, nothing)
        (joint, (memory, last, extremes)), _ = time_loop(move, joint, law, step, look, begin, (columns, weight))
        return (joint, memory), widened(extremes, joint, last)

    begin = joint_start(plan, integrals), memory
    _, extremes = jax.lax.scan(over_block, begin, _blocks(plan, control, block))
    return Course(*extremes)


def _blocks(plan: TrialPlan, control: Array, block: int) -> tuple:
    """Return the controls, steps and weights in blocks; the last is filled with samples of no duration that nobody measures."""
    n = control.shape[0]
    missing = -n % block

    def cut(rows: Array, last: Array) -> Array:
        filled = jnp.concatenate([rows, jnp.broadcast_to(last, (missing, *rows.shape[1:]))])
        return filled.reshape(-1, block, *rows.shape[1:])

    columns = tuple(cut(control[:, i], control[-1, i]) for i in range(control.shape[1]))
    return columns, cut(plan.step, jnp.zeros(())), cut(plan.weight, jnp.zeros(plan.weight.shape[1]))
