"""Slopes of a log-likelihood, and its curvature without what vanishes on average where residuals are noise: Gauss and Newton's method.

Output error, y what the sensors show, J its derivatives and L(theta, y) the log density of the measurements about it: the gradient is
exact, and the curvature leaves out dL/dy d^2y/dtheta^2 alone (Schraudolph, Neural Computation 14, 2002),

    (d/dtheta + J^T d/dy) L,    (d/dtheta + J^T d/dy)^2 L  at constant J

Filter error, e_k the innovation of a measurement given all before it and v_k its variance: the log-likelihood
-1/2 sum (e_k^2 / v_k + log 2 pi v_k) has the exact gradient, and the information (Klein and Morelli, Aircraft System Identification,
2nd ed., 2016, section 6.1),

    I = sum_k (de_k de_k^T / v_k + 1/2 dv_k dv_k^T / v_k^2)

Both cost as many simulations or filters side by side as there are parameters, where second derivatives cost the square of that. A log
density of one's own has its second derivatives.
"""

from dataclasses import replace
from math import gcd
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.compiled.programs import program
from seatrial.estimation.posterior.filter_error import FilterError
from seatrial.estimation.posterior.output_error import BLOCK, OutputError
from seatrial.estimation.posterior.posterior import Posterior


class Slopes(NamedTuple):
    """Log-likelihood at one point, -inf where it diverges, its gradient and the information, in the parameters' own units."""

    value: Float[Array, ""]
    gradient: Float[Array, " d"]
    information: Float[Array, "d d"]


def likelihood_slopes(posterior: Posterior, point: Float[Array, " d"]) -> Slopes:
    """Return the slopes of a posterior's likelihood.

    Args:
        posterior: whose likelihood it is.
        point: values of all parameters, in their own units.
    """
    return _slopes(posterior, point)[0]


def slopes_by_trial(posterior: Posterior, point: Float[Array, " d"]) -> Slopes:
    """Return the slopes of each trial's share of the likelihood, the trials as first axis, by the same program."""
    return _slopes(posterior, point)[1]


@program
def _slopes(posterior: Posterior, point: Float[Array, " d"]) -> tuple[Slopes, Slopes]:
    """Return the slopes of all trials together, and of each."""
    likelihood, data = posterior.likelihood, posterior.data
    if not isinstance(likelihood, OutputError | FilterError):
        whole = _of_density(posterior, point)
        return whole, jax.tree.map(lambda x: x[None], whole)
    trials, names, d = jnp.arange(len(likelihood.labels)), posterior.names, len(posterior.names)
    if isinstance(likelihood, FilterError):
        # Side by side: a step of a filter is so many small operations that one trial leaves the vector units idle.
        each = jax.vmap(lambda index: _along_filter(likelihood, names, point, data, index))(trials)
        total = jax.tree.map(lambda x: x.sum(0), each)
    else:

        def add(total: Slopes, index: Array) -> tuple[Slopes, Slopes]:
            of_trial = _along_simulation(likelihood, names, point, data, index)
            return Slopes(*(a + b for a, b in zip(total, of_trial, strict=True))), of_trial

        total, each = jax.lax.scan(add, _nothing(d), trials)
    return total._replace(value=jnp.where(jnp.isfinite(total.value), total.value, -jnp.inf)), each


def _of_density(posterior: Posterior, point: Array) -> Slopes:
    def value_twice(theta: Array) -> tuple[Array, Array]:
        value = posterior.likelihood(dict(zip(posterior.names, theta, strict=True)), posterior.data)
        return value, value

    def gradient_twice(theta: Array) -> tuple[Array, tuple[Array, Array]]:
        gradient, value = jax.jacfwd(value_twice, has_aux=True)(theta)
        return gradient, (gradient, value)

    hessian, (gradient, value) = jax.jacfwd(gradient_twice, has_aux=True)(point)
    return Slopes(value, gradient, -0.5 * (hessian + hessian.T))


def _along_simulation(likelihood: OutputError, names: tuple[str, ...], point: Array, data: Any, index: Array) -> Slopes:
    """Return the slopes of one trial that is simulated."""
    trial, d = jax.tree.map(lambda x: x[index], data), len(names)
    along, of_noise = jnp.eye(d), np.array([name in likelihood.noise_parameters for name in names])
    moving = np.flatnonzero(~of_noise)
    # Where residuals need a time loop, a second one for the noise alone would take as long to compile as the first.
    joint = moving if likelihood.independent else np.arange(d)
    still = np.setdiff1d(np.arange(d), joint)

    def values_at(theta: Array) -> dict[str, Any]:
        named = dict(zip(names, theta, strict=True))
        return {**named, **{name: of_all[index] for name, of_all in likelihood.apart(named).items()}}

    def shown_at(theta: Array) -> tuple[Array, ...]:
        start = likelihood.starts(dict(zip(names, theta, strict=True)), data)[index]
        return likelihood.simulator.simulate(values_at(theta), start, trial.control, trial.step).kept

    shown, by_theta = jax.vmap(lambda way: jax.jvp(shown_at, (point,), (way,)), out_axes=(None, -1))(along[moving])

    def of_samples(trial: Any, shown: Array, by_theta: Array) -> Slopes:
        """Return the slopes that the residuals of some samples add."""

        def gradient_and_value(shown: Array, theta: Array) -> tuple[tuple[Array, Array], Array]:
            def density(shown: Array, theta: Array) -> Array:
                return likelihood.of_shown(values_at(theta), trial, shown)

            value, gradient = jax.value_and_grad(density, (0, 1))(shown, theta)
            return gradient, value

        def along_way(moved: Array, way: Array) -> tuple[Any, Any, Array]:
            return jax.jvp(gradient_and_value, (shown, point), (moved, way), has_aux=True)

        def along_noise(way: Array) -> Array:
            return jax.jvp(lambda theta: gradient_and_value(shown, theta)[0][1], (point,), (way,))[1]

        def in_motion(pulls: Array) -> Array:
            # What is shown enters the time loop as one number a sample, not as one for each parameter.
            return jnp.tensordot(by_theta, pulls, ((0, 1), (0, 1)))

        moved = by_theta if likelihood.independent else jnp.zeros((*shown.shape, d)).at[..., moving].set(by_theta)
        (pulls, gradient), (moved_pulls, rows), value = jax.vmap(along_way, -1, (None, -1, None))(
            moved, along[:, joint]
        )
        curvature = jnp.zeros_like(along).at[:, joint].set(rows.at[moving].add(in_motion(moved_pulls)))
        if still.size:
            curvature = curvature.at[np.ix_(moving, still)].set(rows[still].T)
            curvature = curvature.at[np.ix_(still, still)].set(jax.vmap(along_noise, -1, -1)(along[:, still])[still])
        return Slopes(value, gradient.at[moving].add(in_motion(pulls)), -0.5 * (curvature + curvature.T))

    if not likelihood.independent:
        return of_samples(trial, jnp.stack(shown), jnp.stack(by_theta))
    # What is made of a block of samples stays in the processor's cache; what has no samples is counted with the first.
    blocks = trial.step.size // (length := gcd(trial.step.size, BLOCK))

    def cut(x: Array) -> Array:
        return x.reshape(blocks, length, *x.shape[1:])

    def add(total: Slopes, block: tuple) -> tuple[Slopes, None]:
        own, first, *samples = block
        channels = tuple(
            one._replace(measured=y, present=here, kind=kind, counts=first * one.counts)
            for one, (y, here, kind) in zip(trial.channels, own, strict=True)
        )
        return jax.tree.map(
            jnp.add, total, of_samples(trial._replace(channels=channels), *map(jnp.stack, samples))
        ), None

    measured = tuple((one.measured, one.present, one.kind) for one in trial.channels)
    samples = (*jax.tree.map(cut, (measured,)), jnp.eye(1, blocks)[0], *jax.tree.map(cut, (shown, by_theta)))
    return jax.lax.scan(add, _nothing(d), samples)[0]


def _along_filter(likelihood: FilterError, names: tuple[str, ...], point: Array, data: Any, index: Array) -> Slopes:
    """Return the slopes of one trial that a filter follows; they travel with its belief."""
    output, method = likelihood.output, likelihood.method
    trial = jax.tree.map(lambda x: x[index], data)
    along, d = jnp.eye(len(names)), len(names)

    def values_at(theta: Array) -> dict[str, Any]:
        named = dict(zip(names, theta, strict=True))
        return {**named, **{name: of_all[index] for name, of_all in output.apart(named).items()}}

    def space_at(theta: Array) -> Any:
        named = dict(zip(names, theta, strict=True))
        return likelihood.space(values_at(theta), output.starts(named, data)[index])

    def begin(theta: Array) -> Any:
        return _arrays(method.form.begin(space_at(theta).initial))

    def drive(theta: Array) -> Array:
        return jnp.stack(output.simulator.delayed(values_at(theta), trial.control, trial.step), -1)

    def advance(theta: Array, belief: Any, held: Array, now: Array, first: Array, h: Array, measured: Array) -> Any:
        space = space_at(theta)
        moving = replace(space, process_sd=space.process_sd * jnp.sqrt(h))
        prior = jax.lax.cond(first, lambda: belief, lambda: _arrays(method.predict(moving, belief, tuple(held), h)[0]))
        after, update = method.update(space, prior, tuple(now), tuple(measured))
        failed = update.failed | ~method.form.positive(after)
        size = jnp.stack(update.variance)
        seen = (jnp.where(failed, -jnp.inf, update.log_likelihood), jnp.stack(update.residual), size)
        return _arrays(after), seen

    control = drive(point)
    # of a delay alone the control has slopes
    slopes = jax.jacfwd(drive)(point) if output.simulator.delay else jnp.zeros((*control.shape, d))
    measured = jnp.stack([jnp.where(c.present > 0, c.measured, jnp.nan) for c in trial.channels], -1)

    def step(carry: tuple, sample: tuple) -> tuple[tuple, None]:
        belief, by_theta, total = carry
        held, held_slopes, now, now_slopes, *rest = sample

        def one(direction: Array, slope: Any, of_held: Array, of_now: Array) -> Any:
            at, tangents = (point, belief, held, now), (direction, slope, of_held, of_now)
            return jax.jvp(lambda *moved: advance(*moved, *rest), at, tangents)

        (after, seen), (after_slopes, seen_slopes) = jax.vmap(one, (0, 0, 1, 1), (None, 0))(
            along, by_theta, held_slopes, now_slopes
        )
        (value, _, size), (gradient, of_residual, of_size) = seen, seen_slopes
        scaled = jnp.concatenate([of_residual / jnp.sqrt(size), of_size / (size * jnp.sqrt(2.0))], 1)
        total = Slopes(total.value + value, total.gradient + gradient, total.information + scaled @ scaled.T)
        return (after, after_slopes, total), None

    belief, by_theta = jax.vmap(lambda way: jax.jvp(begin, (point,), (way,)), out_axes=(None, 0))(along)
    before = [jnp.concatenate([x[:1], x[:-1]]) for x in (control, slopes, trial.step)]
    first = jnp.arange(trial.step.shape[0]) == 0
    samples = (before[0], before[1], control, slopes, first, before[2], measured)
    (_, _, total), _ = jax.lax.scan(step, (belief, by_theta, _nothing(d)), samples)
    return total


def _nothing(d: int) -> Slopes:
    return Slopes(jnp.zeros(()), jnp.zeros(d), jnp.zeros((d, d)))


def _arrays(tree: Any) -> Any:
    return jax.tree.map(lambda x: jnp.asarray(x, float), tree)
