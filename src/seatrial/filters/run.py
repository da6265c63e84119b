"""The one driver of all filters: update at each sample, predict to the next, over a whole record in one compiled loop."""

from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from seatrial.compiled.programs import program
from seatrial.filters.belief import Filter
from seatrial.numerics.gaussian import Gaussian
from seatrial.numerics.state_space import StateSpace


class FilterTrace(NamedTuple):
    """What a filter says about a record; n samples, d states, m channels.

    Attributes:
        log_likelihood: log density of all measurements.
        final: belief after the last measurement.
        means: filtered means, shape (n, d).
        sds: filtered standard deviations, shape (n, d).
        innovations: measured minus predicted, NaN if missing, shape (n, m).
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
        measurement: NaN if a channel was not measured.
        step: time from each sample to the next, s; the last entry is not used.
    """
    return _runner(method)(space, control, measurement, step)


def filter_within(
    method: Filter,
    space: StateSpace,
    control: Float[Array, "n n_controls"],
    measurement: Float[Array, "n m"],
    step: Float[Array, " n"],
    growth: Float[Array, " n"] | None = None,
) -> FilterSummary:
    """Filter inside a function that is being compiled, of which the space's functions may hold variables; keep the end alone.

    Args:
        method: as of `run_filter`, like `space`, `control`, `measurement` and `step`.
        growth: factor of `process_sd` over each step; None for 1.
    """
    return _pass(method, False, space, control, measurement, step, growth)


@lru_cache(maxsize=64)
def _runner(method: Filter):
    @program
    def run(space: StateSpace, control: Array, measurement: Array, step: Array):
        return _pass(method, True, space, control, measurement, step, None)

    return run


def _pass(
    method: Filter,
    keep_trace: bool,
    space: StateSpace,
    control: Array,
    measurement: Array,
    step: Array,
    growth: Array | None,
) -> Any:
    def advance(carry: tuple, sample: tuple) -> tuple[tuple, tuple]:
        belief, held, h, grown, log_likelihood, failures = carry
        first, now, measured, ahead, ahead_grown = sample
        moving = space if growth is None else replace(space, process_sd=space.process_sd * grown)
        # A branch rather than a last update behind the loop: half the code, and XLA does not fuse across it.
        prior, clipped = jax.lax.cond(
            first, lambda: (belief, zero), lambda: _arrays(method.predict(moving, belief, held, h))
        )
        after, update = method.update(space, prior, now, measured)
        failed = update.failed | ~method.form.positive(after)
        carry = (
            _arrays(after),
            now,
            ahead,
            ahead_grown,
            log_likelihood + update.log_likelihood,
            failures + failed,
        )
        if not keep_trace:
            return carry, ()
        means, sds = method.form.means(after), method.form.sds(after)
        return carry, (means, sds, update.innovation, update.nis, update.n_measured, update.clipped + clipped)

    start = method.form.begin(space.initial)
    zero = jnp.zeros(())
    first = jnp.arange(step.shape[0]) == 0
    grows = step if growth is None else growth
    samples = (first, tuple(control.T), tuple(measurement.T), step, grows)
    begin = (_arrays(start), tuple(control[0]), step[0], grows[0], zero, zero)
    (after, _, _, _, log_likelihood, failures), kept = jax.lax.scan(advance, begin, samples)
    final = method.form.end(after)
    failures = jnp.maximum(failures, ~jnp.isfinite(final.chol_cov).all())
    if not keep_trace:
        return FilterSummary(log_likelihood, final, failures)
    means, sds, innovations, nis, n_measured, clipped = kept
    return FilterTrace(
        log_likelihood,
        final,
        jnp.stack(means, 1),
        jnp.stack(sds, 1),
        jnp.stack(innovations, 1),
        nis,
        n_measured,
        clipped,
        failures,
    )


def _arrays(tree: Any) -> Any:
    return jax.tree.map(lambda x: jnp.asarray(x, float), tree)
