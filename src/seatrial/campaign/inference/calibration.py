"""Calibration of a whole campaign: is the stated uncertainty right for this vehicle, these trials and these priors?"""

from collections.abc import Iterable
from itertools import count
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from seatrial.campaign.compute.place import workers_of
from seatrial.campaign.compute.shared_work import Study
from seatrial.campaign.compute.workers import Workers
from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.inference.estimate import estimate_key
from seatrial.campaign.store.estimates import HasKey
from seatrial.campaign.store.stored_result import Store, StoredResult, key_of, load_checkpoint, save_checkpoint
from seatrial.compiled.batching import map_lanes
from seatrial.compiled.programs import program
from seatrial.compiled.random_keys import random_key
from seatrial.core.errors import NumericalError
from seatrial.core.reporter import SILENT, Progress, Reporter
from seatrial.estimation.diagnostics.calibration import Calibration, ranks_of, spread_evenly
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.estimation.posterior.replicate import replicate
from seatrial.estimation.posterior.sample_posterior import Draw, find_method
from seatrial.sampling.target import VECTOR

AT_ONCE = 8  # Replicates between two checkpoints, at least
TRIES = 200  # Draws from the prior until one can be simulated
LIKELIHOOD = "log-likelihood"


def stored_calibration(campaign: Campaign, trials: HasKey, replicates: int, method: str) -> StoredResult[Calibration]:
    """Return where the ranks of a calibration are kept, and what they depend on."""
    key = key_of(_key(estimate_key(campaign, campaign.full, trials), method), replicates)
    return StoredResult(
        Store(campaign.folder).calibration(method), key, Calibration, f"seatrial calibrate {campaign.folder}"
    )


def _key(estimate: str, method: str) -> str:
    """Return what every replicate depends on."""
    return key_of("calibration with diagnostics", estimate, method)


def calibrate(
    campaign: Campaign, trials: Trials, replicates: int, method: str, reporter: Reporter = SILENT
) -> Calibration:
    """Draw parameters from the priors, data from them over the fitted records' own inputs, and rank the truth in each posterior.

    The full structure is calibrated. Resumes from what an interrupted run has done.

    Args:
        campaign: configuration.
        trials: records, of which inputs, times and gaps are used.
        replicates: how many.
        method: see `seatrial.estimation.posterior.sample_posterior`.
        reporter: receives what happens.

    Raises:
        InputError: no such method.
        NumericalError: a prior of which hardly a draw can be simulated.
    """
    structure, _ = campaign.full, find_method(method)
    checkpoint = Store(campaign.folder).checkpoint(f"calibration-{method}")

    def run() -> Calibration:
        workers, study = workers_of(campaign, reporter), Study(campaign, trials.fit, method)
        names = study.posterior(structure).names
        progress = reporter.progress(f"calibrate {structure.label} by {method}")
        replicated = _Found(checkpoint, key_of(_key(estimate_key(campaign, structure, trials), method), "by number"))
        _replicate_all(study, replicated, replicates, progress, workers)
        arrays = replicated.arrays(range(replicates))
        refused = 1.0 - replicates / float(arrays["tries"].sum())
        quantities = (*names, LIKELIHOOD)
        return Calibration(quantities, arrays["rank"], method, structure.label, refused, arrays["health"])

    kept = stored_calibration(campaign, trials, replicates, method)
    return kept.read_or_make(run, lambda: checkpoint.unlink(missing_ok=True))


class _Replicate(NamedTuple):
    """Ranks of one truth, the log-likelihood's last, draws until one could be simulated, and the diagnostics of the draws."""

    rank: np.ndarray
    tries: int
    health: np.ndarray


class _Found:
    """The replicates that are there, by their numbers, and the checkpoint that keeps them."""

    def __init__(self, path: Path, key: str):
        self.path, self.key = path, key
        stored = load_checkpoint(path, key) or dict.fromkeys(("number", *_Replicate._fields), ())
        rows = zip(*(stored[name] for name in _Replicate._fields), strict=True)
        self.results = {int(number): _Replicate(*row) for number, row in zip(stored["number"], rows, strict=True)}
        self.kept = len(self.results)

    def add(self, number: int, result: _Replicate) -> None:
        self.results[number] = result
        there = len(self.results)
        if there - self.kept >= max(AT_ONCE, there // 50):  # the more there are, the longer it takes to write them
            self.keep()

    def keep(self) -> None:
        if len(self.results) > self.kept:
            numbers = sorted(self.results)
            save_checkpoint(self.path, self.key, {"number": np.array(numbers)} | self.arrays(numbers))
            self.kept = len(numbers)

    def arrays(self, numbers: Iterable[int]) -> dict[str, np.ndarray]:
        columns = zip(*(self.results[number] for number in numbers), strict=True)
        return {name: np.array(column) for name, column in zip(_Replicate._fields, columns, strict=True)}


def _replicate_all(study: Study, found: _Found, replicates: int, progress: Progress, workers: Workers) -> None:
    """Add all replicates that are missing; those that are there are kept, however it ends."""
    missing = [number for number in range(replicates) if number not in found.results]
    there = count(replicates - len(missing) + 1)

    def done(index: int, result: _Replicate) -> None:
        found.add(missing[index], result)
        progress(next(there), replicates)

    progress(replicates - len(missing), replicates)
    try:
        workers.run(_numbered, study, missing, done)
    finally:
        found.keep()


def _numbered(study: Study, number: int, report: Progress) -> _Replicate:
    """One replicate by its number, by the method that the study says."""
    key = jax.random.fold_in(random_key(study.campaign.seed, "calibration"), number)
    return _replicate(study.posterior(study.campaign.full), find_method(study.extra), key)


def _replicate(posterior: Posterior, draw: Draw, key: jax.Array) -> _Replicate:
    """Draw a truth that can be simulated, make data, and rank it among draws of their posterior."""
    truth_key, data_key, draw_key = jax.random.split(key, 3)
    for tried in range(1, TRIES + 1):
        z = posterior.sample_prior(jax.random.fold_in(truth_key, tried), 1)[0]
        truth = posterior.constrain(z)
        values = dict(zip(posterior.names, truth, strict=True))
        data = replicate(posterior.likelihood, values, posterior.data, data_key)
        made = Posterior(posterior.parameters, posterior.likelihood, data)
        at_truth = float(_log_likelihoods(made, z[None])[0])
        if np.isfinite(at_truth):
            break
    else:
        raise NumericalError(
            f"none of {TRIES} draws from the prior can be simulated over these records: narrow the priors; `seatrial prior` shows the cause"
        )
    drawn = draw(made, draw_key)
    # Chain after chain: draws taken at even distances are then as far apart as can be.
    chosen = jnp.asarray(spread_evenly(drawn.z.reshape(-1, made.dim)))
    values = np.column_stack([made.constrain(chosen), _log_likelihoods(made, chosen)])
    return _Replicate(ranks_of(np.append(np.asarray(truth), at_truth), values), tried, np.array(drawn.mixing()))


@program
def _log_likelihoods(posterior: Posterior, z: jax.Array) -> jax.Array:
    return map_lanes(posterior.log_likelihood, z, VECTOR)
