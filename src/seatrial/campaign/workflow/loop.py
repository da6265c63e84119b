"""The whole loop: design, simulate or import, estimate, select, and say what to run next; once, or trial after trial."""

from dataclasses import replace
from typing import cast

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.data.check import record_doubts
from seatrial.campaign.data.simulate import add_trial
from seatrial.campaign.inference.baselines import compare_with_baselines, comparison_cautions
from seatrial.campaign.inference.coefficient_csv import averaged_rows, quote_rows
from seatrial.campaign.inference.cross_validation import current_cross_validation
from seatrial.campaign.inference.filter_trace import filter_complaints
from seatrial.campaign.inference.judge_predictions import (
    fit_complaints,
    held_back_alarms,
    held_back_cautions,
    held_back_curves,
)
from seatrial.campaign.store.predictions import Predictions
from seatrial.campaign.store.stored_result import seal_of
from seatrial.campaign.store.summary import NextTrial, Summary
from seatrial.campaign.workflow.next_trial import Proposal, propose
from seatrial.campaign.workflow.outcome import Outcome
from seatrial.campaign.workflow.steps import LOOP, Workflow, stored_summary
from seatrial.campaign.workflow.whole_run import WholeRun, size_of
from seatrial.core.argument_checks import check_kind
from seatrial.core.errors import InputError
from seatrial.core.findings import Finding, Message, accept
from seatrial.core.reporter import SILENT, Reporter
from seatrial.estimation.simulation.sensor_errors import noise_name
from seatrial.messages.cross_validation import complaints
from seatrial.messages.known import known_cautions
from seatrial.messages.render import sentences
from seatrial.selection.cross_validation import advice_tried
from seatrial.selection.verdict import StoredAverage

OF_NEXT_TRIAL = ("next", "contenders")  # Steps without which all that was found so far still holds


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
    whole = WholeRun(reporter, [step.name for step in LOOP if step.files and standing.state(step.name) != "current"])
    flow, results, undesigned = Workflow(campaign, whole), {}, None
    with whole:
        for step in LOOP:
            whole.begin(step.name)
            try:
                results[step.name] = flow.get(step.name)
            except InputError as error:
                if step.name not in OF_NEXT_TRIAL:
                    raise
                results[step.name], undesigned = None, error
            whole.end()
            if step.name == "candidates":
                whole.resize(size_of(results["candidates"], results["trials"]))
    screened, cautions = results["screening"]
    predictions: Predictions = results["predictions"]
    same = ("trials", "selection", "chosen", "filter", "known", "promised", "first", "next", "contenders")
    outcome = Outcome(
        campaign=results["candidates"],
        estimates=tuple(results["estimates"]),
        fits=predictions.fits,
        predictions=predictions.data,
        pooled=predictions.pooled,
        disagreements=predictions.disagreements,
        baselines=results["baselines"],
        compared=compare_with_baselines(results["baselines"], held_back_curves(predictions)),
        screened=screened,
        screening_cautions=tuple(cautions),
        summary=cast(Summary, None),  # made below, of all the rest
        cross_validation=current_cross_validation(results["candidates"], results["trials"]),
        undesigned=f"{undesigned.where}: {undesigned.sentence()}" if undesigned else "",
        **{name: results[name] for name in same},
    )
    summary = summarise(outcome)
    outcome = replace(outcome, summary=summary)
    proposal = propose(outcome)
    words = "; ".join(proposal.beside(summary.cautions).words)
    next_trial = replace(summary.next_trial, words=words, stop=proposal.trial is None)
    outcome = replace(outcome, summary=replace(summary, next_trial=next_trial))
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


def summarise(outcome: Outcome, of_mode: tuple[StoredAverage, ...] = ()) -> Summary:
    """Summarise everything but the words about the next trial, which rest on the summary.

    Args:
        outcome: of the whole loop, or of a first answer.
        of_mode: the values of a first answer, which has no draws to take them from.
    """
    campaign, chosen, selection = outcome.campaign, outcome.chosen, outcome.selection
    records = [*outcome.trials.fit, *outcome.trials.predict]
    # In order of gravity: what touches the values that are printed, then the records, then what nothing rests on.
    # Every surface takes its cautions from here, so that one that prints none has none further down.
    failed, of_fits = held_back_alarms(outcome.fits, outcome.pooled), fit_complaints(outcome.fits, outcome.pooled)
    cautions: list[Message] = [*of_fits, *advice_tried([*failed, *of_fits], outcome.cross_validation)]
    cautions += comparison_cautions(outcome.compared)
    cautions += [*chosen.left_out, *chosen.cautions, *known_cautions(outcome.known)]
    cautions += selection.cautions
    cautions += outcome.disagreements
    if (contenders := outcome.contenders) is not None:
        cautions += contenders.disagreements(selection)
    cautions += [] if outcome.cross_validation is None else complaints(outcome.cross_validation)
    cautions += [text for record in records for text in record_doubts(campaign, record)]
    cautions += held_back_cautions(campaign.imports, outcome.trials)
    cautions += [] if of_mode else filter_complaints(outcome.filter, _fitted_noise(outcome))
    cautions += [*outcome.screening_cautions, *outcome.idle_complaints]
    findings = accept([*failed, *(one for one in cautions if isinstance(one, Finding))], campaign.accepted)
    cautions = [one for one in cautions if not (isinstance(one, Finding) and one.code in campaign.accepted)]
    averages = () if of_mode else averaged_rows(outcome.estimates, selection)
    coefficients = () if of_mode else chosen.parameters
    return Summary(
        name=campaign.name,
        chosen=chosen.structure.label,
        terms=chosen.structure.terms,
        coefficients=coefficients,
        structures=selection.rows,
        inclusion=selection.inclusion,
        inclusion_error=selection.inclusion_error,
        verdicts=selection.verdicts,
        cautions=tuple(sentences(cautions)),
        findings=tuple(findings),
        alarms=(*outcome.own_alarms, *outcome.other_alarms),
        choice_alarms=tuple(outcome.choice_alarms),
        usable=not outcome.own_alarms,
        known=outcome.known,
        fits=outcome.fits,
        pooled=outcome.pooled,
        baselines=outcome.compared,
        next_trial=NextTrial("", False, None if outcome.next is None else outcome.next.design(outcome.next.best)),
        averaged=averages,
        configuration_differences=chosen.configuration_differences,
        quoted=selection.quoted,
        quote=of_mode or quote_rows(selection.quoted, coefficients, averages),
    )


def _fitted_noise(outcome: Outcome) -> list[float]:
    """Return the noise of each sensor by the chosen structure's fit, over the nominal one, of those whose noise is fitted."""
    nominal, chosen = outcome.campaign.noise, outcome.chosen
    return [
        float(chosen.data.sel(parameter=noise_name(channel))["mean"]) / noise
        for channel, noise in nominal.items()
        if noise_name(channel) in chosen.names
    ]
