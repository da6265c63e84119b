"""HoloOcean: the parameters of its torpedo after Fossen, the nearest that its few numbers allow.

The torpedo is a spheroid: mass, length and diameter give inertia, Lamb's added mass and cross-flow; time constants and damping ratios
give linear damping, one drag coefficient the drag ahead. Munk moments are left out, and the vehicle is neutrally buoyant. Its four fins
stand at the end of the spheroid, whatever `x_fin` says, and have one size, lag and limit.
Source: HoloOcean 2, "Fossen-based dynamics" and `fossen_dynamics/{torpedo,actuator,helper_functions}.py`; T. I. Fossen, Handbook of
Marine Craft Hydrodynamics and Motion Control, 2nd ed., 2021, sections 8.4.2 and 9.7, eqs. (8.65) to (8.70).
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from math import degrees, exp, inf, isfinite, log, pi, radians, sqrt
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq

from seatrial.core.errors import InputError
from seatrial.export.manoeuvre import DEFAULT_SPEED, USUAL_FINS, contrary_to
from seatrial.export.motion import Motion, coriolis_force, restoring_force
from seatrial.export.rigid_body import DENSITY, drives_of
from seatrial.export.target import Carried, Exporter, Statement
from seatrial.export.terms import FINS, actuator_losses, added_mass_losses, sorted_terms, term_losses
from seatrial.export.vehicle import ExportedVehicle
from seatrial.vehicles.actuators import Actuator
from seatrial.vehicles.hull import GRAVITY, Hull, rigid_mass_matrix
from seatrial.vehicles.remus100_fossen import CROSS_FLOW, STRIPS

_AREA = 0.7  # Of the wing that lifts as the hull does, by length times diameter
_EFFICIENCY = 0.7  # Of this wing
_ROLL_SHARE = 0.3  # Added inertia in roll by that of the body
# Density by which lift, drag and cross-flow go, whatever the agent's `rho` is, kg/m^3: it stands in the formulas.
WATER = 1026.0


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
    drag: float
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
    """Return Lamb's k of a prolate spheroid along, across and in rotation, by its half length over its radius."""
    e = sqrt(1 - 1 / ratio**2)
    logarithm = log((1 + e) / (1 - e))
    alpha = 2 * (1 - e**2) / e**3 * (0.5 * logarithm - e)
    beta = 1 / e**2 - (1 - e**2) / (2 * e**3) * logarithm
    k3 = e**4 * (beta - alpha) / ((2 - e**2) * (2 * e**2 - (2 - e**2) * (beta - alpha)))
    return alpha / (2 - alpha), beta / (2 - beta), k3


def slenderness(surge: float) -> float:
    """Return the half length over radius of the spheroid whose added mass in surge is this share of its mass, between 0 and 0.5."""
    return float(brentq(lambda ratio: lamb_factors(ratio)[0] - surge, 1.001, 1000.0))


def spheroid_masses(
    mass: float, half: float, radius: float, low: float
) -> tuple[Float[np.ndarray, "6 6"], Float[np.ndarray, "6 6"]]:
    """Return the mass matrices of a spheroid about its centre: of the rigid body, whose centre of gravity lies below it, and added, SI.

    Args:
        mass: kg.
        half: half length, m.
        radius: m.
        low: depth of the centre of gravity below the centre, m.
    """
    k1, k2, k3 = lamb_factors(half / radius)
    roll, pitch = 0.4 * mass * radius**2, 0.2 * mass * (half**2 + radius**2)
    steiner = mass * low**2
    inertia = (roll + steiner, pitch + steiner, pitch)
    rigid = rigid_mass_matrix(Hull("torpedo", mass, inertia, centre_of_gravity=(0.0, 0.0, low)))
    return rigid, np.diag([mass * k1, mass * k2, mass * k2, _ROLL_SHARE * roll, k3 * pitch, k3 * pitch])


def torpedo_motion(t: Torpedo) -> Motion:
    """Return its accelerations, in our axes and with our controls."""
    rigid, added = spheroid_masses(t.mass, t.half_length, t.radius, t.low)
    total = rigid + added
    inverse, weight = np.linalg.inv(total), t.mass * GRAVITY
    roll, pitch = (2 * sqrt(weight * t.low / total[i, i]) for i in (3, 4))
    sway, turning = 1 / t.sway_time, (t.roll_ratio * roll, t.pitch_ratio * pitch, 1 / t.yaw_time)
    shares = (1 / t.surge_time, sway, sway, *turning)
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
    """Return -C_A nu of a diagonal added mass without the entries of the Munk moments, as the simulator has it."""
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
    drag = t.drag * pi * t.radius**2 / area + lift**2 / (pi * _EFFICIENCY * aspect)
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


_NEVER = 1e6  # Time constant, s, of damping that the vehicle does not have
# Rate, m/s and rad/s, at which quadratic damping of pitch, roll and yaw is taken for linear damping of the same power.
_RATE = 0.2
_EQUAL_POWER = 8 / (3 * pi)
_DEFAULTS = {"T_n": 1.0, "nMax": 1525.0, "T_delta": 0.1, "deltaMax_fin_deg": 15.0}  # HoloOcean's own actuators
_UNITS = {"T_n": "s", "nMax": "rpm", "T_delta": "s", "deltaMax_fin_deg": "deg"}


@dataclass(frozen=True)
class HoloOcean(Exporter):
    """See the module; `density` is the water's, kg/m^3."""

    name: str = "holoocean"
    target: str = "HoloOcean 2 (Fossen torpedo, control_scheme 1)"
    density: float = DENSITY
    simulates = "all"

    def check(self, vehicle: ExportedVehicle) -> None:
        """See `Exporter`."""
        super().check(vehicle)
        surge = vehicle.added_mass[0, 0] / vehicle.rigid_mass[0, 0]
        low = vehicle.hull.centre_of_gravity[2] - vehicle.hull.centre_of_buoyancy[2]
        for broken, result, expected in (
            (bool(vehicle.thrusters), f"{len(vehicle.thrusters)} thrusters", "a torpedo with one propeller"),
            (
                not 0 < surge < 0.5,
                f"an added mass of {surge:.3g} of the mass in surge",
                "that of a slender spheroid, 0 to 0.5",
            ),
            (
                low <= 0,
                f"a centre of gravity {low:.3g} m below that of buoyancy",
                "one below it: damping goes by the natural frequency",
            ),
        ):
            if broken:
                raise InputError(
                    f'vehicle "{vehicle.name}", export to {self.name}',
                    found=result,
                    expected=expected,
                    remedy="export to gz or fossen, or feed accelerations into HoloOcean's custom dynamics",
                )

    def carries(self, vehicle: ExportedVehicle) -> Carried:
        """See `Exporter`."""
        torpedo = torpedo_of(vehicle, self.density)
        terms = sorted_terms(vehicle.forces)
        used = {"X_u", "X_uabsu", "T_nabsn", "K_nabsn"}
        limits = actuator_limits(vehicle)
        actuators = _actuators(vehicle, _DEFAULTS | limits)
        lost = [
            f"net buoyancy {vehicle.hull.buoyancy - vehicle.hull.weight:.4g} N: the torpedo is neutral",
            "the centre of buoyancy and the inertia, which follow from the spheroid",
            *added_mass_losses(vehicle, ("X_udot",)),
            *term_losses(
                vehicle, [name for name in vehicle.forces if name not in used and not sorted_terms({name: 1.0}).fin]
            ),
            *actuator_losses(vehicle, actuators),
        ]
        length, thickness = 2 * torpedo.half_length, 2 * torpedo.radius
        changed = [
            f"a spheroid {length:.3g} m long and {thickness:.3g} m thick, with the mass and surge added mass of the vehicle",
            f"damping of roll, pitch and yaw linear, of equal power at {_RATE:g} rad/s; sway and heave by the spheroid's shape",
        ]
        if "X_u" in vehicle.forces:
            speed = vehicle.hull.trim.get("u", DEFAULT_SPEED)
            changed.append(
                f"linear drag ahead fades with speed; the drag coefficient makes drag equal at {speed:.3g} m/s"
            )
        if terms.fin:
            changed.append(
                "fins of equal area in both planes, at the end of the spheroid; their moment is the mean of rudder and stern plane"
            )
        own = ", ".join(f"{key} = {value:g} {_UNITS[key]}" for key, value in _DEFAULTS.items() if key not in limits)
        changed += [f"actuators of HoloOcean for unknown ones of the vehicle: {own}"] if own else []
        changed += _limit_changes(vehicle)
        return Carried(
            torpedo_motion(torpedo),
            tuple(lost),
            tuple(changed),
            actuators,
            reversed=contrary_to(vehicle, USUAL_FINS),
        )

    def write(self, vehicle: ExportedVehicle, statement: Statement) -> dict[str, str]:
        """See `Exporter`."""
        torpedo = torpedo_of(vehicle, self.density)
        content = {
            "about": [
                *statement.lines,
                "merge `agents` into a scenario",
                "u_control: starboard, lower, port and upper fin, rad, and the propeller, rpm; "
                "a rudder d that turns to starboard is 0, -d, 0, d, and a stern plane d that puts the nose down d, 0, -d, 0",
            ],
            "agents": [
                {
                    "agent_name": "auv0",
                    "agent_type": "TorpedoAUV",
                    "fossen_model": "torpedo",
                    "control_scheme": 1,
                    "sensors": [
                        {"sensor_type": "DynamicsSensor", "configuration": {"UseCOM": True, "UseRPY": False}},
                    ],
                    "dynamics": dynamics_table(torpedo),
                    "actuator": actuator_table(torpedo, vehicle),
                }
            ],
        }
        return {"agent.json": json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n"}


def torpedo_of(vehicle: ExportedVehicle, density: float) -> Torpedo:
    """Return the torpedo that is nearest to a vehicle."""
    mass, terms = float(vehicle.rigid_mass[0, 0]), sorted_terms(vehicle.forces)
    ratio = slenderness(vehicle.added_mass[0, 0] / mass)
    radius = (mass / (4 / 3 * pi * density * ratio)) ** (1 / 3)
    half = ratio * radius
    low = vehicle.hull.centre_of_gravity[2] - vehicle.hull.centre_of_buoyancy[2]
    total = np.diag(sum(spheroid_masses(mass, half, radius, low))).tolist()
    # of roll and pitch, by which a damping ratio goes
    critical = [2 * sqrt(mass * GRAVITY * low * inertia) for inertia in total[3:5]]

    def damping(axis: int) -> float:
        """Return positive linear damping of the same power."""
        linear = terms.linear.get((axis, axis), 0.0)
        return -(linear + _EQUAL_POWER * _RATE * terms.modulus.get((axis, axis, axis), 0.0))

    surge, speed = -terms.linear.get((0, 0), 0.0), vehicle.hull.trim.get("u", DEFAULT_SPEED)
    ahead = -terms.modulus.get((0, 0, 0), 0.0) + surge * (1.0 - exp(-3.0 * speed)) / speed
    sway = -terms.linear.get((1, 1), 0.0)
    drives, _ = drives_of(vehicle)
    moments = [abs(terms.fin[key]) for key in ((5, "delta_r"), (4, "delta_s")) if key in terms.fin]
    contrary = contrary_to(vehicle, USUAL_FINS)
    return Torpedo(
        density,
        mass,
        half,
        radius,
        low,
        2 * ahead / (WATER * pi * radius**2),
        total[0] / surge if surge > 0 else _NEVER,
        total[1] / sway if sway > 0 else _NEVER,
        total[5] / damping(5) if damping(5) > 0 else _NEVER,
        max(0.0, damping(3)) / critical[0],
        max(0.0, damping(4)) / critical[1],
        sum(moments) / len(moments) / (density * half) if moments else 0.0,
        drives[0].factor or 0.0 if drives else 0.0,
        vehicle.forces.get("K_nabsn", 0.0),
        -1.0 if "delta_r" in contrary else 1.0,
        -1.0 if "delta_s" in contrary else 1.0,
    )


def dynamics_table(torpedo: Torpedo) -> dict[str, Any]:
    """Return the `dynamics` of the agent."""
    return {
        "rho": torpedo.density,
        "mass": torpedo.mass,
        "length": 2 * torpedo.half_length,
        "diam": 2 * torpedo.radius,
        "r_bg": [0.0, 0.0, torpedo.low],
        "r_bb": [0.0, 0.0, 0.0],
        "r44": _ROLL_SHARE,
        "Cd": torpedo.drag,
        "e": _EFFICIENCY,
        "area_fraction": _AREA,
        "T_surge": torpedo.surge_time,
        "T_sway": torpedo.sway_time,
        "T_yaw": torpedo.yaw_time,
        "zeta_roll": torpedo.roll_ratio,
        "zeta_pitch": torpedo.pitch_ratio,
        "K_nomoto": 0.25,
    }


def actuator_table(torpedo: Torpedo, vehicle: ExportedVehicle) -> dict[str, Any]:
    """Return the agent's `actuator`: four fins of lift slope 1, and a propeller of 0.14 m whose thrust does not fall with the advance."""
    width = 0.14
    thrust = torpedo.thrust * (2 * pi) ** 2 / (torpedo.density * width**4)
    torque = 10 * torpedo.torque * (2 * pi) ** 2 / (torpedo.density * width**5)
    return {
        "fin_count": 4,
        "fin_offset_deg": 0.0,
        "fin_area": torpedo.fin_area,
        "x_fin": -torpedo.half_length,
        "CL_delta": 1.0,
        "D_prop": width,
        "t_prop": 0.0,
        "KT_0": thrust,
        "KT_max": thrust,
        "KQ_0": torque,
        "KQ_max": torque,
        "w": 0.0,
        "Ja_max": 1.0,
        **_DEFAULTS,
        **actuator_limits(vehicle),
    }


def actuator_limits(vehicle: ExportedVehicle) -> dict[str, float]:
    """Return lags, s, and limits, rpm and degrees, as far as they are known: one for all fins, the longest and the narrowest."""
    fins = [vehicle.actuators[name] for name in FINS if name in vehicle.actuators]
    propeller = [vehicle.actuators["n"]] if "n" in vehicle.actuators else []
    results = {
        "T_n": max((one.time_constant for one in propeller), default=0.0),
        "nMax": max((max(abs(one.lower), abs(one.upper)) for one in propeller), default=inf) * 30 / pi,
        "T_delta": max((one.time_constant for one in fins), default=0.0),
        "deltaMax_fin_deg": degrees(min((min(abs(one.lower), abs(one.upper)) for one in fins), default=inf)),
    }
    return {key: value for key, value in results.items() if 0 < value < inf}


def _limit_changes(vehicle: ExportedVehicle) -> list[str]:
    """Return where one limit either way, and one for all fins, is not the vehicle's."""
    known = {name: one for name, one in vehicle.actuators.items() if name in ("n", *FINS)}
    uneven = [name for name, one in known.items() if isfinite(one.upper - one.lower) and one.lower != -one.upper]
    fins = {(one.time_constant, one.lower, one.upper) for name, one in known.items() if name in FINS}
    results = [f"limits of {name} alike either way" for name in uneven]
    return results + (["one lag and limit for all fins, the longest and the narrowest"] if len(fins) > 1 else [])


def _actuators(vehicle: ExportedVehicle, limits: dict[str, float]) -> dict[str, Actuator]:
    top, angle = limits["nMax"] * pi / 30, radians(limits["deltaMax_fin_deg"])
    results = {"n": Actuator(limits["T_n"], -top, top)}
    results |= {name: Actuator(limits["T_delta"], -angle, angle) for name in FINS}
    return {name: actuator for name, actuator in results.items() if name in vehicle.controls}
