"""What targets have in common to keep or to lose: a vehicle without some terms, and words for what is left out."""

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from seatrial.core.coefficients import CoefficientName
from seatrial.core.display_units import shown_unit
from seatrial.export.terms import Pair, product_name
from seatrial.export.vehicle import ExportedVehicle
from seatrial.vehicles.actuators import Actuator

_ROUNDING = 1e-12


def without(vehicle: ExportedVehicle, names: Iterable[str]) -> ExportedVehicle:
    """The vehicle without some terms."""
    gone = set(names)
    return replace(vehicle, coefficients={name: x for name, x in vehicle.coefficients.items() if name not in gone})


def product_losses(own: Mapping[Pair, float], products: Mapping[Pair, float], where: str) -> tuple[str, ...]:
    """One sentence about the products, taken about a place, whose value differs from the vehicle's own; none where all agree."""
    found = []
    for key in sorted({*own, *products}):
        here, there = own.get(key, 0.0), products.get(key, 0.0)
        if abs(here - there) > _ROUNDING * max(abs(here), abs(there)):
            found.append(f"{product_name(key)} = {here:.4g} as {there:.4g}")
    return (f"products of velocities {where} that the target sets itself: " + ", ".join(found),) if found else ()


def term_losses(vehicle: ExportedVehicle, names: Iterable[str], why: str = "") -> tuple[str, ...]:
    """One sentence about terms that are left out; none where there are none."""
    shown = [f"{name} = {vehicle.coefficients[name]:.5g} {CoefficientName.parse(name).unit}" for name in names]
    return (", ".join(shown) + why,) if shown else ()


def added_mass_losses(vehicle: ExportedVehicle, kept: Iterable[str] = ()) -> tuple[str, ...]:
    """One sentence about the added masses but those that are kept."""
    names = [name for name in vehicle.coefficients if name not in vehicle.forces and name not in set(kept)]
    return tuple("added mass: " + line for line in term_losses(vehicle, names))


def actuator_losses(vehicle: ExportedVehicle, kept: Mapping[str, Actuator]) -> tuple[str, ...]:
    """Lags, rates and limits that the target's actuators do not have, in words."""
    found = []
    for name, own in vehicle.actuators.items():
        there = kept.get(name, Actuator(0.0))
        parts = [f"lag {own.time_constant:g} s"] if there.time_constant != own.time_constant else []
        factor, unit = shown_unit(name)
        parts += [f"greatest rate {own.rate * factor:.4g} {unit}/s"] if there.rate != own.rate else []
        if (there.lower, there.upper) != (own.lower, own.upper):
            parts.append(f"limits {own.lower * factor:.4g} to {own.upper * factor:.4g} {unit}")
        if parts:
            found.append(f"{' and '.join(parts)} of {name}")
    return tuple(found)


def is_asymmetric(vehicle: ExportedVehicle) -> bool:
    """Whether the added mass differs from its transpose."""
    matrix = vehicle.added_mass
    return bool(np.abs(matrix - matrix.T).max() > 1e-6 * np.abs(matrix).max())
