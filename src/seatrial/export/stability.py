"""What is refused because a simulator that steps through time would run away with it.

Mass that is not positive definite, damping that gives energy, and added mass that an explicit step cannot follow.
"""

from collections.abc import Mapping
from functools import lru_cache

import numpy as np
from jaxtyping import Float
from scipy.linalg import eigh

from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError
from seatrial.core.signals import RATES
from seatrial.export.vehicle import ExportedVehicle
from seatrial.vehicles.hull import AXES

_AGAIN = (
    "estimate it again with a prior that ends at 0 (`dissipative = true`), export a structure without it by `--structure`, "
    "or correct the value"
)
# Range of each velocity in which damping is tried, m/s and rad/s.
_RANGE = dict(zip(RATES, (2.0, 0.5, 0.5, 1.0, 0.5, 0.5), strict=True))
_COUPLED_VELOCITIES = (("v", "p"), ("v", "r"), ("w", "q"), ("p", "r"))
_SAMPLES = 500


def check_stable(vehicle: ExportedVehicle, target: str) -> None:
    """Refuse what no simulator survives.

    Raises:
        InputError: names the coefficient, its value, and what to do.
    """
    place = f'vehicle "{vehicle.name}", export to {target}'
    _check_mass(vehicle, place)
    # Quadratic drag of a velocity on its own axis must take energy by itself.
    own = {CoefficientName.parse(f"{axis}_{rate}abs{rate}") for axis, rate in zip(AXES, RATES, strict=True)}
    forces = vehicle.forces
    for name, value in forces.items():
        if CoefficientName.parse(name) in own and value > 0:
            raise InputError(
                f"{place}, {name}",
                found=f"{name} = {value:.6g} {vehicle.unit(name)}, which gives energy to the motion",
                expected="a value of 0 or less: drag takes energy",
                remedy=_AGAIN,
            )
    # Each velocity alone, those that couple, and all together.
    singles = [{rate: _RANGE[rate]} for rate in vehicle.moves]
    pairs = [{a: _RANGE[a], b: _RANGE[b]} for a, b in _COUPLED_VELOCITIES if a in vehicle.moves and b in vehicle.moves]
    # Per unit of unknown inertias, forces on several axes add up to no power.
    coupled = [] if vehicle.hull.mass is None else [*pairs, {rate: _RANGE[rate] for rate in vehicle.moves}]
    for speeds in [*singles, *coupled]:
        findings = dissipation_findings(forces, speeds)
        if findings:
            name = _culprit(vehicle, speeds)
            raise InputError(
                f"{place}, {name or 'damping'}",
                found=findings[0]
                + (f"; without {name} = {vehicle.coefficients[name]:.6g} it does not" if name else ""),
                expected="damping that takes energy in every motion",
                remedy=_AGAIN,
            )


def check_explicit_added_mass(vehicle: ExportedVehicle, target: str, limit: float, remedy: str) -> None:
    """Refuse added mass that a target applies from the acceleration of the step before.

    It does not run away while the largest eigenvalue of M_RB^-1 M_A stays below `limit`, 1 without a filter.

    Args:
        vehicle: with mass and added mass.
        target: name, for the error.
        limit: of the eigenvalue.
        remedy: what to do, for the error.

    Raises:
        InputError: it is above; names the added mass that weighs most.
    """
    values, vectors = eigh(vehicle.added_mass, vehicle.rigid_mass)
    if values[-1] < limit:
        return
    axis = int(np.argmax(np.abs(vectors[:, -1]) * np.sqrt(np.diag(vehicle.rigid_mass))))
    name = f"{AXES[axis]}_{RATES[axis]}dot"
    raise InputError(
        f'vehicle "{vehicle.name}", export to {target}, {name}',
        found=f"{name} = {-vehicle.added_mass[axis, axis]:.6g} {vehicle.unit(name)}: added mass is {values[-1]:.3g} times that of the "
        f"vehicle",
        expected=f"less than {limit:.3g} times that: the target applies it from the acceleration of the last step, and diverges above this",
        remedy=remedy,
    )


def dissipation_findings(values: Mapping[str, float], speeds: Mapping[str, float] = _RANGE) -> list[str]:
    """Return the motions in which damping gives power, nu . F > 0, among random ones.

    Damping is every term of velocities alone with a modulus, an odd power or one factor: X_uabsu, Y_v, N_r3. Products of two
    velocities without modulus, such as Y_uv and M_uw, are lift and Coriolis forces: they do no work, or are paid for by the propeller.

    Args:
        values: coefficients, SI.
        speeds: range of each velocity, from minus to plus; of those not named it is 0.
    """
    motions, each = _power_by_coefficient(tuple(values), tuple(speeds.items()))
    coefficients = np.array([*values.values()], float)
    power, share = coefficients @ each, np.abs(coefficients) @ np.abs(each)
    worst = int(np.argmax(power - 1e-9 * share))
    if not power[worst] > 1e-9 * share[worst]:
        return []
    motion = ", ".join(f"{rate} = {x:.3g}" for rate, x in zip(RATES, motions[worst], strict=True) if x)
    return [f"damping gives {power[worst]:.3g} W in the motion {motion}; it must dissipate in every motion"]


@lru_cache(maxsize=64)
def _power_by_coefficient(
    names: tuple[str, ...], speeds: tuple[tuple[str, float], ...]
) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "k n"]]:
    """Return random motions, and the power in each of a unit of each coefficient, SI; 0 of one that is no damping."""
    ranges = [dict(speeds).get(rate, 0.0) for rate in RATES]
    motions = np.random.default_rng(0).uniform(-1.0, 1.0, (_SAMPLES, 6)) * ranges
    signals, power = dict(zip(RATES, motions.T, strict=True)), np.zeros((len(names), _SAMPLES))
    for i, name in enumerate(map(CoefficientName.parse, names)):
        if _is_damping(name):
            power[i] = signals[RATES[AXES.index(name.axis)]] * name.regressor(signals, {})
    return motions, power


def _check_mass(vehicle: ExportedVehicle, place: str) -> None:
    moving = [RATES.index(rate) for rate in vehicle.moves]
    matrix = (vehicle.rigid_mass + vehicle.added_mass)[np.ix_(moving, moving)]
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    if values[0] > 0:
        return
    axis = moving[int(np.argmax(np.abs(vectors[:, 0])))]
    name = f"{AXES[axis]}_{RATES[axis]}dot"
    raise InputError(
        f"{place}, {name}",
        found=f"{name} = {-vehicle.added_mass[axis, axis]:.6g} {vehicle.unit(name)}: "
        f"mass and added mass have the eigenvalue {values[0]:.4g}",
        expected="a positive definite mass matrix",
        remedy="added masses on the diagonal are negative in SNAME notation: check their signs, and the centre of gravity",
    )


def _culprit(vehicle: ExportedVehicle, speeds: dict[str, float]) -> str | None:
    """Return the one coefficient without which damping would take energy in these motions."""
    for name in vehicle.forces:
        others = {other: value for other, value in vehicle.forces.items() if other != name}
        if not dissipation_findings(others, speeds):
            return name
    return None


def _is_damping(name: CoefficientName) -> bool:
    """Return whether a term is damping: of velocities alone, and no plain product of two."""
    plain = all(factor.signal in RATES and not factor.change and not factor.derivative for factor in name.factors)
    if not plain or not name.factors or name.axis not in AXES:
        return False
    order = sum(factor.power for factor in name.factors)
    return order % 2 == 1 or any(factor.modulus for factor in name.factors)
