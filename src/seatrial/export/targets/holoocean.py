"""HoloOcean: the parameters of its torpedo after Fossen, the nearest that its few numbers allow.

The torpedo is a spheroid: mass, length and diameter give inertia, Lamb's added mass and cross-flow; time constants and damping ratios
give linear damping, one drag coefficient the drag ahead. Munk moments are left out, and the vehicle is neutrally buoyant.
Source: HoloOcean 2, "Fossen-based dynamics"; T. I. Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2nd ed., 2021,
sections 8.4.2 and 9.7.
"""

import json
from dataclasses import dataclass
from math import degrees, exp, isfinite, pi
from typing import Any

from seatrial.core.errors import InputError
from seatrial.export.drives import drives_of
from seatrial.export.exact import DENSITY
from seatrial.export.kept import actuator_losses, added_mass_losses, term_losses
from seatrial.export.manoeuvre import SPEED
from seatrial.export.stability import check_stable
from seatrial.export.target import Carried, Statement
from seatrial.export.terms import sorted_terms
from seatrial.export.torpedo import Torpedo, lamb_factors, slenderness, torpedo_motion
from seatrial.export.vehicle import ExportedVehicle, require_whole
from seatrial.vehicles.actuators import Actuator

_NEVER = 1e6
"""Time constant, s, of damping that the vehicle does not have."""
_RATE = 0.2
"""Rate, m/s and rad/s, at which quadratic damping of pitch, roll and yaw is taken for linear damping of the same power."""
_EQUAL_POWER = 8 / (3 * pi)


@dataclass(frozen=True)
class HoloOcean:
    """See the module; `density` is the water's, kg/m^3."""

    name: str = "holoocean"
    target: str = "HoloOcean 2 (Fossen torpedo, control_scheme 1)"
    density: float = DENSITY

    def check(self, vehicle: ExportedVehicle) -> None:
        """See `Exporter`."""
        require_whole(vehicle, self.name)
        check_stable(vehicle, self.name)
        surge = vehicle.added_mass[0, 0] / (vehicle.hull.mass or 1.0)
        low = vehicle.hull.centre_of_gravity[2] - vehicle.hull.centre_of_buoyancy[2]
        for broken, found, expected in (
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
                    found=found,
                    expected=expected,
                    remedy="export to gz or fossen, or feed accelerations into HoloOcean's custom dynamics",
                )

    def carries(self, vehicle: ExportedVehicle) -> Carried:
        """See `Exporter`."""
        torpedo = torpedo_of(vehicle, self.density)
        terms = sorted_terms(vehicle.forces)
        used = {"X_u", "X_uabsu", "T_nabsn", "K_nabsn"}
        lost = [
            f"net buoyancy {vehicle.hull.buoyancy - vehicle.hull.weight:.4g} N: the torpedo is neutral",
            "the centre of buoyancy and the inertia, which follow from the spheroid",
            *added_mass_losses(vehicle, ("X_udot",)),
            *term_losses(
                vehicle, [name for name in vehicle.forces if name not in used and not sorted_terms({name: 1.0}).fin]
            ),
            *actuator_losses(vehicle, _actuators(vehicle)),
        ]
        length, thickness = 2 * torpedo.half_length, 2 * torpedo.radius
        changed = [
            f"a spheroid {length:.3g} m long and {thickness:.3g} m thick, of the vehicle's mass and surge added mass",
            f"damping of roll, pitch and yaw linear, of equal power at {_RATE:g} rad/s; sway and heave by the spheroid's shape",
        ]
        if "X_u" in vehicle.forces:
            speed = vehicle.hull.trim.get("u", SPEED)
            changed.append(
                f"linear drag ahead fades with speed; the drag coefficient makes drag equal at {speed:.3g} m/s"
            )
        if terms.fin:
            changed.append(
                "fins of equal area in both planes, with drag; their lift is the mean of rudder and stern plane"
            )
        return Carried(torpedo_motion(torpedo), tuple(lost), tuple(changed), _actuators(vehicle))

    def write(self, vehicle: ExportedVehicle, statement: Statement) -> dict[str, str]:
        """See `Exporter`."""
        content = {
            "about": [
                *statement.lines,
                "merge `agents` into a scenario; a positive rudder turns to starboard, as HoloOcean has it",
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
                    "dynamics": dynamics_table(torpedo_of(vehicle, self.density), vehicle),
                    "actuator": actuator_table(torpedo_of(vehicle, self.density), vehicle),
                }
            ],
        }
        return {"agent.json": json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n"}


def torpedo_of(vehicle: ExportedVehicle, density: float) -> Torpedo:
    """The torpedo that is nearest to a vehicle."""
    mass, terms = vehicle.hull.mass or 1.0, sorted_terms(vehicle.forces)
    ratio = slenderness(vehicle.added_mass[0, 0] / mass)
    radius = (mass / (4 / 3 * pi * density * ratio)) ** (1 / 3)
    half = ratio * radius
    low = vehicle.hull.centre_of_gravity[2] - vehicle.hull.centre_of_buoyancy[2]
    k1, k2, k3 = lamb_factors(ratio)
    roll, pitch = 0.4 * mass * radius**2, 0.2 * mass * (half**2 + radius**2)
    total_roll, total_pitch = roll + mass * low**2 + 0.3 * roll, pitch + mass * low**2 + k3 * pitch
    total_yaw = pitch + k3 * pitch
    frequency = [(mass * 9.81 * low / inertia) ** 0.5 for inertia in (total_roll, total_pitch)]

    def damping(axis: int) -> float:
        """Positive linear damping of the same power."""
        linear = terms.linear.get((axis, axis), 0.0)
        return -(linear + _EQUAL_POWER * _RATE * terms.modulus.get((axis, axis, axis), 0.0))

    surge, speed = -terms.linear.get((0, 0), 0.0), vehicle.hull.trim.get("u", SPEED)
    ahead = -terms.modulus.get((0, 0, 0), 0.0) + surge * (1.0 - exp(-3.0 * speed)) / speed
    sway = -terms.linear.get((1, 1), 0.0)
    drives, _ = drives_of(vehicle)
    lifts = [abs(terms.fin[key]) for key in ((1, "delta_r"), (2, "delta_s")) if key in terms.fin]
    places = [
        abs(terms.fin.get((moment, fin), 0.0) / terms.fin[force, fin])
        for force, moment, fin in ((1, 5, "delta_r"), (2, 4, "delta_s"))
        if terms.fin.get((force, fin))
    ]
    return Torpedo(
        density,
        mass,
        half,
        radius,
        low,
        0.3,
        2 * ahead / (density * pi * radius**2),
        0.7,
        mass * (1 + k1) / surge if surge > 0 else _NEVER,
        mass * (1 + k2) / sway if sway > 0 else _NEVER,
        total_yaw / damping(5) if damping(5) > 0 else _NEVER,
        max(0.0, damping(3)) / (2 * frequency[0] * total_roll),
        max(0.0, damping(4)) / (2 * frequency[1] * total_pitch),
        float(sum(lifts) / len(lifts)) / density if lifts else 0.0,
        -float(sum(places) / len(places)) if places else 0.0,
        drives[0].factor or 0.0 if drives else 0.0,
        vehicle.forces.get("K_nabsn", 0.0),
        1.0 if terms.fin.get((5, "delta_r"), -1.0) > 0 else -1.0,
    )


def dynamics_table(torpedo: Torpedo, vehicle: ExportedVehicle) -> dict[str, Any]:
    """The `dynamics` of the agent."""
    return {
        "rho": torpedo.density,
        "mass": torpedo.mass,
        "length": 2 * torpedo.half_length,
        "diam": 2 * torpedo.radius,
        "r_bg": [0.0, 0.0, torpedo.low],
        "r_bb": [0.0, 0.0, 0.0],
        "r44": torpedo.roll_share,
        "Cd": torpedo.drag,
        "e": torpedo.efficiency,
        "area_fraction": 0.7,
        "T_surge": torpedo.surge_time,
        "T_sway": torpedo.sway_time,
        "T_yaw": torpedo.yaw_time,
        "zeta_roll": torpedo.roll_ratio,
        "zeta_pitch": torpedo.pitch_ratio,
        "K_nomoto": 0.25,
    }


def actuator_table(torpedo: Torpedo, vehicle: ExportedVehicle) -> dict[str, Any]:
    """The `actuator` of the agent: four fins of lift slope 1, and a propeller of 0.14 m whose thrust does not fall with the advance."""
    width = 0.14
    thrust = torpedo.thrust * (2 * pi) ** 2 / (torpedo.density * width**4)
    torque = 10 * torpedo.torque * (2 * pi) ** 2 / (torpedo.density * width**5)
    found: dict[str, Any] = {
        "fin_count": 4,
        "fin_offset_deg": 0.0,
        "fin_area": torpedo.fin_area,
        "x_fin": torpedo.fin_place,
        "CL_delta": 1.0,
        "D_prop": width,
        "t_prop": 0.0,
        "KT_0": thrust,
        "KT_max": thrust,
        "KQ_0": torque,
        "KQ_max": torque,
        "w": 0.0,
        "Ja_max": 1.0,
    }
    fin = _fin(vehicle)
    if fin is not None and isfinite(fin.upper):
        found |= {"deltaMax_fin_deg": degrees(fin.upper)}
    if fin is not None and fin.time_constant > 0:
        found |= {"T_delta": fin.time_constant}
    propeller = vehicle.actuators.get("n")
    if propeller is not None and isfinite(propeller.upper):
        found |= {"nMax": propeller.upper * 30 / pi}
    if propeller is not None and propeller.time_constant > 0:
        found |= {"T_n": propeller.time_constant}
    return found


def _fin(vehicle: ExportedVehicle) -> Actuator | None:
    """The actuator that all fins get."""
    return vehicle.actuators.get("delta_s") or vehicle.actuators.get("delta_r")


def _actuators(vehicle: ExportedVehicle) -> dict[str, Actuator]:
    """Those of the agent: limits that are the same both ways, lags, no rates."""
    given = {"n": vehicle.actuators.get("n"), "delta_r": _fin(vehicle), "delta_s": _fin(vehicle)}
    return {name: Actuator(one.time_constant, -one.upper, one.upper) for name, one in given.items() if one is not None}
