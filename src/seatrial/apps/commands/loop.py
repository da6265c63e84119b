"""The whole loop, and its page."""

from typing import Any

import typer

from seatrial.apps.running import Exit, Folder, Quiet, finish, with_campaign


def report(folder: Folder, quiet: Quiet = False) -> None:
    """Write report.html from the results; whatever is missing is computed first."""
    with_campaign(folder, quiet, _run_and_report)


def run(folder: Folder, quiet: Quiet = False) -> None:
    """Run the whole loop, resuming where it stopped, and write report.html."""
    with_campaign(folder, quiet, _run_and_report)


def _run_and_report(campaign: Any, watch: Any) -> Exit:
    from seatrial.campaign.loop import run_loop
    from seatrial.report.page import write_report

    outcome = run_loop(campaign, watch)
    summary = outcome.summary
    for row in summary["coefficients"]:
        typer.echo(f"  {row['name']:<16} {row['mean']:>12.5g} ± {row['sd']:<10.3g} {row['unit']}")
    for fit in outcome.fits:
        typer.echo(f"  {_said_of(fit)}")
    for verdict in summary["verdicts"]:
        typer.echo(verdict)
    typer.echo(f"next: {summary['next_trial']['words']}")
    typer.echo(f"report: {write_report(outcome)}")
    told = [fit.reason for fit in outcome.fits]
    return finish(
        summary["alarms"], [text for text in summary["cautions"] if not any(reason in text for reason in told)]
    )


def _said_of(fit: Any) -> str:
    """One channel of one trial: how it was predicted, the verdict, and what keeps it from passing."""
    use = "held-back run" if fit.held_back else "run"
    share = (
        "" if fit.missing or not fit.samples else f", {fit.explained:.0%} of the variance of {fit.channel} explained"
    )
    return f"{use} {fit.record}: {fit.level}{share}" + ("" if fit.level == "pass" else f"; {fit.reason}")
