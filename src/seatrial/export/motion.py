"""Accelerations of a vehicle in NumPy, term by term, for a few states at a time and without compilation.

    nudot = (M_RB + M_A)^-1 ( sum c phi + B T - C(nu) nu - g )

The model of `seatrial.vehicles.whole` is the reference; tests compare the two. Fossen, Handbook of Marine Craft Hydrodynamics and
Motion Control, 2nd ed., 2021, eqs. (3.56), (6.43) and (8.1) to (8.4).
"""

from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from jaxtyping import Float

from seatrial.core.coefficients import CoefficientName
from seatrial.core.signals import RATES
from seatrial.export.vehicle import ExportedVehicle
from seatrial.vehicles.hull import AXES
from seatrial.vehicles.thrusters import beyond_dead_zone, real_thrust

Velocity = Float[np.ndarray, "6 *n"]
# (velocities through the water, roll, pitch, controls) to accelerations through it, SI; a current may be among the
# controls.
Motion = Callable[[Velocity, Any, Any, Mapping[str, Any]], Velocity]
# Names under which a motion finds the water's velocity in body axes, m/s; ours needs none, since all its forces are
# through the water.
CURRENT_IN_BODY = ("current_u", "current_v", "current_w")


@lru_cache(maxsize=4)  # one function for one vehicle: a target that keeps it all is known by it
def motion_of(vehicle: ExportedVehicle) -> Motion:
    """Return the accelerations of the vehicle; those of velocities that do not move are zero."""
    return motion_with(vehicle, force_of(vehicle))


def motion_with(vehicle: ExportedVehicle, *forces: Motion) -> Motion:
    """Return the accelerations of the vehicle's mass under forces."""
    moving = [RATES.index(rate) for rate in vehicle.moves]
    inverse = np.linalg.inv((vehicle.rigid_mass + vehicle.added_mass)[np.ix_(moving, moving)])

    def accelerate(nu: Velocity, phi: Any, theta: Any, controls: Mapping[str, Any]) -> Velocity:
        total = np.sum([force(nu, phi, theta, controls) for force in forces], axis=0)
        result = np.zeros_like(np.asarray(nu, float))
        result[moving] = np.tensordot(inverse, total[moving], 1)
        return result

    return accelerate


def force_of(vehicle: ExportedVehicle) -> Motion:
    """Return everything on the right of M nudot = …: named terms, thrust, Coriolis forces, weight and buoyancy."""
    hull = vehicle.hull
    coriolis = vehicle.rigid_mass if hull.mass is not None else np.zeros((6, 6))
    if vehicle.added_coriolis == "automatic":
        coriolis = coriolis + vehicle.added_mass
    named = [(CoefficientName.parse(name), value) for name, value in vehicle.forces.items()]
    thrust = [(name, value) for name, value in named if name.axis == "T"]
    acting = [(AXES.index(name.axis), name, value) for name, value in named if name.axis in AXES]
    share, inflow = 1.0 - hull.thrust_deduction, 1.0 - hull.wake
    righting, law = np.array(hull.righting), vehicle.thrust_law
    pushing = [(one, control, share * np.array(one.column)) for _, one, control in vehicle.acting_thrusters]

    def force(nu: Velocity, phi: Any, theta: Any, controls: Mapping[str, Any]) -> Velocity:
        nu = np.asarray(nu, float)
        known = {**dict(zip(RATES, nu, strict=True)), "phi": phi, "theta": theta, "psi": 0.0, **controls}
        result = -coriolis_force(coriolis, nu) + restoring_force(hull.weight - hull.buoyancy, righting, phi, theta)
        for axis, pull in enumerate(() if hull.tether is None else hull.tether.force(tuple(nu))):
            result[axis] += pull
        for axis, name, value in acting:
            result[axis] += value * name.regressor(known, hull.trim)
        if not vehicle.thrusters and thrust:
            local = {**known, "u": inflow * known["u"]}
            result[0] += share * sum(value * name.regressor(local, hull.trim) for name, value in thrust)
        for thruster, control, column in pushing:
            push = beyond_dead_zone(law, control, controls[control])
            if thrust:
                local = {**known, control[0]: push, "u": inflow * thruster.inflow(tuple(nu))}
                push = sum(value * name.regressor(local, hull.trim) for name, value in thrust)
            push = real_thrust(law, control, push)
            result += np.multiply.outer(column, push)
        return result

    return force


def current_in(controls: Mapping[str, Any]) -> Float[np.ndarray, " 3"]:
    """Return the water's velocity among the controls of a motion, m/s; still water if there is none."""
    return np.array([controls.get(name, 0.0) for name in CURRENT_IN_BODY], float)


def coriolis_force(mass: Float[np.ndarray, "6 6"], nu: Velocity) -> Velocity:
    """Return C(nu) nu of a mass matrix: (omega x P, v x P + omega x L) with (P, L) = M nu."""
    momentum = np.tensordot(mass, nu, 1)
    v, omega, linear, angular = nu[:3], nu[3:], momentum[:3], momentum[3:]
    return np.concatenate([cross(omega, linear), cross(v, linear) + cross(omega, angular)])


def restoring_force(net: float, righting: Float[np.ndarray, " 3"], phi: Any, theta: Any) -> Velocity:
    """Return the force and moment of weight and buoyancy; `net` is W - B and `righting` is r_g W - r_b B.

    Args:
        net: W - B, N.
        righting: r_g W - r_b B, N m, shape (3,).
        phi: roll, rad.
        theta: pitch, rad.
    """
    down = np.array([-np.sin(theta), np.cos(theta) * np.sin(phi), np.cos(theta) * np.cos(phi)])
    return np.concatenate([net * down, cross(righting, down)])


def cross(a: Any, b: Any) -> Any:
    """Return the vector product of arrays whose first axis counts components, shape (3, …)."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
