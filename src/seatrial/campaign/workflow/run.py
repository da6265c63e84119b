"""The whole loop: design, simulate or import, estimate, select, and say what to run next."""

from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.data.record_cautions import record_cautions
from seatrial.campaign.design.schedule import design_words
from seatrial.campaign.design.sweep import Designs
from seatrial.campaign.inference.baselines import compare_with_baselines, comparison_alarms, comparison_cautions
from seatrial.campaign.inference.cross_validation import current_cross_validation
from seatrial.campaign.inference.filter_trace import filter_complaints
from seatrial.campaign.inference.predict import (
    fit_complaints,
    held_back_alarms,
    held_back_cautions,
    held_back_curves,
    pooled_of,
)
from seatrial.campaign.selection.select_structure import structure_rows
from seatrial.campaign.store.baselines import FittedBaselines
from seatrial.campaign.store.cross_validation import CrossValidation
from seatrial.campaign.store.estimates import Estimate, Fit, Known, LeftOut
from seatrial.campaign.store.structures import Contenders, Screened
from seatrial.campaign.workflow.steps import LOOP, Workflow, stored_summary
from seatrial.core.argument_checks import check_kind
from seatrial.core.progress import SILENT, Reporter
from seatrial.core.signals import signal_unit
from seatrial.estimation.baseline_comparison import Comparison
from seatrial.estimation.pooled_coverage import Pooled
from seatrial.manoeuvres.family import Family
from seatrial.selection.verdict import Selection

if TYPE_CHECKING:
    import xarray as xr

ENOUGH = 0.2
"""Entropy reduction, nats, below which another trial of the family is not worth running."""
MEND = "stop: the model fails on runs that it was not fitted to; mend it before the next trial"
"""What is said in place of the next trial where that is so."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """Everything the loop found, as the report draws it.

    Attributes:
        campaign: configuration.
        trials: records.
        estimates: posterior of each structure.
        selection: which structure the data support.
        chosen: estimate of the most probable structure.
        filter: traces of the full structure.
        fits: how well each record is predicted.
        predictions: the curves.
        pooled: how well each channel of all held-back records together is predicted.
        baselines: simple predictors, fitted to the same records; None where no record is held back.
        compared: the chosen structure beside them, channel by channel.
        known: what the data tell about each parameter of the chosen structure.
        promised: what the best design would tell about those of the full one; None without such designs.
        first: designs from the priors; None where trials were imported that nothing was designed for.
        next: designs from the posterior of the chosen structure.
        screened: every structure in closed form; None where that cannot be done.
        screening_cautions: of that, or why it could not be done.
        contenders: the chosen structure beside the runner-up; None where there is one structure.
        left_out: what the chosen structure lacks and its coefficients hide.
        summary: the machine-readable summary.
        cross_validation: how well each fitted run is predicted from the others; None where that was not asked, or is not current.
    """

    campaign: Campaign
    trials: Trials
    estimates: tuple[Estimate, ...]
    selection: Selection
    chosen: Estimate
    filter: "xr.Dataset"
    fits: tuple[Fit, ...]
    predictions: "xr.Dataset"
    pooled: tuple[Pooled, ...]
    baselines: FittedBaselines | None
    compared: tuple[Comparison, ...]
    known: Known
    promised: Known | None
    first: Designs | None
    next: Designs
    screened: Screened | None
    screening_cautions: tuple[str, ...]
    contenders: Contenders | None
    left_out: tuple[LeftOut, ...]
    summary: dict[str, Any]
    cross_validation: CrossValidation | None = None


def run_loop(campaign: Campaign, reporter: Reporter = SILENT) -> Outcome:
    """Run every step that is not current, and summarise.

    Args:
        campaign: of `load_campaign`.
        reporter: told how far each step has come.

    Returns:
        the results of all steps, and a summary of them that is plain data in SI.

    Raises:
        InputError: as the steps; that the next trial cannot be designed is said before the first of them.
    """
    check_kind(campaign, Campaign, "campaign", "read it with `load_campaign`")
    campaign.control_trim(campaign.model(campaign.full))
    flow = Workflow(campaign, reporter)
    found = {step.name: flow.get(step.name) for step in LOOP}
    screened, cautions = found["screening"]
    fits, predictions = found["predictions"]
    same = ("trials", "selection", "chosen", "filter", "known", "promised", "first", "next", "contenders", "left_out")
    outcome = Outcome(
        campaign=found["candidates"],
        estimates=tuple(found["estimates"]),
        fits=tuple(fits),
        predictions=predictions,
        pooled=pooled_of(predictions),
        baselines=found["baselines"],
        compared=compare_with_baselines(found["baselines"], held_back_curves(predictions)),
        screened=screened,
        screening_cautions=tuple(cautions),
        summary={},
        cross_validation=current_cross_validation(found["candidates"], found["trials"]),
        **{name: found[name] for name in same},
    )
    summary = summarise(outcome)
    stored_summary(outcome.campaign, outcome.estimates).write(summary)
    return replace(outcome, summary=summary)


def summarise(outcome: Outcome) -> dict[str, Any]:
    """Coefficients of the chosen structure, probabilities, verdicts, warnings and the next trial, JSON-able, SI."""
    campaign, chosen, selection = outcome.campaign, outcome.chosen, outcome.selection
    alarms = [f"{estimate.structure.label}: {text}" for estimate in outcome.estimates for text in estimate.alarms]
    alarms += [] if outcome.cross_validation is None else outcome.cross_validation.alarms
    unseen = held_back_alarms(outcome.fits, outcome.pooled)
    alarms += [*selection.alarms, *comparison_alarms(outcome.compared), *unseen]
    records = [*outcome.trials.fit, *outcome.trials.predict]
    cautions = comparison_cautions(outcome.compared)
    cautions += [text for record in records for text in record_cautions(record)]
    cautions += outcome.screening_cautions
    cautions += [effect.sentence for effect in outcome.left_out]
    cautions += [*chosen.cautions, *fit_complaints(outcome.fits, outcome.pooled), *filter_complaints(outcome.filter)]
    cautions += held_back_cautions(campaign, outcome.trials)
    proposed = next_trial(outcome.next)
    return {
        "name": campaign.name,
        "chosen": chosen.structure.label,
        "terms": list(chosen.structure.terms),
        "coefficients": [_coefficient(chosen, name) for name in chosen.names],
        "structures": structure_rows(selection),
        "verdicts": list(selection.verdicts),
        "cautions": cautions,
        "alarms": alarms,
        "known": asdict(outcome.known),
        "fits": [fit.__dict__ for fit in outcome.fits],
        "pooled": [one.__dict__ for one in outcome.pooled],
        "baselines": [asdict(one) for one in outcome.compared],
        "next_trial": {**proposed, "words": MEND} if unseen else proposed,
    }


def next_trial(designs: Designs) -> dict[str, Any]:
    """The next trial in numbers, SI, and in words, in the units of the boundary."""
    sweep = designs.best
    row, column = sweep.best
    trial = {
        "family": sweep.family.kind,
        "control": sweep.family.control,
        "unit": signal_unit(sweep.family.control),
        "trim": sweep.family.trim,
        "amplitude": float(sweep.amplitude[row]),
        "period": float(sweep.period[column]),
        "gain_nat": float(sweep.gain[row, column]),
        "sd_before": dict(zip(designs.names, map(float, designs.sd_before), strict=True)),
        "sd_after": dict(zip(designs.names, map(float, sweep.final_sd[row, column]), strict=True)),
    }
    return {**trial, "words": next_words(trial, sweep.family)}


def next_words(trial: dict[str, Any], family: Family) -> str:
    """Say what to run next, or why not; takes the numbers of `next_trial`."""
    gain = trial["gain_nat"]
    if gain < ENOUGH:
        return (
            f"another {family.words} would teach little ({gain:.2f} nat): "
            "change the sensors, the limits or the manoeuvre instead"
        )
    promise = ", ".join(
        f"{name} from {sd:.3g} to {trial['sd_after'][name]:.3g}" for name, sd in trial["sd_before"].items()
    )
    return (
        f"run a {design_words(family, trial['amplitude'], trial['period'])}: expected to reduce the entropy of the "
        f"coefficients by {gain:.2f} nat; standard deviations {promise}"
    )


def _coefficient(estimate: Estimate, name: str) -> dict[str, Any]:
    from arviz_stats.base.array import array_stats

    row = estimate.data.sel(parameter=name)
    draws = np.sort(estimate.draws([name])[:, 0])
    lower, upper = array_stats.hdi(draws, prob=0.95)
    numbers = {
        key: float(row[key])
        for key in ("mean", "sd", "mcse", "mode", "prior_mean", "prior_sd", "r_hat", "ess_bulk", "ess_tail", "geweke")
    }
    return {
        "name": name,
        "unit": str(row["unit"].values),
        "label": str(row["label"].values),
        **numbers,
        "model_error_sd": estimate.wider(name),
        "lower_95": float(lower),
        "upper_95": float(upper),
    }
