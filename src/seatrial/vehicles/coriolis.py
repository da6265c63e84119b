"""Coriolis and centripetal forces of a mass matrix as products of velocities, after Kirchhoff's equations.

    force = -omega x P,  moment = -v x P - omega x L,  (P, L) = M nu

They are linear in the entries of M: each entry gives at most four products with the factors 1 and -1. So the rigid body's, with its
constants, and those of added mass that is estimated are handled alike, and what cancels or is held at zero is never computed.
Kirchhoff (1869); Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2nd ed., 2021, eqs. (3.46) and (6.47).
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from seatrial.core.coefficients import CoefficientName
from seatrial.core.signals import RATES
from seatrial.vehicles.hull import AXES


class Product(NamedTuple):
    """A factor times a product of two velocities on one axis, the product written as a coefficient's name."""

    name: CoefficientName
    factor: float


def entry_products(row: int, column: int) -> list[Product]:
    """Return the forces of a unit entry of the mass matrix."""
    results = []
    for axis, turning in _crosses(row):
        first, second = sorted((turning, column))
        power = f"{RATES[first]}2" if first == second else RATES[first] + RATES[second]
        sign = _SIGN[axis % 3, turning % 3, row % 3]
        results.append(Product(CoefficientName.parse(f"{AXES[axis]}_{power}"), -sign))
    return results


def matrix_products(matrix: Float[np.ndarray, "6 6"]) -> list[Product]:
    """Return the forces of a constant mass matrix; those that cancel, as v x m v does, are left out."""
    entries = [(i, j) for i in range(6) for j in range(6) if matrix[i, j] != 0]
    return summed((Product(p.name, p.factor * float(matrix[i, j])) for i, j in entries for p in entry_products(i, j)))


def summed(products: Iterable[Product]) -> list[Product]:
    """Return one product for each axis and pair of velocities; those of factor 0 are left out."""
    sums: dict[CoefficientName, float] = {}
    for product in products:
        sums[product.name] = sums.get(product.name, 0.0) + product.factor
    return [Product(name, factor) for name, factor in sums.items() if factor != 0.0]


_SIGN = {(0, 1, 2): 1.0, (1, 2, 0): 1.0, (2, 0, 1): 1.0, (0, 2, 1): -1.0, (2, 1, 0): -1.0, (1, 0, 2): -1.0}


def _crosses(row: int) -> list[tuple[int, int]]:
    """Return the axis on which a component of P or L acts, and the velocity that turns or shifts it."""
    others = [k for k in range(3) if k != row % 3]
    swapped = list(zip(others, reversed(others), strict=True))
    if row < 3:
        return [*((k, 3 + i) for k, i in swapped), *((3 + k, i) for k, i in swapped)]
    return [(3 + k, 3 + i) for k, i in swapped]
