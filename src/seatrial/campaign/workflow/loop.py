"""The whole loop: design, simulate or import, estimate, select, and say what to run next; once, or trial after trial."""

from dataclasses import asdict, replace
from math import isnan
from typing import Any

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.data.check import record_doubts
from seatrial.campaign.data.simulate import add_trial
from seatrial.campaign.design.sweep import Designs
from seatrial.campaign.inference.baselines import compare_with_baselines, comparison_cautions
from seatrial.campaign.inference.coefficient_csv import averaged_rows
from seatrial.campaign.inference.cross_validation import current_cross_validation
from seatrial.campaign.inference.filter_trace import filter_complaints
from seatrial.campaign.inference.judge_predictions import (
    fit_complaints,
    held_back_cautions,
    held_back_curves,
    pooled_of,
)
from seatrial.campaign.selection.evidence import structure_rows
from seatrial.campaign.store.estimates import Estimate
from seatrial.campaign.store.stored_result import seal_of
from seatrial.campaign.workflow.next_trial import Proposal, propose
from seatrial.campaign.workflow.outcome import Outcome
from seatrial.campaign.workflow.steps import LOOP, Workflow, stored_summary
from seatrial.campaign.workflow.whole_run import WholeRun, size_of
from seatrial.core.argument_checks import check_kind
from seatrial.core.errors import InputError
from seatrial.core.findings import Finding, Message, accept, encoded
from seatrial.core.reporter import SILENT, Reporter
from seatrial.core.signals import signal_unit
from seatrial.estimation.simulation.sensor_errors import noise_name
from seatrial.messages.render import sentences

OF_NEXT_TRIAL = ("next", "contenders")
"""Steps without which all that was found so far still holds."""


def run_loop(campaign: Campaign, reporter: Reporter = SILENT) -> Outcome:
    """Run every step that is not current, and summarise.

    Args:
        campaign: of `load_campaign`.
        reporter: told how far each step has come.

    Returns:
        the results of all steps, and a summary of them that is plain data in SI.

    Raises:
        InputError: as the steps. A next trial that no limit allows is none: what was found is kept, and `undesigned` says why.
    """
    check_kind(campaign, Campaign, "campaign", "read it with `load_campaign`")
    if campaign.trial_design is not None:
        campaign.control_trim(campaign.model(campaign.full))
    standing = Workflow(campaign)
    whole = WholeRun(reporter, [step.name for step in LOOP if step.stored and standing.state(step.name) != "current"])
    flow, found, undesigned = Workflow(campaign, whole), {}, None
    with whole:
        for step in LOOP:
            whole.begin(step.name)
            try:
                found[step.name] = flow.get(step.name)
            except InputError as error:
                if step.name not in OF_NEXT_TRIAL:
                    raise
                found[step.name], undesigned = None, error
            whole.end()
            if step.name == "candidates":
                whole.resize(size_of(found["candidates"], found["trials"]))
    screened, cautions = found["screening"]
    fits, predictions = found["predictions"]
    same = ("trials", "selection", "chosen", "filter", "known", "promised", "first", "next", "contenders")
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
        undesigned=f"{undesigned.where}: {undesigned.sentence()}" if undesigned else "",
        **{name: found[name] for name in same},
    )
    outcome = replace(outcome, summary=summarise(outcome))
    proposal = propose(outcome)
    outcome.summary["next_trial"] |= {
        "words": "; ".join(proposal.beside(outcome.summary["cautions"]).words),
        "stop": proposal.trial is None,
    }
    kept = stored_summary(Workflow(campaign))
    kept.write(outcome.summary)
    return replace(outcome, seal=seal_of(kept.path) or "")


def run_sequence(campaign: Campaign, reporter: Reporter = SILENT) -> tuple[Outcome, Proposal]:
    """Run the loop, and while it is a simulated campaign with a goal run what it proposes; a kill loses the work in flight.

    Returns:
        what was found after the last trial, and what to do next.
    """
    while True:
        outcome = run_loop(campaign, reporter)
        proposal = propose(outcome)
        goal = campaign.goal
        if not campaign.is_simulated or goal is None or proposal.trial is None:
            return outcome, proposal
        for line in proposal.lines:
            reporter.say(line)
        if len(outcome.trials.fit) >= goal.trials:
            end = f"stop: {goal.trials} trial{'s are' if goal.trials != 1 else ' is'} run, the most that [goal] allows"
            return outcome, Proposal(None, proposal.standing[:1], (end,))
        add_trial(campaign, proposal.trial)


def summarise(outcome: Outcome) -> dict[str, Any]:
    """Coefficients of the chosen structure, probabilities, verdicts, warnings and the numbers of the next trial, JSON-able, SI."""
    campaign, chosen, selection = outcome.campaign, outcome.chosen, outcome.selection
    records = [*outcome.trials.fit, *outcome.trials.predict]
    # In order of gravity: what touches the values that are printed, then the records, then what nothing rests on.
    # Every surface takes its cautions from here, so that one that prints none has none further down.
    cautions: list[Message] = [*fit_complaints(outcome.fits, outcome.pooled), *comparison_cautions(outcome.compared)]
    cautions += [*(effect.sentence for effect in chosen.left_out), *chosen.cautions, *outcome.known.cautions]
    cautions += selection.cautions
    cautions += [] if outcome.contenders is None else outcome.contenders.cautions(selection)
    cautions += [] if outcome.cross_validation is None else outcome.cross_validation.complaints()
    cautions += [text for record in records for text in record_doubts(campaign, record)]
    cautions += held_back_cautions(campaign, outcome.trials)
    cautions += filter_complaints(outcome.filter, _fitted_noise(outcome))
    cautions += [*outcome.screening_cautions, *outcome.idle_complaints]
    findings = accept((one for one in cautions if isinstance(one, Finding)), campaign.accepted)
    cautions = [one for one in cautions if not (isinstance(one, Finding) and one.code in campaign.accepted)]
    return {
        "name": campaign.name,
        "chosen": chosen.structure.label,
        "terms": list(chosen.structure.terms),
        "coefficients": [_coefficient(chosen, name) for name in chosen.names],
        "averaged": [_averaged(outcome, row) for row in averaged_rows(outcome.estimates, selection)],
        "quoted": selection.quoted,
        "structures": structure_rows(selection),
        "verdicts": list(selection.verdicts),
        "cautions": sentences(cautions),
        "alarms": [*outcome.own_alarms, *outcome.other_alarms],
        "findings": encoded(findings),
        "choice_alarms": outcome.choice_alarms,
        "usable": not outcome.own_alarms,
        "known": asdict(outcome.known),
        "fits": [fit.__dict__ for fit in outcome.fits],
        "pooled": [one.__dict__ for one in outcome.pooled],
        "baselines": [asdict(one) for one in outcome.compared],
        "next_trial": {"best": None if outcome.next is None else _best_design(outcome.next)},
    }


def _fitted_noise(outcome: Outcome) -> list[float]:
    """Return the noise of each sensor by the chosen structure's fit, over the nominal one, of those whose noise is fitted."""
    nominal, chosen = outcome.campaign.noise, outcome.chosen
    return [
        float(chosen.data.sel(parameter=noise_name(channel))["mean"]) / noise
        for channel, noise in nominal.items()
        if noise_name(channel) in chosen.names
    ]


def _best_design(designs: Designs) -> dict[str, Any]:
    """The best design of the next trial in numbers, SI."""
    sweep = designs.best
    row, column = sweep.best
    return {
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


def _averaged(outcome: Outcome, row: dict[str, Any]) -> dict[str, Any]:
    """Return a row of `averaged_rows` as the summary keeps it."""
    label = next(
        str(one.data.sel(parameter=row["name"])["label"].values)
        for one in outcome.estimates
        if row["name"] in one.names
    )
    wider = row["model_error_sd"]
    return {**row, "label": label, "model_error_sd": None if isnan(wider) else wider}


def _coefficient(estimate: Estimate, name: str) -> dict[str, Any]:
    row, (lower, upper) = estimate.data.sel(parameter=name), estimate.interval(name)
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
        "model_error_cause": estimate.wider_cause(name),
        "lower_95": lower,
        "upper_95": upper,
    }
