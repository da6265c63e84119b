"""Search for a peak that sampling at the posterior's own temperature passes by: tempered SMC driven on to p L^30.

In a phase transition a narrow peak holds the evidence and a broad one holds the particles up to b = 1 and beyond (Skilling,
Bayesian Analysis 1, 2006); cold particles climb, so that a peak far above all that was met betrays itself.

What it cannot see: a peak so narrow that no cold particle ever comes near it. Nothing that evaluates points can.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from seatrial.core.trees import compiled_tree
from seatrial.sampling.target import Progress, Target, evaluate, no_progress
from seatrial.sampling.tempered_smc import SMCSettings, sample_tempered_smc

COLD = 30.0
HIGHER = 3.0
"""Nats above the highest peak known that count as another one."""


@compiled_tree()
@dataclass(frozen=True)
class Cooled:
    """A target whose likelihood is raised to a power, 1 for the target itself: both share one compiled sampler."""

    target: Target
    power: Float[Array, ""]

    @property
    def dim(self) -> int:
        """Number of components of z."""
        return self.target.dim

    def log_prior(self, z: Float[Array, " d"]) -> Float[Array, ""]:
        """Log prior density."""
        return self.target.log_prior(z)

    def log_likelihood(self, z: Float[Array, " d"]) -> Float[Array, ""]:
        """Log-likelihood times the power."""
        return self.power * self.target.log_likelihood(z)

    def sample_prior(self, key: jax.Array, n: int) -> Float[Array, "n d"]:
        """Draws from the prior."""
        return self.target.sample_prior(key, n)


def highest_found(target: Target, key: jax.Array, settings: SMCSettings, progress: Progress = no_progress) -> float:
    """Largest log posterior density, unnormalised, among particles cooled thirty times.

    Raises:
        NumericalError: the particles cannot leave the prior.
    """
    run = sample_tempered_smc(Cooled(target, jnp.asarray(COLD)), key, settings, progress)
    return float(evaluate(target, run.particles).max())
