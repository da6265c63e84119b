"""Samplers against posteriors whose moments are published, from long runs of Stan, or exact."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from arviz_stats.base.array import array_stats

from seatrial.estimation.posterior.mode import find_mode
from seatrial.estimation.posterior.sample_posterior import spread_starts
from seatrial.sampling.diagnostics import MIN_ESS, diagnose
from seatrial.sampling.run import ChainSettings
from seatrial.sampling.sampler import SAMPLERS, sample
from seatrial.sampling.tempered_smc import SMCSettings, sample_tempered_smc
from tests.sampling.references import REFERENCES

KEY = jax.random.key(8)
SMC = "tempered-smc"
USUAL = ChainSettings(warmup=1000, draws=6000, thin=4)
SETTINGS = {
    "nuts": ChainSettings(chains=16, warmup=500, draws=300),
}
CASES = [
    ("banana", SMC),
    ("lynx-hare", "independence-metropolis"),
    ("autoregression", "adaptive-metropolis"),
    ("garch", "metropolis"),
    ("one-compartment", "adaptive-metropolis"),
    ("mixture", "de-metropolis"),
    ("eight-schools", "de-metropolis"),
    ("eight-schools", "nuts"),
]


def test_every_sampler_and_every_reference_is_tried():
    problems, methods = map(set, zip(*CASES, strict=True))
    assert problems == set(REFERENCES)
    assert methods == {*SAMPLERS, SMC}


def draw(target, method, settings):
    """Draws as a campaign makes them: a mode, starts spread about it, chains; or particles from the prior."""
    if method == SMC:
        return sample_tempered_smc(target, KEY, SMCSettings(4096)).particles[None]
    mode = find_mode(target, key=KEY)
    starts = spread_starts(target, mode, settings.chains, KEY)
    return sample(SAMPLERS[method], target, starts, jnp.asarray(mode.cov), KEY, settings).z


def errors_of(x, method):
    """Monte Carlo errors of means and standard deviations; resampled particles count for a quarter of their number."""
    if method == SMC:
        square = ((x - x.mean((0, 1))) / x.std((0, 1))) ** 2
        return x.std((0, 1)) * np.stack([np.ones(x.shape[2]), 0.5 * square.std((0, 1))]) / np.sqrt(x.shape[1] / 4)
    assert (diagnose(x).ess_bulk > MIN_ESS).all()
    columns = np.moveaxis(x, -1, 0)
    return np.array([[array_stats.mcse(column, method=kind) for column in columns] for kind in ("mean", "sd")])


@pytest.mark.proof
@pytest.mark.parametrize(("problem", "method"), CASES)
def test_moments(problem, method):
    """Means within a tenth of a standard deviation and those within 5 %, and two Monte Carlo errors of both sides more."""
    reference = REFERENCES[problem]()
    z = draw(reference.target, method, SETTINGS.get(problem, SETTINGS.get(method, USUAL)))
    values = np.moveaxis(np.asarray(reference.target.constrain(jnp.asarray(z))), -1, 0)
    named = reference.quantities(dict(zip(reference.target.names, values, strict=True)))
    x = np.stack([named[name] for name in reference.moments], -1)
    mean, sd = np.array(list(reference.moments.values())).T
    kurtosis = np.mean(((x - x.mean((0, 1))) / x.std((0, 1))) ** 4, (0, 1))
    theirs = sd * np.stack([np.ones_like(sd), 0.5 * np.sqrt(kurtosis - 1.0)]) / np.sqrt(reference.draws)
    errors = np.hypot(errors_of(x, method), theirs)
    off = np.abs(np.stack([x.mean((0, 1)) - mean, x.std((0, 1)) - sd]))
    assert (off < np.array([[0.1], [0.05]]) * sd + 2 * errors).all(), (off / sd).round(3)
