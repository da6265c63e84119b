"""Channels that the model and the sensors of a campaign need of its logs, and that no column of the map gives."""

from seatrial.campaign.config.autopilot_table import AutopilotSettings
from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.import_table import ImportTable
from seatrial.core.errors import InputError
from seatrial.core.signals import ANGLES, OVER_EARTH, QUATERNION


def unmapped(campaign: Campaign) -> dict[str, str]:
    """Return the channels that are needed and not mapped, each with the reason; none of a campaign that imports nothing.

    What is made of other columns needs none of its own: velocities along the body of those over the earth, angles of a quaternion and the
    reverse, controls of the set-points of their autopilot.
    """
    if campaign.imports is None:
        return {}
    given = {run: _given(campaign.autopilot, campaign.imports, run) for run in campaign.imports.runs}
    driving = dict.fromkeys(campaign.model(campaign.full).controls, "is an input of the model")
    needed = driving | dict.fromkeys(campaign.channels, "is in [sensors]; remove it there if you have none")
    missing = {name: [run for run, names in given.items() if name not in names] for name in needed}
    return {
        name: needed[name] + ("" if len(runs) == len(given) else f", for run {', '.join(runs)}")
        for name, runs in missing.items()
        if runs
    }


def check_mapped(campaign: Campaign) -> None:
    """Refuse logs without a channel that every estimate needs.

    Raises:
        InputError: a control or a channel of a sensor that no column gives.
    """
    missing = unmapped(campaign)
    if missing:
        raise InputError(
            campaign.where("import.files"),
            found="no column for " + ", ".join(missing),
            expected="a column for " + "; ".join(f"{name}, which {why}" for name, why in missing.items()),
            remedy="map each under `channels` of the file that has it",
        )


def _given(autopilot: AutopilotSettings, imports: ImportTable, run: str) -> set[str]:
    """Return the channels that the record of a run has after the import."""
    given = {name for file in imports.of(run).values() for name in file.channels}
    for some, others in ((QUATERNION, ANGLES), (ANGLES, QUATERNION)):
        if given >= {*some}:
            given |= {*others}
    if "psi" in given and given >= {*OVER_EARTH[:2]}:
        given |= {"u", "v", "w"} if OVER_EARTH[2] in given else {"u", "v"}
    if autopilot.loops and given >= {*autopilot.trim}:
        given |= {*autopilot.moved}
    return given
