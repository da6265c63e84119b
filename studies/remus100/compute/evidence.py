"""Tables IV and V: Listing 1 over many seeds, evidences that share no code, and what the data say as the true term grows."""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from seatrial.estimation.mode import find_mode
from seatrial.estimation.posterior import Posterior
from seatrial.estimation.priors import Uniform
from seatrial.sampling.run import ChainSettings
from seatrial.sampling.sampler import SAMPLERS, sample
from seatrial.sampling.tempered_smc import SMCSettings
from seatrial.selection.bridge import bridge_evidence
from seatrial.selection.evidence import Evidence, EvidenceSettings, smc_evidence
from seatrial.selection.importance import ImportanceSettings, importance_evidence
from seatrial.selection.nested import nested_evidence
from seatrial.selection.prior_monte_carlo import ListingOne, listing_one
from studies.remus100.compute.trial import around, paper_posterior, paper_trial, wide
from studies.remus100.study import Study
from studies.remus100.vehicle_file import Reading

MODELS = ("M-0", "M-1")
LARGER = (-20.0, -60.0)
"""True coefficients, in multiples of the larger printed one, at which the data begin to tell."""
WEIGHING = ImportanceSettings(draws=4096, pilot=2048)
"""For each of many trials."""
Estimator = Callable[[Posterior, jax.Array], Evidence]


def listing_part(study: Study, table: int) -> xr.Dataset:
    """Listing 1 as printed over many seeds, and with draws shared between the models, on the trial of Table IV or V."""
    sizes, models = study.sizes, _models(study.reading, table)
    found = {}
    for shared, repeats in ((False, sizes.listing_repeats), (True, sizes.listing_shared)):
        title = f"Listing 1 for Table {'IV' if table == 4 else 'V'}, {repeats} seeds" + (
            ", shared draws" if shared else ""
        )
        found[shared] = listing_one(
            models,
            study.random_key("listing"),
            draws=sizes.listing_draws,
            repeats=repeats,
            shared=shared,
            progress=study.progress(title),
        )
    return xr.Dataset(
        {
            "probability": (("repeat", "model"), found[False].probability),
            "shared_probability": (("shared_repeat", "model"), found[True].probability),
            "log_values": (("repeat", "model"), _column(found[False], "log_values")),
            "ess": (("repeat", "model"), _column(found[False], "ess")),
        },
        {"model": list(MODELS)},
        {"status": found[False].status},
    )


def evidence_part(study: Study, table: int) -> xr.Dataset:
    """Log evidences of M-0 and M-1 by methods that share no code, and of M-0 under its wide prior by importance sampling."""
    reading, report = study.reading, study.progress(f"evidences for Table {'IV' if table == 4 else 'V'}")
    weighing = ImportanceSettings(study.sizes.importance_draws)
    estimators: dict[str, Estimator] = {
        "importance sampling": partial(importance_evidence, settings=weighing),
        "bridge sampling": partial(_bridge, draws=study.sizes.bridge_draws),
    }
    if study.sizes.smc_particles:
        smc = EvidenceSettings(smc=SMCSettings(study.sizes.smc_particles))
        estimators["tempered SMC"] = lambda model, key: smc_evidence(model, key, smc)
    if study.sizes.nested_live:
        estimators["nested sampling"] = partial(nested_evidence, live=study.sizes.nested_live)
    models, key = _models(reading, table), study.random_key(f"evidence {table}")
    found, total = [], 2 * len(estimators) + 1
    for row, estimate in enumerate(estimators.values()):
        pair = []
        for model in models:
            report(len(pair) + 2 * row, total)
            pair.append(estimate(model, jax.random.fold_in(key, row)))
        found.append(pair)
    report(total - 1, total)
    record = paper_trial(reading, doubted_value(reading, table))
    alone = importance_evidence(paper_posterior(reading, [record], wide(reading)), key, settings=weighing)
    report(total, total)
    return xr.Dataset(
        {
            "log_value": (("method", "model"), [[one.log_value for one in pair] for pair in found]),
            "error": (("method", "model"), [[one.std_error for one in pair] for pair in found]),
            "wide_log_value": ((), alone.log_value),
            "wide_error": ((), alone.std_error),
        },
        {"method": list(estimators), "model": list(MODELS)},
        {"status": [one.status for pair in found for one in pair]},
    )


def odds_part(study: Study) -> xr.Dataset:
    """Probability of M-0 by importance sampling over several trials, as the true term grows; priors +-200 % of a printed value.

    Beyond the printed values the prior is that of the larger printed one scaled to hold the true value.
    """
    reading, seeds = study.reading, study.sizes.data_seeds
    values = [*reading.source.doubted.values, *(factor * reading.source.doubted.values[1] for factor in LARGER)]
    report, rows, errors = study.progress("probability of M-0 over trials"), [], []
    key = study.random_key("odds")
    for done, (value, seed) in enumerate((value, seed) for value in values for seed in range(1, seeds + 1)):
        report(done, len(values) * seeds)
        record = paper_trial(reading, value, seed)
        full, reduced = (
            importance_evidence(
                paper_posterior(reading, [record], prior), jax.random.fold_in(key, done), settings=WEIGHING
            )
            for prior in (around(value), None)
        )
        rows.append(1.0 / (1.0 + np.exp(reduced.log_value - full.log_value)))
        errors.append(rows[-1] * (1 - rows[-1]) * np.hypot(full.std_error, reduced.std_error))
    report(len(values) * seeds, len(values) * seeds)
    shape = (len(values), seeds)
    return xr.Dataset(
        {
            "probability": (("value", "seed"), np.reshape(rows, shape)),
            "error": (("value", "seed"), np.reshape(errors, shape)),
        },
        {"value": values, "seed": np.arange(1, seeds + 1)},
    )


def doubted_value(reading: Reading, table: int) -> float:
    """True coefficient of the doubted term in Table IV or V."""
    return reading.source.doubted.values[table - 4]


def _models(reading: Reading, table: int) -> list[Posterior]:
    """M-0 and M-1 on the trial of a table."""
    value = doubted_value(reading, table)
    record = paper_trial(reading, value)
    priors: tuple[Uniform | None, ...] = (around(value), None)
    return [paper_posterior(reading, [record], prior) for prior in priors]


def _column(listing: ListingOne, name: str) -> np.ndarray:
    return np.array([evidence.diagnostics[name] for evidence in listing.evidences]).T


def _bridge(posterior: Posterior, key: jax.Array, draws: int) -> Evidence:
    """Bridge sampling from adaptive Metropolis draws, so many of each of 32 chains."""
    mode_key, start_key, chain_key, key = jax.random.split(key, 4)
    mode = find_mode(posterior, mode_key)
    settings = ChainSettings(warmup=max(200, draws // 4), draws=draws)
    noise = jax.random.normal(start_key, (settings.chains, posterior.dim))
    starts = jnp.asarray(mode.z) + noise @ jnp.linalg.cholesky(jnp.asarray(mode.cov)).T
    sampled = sample(SAMPLERS["adaptive-metropolis"], posterior, starts, jnp.asarray(mode.cov), chain_key, settings)
    return bridge_evidence(posterior, sampled.z, key)
