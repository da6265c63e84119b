"""What targets have in common to keep or to lose: a vehicle without some terms, and words for what is left out."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from math import isfinite

import numpy as np

from seatrial.core.coefficients import CoefficientName
from seatrial.export.terms import Pair, all_products, product_name, with_products
from seatrial.export.vehicle import ExportedVehicle

_ROUNDING = 1e-12


def without(vehicle: ExportedVehicle, names: Iterable[str]) -> ExportedVehicle:
    """The vehicle without some terms."""
    gone = set(names)
    return replace(vehicle, coefficients={name: x for name, x in vehicle.coefficients.items() if name not in gone})


def with_only_products(vehicle: ExportedVehicle, products: Mapping[Pair, float]) -> ExportedVehicle:
    """The vehicle with other products of velocities than its own."""
    return replace(vehicle, coefficients=with_products(vehicle, products), added_coriolis="named")


def product_losses(vehicle: ExportedVehicle, products: Mapping[Pair, float]) -> tuple[str, ...]:
    """One sentence about the products whose value differs from the vehicle's own; none where all agree."""
    own, found = all_products(vehicle), []
    for key in sorted({*own, *products}):
        here, there = own.get(key, 0.0), products.get(key, 0.0)
        if abs(here - there) > _ROUNDING * max(abs(here), abs(there)):
            found.append(f"{product_name(key)} = {here:.4g} as {there:.4g}")
    return ("products of velocities that the target sets itself: " + ", ".join(found),) if found else ()


def term_losses(vehicle: ExportedVehicle, names: Iterable[str], why: str = "") -> tuple[str, ...]:
    """One sentence about terms that are left out; none where there are none."""
    shown = [f"{name} = {vehicle.coefficients[name]:.5g} {CoefficientName.parse(name).unit}" for name in names]
    return (", ".join(shown) + why,) if shown else ()


def added_mass_losses(vehicle: ExportedVehicle, kept: Iterable[str] = ()) -> tuple[str, ...]:
    """One sentence about the added masses but those that are kept."""
    names = [name for name in vehicle.coefficients if name not in vehicle.forces and name not in set(kept)]
    return tuple("added mass: " + line for line in term_losses(vehicle, names))


def actuator_losses(vehicle: ExportedVehicle, limits: bool = False) -> tuple[str, ...]:
    """Lags and rates, and limits if asked for, in words; they are not counted in the loss of predicted motion."""
    found = []
    for name, actuator in vehicle.actuators.items():
        parts = [f"lag {actuator.time_constant:g} s"] if actuator.time_constant > 0 else []
        parts += [f"greatest rate {actuator.rate:.4g} SI"] if isfinite(actuator.rate) else []
        if limits and (isfinite(actuator.lower) or isfinite(actuator.upper)):
            parts.append(f"limits {actuator.lower:.4g} to {actuator.upper:.4g} SI")
        if parts:
            found.append(f"{' and '.join(parts)} of {name} (not counted in the loss)")
    return tuple(found)


def is_asymmetric(vehicle: ExportedVehicle) -> bool:
    """Whether the added mass differs from its transpose."""
    matrix = vehicle.added_mass
    return bool(np.abs(matrix - matrix.T).max() > 1e-6 * np.abs(matrix).max())
