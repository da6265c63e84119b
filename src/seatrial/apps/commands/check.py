"""Whether it may be believed: the filter's tuning, and the calibration of the stated uncertainty."""

from typing import Annotated, Any

import typer

from seatrial.apps.running import Answer, Exit, Folder, Quiet, with_campaign
from seatrial.sampling.names import DEFAULT, METHODS


def check(context: typer.Context, folder: Folder, quiet: Quiet = False) -> None:
    """Judge the records: direction, size, delay, outliers, and what each can tell; raw plots are always written."""

    def work(campaign: Any, reporter: Any, answer: Answer) -> Exit:
        if not campaign.has_records:
            return _say_what_is_missing(campaign, answer)
        from seatrial.campaign.data.check import check_records
        from seatrial.campaign.workflow.steps import Workflow
        from seatrial.report.figure_files import write_check_picture

        trials = Workflow(campaign, reporter).get("trials")
        pictures = [write_check_picture(campaign.folder, record) for record in (*trials.fit, *trials.predict)]
        judged = check_records(campaign, trials)
        for one, picture in zip(judged, pictures, strict=True):
            answer.say("\n".join(one.lines()))
            answer.say(f"  raw plot: {picture}")
        return Exit.ALARMS if any(one.level == "fail" for one in judged) else Exit.OK

    with_campaign(folder, quiet, work, context)


def _say_what_is_missing(campaign: Any, answer: Answer) -> Exit:
    """Of a campaign without a record: that its file can be used, whether it is designed, and how it goes on."""
    from seatrial.campaign.data.simulate import no_record
    from seatrial.campaign.workflow.status import standing

    answer.say(f"{campaign.path} can be used; there is no record to judge yet")
    design, records, *_ = standing(campaign.folder)
    answer.say(f"  {design.name}: {design.state}; {records.name}: {records.state}")
    answer.say(f"to go on: {no_record(campaign).remedy}")
    return Exit.OK


def tuning(context: typer.Context, folder: Folder, quiet: Quiet = False) -> None:
    """Check the tuning of the filter along each fitted record, and say which of P, Q and R to change."""

    def work(campaign: Any, reporter: Any, answer: Answer) -> Exit:
        from seatrial.campaign.inference.filter_tuning import WHERE, check_filter
        from seatrial.campaign.workflow.steps import Workflow

        flow = Workflow(campaign, reporter)
        checks = check_filter(campaign, flow.get("full"), flow.get("trials"))
        for check in checks:
            answer.say(f"record {check.record.label}")
            answer.say("\n".join(check.lines()))
        answer.say(WHERE)
        return Exit.OK if all(check.tuned for check in checks) else Exit.ALARMS

    with_campaign(folder, quiet, work, context)


def calibrate(
    context: typer.Context,
    folder: Folder,
    replicates: Annotated[
        int, typer.Option(min=20, max=100_000, help="How many truths are drawn and found again.")
    ] = 400,
    method: Annotated[
        str,
        typer.Option(help=f"{', '.join(METHODS[:-1])} or {METHODS[-1]}."),
    ] = DEFAULT,
    quiet: Quiet = False,
) -> None:
    """Check that stated uncertainty is right: truths from the priors, data from them, and their ranks in the posteriors."""

    def work(campaign: Any, reporter: Any, answer: Answer) -> Exit:
        from seatrial.campaign.workflow.steps import Workflow
        from seatrial.report.figure_files import write_calibration_picture

        found = Workflow(campaign, reporter, replicates=replicates, method=method).get("calibration")
        answer.say("\n".join(found.lines()))
        answer.say(f"picture: {write_calibration_picture(campaign.folder, campaign.name, found)}")
        return Exit.ALARMS if found.calibration.outside() else Exit.OK

    with_campaign(folder, quiet, work, context)
