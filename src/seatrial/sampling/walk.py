"""What walking samplers share: the decision on a proposal, and what all chains together learn in warm-up."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

TARGET_ACCEPTANCE = 0.234  # Of a step in many dimensions (Roberts, Gelman and Gilks, Ann. Appl. Probab. 7, 1997).


def first_log_scale(dim: int) -> float:
    """Return the log of 2.38 / sqrt(d), the best scale of a normal step on a normal density of d dimensions."""
    return float(np.log(2.38 / np.sqrt(dim)))


def step_factor(cov: Float[Array, "d d"]) -> Float[Array, "d d"]:
    """Return the Cholesky factor of a learnt covariance, which may be singular to rounding."""
    return jnp.linalg.cholesky(cov + 1e-12 * jnp.diag(jnp.diag(cov)))


def log_ratio_of(proposed: Float[Array, " chains"], now: Float[Array, " chains"]) -> Float[Array, " chains"]:
    """Return the log of the ratio of densities; a proposal where the density is broken has none."""
    return jnp.where(jnp.isfinite(proposed), proposed, -jnp.inf) - now


def mean_acceptance(log_ratio: Float[Array, " chains"]) -> Float[Array, ""]:
    """Return the mean over the chains of the probability to accept."""
    return jnp.mean(jnp.exp(jnp.minimum(log_ratio, 0.0)))


def learn_moments(
    mean: Float[Array, " d"], cov: Float[Array, "d d"], z: Float[Array, "chains d"], weight: Float[Array, ""]
) -> tuple[Float[Array, " d"], Float[Array, "d d"]]:
    """Move a running mean and covariance towards those of all chains.

    Args:
        mean: running mean, shape (d,).
        cov: running covariance, shape (d, d).
        z: where all chains are, shape (chains, d).
        weight: of what is new, from 0 to 1.
    """
    mean = mean + weight * (z.mean(0) - mean)
    spread = z - mean
    return mean, cov + weight * (spread.T @ spread / z.shape[0] - cov)


def gain_at(t: Array, warmup: int) -> Float[Array, ""]:
    """Return the gain of the log scale in iteration t, (t + 1)^-0.6; none after warm-up."""
    return jnp.where(t < warmup, (t + 1.0) ** -0.6, 0.0)
