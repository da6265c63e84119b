"""The REMUS 100 of T. I. Fossen's Python Vehicle Simulator: lift, drag and cross-flow of shapes instead of fitted coefficients.

    M d(nu_r)/dt = tau + tau_lift_drag + tau_cross_flow - (C_RB + C_A + D) nu_r - g

A prolate spheroid of the hull's length and diameter has mass, inertia and, by Lamb's factors, added mass, without Munk moments; drag
and lift act in the vertical plane, cross-flow drag of strips in sway and yaw; linear damping fades with speed; the propeller's thrust
falls with its advance. It is structurally different from the coefficient models, drags twice as much, and has nothing free: a truth
to test others against. T. I. Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2nd ed., 2021, sections 8.4.2 and
9.7; github.com/cybergalactic/PythonVehicleSimulator (MIT licence), with fins of 2 x 0.00665 m^2, lag 0.1 s and yaw time constant 1 s.
"""

from dataclasses import dataclass
from math import exp, log, pi, sqrt
from typing import Any

import jax.numpy as jnp
import numpy as np

from seatrial.core.signals import RATES
from seatrial.vehicles.actuators import Actuator
from seatrial.vehicles.attitude import Attitude, Kind, attitude_states, position_rates
from seatrial.vehicles.coriolis import matrix_products
from seatrial.vehicles.hull import AXES, GRAVITY, Hull, rigid_mass_matrix, whole_hull
from seatrial.vehicles.model import Params, VehicleModel, cached_model

NOTES = """REMUS 100 of T. I. Fossen's Python Vehicle Simulator (MIT licence). Forces are lift, drag and cross-flow drag of its shapes.

- The simulator's text gives 31.9 kg, its spheroid 31.03 kg.
- The simulator integrates by Euler's method. Its propeller uses the speed over ground, the one here the speed through the water.
- Both leave out the Munk moments. Both sum cross-flow drag over 21 sections, each 1/20 of the length.
- The variant in the Marine Systems Simulator has 31.9 kg from a larger spheroid. Its factor of induced drag is 0.3, not 0.7, and
  its drag is that of a cylinder, not Hoerner's. It also has cross-flow in heave and pitch, with a sign of pitch that contradicts
  the rigid body. Its linear damping in sway does not fade. It has the gravity of Trondheim, and fins up to 20 degrees."""
DENSITY, LENGTH, DIAMETER = 1026.0, 1.6, 0.19
# The simulator's lags and limits: 1525 rpm and 15 degrees.
ACTUATORS = {
    "n": Actuator(1.0, -1525 * pi / 30, 1525 * pi / 30),
    "delta_r": Actuator(0.1, -pi / 12, pi / 12),
    "delta_s": Actuator(0.1, -pi / 12, pi / 12),
}
_CENTRE_BELOW = 0.02  # Centre of gravity below the origin, m
# Lengths into which the hull is divided; the simulator sums over the 21 ends of these, each by a whole length: 5 % more
# than the hull.
STRIPS = 20
# Two-dimensional drag coefficient of a section as broad as deep: Hoerner's curve at B / 2T = 0.5, between its points as
# the simulator interpolates it, 1.19773.
CROSS_FLOW = 1.2108 - 0.1272 * 0.0067 / 0.0652
# Entries of C_A, by axis and column, that the simulator sets to zero.
_MUNK = {("M", 0), ("X", 4), ("M", 2), ("Z", 4), ("N", 0), ("X", 5), ("N", 1), ("Y", 5)}


@dataclass(frozen=True)
class Spheroid:
    """What follows from the shape: mass, inertia about the centre, and added mass, in SI."""

    mass: float
    inertia: tuple[float, float, float]
    added: tuple[float, float, float, float, float, float]


def spheroid() -> Spheroid:
    """Return mass, inertia and Lamb's added mass of a prolate spheroid of the hull's length and diameter (Fossen, eqs. 8.65 to 8.70)."""
    a, b = LENGTH / 2, DIAMETER / 2
    mass = 4 / 3 * pi * DENSITY * a * b**2
    roll, pitch = 0.4 * mass * b**2, 0.2 * mass * (a**2 + b**2)
    e = sqrt(1 - (b / a) ** 2)
    logarithm = log((1 + e) / (1 - e))
    alpha = 2 * (1 - e**2) / e**3 * (0.5 * logarithm - e)
    beta = 1 / e**2 - (1 - e**2) / (2 * e**3) * logarithm
    k1, k2 = alpha / (2 - alpha), beta / (2 - beta)
    k3 = e**4 * (beta - alpha) / ((2 - e**2) * (2 * e**2 - (2 - e**2) * (beta - alpha)))
    return Spheroid(mass, (roll, pitch, pitch), (mass * k1, mass * k2, mass * k2, 0.3 * roll, k3 * pitch, k3 * pitch))


def spheroid_hull() -> Hull:
    """Return the rigid body, its inertia moved from the centre of gravity to the origin."""
    shape = spheroid()
    low = shape.mass * _CENTRE_BELOW**2
    roll, pitch, yaw = shape.inertia
    weight = shape.mass * GRAVITY
    return whole_hull(
        "REMUS 100 (Fossen)",
        shape.mass,
        (roll + low, pitch + low, yaw),
        centre_of_gravity=(0.0, 0.0, _CENTRE_BELOW),
        weight=weight,
    )


@cached_model
def remus100_fossen(attitude: Kind = "quaternion", positions: tuple[str, ...] = ()) -> VehicleModel:
    """Build the vehicle, whose controls are n (rad/s), delta_r and delta_s (rad); it has no free coefficient.

    Args:
        attitude: quaternion or Euler angles.
        positions: those that are states.
    """
    shape, body = spheroid(), spheroid_hull()
    rigid, added = rigid_mass_matrix(body), np.diag(shape.added)
    mass = rigid + added
    inverse = np.linalg.inv(mass)
    products = matrix_products(rigid)
    kept = Attitude(attitude_states(attitude, RATES, (), {"phi", "theta", *(("psi",) if positions else ())}))
    states = (*RATES, *positions, *kept.states)
    # From time constants; in roll and pitch from natural frequencies and damping ratios.
    roll, pitch = (sqrt(body.weight * _CENTRE_BELOW / mass[i, i]) for i in (3, 4))
    shares = (1 / 20, 1 / 20, 1 / 20, 2 * 0.3 * roll, 2 * 0.8 * pitch, 1 / 1.0)
    damping = [float(mass[i, i]) * share for i, share in enumerate(shares)]

    def derivative(_: Params, state: tuple, control: tuple) -> tuple:
        known = dict(zip(states, state, strict=True))
        nu = tuple(known[rate] for rate in RATES)
        pose = kept.at(known)
        force = _propelled(nu, control)
        force = _plus(force, _lift_and_drag(nu))
        force = _plus(force, _cross_flow(nu))
        force = _plus(force, _added_coriolis(nu, shape.added))
        for product in products:
            force[AXES.index(product.name.axis)] += product.factor * product.name.regressor(known, {})
        fade = jnp.exp(-3.0 * _length(*nu[:3]))
        for i in range(6):
            force[i] = force[i] - damping[i] * (fade if i < 2 else 1.0) * nu[i]
        down = pose.rows[2]
        force[3] = force[3] - _CENTRE_BELOW * body.weight * down[1]
        force[4] = force[4] + _CENTRE_BELOW * body.weight * down[0]
        rates = tuple(
            sum(float(inverse[i, j]) * force[j] for j in range(6) if abs(inverse[i, j]) > 1e-15) for i in range(6)
        )
        return (*rates, *position_rates(positions, pose, nu[:3], {}), *kept.rates(pose, nu[3:]))

    return VehicleModel(body.name, states, ("n", "delta_r", "delta_s"), (), (("fossen", 1.0),), False, derivative)


def _propelled(nu: tuple, control: tuple) -> list[Any]:
    """Return the propeller by thrust and torque coefficients that fall with the advance, and fins by their lift and drag."""
    u, v, w = nu[:3]
    n, rudder, plane = control[0] / (2 * pi), control[1], control[2]
    width, advance = 0.14, 0.944 * _length(u, v, w)
    ahead = jnp.where(n > 0, advance / width / 0.6632, 0.0) * abs(n)
    thrust = DENSITY * width**4 * (0.4566 * abs(n) * n + (0.1798 - 0.4566) * ahead)
    torque = DENSITY * width**5 * (0.0700 * abs(n) * n + (0.0312 - 0.0700) * ahead)
    area, at = 2 * 0.00665, -LENGTH / 2
    across, along = 0.5 * DENSITY * area * 0.5 * (u * u + v * v), 0.5 * DENSITY * area * 0.7 * (u * u + w * w)
    side, heave = -across * rudder, -along * plane
    drag = -across * rudder**2 - along * plane**2
    return [0.9 * thrust + drag, side, heave, 0.1 * torque, -at * heave, at * side]


def _lift_and_drag(nu: tuple) -> list[Any]:
    """Return the force of the hull as a wing of low aspect ratio, in the vertical plane."""
    u, v, w = nu[:3]
    area = 0.7 * LENGTH * DIAMETER
    ratio = DIAMETER**2 / area
    angle = jnp.arctan2(w, u)
    lift = pi * ratio / (1 + sqrt(1 + (ratio / 2) ** 2)) * angle
    drag = 0.42 * pi * (DIAMETER / 2) ** 2 / area + lift * lift / (pi * 0.7 * ratio)
    pressure = 0.5 * DENSITY * area * (u * u + v * v + w * w)
    sine, cosine = jnp.sin(angle), jnp.cos(angle)
    return [pressure * (lift * sine - drag * cosine), 0.0, -pressure * (lift * cosine + drag * sine), 0.0, 0.0, 0.0]


def _cross_flow(nu: tuple) -> list[Any]:
    """Return the drag of strips across the hull, each by its own sway velocity, as the simulator's `crossFlowDrag` sums them."""
    width = LENGTH / STRIPS
    side, turn = 0.0, 0.0
    for i in range(STRIPS + 1):
        x = i * width - LENGTH / 2
        local = nu[1] + x * nu[5]
        drag = -0.5 * DENSITY * DIAMETER * CROSS_FLOW * width * local * abs(local)
        side, turn = side + drag, turn + x * drag
    return [0.0, side, 0.0, 0.0, 0.0, turn]


def _added_coriolis(nu: tuple, added: tuple) -> list[Any]:
    """Return -C_A nu of a diagonal added mass, without the entries of the Munk moments."""
    a, b = (
        [m * x for m, x in zip(added[:3], nu[:3], strict=True)],
        [m * x for m, x in zip(added[3:], nu[3:], strict=True)],
    )
    columns = {
        "X": {4: -a[2], 5: a[1]}, "Y": {3: a[2], 5: -a[0]}, "Z": {3: -a[1], 4: a[0]},
        "K": {1: -a[2], 2: a[1], 4: -b[2], 5: b[1]}, "M": {0: a[2], 2: -a[0], 3: b[2], 5: -b[0]},
        "N": {0: -a[1], 1: a[0], 3: -b[1], 4: b[0]},
    }  # fmt: skip
    return [
        sum((entry * nu[j] for j, entry in columns[axis].items() if (axis, j) not in _MUNK), start=0.0) for axis in AXES
    ]


def _plus(a: list[Any], b: list[Any]) -> list[Any]:
    return [x + y for x, y in zip(a, b, strict=True)]


def _length(*parts: Any) -> Any:
    return jnp.sqrt(sum(x * x for x in parts) + exp(-60.0))
