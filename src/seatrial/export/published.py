"""A vehicle of the catalogue on its way out."""

from seatrial import __version__
from seatrial.core.errors import InputError, nearest
from seatrial.core.signals import RATES
from seatrial.export.vehicle import ExportedVehicle, Provenance, of_published
from seatrial.vehicles.catalogue import load_vehicle, vehicle_names


def of_catalogue(name: str) -> tuple[ExportedVehicle, Provenance]:
    """A published vehicle by name.

    Raises:
        InputError: no such vehicle, which may have been meant as a folder.
    """
    names = vehicle_names()
    if name not in names:
        raise InputError(
            name,
            found="neither a folder nor a vehicle of the catalogue",
            expected="a campaign's folder, or one of " + ", ".join(names),
            remedy=nearest(name, names),
        )
    vehicle = of_published(name, load_vehicle(name))
    absent = [f"everything about {rate}" for rate in RATES if rate not in vehicle.moves]
    absent += vehicle.unknown_drives
    return vehicle, Provenance(
        f"catalogue {name}",
        f"{vehicle.name}, as published",
        version=__version__,
        absent=(", ".join(absent),) if absent else (),
    )
