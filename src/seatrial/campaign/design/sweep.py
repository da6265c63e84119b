"""Design of the first trial from the priors, and of the next one from the posterior, kept on disk."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from seatrial.campaign.compute.place import workers_of
from seatrial.campaign.compute.shared_work import Study
from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.design.problem import Believed, believed_after, design_problem
from seatrial.campaign.design.residual_noise import with_residual_noise
from seatrial.campaign.design.schedule import commands_of, write_schedule
from seatrial.campaign.store.estimates import Drawn, Estimate, OfStructure
from seatrial.campaign.store.stored_result import Store, StoredResult, key_of
from seatrial.core.argument_checks import check_kind
from seatrial.core.reporter import SILENT, Progress, Reporter
from seatrial.design.results import SweptDesigns
from seatrial.design.sweep import Sweep
from seatrial.design.trial_design import GridRows, GridSearch, RowsDone, TrialDesign, design_trial, sweep_rows
from seatrial.manoeuvres.manoeuvre import Manoeuvre


def design_key(campaign: Campaign) -> str:
    """Key of the first design."""
    design = campaign.design.model_copy(update={"schedule": None})  # no design depends on a schedule of one's own
    others = {name: bounds for name, bounds in campaign.control_limits.items() if name != campaign.family.control}
    return key_of(
        "design",
        *(campaign.vehicle, campaign.structure, design, campaign.power),
        *(campaign.priors, campaign.sensors, campaign.mounts, campaign.limits, campaign.motion_limits, campaign.seed),
        *([others] if campaign.family.beside or campaign.autopilot.loops else []),
        *([campaign.autopilot] if campaign.autopilot.loops else []),
        *([process] if (process := campaign.expected_process(campaign.model(campaign.full))) else []),
    )


def stored_first(campaign: Campaign) -> StoredResult[SweptDesigns]:
    """Return where the first design is kept, and what it depends on."""
    return StoredResult(
        Store(campaign.folder).design, design_key(campaign), SweptDesigns, f"seatrial design {campaign.folder}"
    )


def stored_next(campaign: Campaign, estimate: OfStructure) -> StoredResult[SweptDesigns]:
    """Return where the design of the next trial is kept, and what it depends on."""
    key = key_of("next", design_key(campaign), estimate.key, estimate.structure.terms)
    return StoredResult(Store(campaign.folder).next_design, key, SweptDesigns, f"seatrial next {campaign.folder}")


def design_first(campaign: Campaign, reporter: Reporter = SILENT) -> TrialDesign:
    """Sweep the design grid under the priors of the full structure, or read the sweep if it is current.

    Args:
        campaign: of `load_campaign`.
        reporter: receives the progress.

    Returns:
        every design with its utility, and the best; `.lines()` has them in words.

    Raises:
        InputError: no campaign, or no design inside its limits.
    """
    check_kind(campaign, Campaign, "campaign", "read it with `load_campaign`")
    return _designs(campaign, stored_first(campaign), lambda: _swept(campaign, None, "the priors", reporter))


def is_designed(campaign: Campaign) -> bool:
    """Whether there is a first design that belongs to the campaign as it is."""
    return stored_first(campaign).is_current()


def design_next(campaign: Campaign, estimate: Estimate, reporter: Reporter = SILENT) -> TrialDesign:
    """Sweep the grid for a structure from what its posterior says of coefficients and noise so far; a current result is read."""
    basis = f"the posterior of {estimate.structure.label}"
    return _designs(
        campaign, stored_next(campaign, estimate), lambda: _swept_after(campaign, estimate, basis, reporter)
    )


def design_next_by_mode(campaign: Campaign, drawn: Drawn, reporter: Reporter = SILENT) -> TrialDesign:
    """Likewise from draws about the posterior mode of a structure."""
    key = key_of("next by mode", design_key(campaign), drawn.structure.terms, drawn.draws().tolist())
    kept = StoredResult(Store(campaign.folder).mode_design, key, SweptDesigns)
    basis = f"the posterior mode of {drawn.structure.label}"
    return _designs(campaign, kept, lambda: _swept_after(campaign, drawn, basis, reporter))


def _designs(campaign: Campaign, kept: StoredResult[SweptDesigns], make: Callable[[], SweptDesigns]) -> TrialDesign:
    """Read or make sweeps; the schedule of the best trial is written again where it is missing or not the same."""
    designs = designs_of(campaign, kept.read_or_make(make))
    write_design(campaign, Store(campaign.folder).schedule(kept.path), designs.best.best_manoeuvre())
    return designs


def write_design(campaign: Campaign, path: Path, manoeuvre: Manoeuvre, rule: str = "", **about: Any) -> Path:
    """Write the schedule of a design, with the key of the designs that it belongs to; arguments and result as `write_schedule`."""
    about = {**about, "design": design_key(campaign)}
    return write_schedule(path, manoeuvre, campaign.family.sample_time, rule, about, commands_of(campaign))


def designs_of(campaign: Campaign, stored: SweptDesigns) -> TrialDesign:
    """Return stored sweeps with the families of the campaign."""
    families = {family.kind: family for family in campaign.families}
    sweeps = []
    for i, kind in enumerate(stored.families):
        ended = stored.length[i] if campaign.design.per == "second" else None
        arrays = stored.gain[i], stored.peak_speed[i], stored.final_sd[i], stored.trim, stored.worth[i], ended
        sweeps.append(Sweep(families[kind], stored.amplitude, stored.period, *arrays))
    return TrialDesign(
        tuple(sorted(sweeps, key=lambda sweep: -sweep.worth[sweep.best])),
        stored.refused,
        dict(zip(stored.names, map(float, stored.sd_before), strict=True)),
        {name: campaign.units[name] for name in stored.names},
        stored.unit,
        stored.safety,
        stored.prediction,
        stored.basis,
    )


def _swept_after(campaign: Campaign, drawn: Drawn, basis: str, reporter: Reporter) -> SweptDesigns:
    return _swept(with_residual_noise(campaign, drawn), believed_after(campaign, drawn), basis, reporter)


def _swept(campaign: Campaign, believed: Believed | None, basis: str, reporter: Reporter) -> SweptDesigns:
    """Sweep, each row of the grid wherever there is a worker."""
    problem, study = design_problem(campaign, believed), Study(campaign, extra=believed)
    run = partial(workers_of(campaign, reporter).run, _sweep_rows, study)
    design = design_trial(problem, GridSearch(run), reporter=reporter)
    by_kind = {sweep.family.kind: sweep for sweep in design.sweeps}
    sweeps = [by_kind[family.kind] for family in problem.families if family.kind in by_kind]
    lengths = [
        np.full(sweep.gain.shape, sweep.family.duration) if sweep.length is None else sweep.length for sweep in sweeps
    ]
    stacked = {name: np.stack([getattr(sweep, name) for sweep in sweeps]) for name in ("gain", "worth", "peak_speed")}
    return SweptDesigns(
        families=tuple(sweep.family.kind for sweep in sweeps),
        control=campaign.family.control,
        trim=problem.trim_of(problem.family),
        amplitude=problem.amplitudes,
        period=problem.periods,
        **stacked,
        final_sd=np.stack([sweep.final_sd for sweep in sweeps]),
        length=np.stack(lengths),
        names=design.names,
        sd_before=np.array(list(design.sd_before.values())),
        basis=basis,
        refused=dict(design.refused),
        safety=design.safety,
        prediction=design.prediction,
        unit=design.unit,
    )


def _sweep_rows(study: Study, rows: GridRows, report: Progress) -> RowsDone:
    """Sweep some rows in a worker, which makes the problem once."""
    return sweep_rows(study.once("problem", lambda: design_problem(study.campaign, study.extra)), rows)
