"""The No-U-Turn sampler with window adaptation, by BlackJAX, many chains in step (Hoffman and Gelman, JMLR 15, 2014).

    for each iteration t
        momentum r ~ N(0, M);  z' drawn along the path of z, r under exp(-H), doubled until it turns back
        while warming up
            log step <- dual averaging of (0.8 - harmonic mean of the chains' acceptances)
            in the slow windows: at each one's end, M^-1 <- covariance of the positions of all chains in it

M^-1 begins as the covariance that is given, which whitens the density; step and M^-1 are learnt from all chains together
and frozen after warm-up. Chains in step wait for the one whose path is longest.
"""

from collections.abc import Callable
from typing import NamedTuple

import blackjax
import jax
import jax.numpy as jnp
import numpy as np
from blackjax.adaptation.mass_matrix import WelfordAlgorithmState, welford_algorithm
from blackjax.adaptation.staged_adaptation import build_schedule
from blackjax.adaptation.step_size import DualAveragingAdaptationState, dual_averaging_adaptation
from blackjax.mcmc.hmc import HMCState
from jaxtyping import Array, Bool, Float, Int

from seatrial.compiled.programs import program
from seatrial.sampling.run import BLOCK
from seatrial.sampling.target import Target

# Gradients of a log density: forward through the time loop where the parameters are few, backward where they are many.
#
# forward: d tangents ride along in one pass; memory does not grow with the steps backward: one pass there and one back
# over every stored step; memory grows with steps x chains

FORWARD_UP_TO = 20  # Parameters up to which forward is no dearer, whatever the rule of integration


def forward_is_cheaper(dim: int) -> bool:
    """Return whether a gradient of `dim` parameters is taken forward."""
    return dim <= FORWARD_UP_TO


def log_density_for_gradients(target: Target) -> Callable[[Float[Array, " d"]], Float[Array, ""]]:
    """Return the log density for callers of `jax.grad`, which get its gradient by the cheaper way.

    NaN counts as zero density, and a derivative that is not finite as zero: a trajectory that comes there has diverged.
    """

    def plain(z: Array) -> Array:
        return target.log_prior(z) + target.log_likelihood(z)

    def twice(z: Array) -> tuple[Array, Array]:
        value = plain(z)
        return value, value

    def value_and_gradient(z: Array) -> tuple[Array, Array]:
        if forward_is_cheaper(target.dim):
            gradient, value = jax.jacfwd(twice, has_aux=True)(z)
        else:
            value, gradient = jax.value_and_grad(plain)(z)
        return _or_zero_density(value), jnp.where(jnp.isfinite(gradient), gradient, 0.0)

    @jax.custom_vjp
    def log_density(z: Array) -> Array:
        return _or_zero_density(plain(z))

    log_density.defvjp(value_and_gradient, lambda gradient, change: (change * gradient,))
    return log_density


def _or_zero_density(value: Array) -> Array:
    return jnp.where(jnp.isnan(value), -jnp.inf, value)


TARGET_ACCEPTANCE = 0.8
MIN_ACCEPTANCE = 0.05  # Acceptance below which a chain counts as one of this, so that it does not outweigh all others
MAX_DOUBLINGS = 8  # A path has at most 2^8 - 1 steps
PRIOR_WEIGHT = 20  # Draws' worth of trust in the last covariance at the end of a window
_begin_step, _learn_step, _learnt_step = dual_averaging_adaptation(TARGET_ACCEPTANCE)
_begin_window, _see, _window_covariance = welford_algorithm(False)


class State(NamedTuple):
    """Everything the next iteration needs; arrays only, so that it can be stored and resumed.

    Attributes:
        z: positions, shape (chains, d).
        log_density: at the positions, shape (chains,).
        gradient: of the log density there, shape (chains, d).
        inverse_mass: M^-1, shape (d, d).
        step: five numbers of dual averaging: log step, its average, count, mean error, centre.
        window_mean: mean of the positions in this window, shape (d,).
        window_squares: sum of the squared deviations from it, shape (d, d).
        window_count: positions in it.
        divergences: transitions after warm-up that diverged.
        steps: gradients in all iterations so far, summed over chains.
    """

    z: Float[Array, "chains d"]
    log_density: Float[Array, " chains"]
    gradient: Float[Array, "chains d"]
    inverse_mass: Float[Array, "d d"]
    step: Float[Array, " 5"]
    window_mean: Float[Array, " d"]
    window_squares: Float[Array, "d d"]
    window_count: Int[Array, ""]
    divergences: Int[Array, ""]
    steps: Int[Array, ""]


def first_state(target: Target, starts: Float[Array, "chains d"], cov: Float[Array, "d d"]) -> State:
    """Return the state at the starts; `cov` is the first guess of the posterior covariance."""
    log_density, gradient = _gradients(target, starts)
    step = _begin_step(target.dim**-0.25)
    empty, none = _begin_window(target.dim), jnp.zeros((), int)
    step = jnp.stack(step._replace(log_step_size_avg=step.log_step_size))
    cov = jnp.asarray(cov, float)
    return State(starts, log_density, gradient, cov, step, empty.mean, empty.m2, none, none, none)


def advance_block(target: Target, state: State, key: jax.Array, start: int, warmup: int):
    """See `Sampler.advance_block`."""
    phase = np.zeros((3, BLOCK), bool)
    if start < warmup:
        phase[0] = True
        phase[1:] = np.asarray(build_schedule(warmup))[start : start + BLOCK].reshape(-1, 2).T
    return _block(target, state, key, start, _Phase(*phase))


class _Phase(NamedTuple):
    """For each iteration: whether it warms up, whether it belongs to a slow window, and whether it ends one."""

    warming: Bool[np.ndarray, " n"]
    slow: Bool[np.ndarray, " n"]
    ending: Bool[np.ndarray, " n"]


@program
def _gradients(target: Target, z: Float[Array, "chains d"]) -> tuple[Array, Array]:
    return jax.vmap(jax.value_and_grad(log_density_for_gradients(target)))(z)


@program
def _block(target: Target, state: State, key: jax.Array, start: int, phase: _Phase):
    transition = jax.vmap(blackjax.nuts.build_kernel(), in_axes=(0, 0, None, None, None, None))
    log_density = log_density_for_gradients(target)

    def iterate(state: State, now: tuple[Array, _Phase]):
        t, phase = now
        chains = state.z.shape[0]
        step = jnp.exp(jnp.where(phase.warming, state.step[0], state.step[1]))
        keys = jax.random.split(jax.random.fold_in(key, t), chains)
        at = HMCState(state.z, state.log_density, state.gradient)
        at, info = transition(keys, at, log_density, step, state.inverse_mass, MAX_DOUBLINGS)
        acceptance = jnp.mean(jnp.nan_to_num(info.acceptance_rate))
        state = state._replace(
            z=at.position,
            log_density=at.logdensity,
            gradient=at.logdensity_grad,
            divergences=state.divergences + jnp.where(phase.warming, 0, jnp.sum(info.is_divergent)),
            steps=state.steps + jnp.sum(info.num_integration_steps),
        )
        # The harmonic mean over the chains: one that is stuck in a narrow neck asks for shorter steps, however well
        # the others fare.
        shared = 1.0 / jnp.mean(1.0 / jnp.maximum(jnp.nan_to_num(info.acceptance_rate), MIN_ACCEPTANCE))
        return _adapt(state, shared, phase), (at.position, at.logdensity, acceptance)

    return jax.lax.scan(iterate, state, (start + jnp.arange(BLOCK), phase))


def _adapt(state: State, acceptance: Array, phase: _Phase) -> State:
    """Learn the step and, in slow windows, the covariance; at a window's end take it over and begin both anew."""
    averaged = _learn_step(DualAveragingAdaptationState(*state.step), acceptance)
    seen = WelfordAlgorithmState(state.window_mean, state.window_squares, state.window_count)
    seen, _ = jax.lax.scan(lambda seen, z: (_see(seen, z), None), seen, state.z)
    spread, count, _ = _window_covariance(seen)
    learnt = (count * spread + PRIOR_WEIGHT * state.inverse_mass) / (count + PRIOR_WEIGHT)

    def choose(when: Array, then: tuple, otherwise: tuple) -> list[Array]:
        return [jnp.where(when, a, b) for a, b in zip(then, otherwise, strict=True)]

    begun = _begin_step(_learnt_step(averaged))._replace(log_step_size_avg=averaged.log_step_size_avg)
    step = choose(phase.ending, begun, averaged)
    window = choose(phase.slow, seen, (state.window_mean, state.window_squares, state.window_count))
    window = choose(phase.ending, tuple(map(jnp.zeros_like, window)), tuple(window))
    return state._replace(
        inverse_mass=jnp.where(phase.ending, learnt, state.inverse_mass),
        step=jnp.where(phase.warming, jnp.stack(step), state.step),
        window_mean=window[0],
        window_squares=window[1],
        window_count=window[2],
    )
