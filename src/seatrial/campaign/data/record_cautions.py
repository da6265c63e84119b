"""What a user must know about a record before believing what is fitted to it."""

from collections.abc import Collection

from seatrial.core.findings import Finding, Message
from seatrial.core.record import SIMULATED, Record
from seatrial.core.signals import RATES
from seatrial.logs.log_table import LOOKS_MEASURED
from seatrial.vehicles.model import VehicleModel


def record_cautions(record: Record, computed: Collection[str] = ()) -> list[Message]:
    """Return the holes in its channels, and the controls of whole real trials that never move.

    Args:
        record: a record.
        computed: controls that are computed from the motion: they change at each sample, and are commands all the same.
    """
    whole = record.provenance.source != SIMULATED and "piece" not in record.provenance.options
    commands = tuple(f'channel "{name}" of ' for name in computed)
    cautions: list[Message] = [
        f"run {record.label}, {text}"
        for text in record.cautions
        if not (text.startswith(commands) and LOOKS_MEASURED in text)
    ]
    for name in record.controls if whole else ():
        column = record.channel(name)
        if column.min() == column.max():
            values = {"value": float(column[0]), "run": record.label}
            cautions.append(Finding("control-constant", "caution", (name,), values, ("check-column",)))
    return cautions


def empty_cells(record: Record) -> list[Finding]:
    """Return of each column of a log in how many rows it is empty or NaN; of a record in pieces with the first."""
    options = record.provenance.options
    if options.get("piece", [0.0])[0] > 0:
        return []
    return [
        Finding(
            "cells-empty",
            "note",
            (name,),
            {
                "count": count,
                "rows": rows,
                "source": file["source"],
                "column": file["channels"][name]["column"],
                "role": file["channels"][name]["role"],
            },
        )
        for file in options.get("files", ())
        for name, (count, rows) in file.get("empty", {}).items()
    ]


def unused_channels(channels: tuple[str, ...], model: VehicleModel, record: Record) -> list[Finding]:
    """Return the velocities that a log gives, and neither a sensor of the campaign nor its model, if they are given, uses.

    Args:
        channels: that are measured.
        model: vehicle, of all terms that any structure may have.
        record: of logs.
    """
    used = {*channels, *model.controls}
    mapped = [name for file in record.provenance.options.get("files", ()) for name in file["channels"]]
    return [
        Finding("channel-unused", "caution", (name,), {}, ("add-sensor",))
        for name in mapped
        if name in RATES and name not in used
    ]
