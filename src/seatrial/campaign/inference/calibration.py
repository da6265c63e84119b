"""Calibration of a whole campaign: is the stated uncertainty right for this vehicle, these trials and these priors?"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Bool, Float

from seatrial.campaign.compute.place import workers_of
from seatrial.campaign.compute.shared_work import Study
from seatrial.campaign.compute.workers import Workers
from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.inference.estimate import estimate_key
from seatrial.campaign.inference.posterior import random_key
from seatrial.campaign.store.files import Store, is_current, key_of, load_checkpoint, save_checkpoint, write_dataset
from seatrial.core.batching import map_lanes
from seatrial.core.dataset_file import open_dataset
from seatrial.core.errors import NumericalError
from seatrial.core.progress import SILENT, Progress, Reporter
from seatrial.estimation.calibration import DRAWS, Calibration, ranks_of, spread_evenly
from seatrial.estimation.draw_posterior import Draw, find_method
from seatrial.estimation.posterior import Posterior
from seatrial.estimation.replicate import replicate
from seatrial.sampling.run import Mixing
from seatrial.sampling.target import VECTOR

AT_ONCE = 8
"""Replicates between two checkpoints, at least."""
TRIES = 200
"""Draws from the prior until one can be simulated."""
LIKELIHOOD = "log-likelihood"
MANY_REFUSED = 0.05
"""Share of the prior beyond which a reader is told."""
MAX_R_HAT, MIN_ESS, MIN_MOVED = 1.3, DRAWS, 0.05
"""What a replicate's draws have at most and at least where they mixed well. Ranks are among 99 draws; of 32 short chains 99 effective
draws are 1.5 in each half, the means of which then differ so much that R-hat is 1.3, where nothing is wrong with them."""
WORST = (
    ("R-hat up to {:.2f}", np.max),
    ("{:.0f} effective draws at least", np.min),
    ("{:.2%} of transitions diverged at most", np.max),
    ("{:.0%} of the moves made at least", np.min),
)
"""How the worst of each diagnostic is told."""
MANY_POOR = 0.02
"""Share of the replicates that did not mix well from which on they may be why ranks are uneven."""


@dataclass(frozen=True, eq=False)
class Calibrated:
    """Result of a calibration, and what it was made of.

    Attributes:
        calibration: ranks.
        method: how posteriors were drawn.
        structure: label of the structure.
        refused: share of the prior's draws that could not be simulated, and were drawn again.
        health: of each replicate, r of them: R-hat, effective sample size, share of divergent transitions, share of moves made, NaN
            where the method has no such number, shape (r, 4).
    """

    calibration: Calibration
    method: str
    structure: str
    refused: float
    health: Float[np.ndarray, "r 4"]

    def poor(self) -> Bool[np.ndarray, " r"]:
        """Replicates whose draws did not mix well, by the method's own diagnostics."""
        r_hat, ess, diverged, moved = self.health.T
        return (
            (r_hat > MAX_R_HAT)
            | (ess < MIN_ESS)
            | (diverged > 0.0)
            | (moved < MIN_MOVED)
            | np.isnan(self.health).all(1)
        )

    def lines(self) -> list[str]:
        """What was found, in words."""
        outside, k = self.calibration.outside(), len(self.calibration.names)
        band = f"the band that holds {'it' if k == 1 else f'all {k} quantities'} with 99 % probability"
        verdict = (
            f"calibrated: the ranks lie inside {band}"
            if not outside
            else f"not calibrated: the ranks of {', '.join(outside)} leave {band}"
        )
        said = [*self.calibration.lines(), self.mixing_words()]
        if self.refused > MANY_REFUSED:
            said.append(
                f"{self.refused:.0%} of the prior could not be simulated and was drawn again; `seatrial prior` shows why"
            )
        return [*said, f"{verdict} (structure {self.structure}, {self.method})"]

    def mixing_words(self) -> str:
        """Whether the draws themselves may be why ranks are uneven, by the method's own diagnostics."""
        poor, r = self.poor(), len(self.health)
        worst = [
            text.format(extreme(column[~np.isnan(column)]))
            for (text, extreme), column in zip(WORST, self.health.T, strict=True)
            if not np.isnan(column).all()
        ]
        numbers = ", ".join(worst)
        if not poor.any():
            end = ": it is not the sampling that makes the ranks uneven" if self.calibration.outside() else ""
            return f"the draws mixed well in all {r} replicates ({numbers}){end}"
        said = f"the draws mixed poorly in {poor.sum()} of {r} replicates ({numbers})"
        if poor.mean() < MANY_POOR:
            return f"{said}: too few to make ranks uneven"
        return f"{said}: uneven ranks may be the sampling's and not the posterior's; try another method, or narrower priors"


def calibrate(
    campaign: Campaign, trials: Trials, replicates: int, method: str, reporter: Reporter = SILENT
) -> Calibrated:
    """Draw parameters from the priors, data from them over the fitted records' own inputs, and rank the truth in each posterior.

    The full structure is calibrated. Resumes from what an interrupted run has done.

    Args:
        campaign: configuration.
        trials: records, of which inputs, times and gaps are used.
        replicates: how many.
        method: see `seatrial.estimation.draw_posterior`.
        reporter: receives what happens.

    Raises:
        InputError: no such method.
        NumericalError: a prior of which hardly a draw can be simulated.
    """
    structure, _ = campaign.full, find_method(method)
    store = Store(campaign.folder)
    path = store.calibration(method)
    stamp = key_of("calibration with diagnostics", estimate_key(campaign, structure, trials), method)
    key = key_of(stamp, replicates)
    if not is_current(path, key):
        workers, study = workers_of(campaign, reporter), Study(campaign, trials.fit, method)
        names = study.posterior(structure).names
        progress = reporter.progress(f"calibrate {structure.label} by {method}")
        found = _Found(store.checkpoint(f"calibration-{method}"), key_of(stamp, "by number"))
        _replicate_all(study, found, replicates, progress, workers)
        arrays = found.arrays(range(replicates))
        dims = {"rank": ("replicate", "quantity"), "tries": ("replicate",), "health": ("replicate", "diagnostic")}
        dataset = xr.Dataset(
            {name: (dims[name], value) for name, value in arrays.items()},
            {"quantity": [*names, LIKELIHOOD], "diagnostic": list(Mixing._fields)},
            {"structure": structure.label, "method": method},
        )
        write_dataset(path, dataset, key)
        found.path.unlink(missing_ok=True)
    data = open_dataset(path)
    names = tuple(map(str, data["quantity"].values))
    refused = 1.0 - data.sizes["replicate"] / float(data["tries"].sum())
    ranks = Calibration(names, data["rank"].values)
    return Calibrated(ranks, method, data.attrs["structure"], refused, data["health"].values)


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
            f"none of {TRIES} draws from the prior can be simulated over these records: narrow the priors; `seatrial prior` shows why"
        )
    drawn = draw(made, draw_key)
    # Chain after chain: draws taken at even distances are then as far apart as can be.
    chosen = jnp.asarray(spread_evenly(drawn.z.reshape(-1, made.dim)))
    values = np.column_stack([made.constrain(chosen), _log_likelihoods(made, chosen)])
    return _Replicate(ranks_of(np.append(np.asarray(truth), at_truth), values), tried, np.array(drawn.mixing()))


@jax.jit
def _log_likelihoods(posterior: Posterior, z: jax.Array) -> jax.Array:
    return map_lanes(posterior.log_likelihood, z, VECTOR)
