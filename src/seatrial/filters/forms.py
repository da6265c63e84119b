"""How a belief is held while a filter runs: triangles of scalars, covariance or its factor, or arrays where there are many."""

from typing import Any, Protocol

import jax.numpy as jnp

from seatrial.filters.belief import FilterState
from seatrial.numerics.gaussian import Gaussian
from seatrial.numerics.triangular import Scalar, cholesky, cholesky_of_array, to_matrix, to_triangle


class StateForm(Protocol):
    """The two ends of a run, and what is asked of a belief on the way."""

    def begin(self, initial: Gaussian) -> FilterState:
        """Return the belief of a Gaussian."""
        ...

    def end(self, belief: FilterState) -> Gaussian:
        """Return the Gaussian of a belief."""
        ...

    def means(self, belief: FilterState) -> tuple[Scalar, ...]:
        """Return the mean of each state."""
        ...

    def sds(self, belief: FilterState) -> tuple[Scalar, ...]:
        """Return the standard deviation of each state."""
        ...

    def positive(self, belief: FilterState) -> Scalar:
        """Return whether every pivot of the factor, or every variance of the covariance, is positive and finite."""
        ...


class CovarianceTriangle:
    """The lower triangle of the covariance, as scalars."""

    def begin(self, initial: Gaussian) -> FilterState:
        """See `StateForm.begin`."""
        return FilterState(tuple(initial.mean), to_triangle(initial.chol_cov @ initial.chol_cov.T))

    def end(self, belief: FilterState) -> Gaussian:
        """See `StateForm.end`."""
        return Gaussian(jnp.stack(belief.mean), to_matrix(cholesky(belief.spread)))

    def means(self, belief: FilterState) -> tuple[Scalar, ...]:
        """See `StateForm.means`."""
        return belief.mean

    def sds(self, belief: FilterState) -> tuple[Scalar, ...]:
        """See `StateForm.sds`."""
        return tuple(jnp.sqrt(row[-1]) for row in belief.spread)

    def positive(self, belief: FilterState) -> Scalar:
        """See `StateForm.positive`."""
        return _positive(jnp.stack([row[-1] for row in belief.spread]))


class FactorTriangle(CovarianceTriangle):
    """The Cholesky factor of the covariance, as scalars."""

    def begin(self, initial: Gaussian) -> FilterState:
        """See `StateForm.begin`."""
        return FilterState(tuple(initial.mean), to_triangle(initial.chol_cov))

    def end(self, belief: FilterState) -> Gaussian:
        """See `StateForm.end`."""
        return Gaussian(jnp.stack(belief.mean), to_matrix(belief.spread))

    def sds(self, belief: FilterState) -> tuple[Scalar, ...]:
        """See `StateForm.sds`."""
        return tuple(jnp.sqrt(sum(x * x for x in row)) for row in belief.spread)


class CovarianceArray:
    """The mean, shape (n,), and the covariance, shape (n, n), as arrays."""

    def begin(self, initial: Gaussian) -> FilterState:
        """See `StateForm.begin`."""
        return FilterState(initial.mean, initial.chol_cov @ initial.chol_cov.T)

    def end(self, belief: FilterState) -> Gaussian:
        """See `StateForm.end`."""
        return Gaussian(belief.mean, cholesky_of_array(belief.spread))

    def means(self, belief: FilterState) -> tuple[Scalar, ...]:
        """See `StateForm.means`."""
        return tuple(belief.mean)

    def sds(self, belief: FilterState) -> tuple[Scalar, ...]:
        """See `StateForm.sds`."""
        return tuple(jnp.sqrt(jnp.diag(belief.spread)))

    def positive(self, belief: FilterState) -> Scalar:
        """See `StateForm.positive`."""
        return _positive(jnp.diag(belief.spread))


class FactorArray(CovarianceArray):
    """The mean, shape (n,), and the Cholesky factor of the covariance, shape (n, n), as arrays."""

    def begin(self, initial: Gaussian) -> FilterState:
        """See `StateForm.begin`."""
        return FilterState(initial.mean, initial.chol_cov)

    def end(self, belief: FilterState) -> Gaussian:
        """See `StateForm.end`."""
        return Gaussian(belief.mean, belief.spread)

    def sds(self, belief: FilterState) -> tuple[Scalar, ...]:
        """See `StateForm.sds`."""
        return tuple(jnp.sqrt((belief.spread**2).sum(1)))


def _positive(values: Any) -> Scalar:
    return ((values > 0) & (values < jnp.inf)).all()
