"""Laws no vehicle breaks: checks of coefficients that return what they find in words, and one driver that raises.

Published tables break some of them, by misprints or because they were measured: so they are asked for, not imposed.
"""

from collections.abc import Iterable, Mapping

import numpy as np

from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError
from seatrial.core.signals import RATES
from seatrial.export.stability import dissipation_findings
from seatrial.vehicles.coriolis import matrix_products
from seatrial.vehicles.hull import AXES, Hull, added_mass_matrix, asymmetric_pairs
from seatrial.vehicles.model import Params, VehicleModel


def added_mass_findings(values: Mapping[str, float]) -> list[str]:
    """Return the added mass that is not symmetric, or not positive: water would be set in motion for nothing."""
    results = [
        f"{one} = {values[one]:g} and {other} = {values[other]:g} differ: the added mass of an ideal fluid is symmetric"
        for one, other in asymmetric_pairs(values)
    ]
    matrix = added_mass_matrix(values)
    axes = [i for i in range(6) if matrix[i].any() or matrix[:, i].any()]
    least = np.linalg.eigvalsh(0.5 * (matrix + matrix.T)[np.ix_(axes, axes)]).min(initial=0.0) if axes else 0.0
    if least < -1e-9 * np.abs(matrix).max(initial=0.0):
        results.append(f"the added mass has the eigenvalue {least:.4g}: moving the water would give energy back")
    return results


def coriolis_findings(values: Mapping[str, float]) -> list[str]:
    """Find the Coriolis forces that the added mass implies and the named terms lack: a part of them alone does work."""
    named = {CoefficientName.parse(name) for name in values}
    return [
        f"{product.name} is missing: the added mass implies {product.factor:g}"
        for product in matrix_products(added_mass_matrix(values))
        if product.name not in named
    ]


def sign_findings(hull: Hull, values: Mapping[str, float]) -> list[str]:
    """Find what is against body axes forward, starboard and down: drag, added mass, thrust, stern fins, weight below buoyancy."""
    named = {CoefficientName.parse(name): value for name, value in {**hull.fixed, **values}.items()}
    results = []
    for axis, rate in zip(AXES, RATES, strict=True):
        for text, what in (
            (f"{axis}_{rate}", "drag"),
            (f"{axis}_{rate}abs{rate}", "drag"),
            (f"{axis}_{rate}dot", "added mass"),
        ):
            value = named.get(CoefficientName.parse(text), 0.0)
            if value > 0:
                results.append(f"{text} = {value:g} is positive: {what} acts against the motion, with a negative sign")
    thrust = named.get(CoefficientName.parse("T_nabsn"), 1.0)
    if thrust < 0:
        results.append(f"T_nabsn = {thrust:g} is negative: positive turns drive the vehicle forward")
    for force, moment, fin, wanted in (("Y", "N", "delta_r", -1.0), ("Z", "M", "delta_s", 1.0)):
        for regressor in (fin, f"uu{fin}"):
            pair = [named.get(CoefficientName.parse(f"{axis}_{regressor}"), 0.0) for axis in (force, moment)]
            if pair[0] * pair[1] * wanted < 0:
                results.append(
                    f"{force}_{regressor} = {pair[0]:g} and {moment}_{regressor} = {pair[1]:g} are those of a fin ahead of the origin"
                )
    low = hull.centre_of_gravity[2] * hull.weight - hull.centre_of_buoyancy[2] * hull.buoyancy
    if hull.mass is not None and low < 0:
        results.append(f"z_g W - z_b B = {low:.3g} N m is negative: the vehicle turns upside down")
    return results


def energy_findings(
    model: VehicleModel, params: Params, mass: np.ndarray, samples: int = 50, seed: int = 0, tolerance: float = 1e-9
) -> list[str]:
    """Find motions in which a vehicle without damping and propulsion, neutral and with weight and buoyancy in one place, gains energy.

    Args:
        model: the vehicle with all six velocities.
        params: value of each free coefficient, SI.
        mass: rigid body and added mass, shape (6, 6).
        samples: number of random motions, controls zero.
        seed: of the samples.
        tolerance: power that counts as none, of the size of the powers that cancel.
    """
    rng = np.random.default_rng(seed)
    for motion in rng.uniform(-1.0, 1.0, (samples, 6)):
        known = {**dict(zip(RATES, motion, strict=True)), "q_w": 1.0}
        state = tuple(known.get(name, 0.0) for name in model.states)
        rates = dict(zip(model.states, model.derivative(params, state, (0.0,) * len(model.controls)), strict=True))
        force = mass @ np.array([float(rates[rate]) for rate in RATES])
        if abs(motion @ force) > tolerance * (np.abs(motion) @ np.abs(force)):
            shown = ", ".join(f"{rate} = {x:.3g}" for rate, x in zip(RATES, motion, strict=True))
            return [f"energy changes at {motion @ force:.3g} W in the motion {shown}, where nothing takes or gives any"]
    return []


def check_laws(hull: Hull, values: Mapping[str, float], allowed: Iterable[str] = ()) -> None:
    """Check added mass, damping and signs of a vehicle.

    Args:
        hull: with its fixed coefficients.
        values: the others, SI.
        allowed: beginnings of findings to pass over, for a table that is known to break a law.

    Raises:
        InputError: one line for each law that is broken.
    """
    together = {**hull.fixed, **values}
    results = [*added_mass_findings(together), *dissipation_findings(together), *sign_findings(hull, values)]
    results = [line for line in results if not line.startswith(tuple(allowed))] if tuple(allowed) else results
    if results:
        raise InputError(
            f'vehicle "{hull.name}"',
            found="\n            ".join(results),
            expected="coefficients that obey the laws of mechanics",
            remedy="check signs, units and the table they come from",
        )
