"""The whole loop, and its page."""

from typing import Annotated, Any

import typer

from seatrial.apps.running import Answer, Exit, Folder, Quiet, with_campaign


def report(context: typer.Context, folder: Folder, quiet: Quiet = False) -> None:
    """Write report.html from the results; whatever is missing is computed first."""

    def work(campaign: Any, reporter: Any, answer: Answer) -> Exit:
        from seatrial.campaign.workflow.loop import run_loop
        from seatrial.campaign.workflow.next_trial import propose

        outcome = run_loop(campaign, reporter)
        return _tell_and_report(answer, outcome, propose(outcome))

    with_campaign(folder, quiet, work, context, also="run")


def run(context: typer.Context, folder: Folder, quiet: Quiet = False) -> None:
    """Run the whole loop, resuming where it stopped, and write report.html; simulated trials go on to the goal."""

    def work(campaign: Any, reporter: Any, answer: Answer) -> Exit:
        from seatrial.campaign.workflow.loop import run_sequence

        return _tell_and_report(answer, *run_sequence(campaign, reporter))

    with_campaign(folder, quiet, work, context)


def next_trial(
    context: typer.Context,
    folder: Folder,
    execute: Annotated[
        bool, typer.Option("--run", help="Run the proposed trial on the simulated vehicle, and propose again.")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Say which trial to run next and what it promises, or why to stop."""

    def work(campaign: Any, reporter: Any, answer: Answer) -> Exit:
        from seatrial.campaign.data.simulate import add_trial, check_simulated
        from seatrial.campaign.design.schedule import write_schedule
        from seatrial.campaign.store.stored_result import Store
        from seatrial.campaign.workflow.loop import run_loop
        from seatrial.campaign.workflow.next_trial import propose

        if execute:
            check_simulated(campaign)
        outcome = run_loop(campaign, reporter)
        proposal = propose(outcome)
        if execute and proposal.trial is not None:
            answer.say("\n".join(proposal.lines))
            add_trial(campaign, proposal.trial)
            outcome = run_loop(campaign, reporter)
            proposal = propose(outcome)
        answer.say("\n".join(proposal.lines))
        if proposal.trial is not None:
            manoeuvre = proposal.trial.manoeuvre(campaign.families)
            path = write_schedule(Store(folder).proposed, manoeuvre, campaign.family.sample_time)
            answer.say(f"schedule: {path}")
        return answer.finish(outcome.summary["alarms"], outcome.summary["cautions"])

    with_campaign(folder, quiet, work, context if not execute else None)


def _tell_and_report(answer: Answer, outcome: Any, proposal: Any) -> Exit:
    from seatrial.campaign.inference.baselines import comparison_lines
    from seatrial.report.page import write_report

    summary = outcome.summary
    for row in summary["coefficients"]:
        answer.say(f"  {row['name']:<16} {row['mean']:>12.5g} ± {row['sd']:<10.3g} {row['unit']}")
    for fit in outcome.fits:
        answer.say(f"  {_said_of(fit)}")
    for one in outcome.pooled:
        answer.say(f"  held-back runs together: {one.level}; {one.reason}")
    for line in comparison_lines(outcome.baselines, outcome.compared):
        answer.say(f"  {line}")
    for verdict in summary["verdicts"]:
        answer.say(verdict)
    for line in proposal.lines:
        answer.say(f"next: {line}")
    answer.say(f"report: {write_report(outcome)}")
    told = [*(one.reason for one in (*outcome.fits, *outcome.pooled)), *(one.sentence for one in outcome.compared)]
    told += ["; ".join(fit.outside) for fit in outcome.fits if fit.outside]
    return answer.finish(
        summary["alarms"], [text for text in summary["cautions"] if not any(reason in text for reason in told)]
    )


def _said_of(fit: Any) -> str:
    """One channel of one trial: how it was predicted, the verdict, and what keeps it from passing."""
    use = "held-back run" if fit.held_back else "run"
    return f"{use} {fit.record}: {fit.level}, {fit.words}"
