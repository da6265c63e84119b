"""What a user must know about a record before believing what is fitted to it."""

from collections.abc import Collection

from seatrial.campaign.config.campaign import Campaign
from seatrial.core.display_units import shown_unit
from seatrial.core.record import SIMULATED, Record
from seatrial.core.signals import RATES
from seatrial.estimation.diagnostics.record_checks import RecordFinding
from seatrial.logs.log_table import LOOKS_MEASURED

_DONE = {"control": "each holds the value before it", "measurement": "they are left out; the other rows are used"}
"""What is done with empty cells, by the role of their channel."""


def record_cautions(record: Record, computed: Collection[str] = ()) -> list[str]:
    """Return the holes in its channels, and the controls of whole real trials that never move, in words.

    Args:
        record: a record.
        computed: controls that are computed from the motion: they change at each sample, and are commands all the same.
    """
    whole = record.provenance.source != SIMULATED and "piece" not in record.provenance.options
    commands = tuple(f'channel "{name}" of ' for name in computed)
    said = [
        f"run {record.label}, {text}"
        for text in record.cautions
        if not (text.startswith(commands) and LOOKS_MEASURED in text)
    ]
    for name in record.controls if whole else ():
        column = record.channel(name)
        if column.min() == column.max():
            factor, unit = shown_unit(name)
            said.append(
                f'run {record.label}, channel "{name}": {column[0] * factor:g} {unit} in every sample; a control that never '
                "moves excites nothing: check its column in the channel map"
            )
    return said


def empty_cells(record: Record) -> list[RecordFinding]:
    """Say of each column of a log in how many rows it is empty or NaN, and what is done with them; of a record in pieces with the first."""
    options = record.provenance.options
    if options.get("piece", [0.0])[0] > 0:
        return []
    return [
        RecordFinding(
            name,
            "empty cells",
            "note",
            f'{count} of {rows} rows of {file["source"]}, column "{file["channels"][name]["column"]}", are empty or NaN',
            _DONE[file["channels"][name]["role"]],
        )
        for file in options.get("files", ())
        for name, (count, rows) in file.get("empty", {}).items()
    ]


def unused_channels(campaign: Campaign, record: Record) -> list[RecordFinding]:
    """Say which velocities a log gives, and neither a sensor of the campaign nor its model, where they are given, uses.

    Args:
        campaign: the campaign.
        record: of logs.
    """
    used = {*campaign.channels, *campaign.model(campaign.full).controls}
    mapped = [name for file in record.provenance.options.get("files", ()) for name in file["channels"]]
    return [
        RecordFinding(
            name,
            "sensor",
            "caution",
            f"channel {name} is mapped but has no [sensors.{name}]; it is not used",
            "a channel is used if it has a sensor",
            f"add [sensors.{name}] with its noise, or take {name} out of the channel map",
        )
        for name in mapped
        if name in RATES and name not in used
    ]
