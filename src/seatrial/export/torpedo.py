"""HoloOcean's torpedo in numbers: a spheroid with time constants, lift, cross-flow, four fins at its end and a propeller.

T. I. Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2nd ed., 2021, sections 8.4.2 and 9.7, eqs. (8.65) to (8.70),
as HoloOcean 2 has it in `fossen_dynamics/{torpedo,actuator,helper_functions}.py`.
"""

from collections.abc import Mapping
from math import log, pi, sqrt
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import brentq

from seatrial.export.motion import Motion, coriolis_force, restoring_force
from seatrial.vehicles.hull import GRAVITY, Hull, rigid_mass_matrix
from seatrial.vehicles.remus100_fossen import CROSS_FLOW, STRIPS

_AREA = 0.7
WATER = 1026.0
"""Density by which lift, drag and cross-flow go, whatever the agent's `rho` is, kg/m^3: it stands in the formulas."""


class Torpedo(NamedTuple):
    """Its numbers, SI; areas and lift slopes of two fins in each plane, thrust and torque by n|n| with n in rad/s.

    Damping of surge and sway fades with speed. `rudder` is 1 where seatrial's positive rudder turns to starboard, `plane` 1 where its
    positive stern plane puts the nose down, as the torpedo's do, and -1 otherwise.
    """

    density: float
    mass: float
    half_length: float
    radius: float
    low: float
    roll_share: float
    drag: float
    efficiency: float
    surge_time: float
    sway_time: float
    yaw_time: float
    roll_ratio: float
    pitch_ratio: float
    fin_area: float
    thrust: float
    torque: float
    rudder: float
    plane: float


def lamb_factors(ratio: float) -> tuple[float, float, float]:
    """Lamb's k of a prolate spheroid along, across and in rotation, by its half length over its radius."""
    e = sqrt(1 - 1 / ratio**2)
    logarithm = log((1 + e) / (1 - e))
    alpha = 2 * (1 - e**2) / e**3 * (0.5 * logarithm - e)
    beta = 1 / e**2 - (1 - e**2) / (2 * e**3) * logarithm
    k3 = e**4 * (beta - alpha) / ((2 - e**2) * (2 * e**2 - (2 - e**2) * (beta - alpha)))
    return alpha / (2 - alpha), beta / (2 - beta), k3


def slenderness(surge: float) -> float:
    """Half length over radius of the spheroid whose added mass in surge is this share of its mass, between 0 and 0.5."""
    return float(brentq(lambda ratio: lamb_factors(ratio)[0] - surge, 1.001, 1000.0))


def torpedo_motion(t: Torpedo) -> Motion:
    """Its accelerations, in our axes and with our controls."""
    k1, k2, k3 = lamb_factors(t.half_length / t.radius)
    roll, pitch = 0.4 * t.mass * t.radius**2, 0.2 * t.mass * (t.half_length**2 + t.radius**2)
    steiner = t.mass * t.low**2
    rigid = rigid_mass_matrix(
        Hull("torpedo", t.mass, (roll + steiner, pitch + steiner, pitch), centre_of_gravity=(0.0, 0.0, t.low))
    )
    added = np.diag([t.mass * k1, t.mass * k2, t.mass * k2, t.roll_share * roll, k3 * pitch, k3 * pitch])
    total = rigid + added
    inverse, weight = np.linalg.inv(total), t.mass * GRAVITY
    frequencies = [sqrt(weight * t.low / total[i, i]) for i in (3, 4)]
    shares = (
        1 / t.surge_time,
        1 / t.sway_time,
        1 / t.sway_time,
        2 * t.roll_ratio * frequencies[0],
        2 * t.pitch_ratio * frequencies[1],
        1 / t.yaw_time,
    )
    damping = np.diag(total) * np.array(shares)
    righting = np.array([0.0, 0.0, t.low * weight])

    def accelerate(nu: Any, phi: Any, theta: Any, controls: Mapping[str, Any]) -> Any:
        nu = np.asarray(nu, float)
        force = _added_coriolis(np.diag(added), nu) - coriolis_force(rigid, nu)
        force = force + restoring_force(0.0, righting, phi, theta)
        fade = np.exp(-3.0 * sqrt(float(nu[0] ** 2 + nu[1] ** 2 + nu[2] ** 2)))
        force = force - damping * np.array([fade, fade, 1, 1, 1, 1]) * nu
        return inverse @ (force + _lift(t, nu) + _cross_flow(t, nu) + _driven(t, nu, controls))

    return accelerate


def _added_coriolis(added: np.ndarray, nu: np.ndarray) -> np.ndarray:
    """-C_A nu of a diagonal added mass without the entries of the Munk moments, as the simulator has it."""
    a, (_, v, w, p, q, r) = added * nu, nu
    return np.array(
        [
            0.0,
            a[2] * p,
            -a[1] * p,
            -a[2] * v + a[1] * w - a[5] * q + a[4] * r,
            a[5] * p - a[3] * r,
            -a[4] * p + a[3] * q,
        ]
    )


def _lift(t: Torpedo, nu: np.ndarray) -> np.ndarray:
    u, w = nu[0], nu[2]
    area, width = _AREA * 4 * t.half_length * t.radius, 2 * t.radius
    aspect = width**2 / area
    angle = np.arctan2(w, u)
    lift = pi * aspect / (1 + sqrt(1 + (aspect / 2) ** 2)) * angle
    drag = t.drag * pi * t.radius**2 / area + lift**2 / (pi * t.efficiency * aspect)
    pressure = 0.5 * WATER * area * float(nu[:3] @ nu[:3])
    ahead = pressure * (lift * np.sin(angle) - drag * np.cos(angle))
    return np.array([ahead, 0.0, -pressure * (lift * np.cos(angle) + drag * np.sin(angle)), 0.0, 0.0, 0.0])


def _cross_flow(t: Torpedo, nu: np.ndarray) -> np.ndarray:
    width = 2 * t.half_length / STRIPS
    x = np.arange(STRIPS + 1) * width - t.half_length
    local = nu[1] + x * nu[5]
    drag = -0.5 * WATER * 2 * t.radius * CROSS_FLOW * width * local * np.abs(local)
    return np.array([0.0, drag.sum(), 0.0, 0.0, 0.0, x @ drag])


def _driven(t: Torpedo, nu: np.ndarray, controls: Mapping[str, Any]) -> np.ndarray:
    n, rudder = controls.get("n", 0.0), t.rudder * controls.get("delta_r", 0.0)
    plane = t.plane * controls.get("delta_s", 0.0)
    u, v, w = nu[:3]
    side = -t.density * t.fin_area * (u * u + v * v) * rudder
    heave = -t.density * t.fin_area * (u * u + w * w) * plane
    push, twist = t.thrust * n * abs(n), t.torque * n * abs(n)
    return np.array([push, side, heave, twist, t.half_length * heave, -t.half_length * side])
