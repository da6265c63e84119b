"""Coordinates in which a spread between trials, the common value and each trial's own can be sampled.

With v_i = mu + tau d_i and d_i standard normal, d_i is a priori independent of mu and tau. Once trial i itself knows v_i, to o_i with
information p_i, it is not: d_i is then (v_i - mu) / tau, and mu within tau of the v_i, ridges that bend and along which no sampler
moves far. Given tau, and as far as trials are normal about v_i and the prior is about mu, of z_mu = (mu - m) / s, both are normal,

    z_mu = sum w_i z_i / (1 + sum w_i)  +  x_mu / sqrt(1 + sum w_i),   w_i = s^2 p_i / (1 + p_i tau^2),  z_i = (o_i - m) / s
    d_i  = p_i tau (o_i - mu) / (1 + p_i tau^2)  +  x_i / sqrt(1 + p_i tau^2)

with x standard normal, and these take the places of z_mu and d_i. What trial i knows of v_i depends on the other parameters, by
o_i = a_i + b_i z. Where trials know nothing x is z; where they know all, x_i is (v_i - o_i) sqrt(p_i) (Papaspiliopoulos, Roberts and
Skoeld, Statistical Science 22, 2007, between the two). The posterior stays what it was, whatever o and p.
"""

from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.compiled.programs import program
from seatrial.compiled.pytrees import compiled_tree
from seatrial.estimation.posterior.mode import Mode
from seatrial.estimation.posterior.output_error import deviation_name, spread_name
from seatrial.estimation.posterior.posterior import Posterior, named_draws
from seatrial.sampling.run import Draws
from seatrial.sampling.target import Target

UNTOUCHED = 1e-6  # Information about d_i, over that of its prior, below which its trial says nothing of it


@compiled_tree("common", "spread", "deviation")
@dataclass(frozen=True)
class Uncoupled:
    """A posterior in these coordinates; a sampler's target, and a pytree; of m values that vary over n trials.

    Attributes:
        posterior: in its own coordinates z.
        common: indices of mu, m of them.
        spread: indices of tau, m of them.
        deviation: indices of d, m times n of them, one value after the other.
        origin: m of the equations, SI, shape (m,).
        scale: s, SI, shape (m,).
        at: a, SI, shape (m, n).
        slope: b, zero for all that varies, shape (m, n, d).
        information: p, per SI unit squared, shape (m, n).
    """

    posterior: Posterior
    common: tuple[int, ...]
    spread: tuple[int, ...]
    deviation: tuple[int, ...]
    origin: Float[Array, " m"]
    scale: Float[Array, " m"]
    at: Float[Array, "m n"]
    slope: Float[Array, "m n d"]
    information: Float[Array, "m n"]

    @property
    def dim(self) -> int:
        """Number of components."""
        return self.posterior.dim

    @program
    def coupled(self, x: Float[Array, "*batch d"]) -> Float[Array, "*batch d"]:
        """Return the posterior's own z."""
        mean, shrink = self._of_common(x)
        z = x.at[..., self.common].set(mean + shrink * x[..., self.common])
        mean, shrink = self._of_deviations(z)
        return z.at[..., self.deviation].set(mean + shrink * z[..., self.deviation])

    @program
    def uncoupled(self, z: Float[Array, "*batch d"]) -> Float[Array, "*batch d"]:
        """These coordinates of the posterior's z."""
        mean, shrink = self._of_deviations(z)
        x = z.at[..., self.deviation].set((z[..., self.deviation] - mean) / shrink)
        mean, shrink = self._of_common(z)
        return x.at[..., self.common].set((z[..., self.common] - mean) / shrink)

    def log_volume(self, z: Float[Array, "*batch d"]) -> Float[Array, "*batch"]:
        """Return the log of the volume of z for that of x."""
        return jnp.log(self._of_common(z)[1]).sum(-1) + jnp.log(self._of_deviations(z)[1]).sum(-1)

    def log_prior(self, z: Float[Array, " d"]) -> Float[Array, ""]:
        """Return the log prior density at a position in these coordinates."""
        there = self.coupled(z)
        return self.posterior.log_prior(there) + self.log_volume(there)

    def log_likelihood(self, z: Float[Array, " d"]) -> Float[Array, ""]:
        """Return the log-likelihood of the data there."""
        return self.posterior.log_likelihood(self.coupled(z))

    def sample_prior(self, key: jax.Array, n: int) -> Float[Array, "n d"]:
        """Return the draws from the prior."""
        return self.uncoupled(self.posterior.sample_prior(key, n))

    def _of_common(self, z: Array) -> tuple[Float[Array, "*batch m"], Float[Array, "*batch m"]]:
        """Return the mean and standard deviation of z_mu given tau and the rest."""
        tau = self._values(z, self.spread)[..., None]
        weight = self.scale[:, None] ** 2 * self.information / (1 + self.information * tau**2)
        known = (self._at(z) - self.origin[:, None]) / self.scale[:, None]
        total = 1 + weight.sum(-1)
        return (weight * known).sum(-1) / total, 1 / jnp.sqrt(total)

    def _of_deviations(self, z: Array) -> tuple[Float[Array, "*batch mn"], Float[Array, "*batch mn"]]:
        """Return the mean and standard deviation of every d given mu, tau and the rest."""
        mu, tau = self._values(z, self.common)[..., None], self._values(z, self.spread)[..., None]
        tight = 1 + self.information * tau**2
        mean = self.information * tau * (self._at(z) - mu) / tight
        flat = (*z.shape[:-1], len(self.deviation))
        return mean.reshape(flat), (1 / jnp.sqrt(tight)).reshape(flat)

    def _at(self, z: Array) -> Float[Array, "*batch m n"]:
        return self.at + jnp.einsum("mnd,...d->...mn", self.slope, z)

    def _values(self, z: Array, which: tuple[int, ...]) -> Float[Array, "*batch m"]:
        return jnp.stack([self.posterior.parameters[i].prior.constrain(z[..., i]) for i in which], -1)


def uncouple(posterior: Posterior, mode: Mode) -> tuple[Target, Mode]:
    """Return the coordinates to sample in, and the mode and its curvature there; the posterior itself where no value varies between trials.

    What each trial knows is read off the curvature at the mode: it serves the sampler only, and need not be exact.
    """
    names, likelihood = posterior.names, posterior.likelihood
    varying = [name for name in getattr(likelihood, "varying", ()) if name in names]
    if not varying:
        return posterior, mode
    common = [names.index(name) for name in varying]
    spread = [names.index(spread_name(name)) for name in varying]
    deviation = [names.index(deviation_name(name, label)) for name in varying for label in likelihood.labels]
    shape = len(varying), len(likelihood.labels)
    mu, tau = mode.values[common][:, None], mode.values[spread][:, None]
    d, about = mode.z[deviation].reshape(shape), mode.precision[deviation].reshape(*shape, -1)
    about_d = np.maximum(np.diag(mode.precision)[deviation].reshape(shape) - 1.0, 0.0)  # less the prior's
    known = about_d > UNTOUCHED
    about_d = np.where(known, about_d, 1.0)
    slope = np.where(known[..., None], -tau[..., None] * about / about_d[..., None], 0.0)
    slope[..., [*common, *spread, *deviation]] = 0.0
    # at the mode the likelihood's slope along d is d, which balances the prior's
    at = mu + tau * (d + np.where(known, d / about_d, 0.0)) - slope @ mode.z
    scale = mode.sd[common] / np.sqrt(np.diag(mode.cov))[common]
    scale = np.where(scale > 0, scale, 1.0)  # an absent value has none, and its trials know nothing
    information = np.where(known, about_d, 0.0) / np.where(known, tau, 1.0) ** 2
    arrays = (mu[:, 0] - scale * mode.z[common], scale, at, slope, information)
    target = Uncoupled(posterior, tuple(common), tuple(spread), tuple(deviation), *map(jnp.asarray, arrays))
    return target, uncoupled_mode(target, mode)


def uncoupled_mode(target: Target, mode: Mode) -> Mode:
    """Return a mode of the posterior, and its curvature, in the coordinates of a target of `uncouple`."""
    if not isinstance(target, Uncoupled):
        return mode
    z = jnp.asarray(mode.z)
    change = np.asarray(_change(target, z))
    back = np.linalg.inv(change)
    precision, cov = back.T @ mode.precision @ back, change @ mode.cov @ change.T
    return mode._replace(z=np.asarray(target.uncoupled(z)), precision=precision, cov=cov)


@program
def _change(target: Uncoupled, z: Array) -> Array:
    return jax.jacfwd(target.uncoupled)(z)


def coupled(target: Target, x: Any) -> Any:
    """Return the posterior's own z for what was drawn from a target of `uncouple`, shape (..., d)."""
    return target.coupled(jnp.asarray(x)) if isinstance(target, Uncoupled) else x


def in_posterior(target: Target, draws: Draws) -> Draws:
    """Return the draws from a target of `uncouple` as of the posterior itself: by its names, in its units."""
    if isinstance(target, Posterior):
        return named_draws(target, draws)
    assert isinstance(target, Uncoupled)  # `uncouple` gives no third
    z = target.coupled(jnp.asarray(draws.z))
    there = replace(draws, z=np.asarray(z), log_density=draws.log_density - np.asarray(target.log_volume(z)))
    return named_draws(target.posterior, there)
