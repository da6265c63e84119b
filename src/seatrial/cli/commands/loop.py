"""The whole loop, and its page."""

from enum import StrEnum
from functools import partial
from typing import Annotated, Any, NamedTuple

import typer

from seatrial.cli.running import Answer, Exit, Folder, Quiet, of_campaign, with_campaign


class NextBy(StrEnum):
    """The posterior from which a next trial is designed."""

    CHAINS = "chains"
    MODE = "mode"


@partial(of_campaign, also="run")
def report(campaign: Any, reporter: Any, answer: Answer) -> Exit:
    """Write report.html; compute missing results first.

    After `estimate --by mode` it reports the posterior mode, and does not start the chains.
    """
    from seatrial.campaign.workflow.loop import run_loop
    from seatrial.campaign.workflow.next_trial import propose

    if remedy := _chains_unasked(campaign):
        return _report_of_mode(campaign, reporter, answer, remedy)
    outcome = run_loop(campaign, reporter)
    return _tell_and_report(answer, outcome, propose(outcome))


def _report_of_mode(campaign: Any, reporter: Any, answer: Answer, remedy: str) -> Exit:
    """Write the report of the posterior mode, marked as a first answer."""
    from seatrial.campaign.inference.quick_estimates import MODE, posterior_modes
    from seatrial.campaign.workflow.first_outcome import first_outcome
    from seatrial.campaign.workflow.steps import Workflow
    from seatrial.report.page import write_report

    flow = Workflow(campaign, reporter)
    trials, campaign = flow.get("trials"), flow.get("candidates")
    outcome = first_outcome(
        campaign, trials, posterior_modes(campaign, trials, reporter), flow.get("baselines"), remedy
    )
    answer.say(MODE)
    answer.say(remedy)
    answer.wrote("report", write_report(outcome))
    answer.give_findings(outcome.summary.findings)
    return answer.finish(outcome.summary.alarms, outcome.summary.cautions)


def _chains_unasked(campaign: Any) -> str:
    """Return the command for the whole posterior, and its time, if the user has asked only for the posterior mode; or empty."""
    from seatrial.campaign.store.stored_result import Store
    from seatrial.campaign.workflow.steps import LOOP, Workflow
    from seatrial.campaign.workflow.whole_run import expected_seconds, size_of
    from seatrial.core.reporter import duration_text

    flow, folder = Workflow(campaign), campaign.folder
    if not Store(folder).mode.is_file() or flow.state("estimates") == "current" or flow.state("trials") != "current":
        return ""
    missing = [step.name for step in LOOP if step.files and flow.state(step.name) != "current"]
    seconds = sum(expected_seconds(missing, size_of(flow.get("candidates"), flow.get("trials"))).values())
    words = f"`seatrial run {folder}` samples the whole posterior, compares the models and writes the report"
    if campaign.is_simulated and campaign.goal is not None:  # that would run further trials too
        words = f"`seatrial estimate {folder}` samples the whole posterior and `seatrial report {folder}` then writes the report"
    return f"{words}, in about {duration_text(seconds)} by the size of the records and earlier times on this machine"


@of_campaign
def run(campaign: Any, reporter: Any, answer: Answer) -> Exit:
    """Run the whole loop and write report.html.

    After an interruption it continues. On a simulated vehicle it runs trial after trial until the goal is met.
    """
    from seatrial.campaign.workflow.loop import run_sequence
    from seatrial.campaign.workflow.steps import Workflow
    from seatrial.campaign.workflow.whole_run import timed

    with timed(Workflow(campaign), reporter, "estimates", of="and the rest"):
        results = run_sequence(campaign, reporter)
    return _tell_and_report(answer, *results)


def next_trial(
    context: typer.Context,
    folder: Folder,
    execute: Annotated[
        bool, typer.Option("--run", help="Run the proposed trial on the simulated vehicle, and propose again.")
    ] = False,
    by: Annotated[
        NextBy,
        typer.Option(help="chains: run the whole loop. mode: answer quickly from the posterior mode, without chains."),
    ] = NextBy.CHAINS,
    quiet: Quiet = False,
) -> None:
    """Recommend the next trial, or to stop."""

    def work(campaign: Any, reporter: Any, answer: Answer) -> Exit:
        from seatrial.campaign.data.simulate import add_trial, check_simulated
        from seatrial.campaign.design.schedule import commands_of, write_schedule
        from seatrial.campaign.store.stored_result import Store

        if execute:
            check_simulated(campaign)
        _ = campaign.design  # fails before the loop if there is none
        look = _by_loop if by is NextBy.CHAINS else _by_mode
        result = look(campaign, reporter)
        if execute and result.proposal.trial is not None:
            answer.say("\n".join(result.proposal.lines))
            add_trial(campaign, result.proposal.trial)
            result = look(campaign, reporter)
        proposal = result.proposal
        answer.say("\n".join(proposal.lines))
        if proposal.trial is not None:
            manoeuvre = proposal.trial.manoeuvre(campaign.families)
            path = write_schedule(
                Store(folder).proposed, manoeuvre, campaign.family.sample_time, commands=commands_of(campaign)
            )
            answer.wrote("schedule", path)
        if result.own is not None:
            answer.say("\n".join(result.own.lines(campaign.shown)))
        trial = proposal.trial
        if trial is not None:
            sweep = next(one for one in result.designs.sweeps if one.family.kind == trial.kind)
            at = abs(sweep.amplitude - trial.amplitude).argmin(), abs(sweep.period - trial.period).argmin()
            trial = result.designs.design(sweep, at)
        answer.give(trial=trial, advice=proposal.words)
        return answer.finish(result.alarms, [*result.cautions, *(result.own.alarms if result.own else ())])

    with_campaign(folder, quiet, work, context if not execute else None)


class _Found(NamedTuple):
    """The next trial, the designs it was chosen from, the information of the campaign's schedule, alarms and cautions."""

    proposal: Any
    designs: Any
    own: Any
    alarms: list[str]
    cautions: list[str]


def _by_loop(campaign: Any, reporter: Any) -> _Found:
    """Propose by the whole loop."""
    from seatrial.campaign.design.searches import evaluate_schedule_after
    from seatrial.campaign.workflow.loop import run_loop
    from seatrial.campaign.workflow.next_trial import propose

    outcome = run_loop(campaign, reporter)
    own = evaluate_schedule_after(outcome.campaign, outcome.chosen, outcome.next) if outcome.next else None
    proposal = propose(outcome)
    wanted = outcome.undesigned and any(outcome.undesigned in line for line in proposal.advice)
    alarms = [*outcome.summary.alarms, *([outcome.undesigned] if wanted else [])]
    return _Found(proposal, outcome.next, own, alarms, outcome.summary.cautions)


def _by_mode(campaign: Any, reporter: Any) -> _Found:
    """Propose by the posterior mode of the most probable structure."""
    from seatrial.campaign.design.searches import evaluate_schedule_after
    from seatrial.campaign.design.sweep import design_next_by_mode
    from seatrial.campaign.inference.quick_estimates import MODE, best_mode, posterior_modes
    from seatrial.campaign.workflow.next_trial import propose_by_mode
    from seatrial.campaign.workflow.steps import Workflow

    flow = Workflow(campaign, reporter)
    trials, campaign = flow.get("trials"), flow.get("candidates")
    modes = posterior_modes(campaign, trials, reporter)
    first = best_mode(modes)
    designs = design_next_by_mode(campaign, first.drawn, reporter)
    proposal = propose_by_mode(campaign, first, designs, len(trials.fit))
    cautions = [MODE, *(text for one in modes for text in ([one.alarm] if one.alarm else one.cautions))]
    return _Found(proposal, designs, evaluate_schedule_after(campaign, first.drawn, designs), [], cautions)


def _tell_and_report(answer: Answer, outcome: Any, proposal: Any) -> Exit:
    from seatrial.campaign.inference.baselines import comparison_lines
    from seatrial.campaign.inference.coefficient_csv import write_coefficients, write_quote
    from seatrial.campaign.inference.judge_predictions import fit_complaints
    from seatrial.messages.effects import shares_text
    from seatrial.messages.predictions import comparison_text
    from seatrial.messages.render import sentence, sentences
    from seatrial.messages.structures import QUOTED
    from seatrial.messages.values import change_text, value_lines, value_text
    from seatrial.report.page import write_report

    summary = outcome.summary
    shown = outcome.campaign.shown
    values = {
        row.name: value_text(row.mean, row.sd, shown(row.name, row.unit), shares_text(row.shares, row.cause))
        for row in summary.quote
    }
    terms = {term for row in summary.structures for term in row.terms}
    answer.say("\n".join(f"  {line}" for line in value_lines(values, terms)))
    if not outcome.own_alarms:
        answer.say(f"  These are the values to quote: {QUOTED[summary.quoted]}.")
    answer.say(f"  {outcome.chosen.contains}")
    for change in summary.configuration_differences:
        answer.say(f"  {change_text(change, shown(change.name, change.unit))}")
    for finding in outcome.cause_findings:
        answer.say(f"  {sentence(finding)}")
    for fit in outcome.fits:
        use = "held-back run" if fit.held_back else "run"
        answer.say(f"  {use} {fit.record}: {fit.level}, {fit.finding}")
    for one in outcome.pooled:
        answer.say(f"  held-back runs together: {one.level}; {sentence(one.verdict)}")
    for line in comparison_lines(outcome.baselines, outcome.compared):
        answer.say(f"  {line}")
    for verdict in summary.verdicts:
        answer.say(verdict)
    for line in proposal.beside(summary.cautions).lines:
        answer.say(f"next: {line}")
    folder = outcome.campaign.folder
    answer.give_result(summary)
    answer.wrote("report", write_report(outcome))
    answer.wrote("coefficients", write_coefficients(folder, outcome.estimates, shown, outcome.selection))
    answer.wrote("quote", write_quote(folder, summary.quote, shown))
    words = sentences(fit_complaints([fit for fit in outcome.fits if not fit.advice], outcome.pooled))
    words += [comparison_text(one) for one in outcome.compared]
    answer.give_findings(summary.findings)
    return answer.finish(summary.alarms, [text for text in summary.cautions if text not in words])
