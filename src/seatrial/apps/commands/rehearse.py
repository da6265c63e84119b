"""Before the campaign: how many trials its goal will take, and what choosing each trial anew saves."""

from typing import Annotated, Any

import typer

from seatrial.apps.running import Answer, Exit, Folder, Quiet, with_campaign


def rehearse(
    context: typer.Context,
    folder: Folder,
    truths: Annotated[
        int, typer.Option(min=2, max=10_000, help="How many vehicles are drawn from the priors and identified.")
    ] = 20,
    quiet: Quiet = False,
) -> None:
    """Rehearse the campaign on simulated vehicles: trials until the goal is met, chosen anew, repeated or at random."""

    def work(campaign: Any, reporter: Any, answer: Answer) -> Exit:
        from seatrial.campaign.workflow.steps import Workflow
        from seatrial.report.figure_files import write_rehearsal_picture

        found = Workflow(campaign, reporter, vehicles=truths).get("rehearsal")
        answer.say("\n".join(found.lines()))
        answer.say(f"picture: {write_rehearsal_picture(campaign, found)}")
        return answer.finish(found.alarms(), [])

    with_campaign(folder, quiet, work, context)
