"""Coefficients sorted by the form of their regressor, which is how the targets tell them apart.

    linear  c nu_j      modulus  c nu_j |nu_k|      product  c nu_j nu_k      fin  c u^2 delta      the rest

Products hold lift and the Coriolis forces of the added mass, which some targets compute themselves.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from seatrial.core.coefficients import CoefficientName
from seatrial.core.signals import RATES
from seatrial.export.vehicle import ExportedVehicle
from seatrial.vehicles.coriolis import matrix_products
from seatrial.vehicles.hull import AXES

Pair = tuple[int, int, int]
"""Axis and the two velocities of a term, 0 to 5; of a modulus the second is the one with bars, of a product they ascend."""
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
    found = Sorted()
    for text, value in forces.items():
        name = CoefficientName.parse(text)
        if name.axis == "T":
            found.thrust[text] = value
            continue
        axis = AXES.index(name.axis) if name.axis in AXES else -1
        plain, moduli, fins = _parts(name)
        if axis < 0 or plain is None:
            found.other[text] = value
        elif len(fins) == 1 and plain == [0, 0] and not moduli:
            found.fin[axis, fins[0]] = value
        elif fins:
            found.other[text] = value
        elif len(plain) == 1 and len(moduli) == 1:
            found.modulus[axis, plain[0], moduli[0]] = value
        elif len(plain) == 2 and not moduli:
            found.product[axis, plain[0], plain[1]] = value
        elif len(plain) == 1 and not moduli:
            found.linear[axis, plain[0]] = value
        else:
            found.other[text] = value
    return found


def automatic_products(vehicle: ExportedVehicle) -> dict[Pair, float]:
    """Coriolis forces that follow from the added mass, as products."""
    return mass_products(vehicle.added_mass)


def mass_products(matrix: Float[np.ndarray, "6 6"]) -> dict[Pair, float]:
    """Coriolis forces of a mass matrix, as products."""
    found = {}
    for product in matrix_products(matrix):
        plain, _, _ = _parts(product.name)
        assert plain is not None
        found[AXES.index(product.name.axis), plain[0], plain[1]] = product.factor
    return found


def all_products(vehicle: ExportedVehicle) -> dict[Pair, float]:
    """Every product of two velocities but those of the rigid body: named ones, and automatic ones where the vehicle has them."""
    found = dict(sorted_terms(vehicle.forces).product)
    if vehicle.added_coriolis == "automatic":
        for key, value in automatic_products(vehicle).items():
            found[key] = found.get(key, 0.0) + value
    return found


def product_name(key: Pair) -> str:
    """Name of a product, for example `X_wq` or `X_q2`."""
    axis, first, second = key
    return f"{AXES[axis]}_{RATES[first]}{'2' if first == second else RATES[second]}"


def _parts(name: CoefficientName) -> tuple[list[int] | None, list[int], list[str]]:
    """Velocities without and with bars, and fins; None where something else is in it."""
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
