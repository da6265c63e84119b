"""Runs of this package's samplers that are timed: compiled beforehand, and of a size that is worked out from one block."""

import time
from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from seatrial.estimation.posterior.mode import Mode
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.estimation.posterior.sample_posterior import spread_starts
from seatrial.sampling.run import BLOCK, ChainSettings
from seatrial.sampling.sampler import SAMPLERS, advance_chains, sample, start_chains

SMALLER = ((200, 800), (100, 400), (100, 100))
"""Warm-up and draws that are tried, in this order, where the default run takes too long."""


class Timed(NamedTuple):
    """A run: its size, its draws in SI, shape (chains, draws, d), and its seconds, warm-up included."""

    settings: ChainSettings
    draws: Float[np.ndarray, "chains draws d"]
    seconds: float

    @property
    def size(self) -> str:
        """Chains, warm-up and draws, in words."""
        return f"{self.settings.chains} chains, {self.settings.warmup} + {self.settings.draws}"


def fitting(name: str, posterior: Posterior, mode: Mode, longest: float, chains: int | None = None) -> ChainSettings:
    """Compile a sampler and choose its run: the default size, or the largest of `SMALLER` that takes at most `longest` seconds.

    Where even the smallest takes longer, that one.
    """
    default = ChainSettings() if chains is None else ChainSettings(chains)
    sampler, key = SAMPLERS[name], jax.random.key(0)
    starts = spread_starts(posterior, mode, default.chains, key)
    run = start_chains(sampler, posterior, starts, jnp.asarray(mode.cov))
    run = advance_chains(sampler, posterior, run, key, default)
    start = time.perf_counter()
    advance_chains(sampler, posterior, run, key, default)
    block = time.perf_counter() - start
    sizes = [default, *(replace(default, warmup=warmup, draws=draws) for warmup, draws in SMALLER)]
    return next((size for size in sizes if (size.warmup + size.draws) / BLOCK * block <= longest), sizes[-1])


def timed(name: str, posterior: Posterior, mode: Mode, settings: ChainSettings, seed: int) -> Timed:
    """Run a compiled sampler from starts spread about a mode."""
    start = time.perf_counter()
    start_key, key = jax.random.split(jax.random.key(seed))
    starts = spread_starts(posterior, mode, settings.chains, start_key)
    draws = sample(SAMPLERS[name], posterior, starts, jnp.asarray(mode.cov), key, settings)
    values = np.asarray(posterior.constrain(jnp.asarray(draws.z)))
    return Timed(settings, values, time.perf_counter() - start)
