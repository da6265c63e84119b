"""What a sampler sees: a density on the real vector space, prior and likelihood kept apart."""

from functools import partial
from typing import Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.compiled.batching import lanes_at_once, map_lanes
from seatrial.compiled.programs import program


class Target(Protocol):
    """A pytree whose arrays are the data, so that one compiled sampler serves every data set of the same shape.

    Densities may be -inf, never NaN.
    """

    @property
    def dim(self) -> int:
        """Number of components of z."""
        ...

    def log_prior(self, z: Float[Array, " d"]) -> Float[Array, ""]:
        """Return the log prior density."""
        ...

    def log_likelihood(self, z: Float[Array, " d"]) -> Float[Array, ""]:
        """Log-likelihood."""
        ...

    def sample_prior(self, key: jax.Array, n: int) -> Float[Array, "n d"]:
        """Return the draws from the prior."""
        ...


VECTOR = 8  # Lanes of few: as many doubles as the widest vector registers hold


@program
def log_densities(target: Target, z: Float[Array, "n d"]) -> Float[Array, " n"]:
    """Return the log densities of several positions, computed side by side.

    Fewer than a vector of them are filled up to one: the compiler leaves a part of a vector scalar, and 4 lanes then cost half
    as much again as 8.
    """
    n = z.shape[0]
    filled = jnp.concatenate([z, jnp.broadcast_to(z[:1], (VECTOR - n, z.shape[1]))]) if 1 < n < VECTOR else z
    return jax.vmap(partial(_log_density, target))(filled)[:n]


# Positions in one call of `evaluate`, at least: the same for every caller, so that each target is compiled once.
AT_ONCE = 512
# Densities computed at once on a processor: enough to fill its vector units, few enough for their data to stay in its
# cache.
LANES = 64


def evaluate(target: Target, z: Float[np.ndarray, "n d"], at_once: int = AT_ONCE) -> Float[np.ndarray, " n"]:
    """Return the log densities of any number of positions, NaN taken as -inf; arguments as `evaluate_parts`."""
    values = np.add(*evaluate_parts(target, z, at_once))
    return np.where(np.isnan(values), -np.inf, values)


def evaluate_parts(
    target: Target, z: Float[np.ndarray, "n d"], at_once: int = AT_ONCE
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Return log prior densities and log-likelihoods; few programs to compile, since compiling is what takes time.

    Args:
        target: density.
        z: positions, any number of them.
        at_once: positions in one call, at least.
    """
    n = z.shape[0]
    size = max(at_once, lanes_at_once(partial(_evaluate, target), z, cpu=LANES))
    blocks = np.minimum(np.arange(-(-n // size) * size), n - 1).reshape(-1, size)
    log_prior, log_likelihood = zip(*(_evaluate(target, z[block]) for block in blocks), strict=True)
    return np.concatenate(log_prior)[:n], np.concatenate(log_likelihood)[:n]


@program
def _evaluate(target: Target, z: Float[Array, "n d"]) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    return map_lanes(lambda one: (target.log_prior(one), target.log_likelihood(one)), z, LANES)


def _log_density(target: Target, z: Float[Array, " d"]) -> Float[Array, ""]:
    return target.log_prior(z) + target.log_likelihood(z)
