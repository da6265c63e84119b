"""Draws of a posterior by any method, from nothing but the posterior: what calibration repeats many times."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from seatrial.core.errors import InputError, nearest
from seatrial.estimation.mode import Mode, find_mode
from seatrial.estimation.noncentred import coupled, uncouple
from seatrial.estimation.posterior import Posterior
from seatrial.sampling.diagnostics import mixing
from seatrial.sampling.names import METHODS
from seatrial.sampling.nested import sample_nested
from seatrial.sampling.run import ChainSettings
from seatrial.sampling.sampler import SAMPLERS, Sampler, sample
from seatrial.sampling.target import Target, log_densities
from seatrial.sampling.tempered_smc import SMCSettings, sample_tempered_smc


class Drawn(NamedTuple):
    """Draws of a posterior, and what the method that made them says of itself, NaN where it has no such number.

    Attributes:
        z: draws, shape (n, d).
        r_hat: largest R-hat of all parameters.
        ess: smallest effective sample size.
        diverged: share of the transitions that diverged.
        moved: smallest share of the moves of a population that were made.
    """

    z: Float[np.ndarray, "n d"]
    r_hat: float = np.nan
    ess: float = np.nan
    diverged: float = np.nan
    moved: float = np.nan


Draw = Callable[[Posterior, jax.Array], Drawn]
SIZES = {
    "independence-metropolis": ChainSettings(32, 300, 200),
    "adaptive-metropolis": ChainSettings(32, 500, 500),
    "metropolis": ChainSettings(32, 500, 1000),
    "de-metropolis": ChainSettings(32, 500, 1000),
    "nuts": ChainSettings(8, 300, 200),
}
"""Size of each sampler's run; enough for a hundred independent draws of a posterior that is not too far from normal."""
PARTICLES, LIVE = 512, 200
SPREAD = 1.5
"""Standard deviations of the normal approximation from which chains start."""


def find_method(name: str) -> Draw:
    """Method by name: a sampler of `SAMPLERS`, `tempered-smc` or `nested`.

    Raises:
        InputError: no such method.
    """
    if name not in METHODS:
        raise InputError("method", found=f'"{name}"', expected=", ".join(METHODS), remedy=nearest(name, METHODS))
    whole = {"tempered-smc": _by_smc, "nested": _by_nested}
    return whole[name] if name in whole else partial(_by_chains, SAMPLERS[name], SIZES[name])


def spread_starts(target: Target, mode: Mode, chains: int, key: jax.Array) -> jax.Array:
    """Positions spread wider than the normal approximation, so that R-hat can see chains that do not meet, shape (chains, d)."""
    noise = jax.random.normal(key, (chains, target.dim))
    starts = jnp.asarray(mode.z) + SPREAD * noise @ jnp.linalg.cholesky(jnp.asarray(mode.cov)).T
    finite = jnp.isfinite(log_densities(target, starts))
    return jnp.where(finite[:, None], starts, jnp.asarray(mode.z))


def _by_chains(sampler: Sampler, settings: ChainSettings, posterior: Posterior, key: jax.Array) -> Drawn:
    mode_key, start_key, key = jax.random.split(key, 3)
    target, mode = uncouple(posterior, find_mode(posterior, mode_key))
    starts = spread_starts(target, mode, settings.chains, start_key)
    draws = sample(sampler, target, starts, jnp.asarray(mode.cov), key, settings)
    z = np.asarray(coupled(target, draws.z))
    chains, kept, d = z.shape
    # Chain after chain: draws taken at even distances are then as far apart as can be.
    return Drawn(z.reshape(-1, d), *mixing(z), diverged=draws.divergences / (chains * kept))


def _by_smc(posterior: Posterior, key: jax.Array) -> Drawn:
    run = sample_tempered_smc(posterior, key, SMCSettings(PARTICLES))
    return Drawn(run.particles, moved=float(run.acceptance.min()))


def _by_nested(posterior: Posterior, key: jax.Array) -> Drawn:
    run_key, draw_key = jax.random.split(key)
    run = sample_nested(posterior, run_key, live=LIVE)
    return Drawn(run.draws(PARTICLES, draw_key), moved=1.0 - run.stuck)
