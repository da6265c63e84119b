"""Forces on the six axes but weight and buoyancy: one coefficient for each regressor, made of all that multiplies it.

Named terms, the propeller's share of the thrust, and Coriolis forces of the rigid body and of the added mass that are products of the
same velocities come together before anything is compiled.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from seatrial.core.coefficients import CoefficientName
from seatrial.core.signals import thruster_controls
from seatrial.numerics.rotations import times, total
from seatrial.vehicles.coriolis import Product, entry_products, matrix_products, summed
from seatrial.vehicles.freedom import AddedCoriolis, Freedom, acts
from seatrial.vehicles.hull import AXES, Hull, added_mass_entry, added_mass_matrix, rigid_mass_matrix
from seatrial.vehicles.thrusters import Thruster

Forces = Callable[[Mapping[str, Any], Mapping[str, Any], tuple], list[Any]]


def forces_of(
    hull: Hull,
    named: Sequence[CoefficientName],
    fixed: Mapping[str, float],
    freedom: Freedom,
    added_coriolis: AddedCoriolis,
    thrusters: Sequence[Thruster],
    inertial: Sequence[CoefficientName],
) -> Callable[[Mapping[str, Any], Mapping[str, Any], tuple], list[Any]]:
    """Forces on the six axes but weight and buoyancy: one coefficient for each regressor, made of all that multiply it."""
    share, inflow = 1.0 - hull.thrust_deduction, 1.0 - hull.wake
    sums: dict[CoefficientName, list[tuple[float, str]]] = {}
    thrust = [name for name in named if name.axis == "T"]
    for name in named:
        if name.is_added_mass or (name.axis == "T" and thrusters):
            continue
        if name.axis == "T":
            factor = share * inflow ** sum(f.power for f in name.factors if f.signal == "u" and not f.change)
            sums.setdefault(CoefficientName("", "X", name.factors, name.key), []).append((factor, name.text))
        else:
            sums.setdefault(name, []).append((1.0, name.text))
    constant = {p.name: p.factor for p in _coriolis_products(hull, fixed, freedom, added_coriolis)}
    if added_coriolis == "automatic":
        for entry in inertial:
            for product in entry_products(*added_mass_entry(entry)):
                if acts(product.name, freedom, ()):
                    sums.setdefault(product.name, []).append((-product.factor, entry.text))
    for product in constant:
        sums.setdefault(product, [])
    columns = [tuple(share * x for x in thruster.column) for thruster in thrusters]
    names = thruster_controls(len(thrusters), commanded_force=not thrust)

    def forces(values: Mapping[str, Any], known: Mapping[str, Any], velocity: tuple) -> list[Any]:
        found: list[Any] = [0.0] * 6
        made: dict[tuple, Any] = {}
        for name, parts in sums.items():
            if name.key not in made:
                made[name.key] = name.regressor(known, hull.trim)
            axis = AXES.index(name.axis)
            scale = total((constant.get(name, 0.0), *(times(factor, values[text]) for factor, text in parts)))
            found[axis] = total((found[axis], times(scale, made[name.key])))
        for thruster, control, column in zip(thrusters, names, columns, strict=True):
            push = known[control]
            if thrust:
                local = {**known, "n": push, "u": times(inflow, thruster.inflow(velocity))}
                push = total(times(values[term.text], term.regressor(local, hull.trim)) for term in thrust)
            found = [total((force, times(x, push))) for force, x in zip(found, column, strict=True)]
        return found

    return forces


def _coriolis_products(
    hull: Hull, fixed: Mapping[str, float], freedom: Freedom, added_coriolis: AddedCoriolis
) -> list[Product]:
    """Products of the rigid body, and of the fixed added mass where that is wanted; none of a body of which nothing is known."""
    rigid = [] if hull.mass is None else matrix_products(rigid_mass_matrix(hull))
    added = matrix_products(added_mass_matrix(fixed)) if added_coriolis == "automatic" else []
    return [product for product in summed((*rigid, *added)) if acts(product.name, freedom, ())]
