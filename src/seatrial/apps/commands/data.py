"""The trial's records: simulated, or read from logs."""

from typing import Any

import typer

from seatrial.apps.running import Exit, Folder, Quiet, with_campaign


def simulate(folder: Folder, quiet: Quiet = False) -> None:
    """Run the trials that were decided on the simulated vehicle, the designed one first."""

    def work(campaign: Any, watch: Any) -> Exit:
        from seatrial.campaign.trials import simulate_trials

        return _say_trials(simulate_trials(campaign, watch))

    with_campaign(folder, quiet, work)


def import_logs(folder: Folder, quiet: Quiet = False) -> None:
    """Read real logs into records, by the campaign's channel map."""

    def work(campaign: Any, watch: Any) -> Exit:
        from seatrial.campaign.trials import import_trials

        return _say_trials(import_trials(campaign, watch))

    with_campaign(folder, quiet, work)


def _say_trials(trials: Any) -> Exit:
    from seatrial.campaign.record_checks import record_cautions

    for record in (*trials.fit, *trials.predict):
        channels = f"{', '.join(record.controls)} -> {', '.join(record.measured)}"
        typer.echo(f"record {record.label}: {record.time.size} samples over {record.time[-1]:.1f} s; {channels}")
        for text in record_cautions(record):
            typer.echo(f"caution: {text}", err=True)
    return Exit.OK
