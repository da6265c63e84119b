"""Coefficients sorted by the form of their regressor, which is how the targets separate them.

    linear  c nu_j      modulus  c nu_j |nu_k|      product  c nu_j nu_k      fin  c u^2 delta      the rest

Products hold lift and the Coriolis forces of the added mass, which some targets compute themselves.

What targets have in common to keep or to lose: a vehicle without some terms, and words for what is left out.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

from seatrial.core.coefficients import CoefficientName
from seatrial.core.display_units import shown_unit
from seatrial.core.signals import RATES
from seatrial.export.vehicle import ExportedVehicle
from seatrial.vehicles.actuators import Actuator
from seatrial.vehicles.coriolis import matrix_products
from seatrial.vehicles.hull import AXES

# Axis and the two velocities of a term, 0 to 5; of a modulus the second is the one with bars, of a product they ascend.
Pair = tuple[int, int, int]
FINS = ("delta_r", "delta_s")


@dataclass(frozen=True)
class Sorted:
    """Values of the terms of each form, SI; `other` holds names of those of no listed form."""

    linear: dict[tuple[int, int], float] = field(default_factory=dict)
    modulus: dict[Pair, float] = field(default_factory=dict)
    product: dict[Pair, float] = field(default_factory=dict)
    fin: dict[tuple[int, str], float] = field(default_factory=dict)
    thrust: dict[str, float] = field(default_factory=dict)
    other: dict[str, float] = field(default_factory=dict)


def sorted_terms(forces: Mapping[str, float]) -> Sorted:
    """Sort coefficients that are no added masses."""
    result = Sorted()
    for text, value in forces.items():
        name = CoefficientName.parse(text)
        if name.axis == "T":
            result.thrust[text] = value
            continue
        axis = AXES.index(name.axis) if name.axis in AXES else -1
        plain, moduli, fins = _parts(name)
        if axis < 0 or plain is None:
            result.other[text] = value
        elif len(fins) == 1 and plain == [0, 0] and not moduli:
            result.fin[axis, fins[0]] = value
        elif fins:
            result.other[text] = value
        elif len(plain) == 1 and len(moduli) == 1:
            result.modulus[axis, plain[0], moduli[0]] = value
        elif len(plain) == 2 and not moduli:
            result.product[axis, plain[0], plain[1]] = value
        elif len(plain) == 1 and not moduli:
            result.linear[axis, plain[0]] = value
        else:
            result.other[text] = value
    return result


def automatic_products(vehicle: ExportedVehicle) -> dict[Pair, float]:
    """Return the Coriolis forces that follow from the added mass, as products."""
    results = {}
    for product in matrix_products(vehicle.added_mass):
        plain, _, _ = _parts(product.name)
        assert plain is not None
        results[AXES.index(product.name.axis), plain[0], plain[1]] = product.factor
    return results


def all_products(vehicle: ExportedVehicle) -> dict[Pair, float]:
    """Return every product of two velocities but those of the rigid body: named ones, and automatic ones where the vehicle has them."""
    results = dict(sorted_terms(vehicle.forces).product)
    if vehicle.added_coriolis == "automatic":
        for key, value in automatic_products(vehicle).items():
            results[key] = results.get(key, 0.0) + value
    return results


def without(vehicle: ExportedVehicle, names: Iterable[str]) -> ExportedVehicle:
    """Return the vehicle without some terms."""
    gone = set(names)
    return replace(vehicle, coefficients={name: x for name, x in vehicle.coefficients.items() if name not in gone})


def term_losses(vehicle: ExportedVehicle, names: Iterable[str]) -> tuple[str, ...]:
    """Return one sentence about terms that are left out; none if there are none.

    Args:
        vehicle: whose terms these are.
        names: of what is left out.
    """
    shown = [f"{name} = {vehicle.coefficients[name]:.5g} {CoefficientName.parse(name).unit}" for name in names]
    return (", ".join(shown),) if shown else ()


def added_mass_losses(vehicle: ExportedVehicle, kept: Iterable[str] = ()) -> tuple[str, ...]:
    """Return one sentence about the added masses but those that are kept."""
    names = [name for name in vehicle.coefficients if name not in vehicle.forces and name not in set(kept)]
    return tuple("added mass: " + line for line in term_losses(vehicle, names))


def actuator_losses(vehicle: ExportedVehicle, kept: Mapping[str, Actuator]) -> tuple[str, ...]:
    """Return the lags, rates and limits that the target's actuators do not have, in words."""
    results = []
    for name, own in vehicle.actuators.items():
        if name not in vehicle.controls:
            continue
        target = kept.get(name, Actuator(0.0))
        parts = [f"lag {own.time_constant:g} s"] if target.time_constant != own.time_constant else []
        factor, unit = shown_unit(name)
        parts += [f"greatest rate {own.rate * factor:.4g} {unit}/s"] if target.rate != own.rate else []
        if (target.lower, target.upper) != (own.lower, own.upper):
            parts.append(f"limits {own.lower * factor:.4g} to {own.upper * factor:.4g} {unit}")
        if parts:
            results.append(f"{' and '.join(parts)} of {name}")
    return tuple(results)


def with_gains(vehicle: ExportedVehicle) -> ExportedVehicle:
    """Return the vehicle without what `thrust_law_losses` names."""
    return replace(vehicle, numbers={key: one for key, one in vehicle.numbers.items() if key.startswith("gain_")})


def thrust_law_losses(vehicle: ExportedVehicle) -> tuple[str, ...]:
    """Return the dead zone and the share astern of thrusters, in words, for a target that has gains alone."""
    return tuple(
        f"{name} = {value:.5g} {vehicle.numbers[name].unit}"
        for name, value in vehicle.thrust_law.items()
        if not name.startswith("gain_")
    )


def _parts(name: CoefficientName) -> tuple[list[int] | None, list[int], list[str]]:
    """Return the velocities without and with bars, and fins; None if something else is in it."""
    plain: list[int] = []
    moduli: list[int] = []
    fins: list[str] = []
    for (signal, change, derivative), power, bars in name.key:
        if change or derivative:
            return None, [], []
        if signal in FINS and power == 1 and not bars:
            fins.append(signal)
        elif signal in RATES:
            plain += [RATES.index(signal)] * power
            moduli += [RATES.index(signal)] * bars
        else:
            return None, [], []
    return sorted(plain), moduli, fins
