"""The one driver of all filters: update at each sample, predict to the next, over a whole record in one compiled loop."""

from functools import lru_cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from seatrial.core.gaussian import Gaussian
from seatrial.core.state_space import StateSpace
from seatrial.filters.belief import Belief, Filter
from seatrial.numerics.triangular import Triangle, cholesky, to_matrix, to_triangle


class FilterTrace(NamedTuple):
    """What a filter says about a record; n samples, d states, m channels.

    Attributes:
        log_likelihood: log density of all measurements.
        final: belief after the last measurement.
        means: filtered means, shape (n, d).
        sds: filtered standard deviations, shape (n, d).
        innovations: measured minus predicted, NaN where missing, shape (n, m).
        nis: normalised innovation squared, shape (n,).
        n_measured: channels measured, shape (n,).
        clipped: sigma points clipped at each sample, shape (n,).
        failures: number of samples at which a covariance lost positive definiteness; anything but 0 voids the trace.
    """

    log_likelihood: Float[Array, ""]
    final: Gaussian
    means: Float[Array, "n d"]
    sds: Float[Array, "n d"]
    innovations: Float[Array, "n m"]
    nis: Float[Array, " n"]
    n_measured: Float[Array, " n"]
    clipped: Float[Array, " n"]
    failures: Float[Array, ""]


class FilterSummary(NamedTuple):
    """The end of a run only: what design needs, without the memory of a trace."""

    log_likelihood: Float[Array, ""]
    final: Gaussian
    failures: Float[Array, ""]


def run_filter(
    method: Filter,
    space: StateSpace,
    control: Float[Array, "n n_controls"],
    measurement: Float[Array, "n m"],
    step: Float[Array, " n"],
) -> FilterTrace:
    """Run a filter over a record and keep everything. May be batched with `jax.vmap` over any array.

    Args:
        method: one of the filters of this package.
        space: state space; its initial belief is that before the first measurement.
        control: control held from each sample to the next, SI.
        measurement: NaN where a channel was not measured.
        step: time from each sample to the next, s; the last entry is not used.
    """
    return _runner(method, True)(space, control, measurement, step)


def summarise_filter(
    method: Filter,
    space: StateSpace,
    control: Float[Array, "n n_controls"],
    measurement: Float[Array, "n m"],
    step: Float[Array, " n"],
) -> FilterSummary:
    """Run a filter and keep only the total log-likelihood and the final belief; arguments as `run_filter`."""
    return _runner(method, False)(space, control, measurement, step)


@lru_cache(maxsize=64)
def _runner(method: Filter, keep_trace: bool):
    @jax.jit
    def run(space: StateSpace, control: Array, measurement: Array, step: Array):
        def advance(carry: tuple, sample: tuple):
            belief, log_likelihood, failures, clipped_before = carry
            held, measured, h = sample
            after, update = method.update(space, belief, held, measured)
            total = log_likelihood + update.log_likelihood
            failures = failures + update.failed * 1
            ahead, clipped = method.predict(space, after, held, h)
            carry = (_arrays(ahead), total, failures, jnp.asarray(clipped, float))
            if not keep_trace:
                return carry, None
            sds = tuple(
                jnp.sqrt(sum(x * x for x in row)) if method.square_root else jnp.sqrt(row[-1]) for row in after.spread
            )
            return carry, (
                after.mean,
                sds,
                update.innovation,
                update.nis,
                update.n_measured,
                update.clipped + clipped_before,
            )

        start = Belief(tuple(space.initial.mean), _start(method, space.initial))
        zero = jnp.zeros(())
        samples = (tuple(control.T), tuple(measurement.T), step)
        n = measurement.shape[0]
        carry, kept = jax.lax.scan(
            advance, (_arrays(start), zero, zero, zero), jax.tree.map(lambda x: x[: n - 1], samples)
        )
        belief, log_likelihood, failures, clipped = carry
        last = jax.tree.map(lambda x: x[n - 1], samples)
        after, update = method.update(space, belief, last[0], last[1])
        final = Gaussian(
            jnp.stack(after.mean), to_matrix(after.spread if method.square_root else cholesky(after.spread))
        )
        log_likelihood, failures = log_likelihood + update.log_likelihood, failures + update.failed * 1
        failures = failures + ~jnp.isfinite(final.chol_cov).all() * 1
        if not keep_trace:
            return FilterSummary(log_likelihood, final, failures)
        end = (after.mean, tuple(final.sd), update.innovation, update.nis, update.n_measured, update.clipped + clipped)
        means, sds, innovations, nis, n_measured, clips = jax.tree.map(
            lambda a, b: jnp.concatenate([a, jnp.reshape(b, (1,)).astype(a.dtype)]), kept, end
        )
        return FilterTrace(
            log_likelihood,
            final,
            jnp.stack(means, -1),
            jnp.stack(sds, -1),
            jnp.stack(innovations, -1),
            nis,
            n_measured,
            clips,
            failures,
        )

    return run


def _start(method: Filter, initial: Gaussian) -> Triangle:
    return to_triangle(initial.chol_cov if method.square_root else initial.chol_cov @ initial.chol_cov.T)


def _arrays(belief: Belief) -> Belief:
    return jax.tree.map(lambda x: jnp.asarray(x, float), belief)
