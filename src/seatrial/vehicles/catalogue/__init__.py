"""Published vehicles, one TOML file each, with their sources."""

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import PurePath

from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError, nearest
from seatrial.core.signals import signal_unit
from seatrial.core.units import quantity
from seatrial.vehicles.surge import SurgeHull, surge_vehicle, trim_speed


@dataclass(frozen=True)
class CatalogueEntry:
    """A published vehicle: the hull, its trim solved, and the published coefficients (SI)."""

    hull: SurgeHull
    coefficients: dict[str, float]


def catalogue_names() -> tuple[str, ...]:
    """Names of the catalogue's vehicles."""
    return tuple(sorted(PurePath(item.name).stem for item in files(__name__).iterdir() if item.name.endswith(".toml")))


@cache
def catalogue_vehicle(name: str) -> CatalogueEntry:
    """Load a vehicle; the trim speed is solved from its own coefficients and the trim control.

    Raises:
        InputError: no vehicle of that name.
    """
    if name not in catalogue_names():
        raise InputError(
            f'vehicle "{name}"',
            found="no such vehicle in the catalogue",
            expected=", ".join(catalogue_names()),
            remedy=nearest(name, catalogue_names()),
        )
    table = tomllib.loads(files(__name__).joinpath(f"{name}.toml").read_text(encoding="utf-8"))
    where = f"catalogue {name}"
    trim = {signal: quantity(text, signal_unit(signal), where) for signal, text in table["trim"].items()}
    hull = SurgeHull(
        table["name"], quantity(table["mass"], "kg", where), table["thrust_deduction"], table["fixed"], trim
    )
    coefficients = {CoefficientName.parse(key).text: float(value) for key, value in table["coefficients"].items()}
    model = surge_vehicle(hull, tuple(coefficients))
    speed = trim_speed(model, coefficients, [trim[control] for control in model.controls])
    return CatalogueEntry(
        SurgeHull(hull.name, hull.mass, hull.thrust_deduction, hull.fixed, {"u": speed, **trim}), coefficients
    )
