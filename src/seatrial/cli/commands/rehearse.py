"""Before the campaign: how many trials its goal will take, and what redesigning each trial saves."""

from typing import Annotated, Any

import typer

from seatrial.cli import results
from seatrial.cli.running import Answer, Exit, Folder, Quiet, with_campaign


def rehearse(
    context: typer.Context,
    folder: Folder,
    truths: Annotated[
        int, typer.Option(min=2, max=10_000, help="Number of vehicles that are drawn from the priors and identified.")
    ] = 20,
    quiet: Quiet = False,
) -> None:
    """Simulate how many trials the goal needs.

    Trials of each vehicle are simulated until the goal is met: each designed from the ones before, one repeated, and random ones.
    """

    def work(campaign: Any, reporter: Any, answer: Answer) -> Exit:
        from seatrial.campaign.workflow.steps import Workflow
        from seatrial.report.figure_files import write_rehearsal_picture

        found = Workflow(campaign, reporter, vehicles=truths).get("rehearsal")
        answer.say("\n".join(found.lines()))
        answer.give(**results.rehearsal(found))
        answer.wrote("picture", write_rehearsal_picture(campaign, found))
        return answer.finish(found.alarms(), [])

    with_campaign(folder, quiet, work, context)
