"""Estimation of every candidate structure: mode, chains with checkpoints, health in words."""

from collections.abc import Mapping, Sequence
from dataclasses import astuple
from typing import NamedTuple

import jax
import numpy as np

from seatrial.campaign.compute.place import workers_of
from seatrial.campaign.compute.shared_work import Study
from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.schema import EstimationTable
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.inference.model_error import (
    causes_of,
    contradictions,
    describes_nothing,
    findings_of,
    left_out,
    stated_errors,
    tried_effects,
)
from seatrial.campaign.inference.modes import all_modes, check_prior_of, long_steps
from seatrial.campaign.inference.posterior import is_whole, widest
from seatrial.campaign.store.estimates import Estimate, HasKey
from seatrial.campaign.store.stored_result import Store, StoredResult, key_of, load_checkpoint, save_checkpoint
from seatrial.compiled.programs import program
from seatrial.compiled.random_keys import fold_in, random_key
from seatrial.core.argument_checks import check_kind
from seatrial.core.dataset import Dataset
from seatrial.core.errors import NumericalError
from seatrial.core.findings import Finding, Message
from seatrial.core.reporter import SILENT, Progress, Reporter
from seatrial.estimation.diagnostics.error_budget import ORIGINS, ErrorBudget, error_budget
from seatrial.estimation.diagnostics.error_sources import StatedErrors
from seatrial.estimation.diagnostics.identifiability import identifiability_of_fit
from seatrial.estimation.diagnostics.prior_checks import prior_findings
from seatrial.estimation.posterior.mode import Mode
from seatrial.estimation.posterior.noncentred import in_posterior, uncouple, uncoupled_mode
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.estimation.posterior.sample_posterior import spread_starts
from seatrial.estimation.priors import by_kind, prior_curve
from seatrial.messages.effects import contents_text
from seatrial.messages.identifiability import identifiability_cautions
from seatrial.messages.render import sentences
from seatrial.sampling.diagnostics import ChainHealth, asks_for_more, chain_findings, diagnose
from seatrial.sampling.run import (
    BLOCK,
    ChainRun,
    ChainSettings,
    Draws,
    arrays_of_run,
    finish,
    run_from_arrays,
)
from seatrial.sampling.sampler import SAMPLERS, advance_chains, start_chains
from seatrial.sampling.target import Target
from seatrial.selection.structures import Structure

CHECKPOINT_EVERY = 5


def estimate_key(campaign: Campaign, structure: Structure, trials: HasKey) -> str:
    """Key of one structure's posterior."""
    return key_of(
        "posterior, with all errors in its standard deviations, cut at bounds, the effects tried, about all modes",
        *(trials.key, structure.terms, campaign.vehicle),
        *(campaign.priors, campaign.sensors, campaign.mounts, campaign.estimation, campaign.seed),
    )


def stored_estimates(campaign: Campaign, trials: HasKey) -> dict[Structure, StoredResult[Estimate]]:
    """Return where the posterior of each candidate structure is kept, and what it depends on."""
    return {
        one: StoredResult(
            Store(campaign.folder).posterior(one.label),
            estimate_key(campaign, one, trials),
            Estimate,
            f"seatrial estimate {campaign.folder}",
        )
        for one in campaign.structures
    }


def estimate_all(
    campaign: Campaign, trials: Trials, reporter: Reporter = SILENT, only: Sequence[Structure] | None = None
) -> list[Estimate]:
    """Estimate every candidate structure, side by side; current results are read.

    Args:
        campaign: configuration.
        trials: records, of `get_trials`.
        reporter: receives the progress.
        only: candidates that are estimated; None for all.

    Returns:
        one posterior for each of these; `.data` has draws and a summary, and `.draws(names)` gives them in SI, shape (n, k).
    """
    check_kind(campaign, Campaign, "campaign", "read it with `load_campaign`")
    check_kind(trials, Trials, "trials", "make them with `get_trials`")
    store, every = Store(campaign.folder), stored_estimates(campaign, trials)
    kept = every if only is None else {one: every[one] for one in only}
    missing = [one for one, result in kept.items() if not result.is_current()]
    if missing:
        shown = [reporter.progress(f"estimate {one.label}: {' '.join(one.terms)}") for one in missing]

        checkpoint_keys = {one: key_of("chains", kept[one].key, widest(campaign.structures).terms) for one in missing}

        def done(index: int, result: _Ended | _Unended) -> _Unended | None:
            """Keep what is there: a finished posterior, or the chains so far, from which its next piece goes on."""
            structure = missing[index]
            checkpoint = store.checkpoint(f"posterior-{structure.label}")
            if isinstance(result, _Unended):
                save_checkpoint(checkpoint, checkpoint_keys[structure], result.run)
                shown[index](result.done, result.total)
                return result
            kept[structure].write(result.estimate)
            checkpoint.unlink(missing_ok=True)
            shown[index](1, 1)
            return None

        def on_progress(index: int, done: int, total: int) -> None:
            shown[index](done, total)

        study, workers = Study(campaign, trials.fit), workers_of(campaign, reporter)
        # Of all structures, also those that are there: each mode depends on the others', and must not on what was kept.
        known = all_modes(study, trials, reporter)
        modes = {one: known.of(one) or (known.highest(one),) for one in missing}
        begun = [
            _Begun(one, modes[one], load_checkpoint(store.checkpoint(f"posterior-{one.label}"), checkpoint_keys[one]))
            for one in missing
        ]
        workers.run(_advance, study, begun, done, on_progress)
    return [result.read() for result in kept.values()]


class _Begun(NamedTuple):
    """A structure with its modes, the highest first, whose chains are to begin, or to go on from arrays of their run."""

    structure: Structure
    modes: tuple[Mode | NumericalError, ...]
    run: dict[str, np.ndarray] | None


class _Unended(NamedTuple):
    """A structure with its modes and its chains' run so far, with the iterations done and in all."""

    structure: Structure
    modes: tuple[Mode | NumericalError, ...]
    run: dict[str, np.ndarray]
    done: int
    total: int


class _Ended(NamedTuple):
    """The posterior of a structure."""

    estimate: Estimate


def _advance(study: Study, item: _Begun | _Unended, report: Progress) -> _Ended | _Unended:
    """Run the chains of one structure to the next checkpoint, or to their end."""
    campaign, structure = study.campaign, item.structure
    table = campaign.estimation
    if isinstance(item, _Begun):  # the errors of the model come first, and may take minutes
        report(0, table.warmup + table.lengths[0])
    posterior, mode, budget, target, there = study.once(
        ("mode", structure.terms), lambda: _prepare(study, structure, item.modes[0])
    )
    sampler = SAMPLERS[table.sampler]
    settings = ChainSettings(table.chains, table.warmup, table.lengths[-1], table.thin)
    draw_key = random_key(campaign.seed, f"chains {structure.terms}")
    if item.run is None:
        further = [uncoupled_mode(target, one) for one in item.modes[1:] if isinstance(one, Mode)]
        starts = spread_starts(target, there, settings.chains, fold_in(draw_key, 2**31), further)
        run = start_chains(sampler, target, starts, there.cov)
    else:
        run = run_from_arrays(sampler.State, item.run)
    while (enough := _enough(target, run, table)) is None:
        total = next(end for length in table.lengths if (end := table.warmup + length) > run.iteration)
        report(
            run.iteration, total
        )  # before each block: whether chains that are as long as asked for go on is not known yet
        run = advance_chains(sampler, target, run, draw_key, settings)
        if run.iteration // BLOCK % CHECKPOINT_EVERY == 0 and run.iteration < total:
            return _Unended(structure, item.modes, arrays_of_run(run), run.iteration, total)
    doubts = long_steps(posterior, mode, study.records)
    mode = mode.only(posterior.places)
    missing = left_out(posterior, structure, budget)
    stated = stated_errors(table)
    return _Ended(_estimate(structure, posterior, mode, budget, stated, missing, *enough, campaign.hull.trim, doubts))


def _enough(target: Target, run: ChainRun, table: EstimationTable) -> tuple[Draws, ChainHealth] | None:
    """Return the draws of chains that need no more: they are as many as asked for, or twice, and agree, or four times; else None."""
    made = run.iteration - table.warmup
    if made not in table.lengths:
        return None
    draws = in_posterior(target, finish(run))
    health = diagnose(draws.values)
    return None if made < table.lengths[-1] and asks_for_more(health) else (draws, health)


def _prepare(
    study: Study, structure: Structure, mode: Mode | NumericalError
) -> tuple[Posterior, Mode, ErrorBudget, Target, Mode]:
    """Posterior and mode of a structure, what leaving out data does to it, and both in the coordinates in which it is sampled."""
    campaign, posterior = study.campaign, study.posterior(structure)
    if isinstance(mode, NumericalError):
        raise mode
    own = mode.only(posterior.places)
    if is_whole(structure, campaign.structures):
        check_prior_of(study, posterior, own)
    return (
        posterior,
        mode,
        error_budget(posterior, mode, stated_errors(campaign.estimation)),
        *uncouple(posterior, mode),
    )


def _estimate(
    structure: Structure,
    posterior: Posterior,
    mode: Mode,
    budget: ErrorBudget,
    stated: StatedErrors,
    missing: tuple[Finding, ...],
    draws: Draws,
    health: ChainHealth,
    at: Mapping[str, float],
    doubts: Sequence[Message],
) -> Estimate:
    values = draws.values
    parameters, names = posterior.present_parameters, posterior.present_names
    prior_sd = np.array([parameter.prior.sd for parameter in parameters])
    within = dict(zip(names, map(float, values.std(axis=(0, 1))), strict=True))
    flat = values.reshape(-1, len(names))
    known = identifiability_of_fit(posterior, mode, flat, at)
    cautions = [*doubts, *identifiability_cautions(known), *prior_findings(posterior, mode, flat)]
    cautions += contradictions(budget, stated)
    prior_value, prior_density = zip(*prior_curves(posterior).values(), strict=True)
    per_parameter = {
        "mode": mode.values,
        "laplace_sd": mode.sd,
        "mean": values.mean(axis=(0, 1)),
        "sd": [budget.sd(name, one) for name, one in within.items()],
        "draws_sd": list(within.values()),
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
    data = Dataset(
        {
            "draws": (("chain", "draw", "parameter"), values),
            "log_density": (("chain", "draw"), draws.log_density),
            **{name: ("parameter", np.asarray(column, float)) for name, column in per_parameter.items()},
            "shares": (
                ("parameter", "origin"),
                np.array([astuple(budget.shares_of(name))[: len(ORIGINS)] for name in names]),
            ),
            "prior_value": (("parameter", "point"), np.stack(prior_value)),
            "prior_density": (("parameter", "point"), np.stack(prior_density)),
        },
        coords={
            "parameter": list(names),
            "origin": list(ORIGINS),
            "unit": ("parameter", [p.unit for p in parameters]),
            "label": ("parameter", [p.label for p in parameters]),
            "prior_kind": ("parameter", [type(p.prior).__name__ for p in parameters]),
        },
        attrs={"acceptance": draws.acceptance, "laplace_log_evidence": mode.log_evidence},
    )
    return Estimate(
        structure,
        data,
        alarms=tuple(sentences([*chain_findings(names, health), *draws.faults(), *describes_nothing(budget)])),
        cautions=tuple(cautions),
        at_bounds=tuple(sentences(mode.at_bounds)),
        left_out=missing,
        contains=contents_text(budget, stated),
        causes=causes_of(budget, within),
        cause_findings=tuple(findings_of(posterior, budget)),
        tried_effects=tried_effects(budget),
        configuration_differences=budget.changes(dict(zip(names, values.mean((0, 1)), strict=True)), within),
    )


def prior_curves(posterior: Posterior) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Each present parameter's prior density over nearly all of its support: values that increase, and the density per unit there."""
    values, log_density = (np.asarray(x).T[posterior.places] for x in _prior_curves(posterior))
    order = np.argsort(values, axis=1)
    curves = (np.take_along_axis(one, order, 1) for one in (values, np.exp(log_density)))
    return dict(zip(posterior.present_names, zip(*curves, strict=True), strict=True))


@program
def _prior_curves(posterior: Posterior) -> tuple[jax.Array, jax.Array]:
    """Return values of every parameter along z, and their log prior densities per unit of the value, shape (points, d)."""
    return by_kind([parameter.prior for parameter in posterior.parameters], prior_curve)
