"""The regularised horseshoe: shrinkage instead of a choice among structures (Piironen and Vehtari, EJS 11, 2017).

    c_j = tau l_j z_j,  z_j ~ N(0, 1),  l_j^2 = w^2 lambda_j^2 / (w^2 + tau^2 lambda_j^2),  lambda_j ~ C+(0, 1)
    tau ~ C+(0, p0 / (k - p0) s / sqrt(n)),  w^2 ~ inverse gamma(nu/2, nu slab^2/2),  log s ~ N(log rms of y, 1)

on columns of root mean square 1. The shrinkage factor kappa_j = 1 / (1 + n tau^2 l_j^2 / s^2) is 0 where the data speak and 1 where
the coefficient is pulled to zero; 1 - kappa_j, averaged, stands for the inclusion probability that this prior does not have.
Non-centred, in logarithms of the scales, by NUTS.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.core.errors import InputError
from seatrial.sampling import nuts
from seatrial.sampling.diagnostics import ChainHealth, complaints, diagnose
from seatrial.sampling.run import ChainSettings, complaints_of_draws
from seatrial.sampling.sampler import sample
from seatrial.selection.subsets.gram import Gram, check_gram

SLAB, FREEDOM = 2.0, 4.0
"""Scale of the slab over the root mean square of the response, and the slab's degrees of freedom."""
SETTINGS = ChainSettings(chains=8, warmup=500, draws=500)


class Horseshoe(NamedTuple):
    """Posterior under the regularised horseshoe.

    Attributes:
        names: terms.
        coefficients: draws, in their own units, shape (chains, draws, k).
        kappa: shrinkage factors, shape (chains, draws, k).
        noise_sd: draws, unit of the response, shape (chains, draws).
        health: diagnostics of the coefficients.
        status: empty if the chains can be trusted, else what is wrong in words.
    """

    names: tuple[str, ...]
    coefficients: Float[np.ndarray, "chains draws k"]
    kappa: Float[np.ndarray, "chains draws k"]
    noise_sd: Float[np.ndarray, "chains draws"]
    health: ChainHealth
    status: str

    @property
    def pseudo_inclusion(self) -> Float[np.ndarray, " k"]:
        """Mean of 1 - kappa of each term."""
        return 1 - self.kappa.mean((0, 1))

    @property
    def effective_terms(self) -> float:
        """Posterior mean of the number of terms that are not shrunk, the sum of 1 - kappa."""
        return float(self.pseudo_inclusion.sum())

    @property
    def terms(self) -> tuple[str, ...]:
        """Terms whose central 95 % interval leaves out zero: with few terms in all, kappa of noise is near one half, too."""
        low, high = np.quantile(self.coefficients, (0.025, 0.975), axis=(0, 1))
        return tuple(name for name, real in zip(self.names, (low > 0) | (high < 0), strict=True) if real)


class HorseshoeTarget(NamedTuple):
    """Density of z = (k standardised coefficients, k logs of lambda, log tau over its scale, log w, log s).

    Columns and response have root mean square 1.

    Attributes:
        matrix: Phi^T Phi, shape (k, k).
        moment: Phi^T y, shape (k,).
        n: number of measurements, also y^T y.
        expected: odds p0 / (k - p0) of a term.
        slab: scale of the slab.
    """

    matrix: Float[Array, "k k"]
    moment: Float[Array, " k"]
    n: Float[Array, ""]
    expected: Float[Array, ""]
    slab: Float[Array, ""]

    @property
    def dim(self) -> int:
        """Number of components of z."""
        return 2 * self.moment.shape[0] + 3

    def parts(self, z: Float[Array, " d"]) -> tuple[Array, Array, Array]:
        """Coefficients, their prior standard deviations tau l_j, and the noise standard deviation."""
        k = self.moment.shape[0]
        local, (log_tau, log_width, log_noise) = z[k : 2 * k], z[2 * k :]
        width, noise = self.slab * jnp.exp(log_width), jnp.exp(log_noise)
        tau = jnp.exp(log_tau) * self.expected * noise / jnp.sqrt(self.n)
        # 1 / sqrt(1 / a^2 + 1 / w^2), safe for a scale that is very large
        scale = 1 / jnp.sqrt(jnp.exp(-2 * local) / tau**2 + 1 / width**2)
        return scale * z[:k], scale, noise

    def log_prior(self, z: Float[Array, " d"]) -> Float[Array, ""]:
        """Log prior density."""
        k = self.moment.shape[0]
        normal = -0.5 * jnp.sum(z[:k] ** 2) - 0.5 * z[-1] ** 2 - 0.5 * (k + 1) * jnp.log(2 * jnp.pi)
        cauchy = jnp.sum(jnp.log(2 / jnp.pi) - jnp.logaddexp(z[k:-2], -z[k:-2]))
        half = FREEDOM / 2
        width = (
            jnp.log(2.0) + half * jnp.log(half) - jax.lax.lgamma(half) - 2 * half * z[-2] - half * jnp.exp(-2 * z[-2])
        )
        return normal + cauchy + width

    def log_likelihood(self, z: Float[Array, " d"]) -> Float[Array, ""]:
        """Log-likelihood of the standardised response."""
        c, _, noise = self.parts(z)
        left = self.n - 2 * c @ self.moment + c @ self.matrix @ c
        return -0.5 * left / noise**2 - self.n * (jnp.log(noise) + 0.5 * jnp.log(2 * jnp.pi))

    def sample_prior(self, key: jax.Array, n: int) -> Float[Array, "n d"]:
        """Draws from the prior."""
        k = self.moment.shape[0]
        keys = jax.random.split(key, 4)
        log_cauchy = jnp.log(jnp.abs(jax.random.cauchy(keys[1], (n, k + 1))))
        log_width = 0.5 * jnp.log(FREEDOM / 2 / jax.random.gamma(keys[2], FREEDOM / 2, (n, 1)))
        return jnp.concatenate(
            [jax.random.normal(keys[0], (n, k)), log_cauchy, log_width, jax.random.normal(keys[3], (n, 1))], axis=1
        )


def horseshoe(
    stats: Gram,
    names: Sequence[str],
    key: jax.Array,
    *,
    expected: float = 1.0,
    slab: float = SLAB,
    settings: ChainSettings = SETTINGS,
) -> Horseshoe:
    """Sample the coefficients under the regularised horseshoe.

    Args:
        stats: of the regression on all terms.
        names: of the terms, one for each column.
        key: random key.
        expected: guess of the number of terms that are real, above 0 and below k; too few costs little, since real terms
            escape the shrinkage, and too many leaves the others half shrunk.
        slab: scale of coefficients that are not shrunk, over the root mean square of the response, on columns of unit size.
        settings: size of the run.

    Raises:
        InputError: as `check_gram`; a response that is zero, fewer than two terms, a guess or a slab out of range.
    """
    names = tuple(names)
    check_gram(stats, names)
    k = len(names)
    _check(stats, k, expected, slab)
    size, rms = np.sqrt(np.diag(stats.matrix) / stats.n), np.sqrt(stats.square / stats.n)
    numbers = (
        stats.matrix / np.outer(size, size),
        stats.moment / (size * rms),
        float(stats.n),
        expected / (k - expected),
        slab,
    )
    target = HorseshoeTarget(*(jnp.asarray(x, float) for x in numbers))
    key_start, key_chains = jax.random.split(key)
    starts = 0.3 * jax.random.normal(key_start, (settings.chains, target.dim))
    draws = sample(nuts, target, starts, jnp.eye(target.dim), key_chains, settings)
    coefficients, scale, noise = map(np.asarray, _parts(target, jnp.asarray(draws.z)))
    coefficients = coefficients * rms / size
    health = diagnose(coefficients)
    return Horseshoe(
        names,
        coefficients,
        1 / (1 + stats.n * (scale / noise[..., None]) ** 2),
        noise * rms,
        health,
        "; ".join([*complaints(names, health), *complaints_of_draws(draws)]),
    )


@jax.jit
def _parts(target: HorseshoeTarget, z: Float[Array, "chains draws d"]) -> tuple[Array, Array, Array]:
    return jax.vmap(jax.vmap(target.parts))(z)


def _check(stats: Gram, k: int, guess: float, slab: float) -> None:
    if not stats.square > 0:
        raise InputError(
            "response",
            found="zero throughout",
            expected="a measured response",
            remedy="give a trial that excites the axis",
        )
    if k < 2 or not 0 < guess < k:
        raise InputError(
            "expected number of terms",
            found=f"{guess:g} of {k}",
            expected="above 0, and fewer than all of at least two",
            remedy="guess how many terms of the library are real",
        )
    if not 0 < slab < np.inf:
        raise InputError("scale of the slab", found=str(slab), expected="a positive number", remedy="take 1 to 3")
