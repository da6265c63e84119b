"""Tables III and VI and Figures 6 to 8: Markov chains of the paper's length, what they look like and what they say."""

import time
from types import ModuleType
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Float

from seatrial.estimation.mode import find_mode
from seatrial.estimation.pointwise import pointwise_log_likelihood, thin_draws
from seatrial.estimation.posterior import Posterior
from seatrial.sampling import adaptive_metropolis
from seatrial.sampling.diagnostics import diagnose
from seatrial.sampling.geweke import geweke_scores, printed_geweke_scores
from seatrial.sampling.run import ChainSettings, Run, finish, is_finished
from seatrial.selection.criteria import deviance_criteria, psis_loo, waic
from studies.remus100.compute.trial import paper_posterior, paper_trial, wide
from studies.remus100.study import Study
from studies.remus100.vehicle_file import Reading

LAGS = 200
KEPT = 5000
"""Draws of each chain that are kept for figures; every number comes from all of them."""
AFAR = 10.0
"""Nats below the mode at which a start counts as arrived."""


def table_3_part(study: Study, sampler: ModuleType) -> xr.Dataset:
    """M-1 on the trial of a vehicle without the doubted term, by adaptive Metropolis or by Metropolis-Hastings."""
    posterior = paper_posterior(study.reading, [paper_trial(study.reading, None)], None)
    name = sampler.__name__.rpartition(".")[-1]
    return _summary(study, posterior, _sample(study, posterior, sampler, f"Table III, {name.replace('_', ' ')}"))


def table_6_part(study: Study, full: bool) -> xr.Dataset:
    """M-0 under the uninformative prior, or M-1, on the trial of the smaller doubted term, with information criteria."""
    reading = study.reading
    record = paper_trial(reading, reading.source.doubted.values[0])
    posterior = paper_posterior(reading, [record], wide(reading) if full else None)
    sampled = _sample(study, posterior, adaptive_metropolis, f"Table VI, M-{0 if full else 1}")
    report = study.progress(f"information criteria of M-{0 if full else 1}")
    report(0, 2)
    found = deviance_criteria(posterior, sampled.values)
    report(1, 2)
    table = pointwise_log_likelihood(posterior, thin_draws(sampled.values, study.sizes.criteria_draws))
    predictive = (waic(table), psis_loo(table))
    report(2, 2)
    named = {"DIC": found.dic, "BPIC": found.bpic, "p_D": found.p_d, "Dbar": found.mean_deviance}
    named |= {criterion.method: criterion.value for criterion in predictive}
    return _summary(study, posterior, sampled).assign(
        criterion_value=("criterion", [one.value for one in named.values()]),
        criterion_error=("criterion", [one.error for one in named.values()]),
        pointwise=(("predictive", "sample"), [one.pointwise for one in predictive]),
        k_hat=("sample", predictive[1].k_hat),
        criterion=list(named),
        predictive=[one.method for one in predictive],
    )


def starts_part(study: Study) -> xr.Dataset:
    """How long a chain takes to arrive from the paper's first estimates, half the truth, and from the posterior mode."""
    posterior = paper_posterior(study.reading, [paper_trial(study.reading, None)], None)
    mode = find_mode(posterior, study.random_key("mode"))
    half = [0.5 * study.reading.truth.get(name, study.reading.sigma) for name in posterior.names]
    first = {"half the truth": posterior.unconstrain(jnp.asarray(half)), "posterior mode": jnp.asarray(mode.z)}
    settings = ChainSettings(study.sizes.chains, 2000, 100)
    report, heights = study.progress("where chains start"), []
    for done, z in enumerate(first.values()):
        report(done, len(first))
        run = adaptive_metropolis.start_chains(
            posterior, jnp.tile(z, (settings.chains, 1)), 1e-4 * jnp.eye(posterior.dim)
        )
        height = [np.asarray(run.state.log_density)]
        while run.iteration < settings.warmup:
            run = adaptive_metropolis.advance_chains(posterior, run, study.random_key("starts"), settings)
            height.append(np.asarray(run.state.log_density))
        heights.append(np.array(height) - mode.log_density)
    report(len(first), len(first))
    return xr.Dataset(
        {"height": (("start", "iteration", "chain"), heights)},
        {"start": list(first), "iteration": 100 * np.arange(len(heights[0]))},
    )


class _Sampled(NamedTuple):
    """A finished run: draws in SI, shape (chains, draws, d), chain 0 every 100 iterations from the start, and its cost."""

    values: Float[np.ndarray, "chains draws d"]
    trace: Float[np.ndarray, "points d"]
    mode: Float[np.ndarray, " d"]
    acceptance: float
    seconds: float


def _sample(study: Study, posterior: Posterior, sampler: ModuleType, title: str) -> _Sampled:
    """Burn in and sample; chain 0 starts at the posterior mode, the others at draws of the normal approximation."""
    sizes = study.sizes
    settings = ChainSettings(sizes.chains, sizes.burn_in, sizes.draws)
    mode_key, start_key, key = jax.random.split(study.random_key(title), 3)
    mode = find_mode(posterior, mode_key)
    starts = jax.random.multivariate_normal(start_key, mode.z, mode.cov, (sizes.chains,)).at[0].set(mode.z)
    run: Run = sampler.start_chains(posterior, starts, jnp.asarray(mode.cov))
    report, total = study.progress(f"{title}, {sizes.chains} chains"), sizes.burn_in + sizes.draws
    trace, first, begun = [np.asarray(starts[0])], 0.0, time.perf_counter()
    while not is_finished(run, settings):
        run = sampler.advance_chains(posterior, run, key, settings)
        first = first or time.perf_counter() - begun
        trace.append(np.asarray(run.state.z[0]))
        report(run.iteration, total)
    seconds = time.perf_counter() - begun - first
    draws = finish(run)
    values, shown = (np.asarray(posterior.constrain(jnp.asarray(z))) for z in (draws.z, np.array(trace)))
    return _Sampled(values, shown, mode.values, draws.acceptance, seconds)


def _summary(study: Study, posterior: Posterior, sampled: _Sampled) -> xr.Dataset:
    from arviz_stats.base.array import array_stats

    reading, names = study.reading, posterior.names
    scale = np.array([reading.print_scales.get(name, 1.0) for name in names])
    values = sampled.values / scale
    health, flat = diagnose(values), values.reshape(-1, len(names))
    hpd = np.array([array_stats.hdi(flat[:, i], prob=0.95) for i in range(len(names))])
    one = values[0]
    scores = [geweke_scores(one[:, i]) for i in range(len(names))]
    every = max(1, values.shape[1] // KEPT)
    columns = {
        "mean": flat.mean(0),
        "sd": flat.std(0, ddof=1),
        "hpd_low": hpd[:, 0],
        "hpd_high": hpd[:, 1],
        "r_hat": health.r_hat,
        "ess": health.ess_bulk,
        "ess_tail": health.ess_tail,
        "mcse": health.mcse,
        "mode": sampled.mode / scale,
        "truth": _truth(reading, names) / scale,
    }
    return xr.Dataset(
        {
            **{name: ("parameter", column) for name, column in columns.items()},
            "draws": (("chain", "draw", "parameter"), values[:, every - 1 :: every]),
            "trace": (("iteration", "parameter"), sampled.trace / scale),
            "raw_acf": (("lag", "parameter"), np.stack([_raw_acf(x) for x in one.T], -1)),
            "acf": (
                ("lag", "parameter"),
                np.stack([array_stats.autocorr(_detrended(x))[: LAGS + 1] for x in one.T], -1),
            ),
            "geweke": (("interval", "parameter"), np.stack([score.score for score in scores], -1)),
            "printed_geweke": (
                ("interval", "parameter"),
                np.stack([printed_geweke_scores(x).score for x in one.T], -1),
            ),
            "geweke_start": ("interval", scores[0].start),
            "covariance": (("parameter", "other"), np.cov(flat, rowvar=False)),
            "acceptance": ((), sampled.acceptance),
            "seconds": ((), sampled.seconds),
        },
        {"parameter": list(names), "iteration": 100 * np.arange(len(sampled.trace)), "lag": np.arange(LAGS + 1)},
        {"labels": [parameter.label for parameter in posterior.parameters]},
    )


def _truth(reading: Reading, names: tuple[str, ...]) -> Float[np.ndarray, " d"]:
    true = {**reading.truth, reading.doubted: reading.source.doubted.values[0], "sigma_u": reading.sigma}
    return np.array([true[name] for name in names])


def _raw_acf(x: np.ndarray) -> np.ndarray:
    """Products of the draws as they are, their mean left in: near 1 at every lag unless the mean is near 0."""
    return np.array([x[lag:] @ x[: x.size - lag] for lag in range(LAGS + 1)]) / (x @ x)


def _detrended(x: np.ndarray) -> np.ndarray:
    at = np.arange(x.size)
    return x - np.polyval(np.polyfit(at, x, 1), at)
