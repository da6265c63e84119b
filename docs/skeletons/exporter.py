"""Skeleton of an exporter: copy to `src/seatrial/export/targets/`, and add it to `EXPORTERS` of `export/write.py`.

In another package, name its class in an entry point instead: in its pyproject.toml, under
`[project.entry-points."seatrial.exporters"]`, `plain = "package.module:PlainText"`. `seatrial export DIR --to plain` then finds it.

This one writes every coefficient with its unit, a line each.
"""

from dataclasses import dataclass

from seatrial.export.motion import motion_of
from seatrial.export.target import Carried, Exporter, Statement
from seatrial.export.vehicle import ExportedVehicle


@dataclass(frozen=True)
class PlainText(Exporter):
    """Its fields beside the name and the target are options of the command line."""

    name: str = "plain"
    target: str = "plain text of coefficients 1.0"

    def check(self, vehicle: ExportedVehicle) -> None:
        """See `Exporter`: refuse what the target cannot hold, beside what no simulator survives."""
        super().check(vehicle)

    def carries(self, vehicle: ExportedVehicle) -> Carried:
        """See `Exporter`: the motion in the target, what is lost, and what is carried in another form."""
        return Carried(motion_of(vehicle), actuators=vehicle.actuators)

    def write(self, vehicle: ExportedVehicle, statement: Statement) -> dict[str, str]:
        """See `Exporter`: texts by file name, each of which repeats the statement."""
        head = [f"# {line}" for line in statement.lines]
        rows = [f"{name} = {value!r} {vehicle.unit(name)}" for name, value in vehicle.coefficients.items()]
        return {"vehicle.txt": "\n".join([*head, *rows, ""])}
