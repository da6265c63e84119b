"""A Gaussian by its mean and the lower Cholesky factor of its covariance, and its differential entropy."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float


class Gaussian(NamedTuple):
    """Normal distribution N(mean, chol_cov @ chol_cov.T); a pytree, so it may be batched."""

    mean: Float[Array, "*batch n"]
    chol_cov: Float[Array, "*batch n n"]

    @property
    def cov(self) -> Float[Array, "*batch n n"]:
        """Covariance matrix."""
        return self.chol_cov @ jnp.swapaxes(self.chol_cov, -1, -2)

    @property
    def sd(self) -> Float[Array, "*batch n"]:
        """Marginal standard deviations."""
        return jnp.sqrt(jnp.sum(self.chol_cov**2, axis=-1))

    def marginal(self, start: int) -> "Gaussian":
        """Return the marginal of the components from `start` on."""
        cov = self.cov[..., start:, start:]
        return Gaussian(self.mean[..., start:], jnp.linalg.cholesky(cov))

    def entropy(self) -> Float[Array, "*batch"]:
        """Differential entropy in nats: 0.5 log((2 pi e)^n |P|), Cover and Thomas (2006), theorem 8.4.1."""
        n = self.mean.shape[-1]
        diagonal = jnp.diagonal(self.chol_cov, axis1=-2, axis2=-1)
        return 0.5 * n * jnp.log(2 * jnp.pi * jnp.e) + jnp.sum(jnp.log(jnp.abs(diagonal)), axis=-1)


def independent(mean: Float[Array, " n"], sd: Float[Array, " n"]) -> Gaussian:
    """Gaussian with independent components of the given standard deviations."""
    return Gaussian(jnp.asarray(mean, float), jnp.diag(jnp.asarray(sd, float)))
