"""Commands that check: records, the tuning of the filter, and the calibration of the stated uncertainty."""

from typing import Annotated, Any

import typer

from seatrial.cli.running import Answer, Exit, Folder, Quiet, of_campaign, with_campaign
from seatrial.sampling.names import DEFAULT, METHODS


@of_campaign
def check(campaign: Any, reporter: Any, answer: Answer) -> Exit:
    """Check records for wrong signs, units, delays and outliers.

    It also lists the terms that each record can determine, and writes a plot of the raw signals.
    """
    if not campaign.has_records:
        return _say_what_is_missing(campaign, answer)
    from seatrial.campaign.data.check import check_records, summary_line
    from seatrial.campaign.data.thruster_check import thruster_lines
    from seatrial.campaign.prior.cautions import vehicle_cautions
    from seatrial.campaign.workflow.steps import Workflow
    from seatrial.messages.render import row_of, sentences
    from seatrial.report.figure_files import write_check_picture

    trials = Workflow(campaign, reporter).get("trials")
    pictures = [write_check_picture(campaign.folder, record) for record in (*trials.fit, *trials.predict)]
    if lines := thruster_lines(campaign.vehicle, campaign.channels):
        answer.say("\n".join(lines))
    judged = check_records(campaign, trials)
    for one, picture in zip(judged, pictures, strict=True):
        answer.say("\n".join(one.lines()))
        answer.say(f"  raw plot: {picture}")
        answer.name_file(f"raw plot of {one.record.label}", picture)
    answer.say(summary_line(judged))
    answer.give(
        records=[
            {
                "label": one.record.label,
                "level": one.level,
                "findings": list(map(row_of, one.findings)),
                "cautions": sentences(one.cautions),
            }
            for one in judged
        ]
    )
    for text in vehicle_cautions(campaign):
        answer.caution(text)
    return Exit.ALARMS if any(one.level == "alarm" for one in judged) else Exit.OK


def _say_what_is_missing(campaign: Any, answer: Answer) -> Exit:
    """Print that the file of a campaign without a record is valid, whether it is designed, and its next step."""
    from seatrial.campaign.data.no_record import no_record
    from seatrial.campaign.prior.cautions import file_cautions
    from seatrial.campaign.workflow.status import standing

    answer.say(f"{campaign.path} is valid; there is no record to check yet")
    design, records, *_ = standing(campaign.folder)
    answer.say(f"  {design.name}: {design.state}; {records.name}: {records.state}")
    answer.say(f"next step: {no_record(campaign).remedy}")
    answer.give(records=[])
    return answer.finish([], file_cautions(campaign))


@of_campaign
def tuning(campaign: Any, reporter: Any, answer: Answer) -> Exit:
    """Check the tuning of the filter, and recommend changes.

    P is the uncertainty at the start, Q the process noise, R the noise of the sensors.
    """
    from seatrial.campaign.inference.filter_tuning import WHERE, check_filter
    from seatrial.campaign.workflow.steps import Workflow
    from seatrial.messages.render import row_of

    flow = Workflow(campaign, reporter)
    checks = check_filter(campaign, flow.get("full"), flow.get("trials"))
    for check in checks:
        answer.say(f"record {check.record.label}")
        answer.say("\n".join(check.lines()))
    answer.say(WHERE)
    answer.give(
        records=[
            {
                "record": one.record.label,
                "nis": one.report.nis,
                "nis_band": one.report.nis_band,
                "changes": list(map(row_of, one.report.findings)),
            }
            for one in checks
        ]
    )
    return Exit.OK if all(check.tuned for check in checks) else Exit.ALARMS


def calibrate(
    context: typer.Context,
    folder: Folder,
    replicates: Annotated[int, typer.Option(min=20, max=100_000, help="Number of simulated records.")] = 400,
    method: Annotated[str, typer.Option(help=f"{', '.join(METHODS[:-1])} or {METHODS[-1]}.")] = DEFAULT,
    quiet: Quiet = False,
) -> None:
    """Test the stated uncertainty on simulated records.

    True values are drawn from the priors, records are simulated and estimated, and the rank of each true value is counted.
    """

    def work(campaign: Any, reporter: Any, answer: Answer) -> Exit:
        from seatrial.campaign.workflow.steps import Workflow
        from seatrial.campaign.workflow.whole_run import timed
        from seatrial.messages.predictions import calibration_report
        from seatrial.report.figure_files import write_calibration_picture

        flow = Workflow(campaign, reporter, replicates=replicates, method=method)
        with timed(flow, reporter, "calibration", of=f"{replicates} {method}"):
            result = flow.get("calibration")
        answer.say("\n".join(calibration_report(result)))
        answer.give(
            structure=result.structure,
            method=result.method,
            replicates=result.ranks.shape[0],
            outside=result.outside(),
            p_values=dict(zip(result.names, result.p_values(), strict=True)),
        )
        answer.wrote("picture", write_calibration_picture(campaign.folder, campaign.name, result))
        return Exit.ALARMS if result.outside() else Exit.OK

    with_campaign(folder, quiet, work, context)
