"""Estimation of every candidate structure: mode, adaptive Metropolis with checkpoints, health in words, filter traces."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from seatrial.campaign.config import Campaign
from seatrial.campaign.problem import build_posterior, random_key
from seatrial.campaign.store import Store, is_current, key_of, load_checkpoint, save_checkpoint, write_dataset
from seatrial.campaign.trials import Trials
from seatrial.campaign.watch import SILENT, Watch, run_side_by_side
from seatrial.core.dataset_file import open_dataset
from seatrial.estimation.checks import check_prior_contains_data, information_complaints
from seatrial.estimation.mode import Mode, find_mode
from seatrial.estimation.posterior import Posterior
from seatrial.sampling.adaptive_metropolis import (
    BLOCK,
    ChainState,
    MetropolisSettings,
    Run,
    advance_chains,
    finish,
    is_finished,
    start_chains,
)
from seatrial.sampling.diagnostics import complaints, diagnose
from seatrial.sampling.target import Progress, log_densities
from seatrial.selection.structures import Structure

CHECKPOINT_EVERY = 5


@dataclass(frozen=True, eq=False)
class Estimate:
    """Posterior of one structure as stored: parameters on `parameter`, draws on `chain` and `draw`.

    Attributes:
        structure: which terms.
        data: the stored dataset.
    """

    structure: Structure
    data: xr.Dataset

    @property
    def key(self) -> str:
        """Stamp of the result."""
        return self.data.attrs["key"]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(str(name) for name in self.data["parameter"].values)

    @property
    def alarms(self) -> list[str]:
        """What makes the draws unfit for use."""
        return json.loads(self.data.attrs["alarms"])

    @property
    def cautions(self) -> list[str]:
        """What a reader must know."""
        return json.loads(self.data.attrs["cautions"])

    def draws(self, names: Sequence[str] | None = None) -> np.ndarray:
        """Draws of the named parameters, SI, all chains together, shape (n, k)."""
        chosen = self.data["draws"].sel(parameter=list(self.names if names is None else names))
        return chosen.values.reshape(-1, chosen.sizes["parameter"])


def estimate_key(campaign: Campaign, structure: Structure, trials: Trials) -> str:
    """Key of one structure's posterior."""
    source = campaign.source
    priors = {name: table.model_dump() for name, table in source.prior.items()}
    sensors = {name: table.model_dump() for name, table in source.sensors.items()}
    return key_of(
        "posterior",
        trials.key,
        structure.terms,
        source.vehicle.model_dump(),
        priors,
        sensors,
        source.estimation.model_dump(),
        source.campaign.seed,
    )


def estimate_all(campaign: Campaign, trials: Trials, watch: Watch = SILENT) -> list[Estimate]:
    """Estimate every candidate structure, side by side; current results are read."""
    tasks = []
    for structure in campaign.structures:
        current = is_current(
            Store(campaign.folder).posterior(structure.label), estimate_key(campaign, structure, trials)
        )
        progress = None if current else watch.progress(f"estimate {structure.label}: {' '.join(structure.terms)}")
        tasks.append(partial(_estimate, campaign, structure, trials, progress))
    return run_side_by_side(tasks)


def _estimate(campaign: Campaign, structure: Structure, trials: Trials, progress: Progress | None) -> Estimate:
    store, key = Store(campaign.folder), estimate_key(campaign, structure, trials)
    path = store.posterior(structure.label)
    if progress is not None:
        posterior = build_posterior(campaign, structure, trials.fit)
        mode = find_mode(posterior, random_key(campaign, f"mode {structure.terms}"))
        check_prior_contains_data(posterior, mode, str(campaign.path))
        run = _sample(campaign, structure, posterior, mode, key, progress)
        write_dataset(path, _dataset(posterior, mode, run), key)
        store.checkpoint(f"posterior-{structure.label}").unlink(missing_ok=True)
    return Estimate(structure, open_dataset(path))


def _sample(
    campaign: Campaign, structure: Structure, posterior: Posterior, mode: Mode, key: str, progress: Progress
) -> Run:
    table = campaign.source.estimation
    settings = MetropolisSettings(table.chains, table.warmup, table.draws, table.thin)
    draw_key = random_key(campaign, f"chains {structure.terms}")
    checkpoint = Store(campaign.folder).checkpoint(f"posterior-{structure.label}")
    stored = load_checkpoint(checkpoint, key)
    run = (
        _restore(stored)
        if stored is not None
        else start_chains(posterior, _starts(posterior, mode, settings.chains, draw_key), jnp.asarray(mode.cov))
    )
    total = settings.warmup + settings.draws
    while not is_finished(run, settings):
        run = advance_chains(posterior, run, draw_key, settings)
        progress(run.iteration, total)
        if run.iteration // BLOCK % CHECKPOINT_EVERY == 0 and not is_finished(run, settings):
            save_checkpoint(
                checkpoint,
                key,
                {
                    **run.state._asdict(),
                    "iteration": run.iteration,
                    "draws": run.z,
                    "log_densities": run.log_density,
                    "acceptance": run.acceptance,
                },
            )
    return run


def _starts(posterior: Posterior, mode: Mode, chains: int, key: jax.Array) -> jax.Array:
    """Positions spread 1.5 times as wide as the normal approximation, so that R-hat can see chains that do not meet."""
    noise = jax.random.normal(jax.random.fold_in(key, 2**31), (chains, posterior.dim))
    starts = jnp.asarray(mode.z) + 1.5 * noise @ jnp.linalg.cholesky(jnp.asarray(mode.cov)).T
    finite = jnp.isfinite(log_densities(posterior, starts))
    return jnp.where(finite[:, None], starts, jnp.asarray(mode.z))


def _restore(stored: dict[str, np.ndarray]) -> Run:
    state = ChainState(*(jnp.asarray(stored[name]) for name in ChainState._fields))
    return Run(state, int(stored["iteration"]), stored["draws"], stored["log_densities"], stored["acceptance"])


def _dataset(posterior: Posterior, mode: Mode, run: Run) -> xr.Dataset:
    draws = finish(run)
    values = np.asarray(posterior.constrain(jnp.asarray(draws.z)))
    health = diagnose(values)
    parameters = posterior.parameters
    prior_sd = np.array([parameter.prior.sd for parameter in parameters])
    sd = values.std(axis=(0, 1))
    cautions = information_complaints(posterior, mode, values.reshape(-1, posterior.dim))
    per_parameter = {
        "mode": mode.values,
        "laplace_sd": mode.sd,
        "mean": values.mean(axis=(0, 1)),
        "sd": sd,
        "prior_mean": [p.prior.mean for p in parameters],
        "prior_sd": prior_sd,
        "prior_lower": [p.prior.bounds[0] for p in parameters],
        "prior_upper": [p.prior.bounds[1] for p in parameters],
        "r_hat": health.r_hat,
        "ess_bulk": health.ess_bulk,
        "ess_tail": health.ess_tail,
        "geweke": health.geweke,
        "mcse": health.mcse,
    }
    return xr.Dataset(
        {
            "draws": (("chain", "draw", "parameter"), values),
            "log_density": (("chain", "draw"), draws.log_density),
            **{name: ("parameter", np.asarray(column, float)) for name, column in per_parameter.items()},
        },
        coords={
            "parameter": list(posterior.names),
            "unit": ("parameter", [p.unit for p in parameters]),
            "label": ("parameter", [p.label for p in parameters]),
        },
        attrs={
            "acceptance": draws.acceptance,
            "laplace_log_evidence": mode.log_evidence,
            "alarms": json.dumps(complaints(posterior.names, health)),
            "cautions": json.dumps(cautions),
        },
    )
