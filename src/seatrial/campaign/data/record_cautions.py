"""What a user must know about a record before believing what is fitted to it."""

from seatrial.core.display_units import shown_unit
from seatrial.core.record import SIMULATED, Record


def record_cautions(record: Record) -> list[str]:
    """Holes in its channels, and controls of whole real trials that never move, in words."""
    whole = record.provenance.source != SIMULATED and "piece" not in record.provenance.options
    said = [f"run {record.label}, {text}" for text in record.provenance.options.get("cautions", [])]
    for name in record.controls if whole else ():
        column = record.channel(name)
        if column.min() == column.max():
            factor, unit = shown_unit(name)
            said.append(
                f'run {record.label}, channel "{name}": {column[0] * factor:g} {unit} in every sample; a control that never '
                "moves excites nothing: check its column in the channel map"
            )
    return said
