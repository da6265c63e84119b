"""The posterior of the paper's Table III, for this package and, in plain numbers, for other programs."""

import sys
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from timing import agree

from seatrial.estimation.posterior.mode import Mode
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.sampling.diagnostics import diagnose
from seatrial.sampling.run import ChainSettings
from seatrial.sampling.sampler import SAMPLERS, sample

sys.path.insert(0, str(Path(__file__).parents[1]))
from studies.remus100.reading import READINGS
from studies.remus100.trial import STEP, paper_posterior, paper_trial


class Problem(NamedTuple):
    """A posterior of X_u, X_uabsu, T_nabsn and sigma_u, and what it is computed from: `lower` and `upper` bound the priors."""

    posterior: Posterior
    lower: np.ndarray
    upper: np.ndarray
    control: np.ndarray
    measured: np.ndarray
    initial: float
    step: float
    mass: float
    share: float

    @property
    def trial(self) -> tuple:
        """Arguments of the C loops that describe the trial."""
        numbers = self.initial, self.step, self.mass, self.share
        return self.control.size, self.control, self.measured, *numbers

    @property
    def plain(self) -> dict:
        """The problem in plain numbers, for a process that knows nothing of this package."""
        arrays = {"lower": self.lower, "upper": self.upper, "control": self.control, "measured": self.measured}
        numbers = {"initial": self.initial, "step": self.step, "mass": self.mass, "share": self.share}
        return {name: values.tolist() for name, values in arrays.items()} | numbers | {"names": self.posterior.names}

    def log_likelihoods(self, points: np.ndarray) -> np.ndarray:
        """Log-likelihoods at parameter values in SI, shape (n, d)."""
        z = self.posterior.unconstrain(jnp.asarray(points))
        return np.asarray(jax.jit(jax.vmap(self.posterior.log_likelihood))(z))

    def sample(self, mode: Mode, settings: ChainSettings, seed: int = 0) -> np.ndarray:
        """Draws of adaptive Metropolis in SI, shape (chains, draws, d); all chains start at the mode."""
        starts = jnp.tile(jnp.asarray(mode.z), (settings.chains, 1))
        key = jax.random.key(seed)
        draws = sample(SAMPLERS["adaptive-metropolis"], self.posterior, starts, jnp.asarray(mode.cov), key, settings)
        return np.asarray(self.posterior.constrain(jnp.asarray(draws.z)))


def paper_problem() -> Problem:
    """Fit 60 s of doublets at 0.01 s, reading A."""
    reading = READINGS["A"]
    record = paper_trial(reading, None)
    posterior = paper_posterior(reading, [record], None)
    lower, upper = np.array([parameter.prior.bounds for parameter in posterior.parameters]).T.copy()
    return Problem(
        posterior,
        lower,
        upper,
        control=record.control[:, 0].copy(),
        measured=record.measurement[:, 0].copy(),
        initial=reading.hull.trim["u"],
        step=STEP,
        mass=reading.inertia,
        share=1.0 - reading.hull.thrust_deduction,
    )


def near(mode: Mode, n: int = 20) -> np.ndarray:
    """Points about a mode, in SI, shape (n, d)."""
    return mode.values + 2 * mode.sd * np.random.default_rng(0).uniform(-1, 1, (n, mode.values.size))


def worst_ess(draws: np.ndarray) -> float:
    """Bulk effective sample size of the worst parameter; draws have shape (chains, draws, d)."""
    return float(diagnose(draws).ess_bulk.min())


def agree_in_moments(what: str, ours: np.ndarray, theirs: np.ndarray, mode: Mode) -> None:
    """Check that first and second moments about a mode differ by at most 5 Monte Carlo standard errors."""
    (first, error), (second, other) = (_moments(draws, mode) for draws in (ours, theirs))
    together = np.hypot(error, other)
    agree(f"{what}, in Monte Carlo errors of their moments,", first / together, second / together, 5.0)


def _moments(draws: np.ndarray, mode: Mode) -> tuple[np.ndarray, np.ndarray]:
    """Moments and their Monte Carlo standard errors, shape (2 d,)."""
    standard = (draws - mode.values) / mode.sd
    powers = np.concatenate([standard, standard**2], -1)
    return powers.mean((0, 1)), diagnose(powers).mcse
