"""Writing an export: checked first, then every file whole, or none."""

from pathlib import Path

from seatrial.core.files import write_text
from seatrial.export.statement import state
from seatrial.export.target import Exporter, Statement
from seatrial.export.vehicle import ExportedVehicle, Provenance


def export_vehicle(
    exporter: Exporter, vehicle: ExportedVehicle, provenance: Provenance, folder: Path
) -> tuple[Statement, list[Path]]:
    """Write a vehicle's files into a folder; returns what they say of themselves, and their paths.

    Raises:
        InputError: a vehicle that the target cannot hold or would make unstable; nothing is written then.
    """
    exporter.check(vehicle)
    statement = state(exporter, vehicle, provenance)
    texts = exporter.write(vehicle, statement)
    for name, text in texts.items():
        write_text(folder / name, text)
    return statement, [folder / name for name in texts]
