"""Which structure, and which model of the error, predicts runs that were left out."""

from typing import Any

import typer

from seatrial.cli import results
from seatrial.cli.running import Answer, Exit, Folder, Quiet, with_campaign


def crossvalidate(context: typer.Context, folder: Folder, quiet: Quiet = False) -> None:
    """Predict each fitted run from the others, by each model."""

    def work(campaign: Any, reporter: Any, answer: Answer) -> Exit:
        from seatrial.campaign.workflow.steps import Workflow

        result = Workflow(campaign, reporter).get("cross_validation")
        answer.say("\n".join(result.lines()))
        answer.give(**results.cross_validated(result))
        return answer.finish(result.alarms, result.complaints())

    with_campaign(folder, quiet, work, context)
