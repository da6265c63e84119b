"""Search for modes beside the highest one known, among particles of tempered SMC that are cooled on to p L^10.

In a phase transition a narrow peak holds the evidence and a broad one holds the particles up to b = 1 and beyond (Skilling,
Bayesian Analysis 1, 2006); cold particles climb, so that a peak far above all that was met betrays itself. Particles at b = 1 show
modes that are lower and hold evidence all the same.

What it cannot see: a peak so narrow that no cold particle ever comes near it. Nothing that evaluates points can.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy import stats

from seatrial.core.errors import NumericalError
from seatrial.core.trees import compiled_tree
from seatrial.estimation.mode import Mode, climb, rises
from seatrial.estimation.posterior import Posterior
from seatrial.sampling.target import Progress, Target, evaluate, no_progress
from seatrial.sampling.tempered_smc import SMCResult, SMCSettings, Start, sample_tempered_smc
from seatrial.selection.importance import distance, laplace_proposal

COLD = 10.0
MANY = 0.01
"""Share of the particles far from all known modes that are looked into."""
FAR = 1e-3
"""Share of a normal density that lies farther off than what counts as far."""
HIGHER = 0.1
"""Nats above the highest mode known that no rounding of its place explains."""
CLIMBS = 3
"""Climbs at most from each set of particles."""


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


def sample_warm(target: Target, key: jax.Array, settings: SMCSettings, progress: Progress = no_progress) -> SMCResult:
    """Run tempered SMC as it is, by the program that `sample_cold` goes on with; errors as `sample_tempered_smc`."""
    return sample_tempered_smc(Cooled(target, jnp.ones(())), key, settings, progress)


def sample_cold(
    target: Target, warm: SMCResult, key: jax.Array, settings: SMCSettings, progress: Progress = no_progress
) -> Float[np.ndarray, "particles d"]:
    """Cool the particles of a run ten times further, and return where they are then; errors as `sample_tempered_smc`."""
    start = Start(warm.particles, 1.0 / COLD)
    return sample_tempered_smc(
        Cooled(target, jnp.full((), COLD, float)), key, settings, progress, start=start
    ).particles


def further_modes(
    posterior: Posterior, known: Mode, sets: Sequence[Float[np.ndarray, "particles d"]]
) -> tuple[Mode, ...]:
    """Climb from particles that lie far from all modes known, or higher than them, and return the modes that are new.

    Args:
        posterior: density.
        known: its highest mode found so far.
        sets: particles, the coldest first.
    """
    modes = [known]
    for particles in filter(len, sets):
        height, looked_into = evaluate(posterior, particles), np.zeros(len(particles), bool)
        for _ in range(CLIMBS):
            new = ~looked_into & np.isfinite(height) & _is_new(modes, particles, height)
            start = particles[np.argmax(np.where(new, height, -np.inf))]
            if not new.mean() > MANY and not _higher(modes, height[new]).any():
                break
            looked_into |= (particles == start).all(1)
            if any(rises(posterior, start, mode.z) for mode in modes):
                continue
            try:
                found = climb(posterior, start)
            except NumericalError:
                continue
            if _is_new(modes, found.z[None], np.array([found.log_density]))[0]:
                modes.append(found)
    return tuple(modes[1:])


def _is_new(
    modes: Sequence[Mode], z: Float[np.ndarray, "n d"], height: Float[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    """Whether points lie far from all modes, or higher than them."""
    away = np.min([distance(laplace_proposal(mode), z) for mode in modes], 0)
    return (away > stats.chi2.isf(FAR, z.shape[1])) | _higher(modes, height)


def _higher(modes: Sequence[Mode], height: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    return height > max(mode.log_density for mode in modes) + HIGHER
