"""Search for modes beside the highest known one, among particles of tempered SMC that are cooled on to p L^10.

In a phase transition a narrow peak holds the evidence and a broad one holds the particles up to b = 1 and beyond (Skilling, Bayesian
Analysis 1, 2006). Cold particles climb, so that a peak far above all others shows itself. Particles at b = 1 show modes that are lower
and hold evidence all the same.

No method that evaluates points finds a peak so narrow that no cold particle comes near it.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import jax
import numpy as np
import scipy
from jaxtyping import Array, Bool, Float

from seatrial.compiled.pytrees import compiled_tree
from seatrial.compiled.random_keys import split
from seatrial.core.errors import NumericalError
from seatrial.core.reporter import Progress, no_progress
from seatrial.estimation.posterior.mode import Mode, completed, is_uphill, maximise_from
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.sampling.target import Target, evaluate, evaluate_parts
from seatrial.sampling.tempered_smc import (
    Particles,
    SMCResult,
    SMCSettings,
    TemperedStart,
    prior_particles,
    sample_tempered_smc,
)
from seatrial.selection.importance import distance, edges_of, laplace_proposal

LIKELIHOOD_POWER = 10.0  # To which particles are cooled
MIN_FAR_SHARE = 0.01  # Share of the particles far from all known modes from which these are climbed from
FAR_TAIL = 1e-3  # Share of a normal density that lies farther from its mode than a particle that is far
MIN_MODE_RISE = 0.1  # Nats above the highest known mode that no rounding of its place explains
MAX_CLIMBS = 3  # From each set of particles
MAX_SEARCH_DIM, SEARCH_MOVES = (
    12,
    8,
)  # Parameters up to which modes are looked for from the prior, and moves of a particle each time


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
        """Return the log prior density."""
        return self.target.log_prior(z)

    def log_likelihood(self, z: Float[Array, " d"]) -> Float[Array, ""]:
        """Return the log-likelihood times the power."""
        return self.power * self.target.log_likelihood(z)

    def sample_prior(self, key: jax.Array, n: int) -> Float[Array, "n d"]:
        """Return the draws from the prior."""
        return self.target.sample_prior(key, n)


def sample_warm(target: Target, key: jax.Array, settings: SMCSettings, progress: Progress = no_progress) -> SMCResult:
    """Run tempered SMC as it is, by the program that `sample_cold` goes on with; errors as `sample_tempered_smc`."""
    start_key, key = split(key)
    start = prior_particles(target, start_key, settings.particles_for(target.dim))
    return sample_tempered_smc(Cooled(target, np.ones(())), key, settings, progress, start=start)


def sample_cold(
    target: Target, warm: SMCResult, key: jax.Array, settings: SMCSettings, progress: Progress = no_progress
) -> Float[np.ndarray, "particles d"]:
    """Cool the particles of a run ten times further, and return where they are then; errors as `sample_tempered_smc`."""
    log_prior, log_likelihood = evaluate_parts(target, warm.particles)
    start = TemperedStart(
        Particles(warm.particles, log_prior, LIKELIHOOD_POWER * log_likelihood), 1.0 / LIKELIHOOD_POWER
    )
    return sample_tempered_smc(
        Cooled(target, np.full((), LIKELIHOOD_POWER)), key, settings, progress, start=start
    ).particles


def search_modes(
    posterior: Posterior, known: Sequence[Mode], key: jax.Array, around: Sequence[Mode] = ()
) -> tuple[Mode, ...]:
    """Look for modes from the prior, and return all, the highest first; in many parameters those known.

    The particles are too few for an evidence, and enough to meet every mode that holds a twentieth of it.

    Args:
        posterior: density.
        known: its modes known so far, one at least.
        key: random key.
        around: modes of structures that contain this one, which take the place of the particles.
    """
    if around:
        return further_modes(posterior, known, [np.concatenate([completed(posterior, one) for one in around])])
    if posterior.dim > MAX_SEARCH_DIM:
        return tuple(known)
    settings = SMCSettings(max(128, 16 * posterior.dim), moves=SEARCH_MOVES, target_ess=0.5)
    warm_key, cold_key = split(key)
    sets = []
    with suppress(NumericalError):  # of a prior of which little can be simulated, the modes known are all
        warm = sample_warm(posterior, warm_key, settings)
        sets = [warm.particles]
        sets = [sample_cold(posterior, warm, cold_key, settings), *sets]
    return further_modes(posterior, known, sets)


def further_modes(
    posterior: Posterior, known: Sequence[Mode], sets: Sequence[Float[np.ndarray, "particles d"]]
) -> tuple[Mode, ...]:
    """Climb from particles that lie far from all modes known, or higher than them, and return all modes, the highest first.

    Args:
        posterior: density.
        known: its modes found so far, one at least.
        sets: particles, the coldest first.
    """
    modes, edges = [*known], edges_of(posterior)
    for particles in filter(len, sets):
        height, looked_into = evaluate(posterior, particles), np.zeros(len(particles), bool)
        for _ in range(MAX_CLIMBS):
            new = ~looked_into & np.isfinite(height) & _is_new(modes, edges, particles, height)
            start = particles[np.argmax(np.where(new, height, -np.inf))]
            if not new.mean() > MIN_FAR_SHARE and not _is_higher_mode(modes, height[new]).any():
                break
            looked_into |= (particles == start).all(1)
            if any(is_uphill(posterior, start, mode.z) for mode in modes):
                continue
            try:
                result = maximise_from(posterior, start)
            except NumericalError:
                continue
            if _is_new(modes, edges, result.z[None], np.array([result.log_density]))[0]:
                modes.append(result)
    return tuple(sorted(modes, key=lambda mode: -mode.log_density))


def _is_new(
    modes: Sequence[Mode],
    edges: Float[np.ndarray, "d 2"],
    z: Float[np.ndarray, "n d"],
    height: Float[np.ndarray, " n"],
) -> Bool[np.ndarray, " n"]:
    """Return whether points lie far from all modes, or higher than them."""
    away = np.min([distance(laplace_proposal(mode, edges), z) for mode in modes], 0)
    return (away > scipy.special.chdtri(z.shape[1], FAR_TAIL)) | _is_higher_mode(modes, height)


def _is_higher_mode(modes: Sequence[Mode], height: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    return height > max(mode.log_density for mode in modes) + MIN_MODE_RISE
