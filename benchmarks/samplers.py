"""Effective samples per second on the surge posterior, and the time of its evidence."""

import time

import jax
import jax.numpy as jnp
import numpy as np
from joint_problem import joint_posterior
from timing import Ratio, Row

from seatrial.estimation.posterior.mode import find_mode
from seatrial.sampling.diagnostics import diagnose
from seatrial.sampling.run import ChainSettings
from seatrial.sampling.sampler import SAMPLERS, sample
from seatrial.selection.evidence import EvidenceSettings, smc_evidence

GROUP = "surge posterior, 1 500 steps of 0.04 s, 4 parameters"


def sampling(cores: int) -> list[Row | Ratio]:
    """Adaptive Metropolis from the posterior mode, warm-up counted, and tempered SMC evidence; compiled beforehand."""
    posterior = joint_posterior(0, 1_500)
    mode, settings = find_mode(posterior, key=jax.random.key(0)), ChainSettings()
    spread = jax.random.multivariate_normal(jax.random.key(1), mode.z, mode.cov, (settings.chains,))
    rates = []
    for seed in range(6):
        start = time.perf_counter()
        draws = sample(
            SAMPLERS["adaptive-metropolis"], posterior, spread, jnp.asarray(mode.cov), jax.random.key(seed), settings
        )
        seconds = time.perf_counter() - start
        rates.append(diagnose(draws.z).ess_bulk.min() / seconds)
    evidence, smc = EvidenceSettings(), []
    for seed in range(3):
        start = time.perf_counter()
        smc_evidence(posterior, jax.random.key(seed), evidence)
        smc.append(time.perf_counter() - start)
    what = f"adaptive Metropolis, {settings.chains} chains, worst parameter"
    name = f"tempered SMC evidence, {evidence.repeats} x {evidence.smc.particles_for(posterior.dim)} particles"
    return [
        Row(GROUP, what, cores, "effective samples/s", float(np.median(rates[1:])), min(rates[1:])),
        Row(GROUP, name, cores, "s", float(np.median(smc[1:])), min(smc[1:])),
    ]
