"""Published vehicles, one TOML file each, with their sources."""

import tomllib
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from pathlib import PurePath
from typing import Any

from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError, nearest
from seatrial.core.signals import signal_unit
from seatrial.core.units import quantity
from seatrial.vehicles.hull import GRAVITY
from seatrial.vehicles.linearise import trim
from seatrial.vehicles.longitudinal import LongitudinalHull, longitudinal_vehicle
from seatrial.vehicles.surge import SurgeHull, surge_vehicle, trim_speed

_SURGE, _LONGITUDINAL = "_surge", "_longitudinal"


@dataclass(frozen=True)
class CatalogueEntry:
    """A published vehicle: the hull, its trim solved, and the published coefficients (SI)."""

    hull: SurgeHull
    coefficients: dict[str, float]


@dataclass(frozen=True)
class LongitudinalEntry:
    """A published longitudinal vehicle: the hull, its level flight solved, and the published coefficients (SI)."""

    hull: LongitudinalHull
    coefficients: dict[str, float]


def catalogue_names() -> tuple[str, ...]:
    """Names of the catalogue's surge vehicles."""
    return tuple(name for name in _names() if name.endswith(_SURGE))


def longitudinal_names() -> tuple[str, ...]:
    """Names of the catalogue's longitudinal vehicles."""
    return tuple(name for name in _names() if name.endswith(_LONGITUDINAL))


@cache
def catalogue_vehicle(name: str) -> CatalogueEntry:
    """Load a vehicle; the trim speed is solved from its own coefficients and the trim control.

    Raises:
        InputError: no vehicle of that name.
    """
    table = _table(name, catalogue_names())
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


@cache
def catalogue_longitudinal(name: str) -> LongitudinalEntry:
    """Load a longitudinal vehicle; level flight is solved from its own coefficients and the trim propeller speed.

    Raises:
        InputError: no longitudinal vehicle of that name.
    """
    table, where = _table(name, longitudinal_names()), f"catalogue {name}"
    size = {"mass": "kg", "pitch_inertia": "kg m^2", "x_g": "m", "z_g": "m", "net_buoyancy": "N"}
    given = {key: quantity(table[key], unit, where) for key, unit in size.items()}
    buoyancy = given["mass"] * GRAVITY + given.pop("net_buoyancy")
    hull = LongitudinalHull(
        table["name"], **given, buoyancy=buoyancy, thrust_deduction=table["thrust_deduction"], fixed=table["fixed"]
    )
    coefficients = {CoefficientName.parse(key).text: float(value) for key, value in table["coefficients"].items()}
    model = longitudinal_vehicle(hull, tuple(coefficients))
    level = trim(model, coefficients, n=quantity(table["trim"]["n"], "rad/s", where))
    state, control = (
        dict(zip(names, values, strict=True))
        for names, values in ((model.states, level.state), (model.controls, level.control))
    )
    known = {signal: state[signal] for signal in ("u", "w", "q", "theta")}
    return LongitudinalEntry(replace(hull, trim={**known, **control}), coefficients)


def _names() -> tuple[str, ...]:
    return tuple(sorted(PurePath(item.name).stem for item in files(__name__).iterdir() if item.name.endswith(".toml")))


def _table(name: str, names: tuple[str, ...]) -> dict[str, Any]:
    if name not in names:
        raise InputError(
            f'vehicle "{name}"',
            found="no such vehicle in the catalogue",
            expected=", ".join(names),
            remedy=nearest(name, names),
        )
    return tomllib.loads(files(__name__).joinpath(f"{name}.toml").read_text(encoding="utf-8"))
