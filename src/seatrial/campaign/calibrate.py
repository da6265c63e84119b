"""Calibration of a whole campaign: is the stated uncertainty right for this vehicle, these trials and these priors?"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from seatrial.campaign.compute.place import workers_of
from seatrial.campaign.compute.study import Study
from seatrial.campaign.compute.workers import Workers
from seatrial.campaign.config import Campaign
from seatrial.campaign.estimate import estimate_key
from seatrial.campaign.problem import random_key
from seatrial.campaign.store import Store, is_current, key_of, load_checkpoint, save_checkpoint, write_dataset
from seatrial.campaign.trials import Trials
from seatrial.campaign.watch import SILENT, Watch
from seatrial.core.dataset_file import open_dataset
from seatrial.core.errors import NumericalError
from seatrial.core.lanes import map_lanes
from seatrial.estimation.calibration import Calibration, ranks_of, spread_evenly
from seatrial.estimation.draw_posterior import Draw, find_method
from seatrial.estimation.posterior import Posterior
from seatrial.estimation.replicate import replicate
from seatrial.sampling.target import VECTOR, Progress

AT_ONCE = 8
"""Replicates between two checkpoints, at least."""
TRIES = 200
"""Draws from the prior until one can be simulated."""
LIKELIHOOD = "log-likelihood"
MANY_REFUSED = 0.05
"""Share of the prior beyond which a reader is told."""


@dataclass(frozen=True, eq=False)
class Calibrated:
    """Result of a calibration, and what it was made of.

    Attributes:
        calibration: ranks.
        method: how posteriors were drawn.
        structure: label of the structure.
        refused: share of the prior's draws that could not be simulated, and were drawn again.
    """

    calibration: Calibration
    method: str
    structure: str
    refused: float

    def lines(self) -> list[str]:
        """What was found, in words."""
        outside = self.calibration.outside()
        verdict = (
            f"calibrated: the ranks of all {len(self.calibration.names)} quantities lie inside their 99 % bands"
            if not outside
            else f"not calibrated: the ranks of {', '.join(outside)} leave their 99 % bands"
        )
        said = self.calibration.lines()
        if self.refused > MANY_REFUSED:
            said.append(
                f"{self.refused:.0%} of the prior could not be simulated and was drawn again; `seatrial prior` shows why"
            )
        return [*said, f"{verdict} (structure {self.structure}, {self.method})"]


def calibrate(campaign: Campaign, trials: Trials, replicates: int, method: str, watch: Watch = SILENT) -> Calibrated:
    """Draw parameters from the priors, data from them over the fitted records' own inputs, and rank the truth in each posterior.

    The full structure is calibrated. Resumes from what an interrupted run has done.

    Args:
        campaign: configuration.
        trials: records, of which inputs, times and gaps are used.
        replicates: how many.
        method: see `seatrial.estimation.draw_posterior`.
        watch: receives what happens.

    Raises:
        InputError: no such method.
        NumericalError: a prior of which hardly a draw can be simulated.
    """
    structure, _ = campaign.full, find_method(method)
    store = Store(campaign.folder)
    path = store.calibration(method)
    stamp = key_of("calibration", estimate_key(campaign, structure, trials), method)
    key = key_of(stamp, replicates)
    if not is_current(path, key):
        workers, study = workers_of(campaign, watch), Study(campaign, trials.fit, method)
        names = study.posterior(structure).names
        progress = watch.progress(f"calibrate {structure.label} by {method}")
        found = _Found(store.checkpoint(f"calibration-{method}"), key_of(stamp, "by number"))
        _replicate_all(study, found, replicates, progress, workers)
        ranks, tries = found.arrays(range(replicates))
        dataset = xr.Dataset(
            {"rank": (("replicate", "quantity"), ranks), "tries": ("replicate", tries)},
            {"quantity": [*names, LIKELIHOOD]},
            {"structure": structure.label, "method": method},
        )
        write_dataset(path, dataset, key)
        found.path.unlink(missing_ok=True)
    data = open_dataset(path)
    names = tuple(map(str, data["quantity"].values))
    refused = 1.0 - data.sizes["replicate"] / float(data["tries"].sum())
    return Calibrated(Calibration(names, data["rank"].values), method, data.attrs["structure"], refused)


class _Found:
    """Ranks and tries of the replicates that are there, by their numbers, and the checkpoint that keeps them."""

    def __init__(self, path: Path, key: str):
        self.path, self.key = path, key
        stored = load_checkpoint(path, key) or {"number": (), "ranks": (), "tries": ()}
        columns = zip(stored["number"], stored["ranks"], stored["tries"], strict=True)
        self.results = {int(number): (ranks, int(tries)) for number, ranks, tries in columns}
        self.kept = len(self.results)

    def add(self, number: int, result: tuple[np.ndarray, int]) -> None:
        self.results[number] = result
        there = len(self.results)
        if there - self.kept >= max(AT_ONCE, there // 50):  # the more there are, the longer it takes to write them
            self.keep()

    def keep(self) -> None:
        if len(self.results) > self.kept:
            numbers = sorted(self.results)
            ranks, tries = self.arrays(numbers)
            save_checkpoint(self.path, self.key, {"number": np.array(numbers), "ranks": ranks, "tries": tries})
            self.kept = len(numbers)

    def arrays(self, numbers: Iterable[int]) -> tuple[np.ndarray, np.ndarray]:
        ranks, tries = zip(*(self.results[number] for number in numbers), strict=True)
        return np.array(ranks), np.array(tries)


def _replicate_all(study: Study, found: _Found, replicates: int, progress: Progress, workers: Workers) -> None:
    """Add all replicates that are missing; those that are there are kept, however it ends."""
    missing = [number for number in range(replicates) if number not in found.results]
    there = count(replicates - len(missing) + 1)

    def done(index: int, result: tuple[np.ndarray, int]) -> None:
        found.add(missing[index], result)
        progress(next(there), replicates)

    progress(replicates - len(missing), replicates)
    try:
        workers.run(_numbered, study, missing, done)
    finally:
        found.keep()


def _numbered(study: Study, number: int, report: Progress) -> tuple[np.ndarray, int]:
    """One replicate by its number, by the method that the study says."""
    key = jax.random.fold_in(random_key(study.campaign, "calibration"), number)
    return _replicate(study.posterior(study.campaign.full), find_method(study.extra), key)


def _replicate(posterior: Posterior, draw: Draw, key: jax.Array) -> tuple[np.ndarray, int]:
    """Ranks of one truth, the log-likelihood's last, and how many draws it took to find one that can be simulated."""
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
            f"none of {TRIES} draws from the prior can be simulated over these records: narrow the priors; `seatrial prior` shows why"
        )
    chosen = jnp.asarray(spread_evenly(draw(made, draw_key)))
    values = np.column_stack([made.constrain(chosen), _log_likelihoods(made, chosen)])
    return ranks_of(np.append(np.asarray(truth), at_truth), values), tried


@jax.jit
def _log_likelihoods(posterior: Posterior, z: jax.Array) -> jax.Array:
    return map_lanes(posterior.log_likelihood, z, VECTOR)
