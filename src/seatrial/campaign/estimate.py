"""Estimation of every candidate structure: mode, chains with checkpoints, health in words."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from seatrial.campaign.config import Campaign
from seatrial.campaign.problem import build_posterior, is_whole, random_key
from seatrial.campaign.store import Store, is_current, key_of, load_checkpoint, save_checkpoint, write_dataset
from seatrial.campaign.trials import Trials
from seatrial.campaign.watch import SILENT, Watch, run_side_by_side
from seatrial.core.dataset_file import open_dataset
from seatrial.estimation.checks import check_prior_contains_data, information_complaints
from seatrial.estimation.draw_posterior import spread_starts
from seatrial.estimation.mode import Mode, find_mode
from seatrial.estimation.output_error import deviation_name, is_deviation, of_deviation, spread_name
from seatrial.estimation.posterior import Posterior
from seatrial.estimation.uncoupled import in_posterior, uncouple
from seatrial.sampling.diagnostics import complaints, diagnose
from seatrial.sampling.run import (
    BLOCK,
    ChainSettings,
    Draws,
    Run,
    arrays_of_run,
    complaints_of_draws,
    is_finished,
    run_from_arrays,
)
from seatrial.sampling.sampler import SAMPLERS
from seatrial.sampling.target import Progress, Target
from seatrial.selection.structures import Structure

CHECKPOINT_EVERY = 5
CURVE = 241
"""Points of a prior's density."""


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

    def own_values(self) -> list[tuple[str, str, float, float, str]]:
        """Of each value that varies between trials: its name, the trial, its mean, standard deviation and SI unit."""
        found = []
        for name, label in map(of_deviation, filter(is_deviation, self.names)):
            common, spread, deviation = self.draws([name, spread_name(name), deviation_name(name, label)]).T
            own, unit = common + spread * deviation, str(self.data.sel(parameter=name)["unit"].values)
            found.append((name, label, float(own.mean()), float(own.std()), unit))
        return found


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
        check_prior_contains_data(posterior, mode, str(campaign.path), is_whole(campaign, structure))
        target, there = uncouple(posterior, mode)
        run = _sample(campaign, structure, target, there, key, progress)
        draws = in_posterior(target, SAMPLERS[campaign.source.estimation.sampler].finish(run))
        write_dataset(path, _dataset(posterior, mode, draws, campaign.hull.trim), key)
        store.checkpoint(f"posterior-{structure.label}").unlink(missing_ok=True)
    return Estimate(structure, open_dataset(path))


def _sample(campaign: Campaign, structure: Structure, target: Target, mode: Mode, key: str, progress: Progress) -> Run:
    table = campaign.source.estimation
    sampler = SAMPLERS[table.sampler]
    settings = ChainSettings(table.chains, table.warmup, table.draws, table.thin)
    draw_key = random_key(campaign, f"chains {structure.terms}")
    checkpoint = Store(campaign.folder).checkpoint(f"posterior-{structure.label}")
    stored = load_checkpoint(checkpoint, key)
    if stored is None:
        starts = spread_starts(target, mode, settings.chains, jax.random.fold_in(draw_key, 2**31))
        run = sampler.start_chains(target, starts, jnp.asarray(mode.cov))
    else:
        run = run_from_arrays(sampler.State, stored)
    total = settings.warmup + settings.draws
    while not is_finished(run, settings):
        run = sampler.advance_chains(target, run, draw_key, settings)
        progress(run.iteration, total)
        if run.iteration // BLOCK % CHECKPOINT_EVERY == 0 and not is_finished(run, settings):
            save_checkpoint(checkpoint, key, arrays_of_run(run))
    return run


def _dataset(posterior: Posterior, mode: Mode, draws: Draws, at: Mapping[str, float]) -> xr.Dataset:
    values = np.asarray(posterior.constrain(jnp.asarray(draws.z)))
    health = diagnose(values)
    parameters = posterior.parameters
    prior_sd = np.array([parameter.prior.sd for parameter in parameters])
    sd = values.std(axis=(0, 1))
    cautions = information_complaints(posterior, mode, values.reshape(-1, posterior.dim), at)
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
            **prior_curves(posterior),
        },
        coords={
            "parameter": list(posterior.names),
            "unit": ("parameter", [p.unit for p in parameters]),
            "label": ("parameter", [p.label for p in parameters]),
            "prior_kind": ("parameter", [type(p.prior).__name__ for p in parameters]),
        },
        attrs={
            "acceptance": draws.acceptance,
            "laplace_log_evidence": mode.log_evidence,
            "alarms": json.dumps(complaints(posterior.names, health) + complaints_of_draws(draws)),
            "cautions": json.dumps(cautions),
        },
    )


def prior_curves(posterior: Posterior) -> dict[str, tuple[tuple[str, str], np.ndarray]]:
    """Each parameter's prior density over nearly all of its support, for figures: `prior_value` and `prior_density`."""
    z = jnp.broadcast_to(jnp.linspace(-4.0, 4.0, CURVE)[:, None], (CURVE, posterior.dim))
    values, slopes = (
        np.asarray(x).T for x in jax.jit(jax.jvp, static_argnums=0)(posterior.constrain, (z,), (jnp.ones_like(z),))
    )
    log_density = np.stack([np.asarray(p.prior.log_density(z[:, i])) for i, p in enumerate(posterior.parameters)])
    density = np.exp(log_density) / np.abs(slopes)
    order = np.argsort(values, axis=1)
    across = ("parameter", "point")
    return {
        "prior_value": (across, np.take_along_axis(values, order, 1)),
        "prior_density": (across, np.take_along_axis(density, order, 1)),
    }
