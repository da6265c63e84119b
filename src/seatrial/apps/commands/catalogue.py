"""The published vehicles: their names, and the page of one."""

from typing import Annotated

import typer


def vehicle(
    name: Annotated[str | None, typer.Argument(help="A vehicle of the catalogue; all names if left out.")] = None,
) -> None:
    """Show a published vehicle: body, coefficients with units, sources and errata."""
    from seatrial.report.vehicle_page import vehicle_page
    from seatrial.vehicles.catalogue import load_vehicle, vehicle_names

    if name is None:
        typer.echo("\n".join(f"{one:<24} {load_vehicle(one).hull.name}" for one in vehicle_names()))
    else:
        typer.echo(vehicle_page(name, load_vehicle(name)), nl=False)
