"""A Gaussian by its mean and the lower Cholesky factor of its covariance, and its differential entropy."""

from math import e, log, pi
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Array, Float

from seatrial.numerics.array_module import array_module


class Gaussian(NamedTuple):
    """Normal distribution N(mean, chol_cov @ chol_cov.T); a pytree, so it may be batched."""

    mean: Float[Array, "*batch n"]
    chol_cov: Float[Array, "*batch n n"]

    @property
    def cov(self) -> Float[Array, "*batch n n"]:
        """Covariance matrix."""
        return self.chol_cov @ array_module(self.chol_cov).swapaxes(self.chol_cov, -1, -2)

    @property
    def sd(self) -> Float[Array, "*batch n"]:
        """Marginal standard deviations."""
        xp = array_module(self.chol_cov)
        return xp.sqrt(xp.sum(self.chol_cov**2, axis=-1))

    def marginal(self, start: int) -> "Gaussian":
        """Return the marginal of the components from `start` on."""
        cov = self.cov[..., start:, start:]
        return Gaussian(self.mean[..., start:], _cholesky(cov))

    def entropy(self) -> Float[Array, "*batch"]:
        """Differential entropy in nats: 0.5 log((2 pi e)^n |P|), Cover and Thomas (2006), theorem 8.4.1."""
        n, xp = self.mean.shape[-1], array_module(self.chol_cov)
        diagonal = xp.diagonal(self.chol_cov, axis1=-2, axis2=-1)
        return 0.5 * n * log(2 * pi * e) + xp.sum(xp.log(xp.abs(diagonal)), axis=-1)


def _cholesky(cov: Any) -> Any:
    """Lower factor, NaN if there is none, by NumPy as by JAX."""
    xp = array_module(cov)
    # A program with LAPACK in it has JAX load SciPy, which takes longer than a sweep.
    if xp is not np and cov.ndim == 2:
        from seatrial.numerics.triangular import cholesky_of_array

        return cholesky_of_array(cov)
    try:
        return xp.linalg.cholesky(cov)
    except np.linalg.LinAlgError:
        return np.full_like(cov, np.nan)


def independent(mean: Float[Array, " n"], sd: Float[Array, " n"]) -> Gaussian:
    """Gaussian with independent components of the given standard deviations."""
    xp = array_module(mean, sd)
    return Gaussian(xp.asarray(mean, float), xp.diag(xp.asarray(sd, float)))
