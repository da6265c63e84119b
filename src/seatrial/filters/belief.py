"""What every filter shares: its belief, what one measurement update reports, and how missing channels are left out."""

from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple, Protocol

import jax.numpy as jnp

from seatrial.numerics.state_space import StateSpace
from seatrial.numerics.triangular import Scalar, Triangle, Vector, dot, is_zero, log_diagonal, solve_lower

LOG_2PI = 1.8378770664093453


class FilterState(NamedTuple):
    """Mean and spread of the state, held as the filter's form says: covariance or its Cholesky factor, scalars or arrays."""

    mean: Any
    spread: Any


class Update(NamedTuple):
    """What one measurement update reports.

    Attributes:
        log_likelihood: log density of the measurement given the past, 0 if nothing was measured.
        nis: normalised innovation squared; chi-squared with `n_measured` degrees of freedom if the filter is consistent.
        n_measured: channels measured.
        innovation: measured minus predicted, NaN if missing.
        failed: whether a covariance lost positive definiteness.
        clipped: number of sigma points moved back to the bounds.
        residual: innovation of each channel given those before it at the same time, 0 if missing.
        variance: its variance, 1 if missing; the log-likelihood is that of these residuals, one after the other.
    """

    log_likelihood: Scalar
    nis: Scalar
    n_measured: Scalar
    innovation: Vector
    failed: Scalar
    clipped: Scalar
    residual: Vector
    variance: Vector


class Filter(Protocol):
    """A recursive Gaussian filter; implementations are frozen dataclasses of plain settings, so that they can be hashed."""

    form: ClassVar[Any]
    """How the belief is held, one of `seatrial.filters.forms`."""

    def predict(
        self, space: StateSpace, belief: FilterState, control: Vector, step: Scalar
    ) -> tuple[FilterState, Scalar]:
        """Return the belief one step later, and the number of sigma points clipped."""
        ...

    def update(
        self, space: StateSpace, belief: FilterState, control: Vector, measurement: Vector
    ) -> tuple[FilterState, Update]:
        """Return the belief after a measurement in which NaN marks a missing channel."""
        ...


class Masked(NamedTuple):
    """A measurement with its gaps taken out: a missing channel has weight 0, innovation 0 and unit noise.

    Cross terms are multiplied by the weight, so the channel drops out of the update exactly.
    """

    weight: Vector
    noise_sd: Vector
    innovation: Vector
    reported: Vector


def mask_missing(space: StateSpace, measurement: Vector, predicted: Sequence[Scalar]) -> Masked:
    """Split a measurement into present and missing channels.

    Args:
        space: of m channels.
        measurement: SI, NaN if a channel is missing.
        predicted: what was expected of each.
    """
    present = tuple(jnp.isfinite(y) for y in measurement)
    difference = tuple(y - p for y, p in zip(measurement, predicted, strict=True))
    return Masked(
        weight=tuple(p * 1.0 for p in present),
        noise_sd=tuple(jnp.where(p, space.measurement_sd[i], 1.0) for i, p in enumerate(present)),
        innovation=tuple(jnp.where(p, d, 0.0) for p, d in zip(present, difference, strict=True)),
        reported=tuple(jnp.where(p, d, jnp.nan) for p, d in zip(present, difference, strict=True)),
    )


def process_columns(space: StateSpace, state: Vector, control: Vector, step: Scalar) -> list[Vector]:
    """Return columns whose outer products add up to the covariance of the process noise over a step; structural zeros are kept.

    Args:
        space: of n states.
        state: about which the noise acts.
        control: held over the step.
        step: s.
    """
    n, shocks = len(state), () if space.shocks is None else space.shocks(state, control, step)
    own = [tuple(space.process_sd[i] if i == j else 0.0 for j in range(n)) for i in range(n)]
    return [*own, *((*shock, *[0.0] * (n - len(shock))) for shock in shocks)]


def process_covariance(space: StateSpace, state: Vector, control: Vector, step: Scalar) -> Any:
    """Return the covariance of the process noise over a step as an array, shape (n, n); arguments as `process_columns`."""
    covariance = jnp.diag(space.process_sd**2)
    for shock in () if space.shocks is None else space.shocks(state, control, step):
        column = jnp.zeros(len(state)).at[: len(shock)].set(jnp.stack([jnp.asarray(x, float) for x in shock]))
        covariance = covariance + jnp.outer(column, column)
    return covariance


def gate(weight: Scalar, value: Scalar) -> Scalar:
    """Return the product with a channel's weight that keeps structural zeros."""
    return value if is_zero(value) else weight * value


def whiten(factor: Triangle, masked: Masked, failed: Scalar = False, clipped: Scalar = 0) -> tuple[Vector, Update]:
    """Whiten the innovation with the lower factor of its covariance; return it and the update's report.

    Args:
        factor: lower triangle of the innovation's covariance.
        masked: what was measured, and which channels are missing.
        failed: whether a covariance before was not positive.
        clipped: sigma points that were clipped.
    """
    white = solve_lower(factor, masked.innovation)
    nis = dot(white, white)
    n_measured = sum(masked.weight)
    log_likelihood = -0.5 * (nis + n_measured * LOG_2PI) - log_diagonal(factor)
    sizes = [row[i] for i, row in enumerate(factor)]
    return white, Update(
        log_likelihood,
        nis,
        n_measured,
        masked.reported,
        failed | ~jnp.isfinite(log_likelihood),
        clipped,
        tuple(e * size for e, size in zip(white, sizes, strict=True)),
        tuple(size * size for size in sizes),
    )


def condition(
    belief: FilterState, factor: Triangle, cross: Sequence[Vector], masked: Masked
) -> tuple[FilterState, Update]:
    """Update in covariance form: mean + B e and P - B B^T, with B = P_xy S^-T/2 and e the whitened innovation.

    Args:
        belief: prior belief, in covariance form.
        factor: lower factor of the innovation covariance S.
        cross: rows of the cross covariance P_xy, one for each state.
        masked: measurement.
    """
    white, update = whiten(factor, masked)
    gains = [solve_lower(factor, row) for row in cross]
    mean = tuple(x + dot(gain, white) for x, gain in zip(belief.mean, gains, strict=True))
    covariance = tuple(
        tuple(p - dot(gains[i], gains[j]) for j, p in enumerate(row)) for i, row in enumerate(belief.spread)
    )
    return FilterState(mean, covariance), update
