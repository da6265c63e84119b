"""Stonefish: a box of the displaced volume with the vehicle's mass, inertia, thrusters, and drag of its three directions.

Stonefish computes added mass from the geometry, as that of the ellipsoid of the box's half lengths, and takes the mean of the three
directions; drag is summed over the faces of the mesh, F = rho/2 C_i A v|v| + rho c_i A_t v. The multipliers C and c are fitted here to
the vehicle's drag in surge, sway and heave; drag of rotation is then what the faces make of it. Axes are forward, starboard, down.
Source: Stonefish 1.6, `ScenarioParser.cpp`, `SolidEntity.cpp`, `ActuatorDynamics.h`.
"""

from dataclasses import dataclass, replace
from math import asin, atan2, isfinite, log, pi

import numpy as np
from jaxtyping import Float

from seatrial.core.signals import RATES
from seatrial.export.drives import Drive, drive_name, drives_of
from seatrial.export.exact import DENSITY, body_of, gravity_of
from seatrial.export.kept import actuator_losses, added_mass_losses, term_losses
from seatrial.export.motion import motion_of
from seatrial.export.stability import check_stable
from seatrial.export.target import Carried, Statement
from seatrial.export.terms import sorted_terms
from seatrial.export.vehicle import ExportedVehicle, require_whole
from seatrial.export.xml_text import HEAD, comment, identifier, number, numbers, text
from seatrial.vehicles.actuators import Actuator
from seatrial.vehicles.hull import AXES, GRAVITY

_SPAN = 2.0
"""Length of the box over the distance of a fin or thruster from the origin."""


@dataclass(frozen=True)
class Stonefish:
    """See the module; `density` is the water's, kg/m^3."""

    name: str = "stonefish"
    target: str = "Stonefish 1.6"
    density: float = DENSITY

    def check(self, vehicle: ExportedVehicle) -> None:
        """See `Exporter`."""
        require_whole(vehicle, self.name)
        check_stable(vehicle, self.name)

    def carries(self, vehicle: ExportedVehicle) -> Carried:
        """See `Exporter`."""
        drag, friction = drag_multipliers(vehicle, self.density)
        half, (added, turned) = (
            box(vehicle, self.density),
            geometry_added_mass(box(vehicle, self.density), self.density),
        )
        terms, (drives, thrust) = sorted_terms(vehicle.forces), drives_of(vehicle)
        own = {f"{AXES[i]}_{RATES[i]}abs{RATES[i]}": (i, i, i) for i in range(3)}
        linear = {f"{AXES[i]}_{RATES[i]}": (i, i) for i in range(3)}
        kept = {name: terms.modulus[key] for name, key in own.items() if key in terms.modulus and drag[key[0]] > 0}
        kept |= {
            name: terms.linear[key] for name, key in linear.items() if key in terms.linear and friction[key[0]] > 0
        }
        if drives and drives[0].factor is not None:
            kept |= {name: value for name, value in terms.thrust.items() if name not in thrust}
        rotation = {
            f"{AXES[3 + i]}_{RATES[3 + i]}abs{RATES[3 + i]}": -0.5 * self.density * drag[i] * face_torque(half, i)
            for i in range(3)
        }
        masses = {f"{AXES[i]}_{RATES[i]}dot": -added for i in range(3)}
        masses |= {f"{AXES[3 + i]}_{RATES[3 + i]}dot": -turned[i] for i in range(3)}
        body = body_of(vehicle.rigid_mass)
        hull = replace(vehicle.hull, products=_products_without_axes(vehicle))
        other = replace(vehicle, hull=hull, coefficients={**kept, **rotation, **masses}, added_coriolis="automatic")
        rest = [name for name in vehicle.forces if name not in kept and name not in rotation]
        lost = [
            *added_mass_losses(vehicle),
            *term_losses(vehicle, rest),
            *actuator_losses(vehicle, _actuators(vehicle)),
        ]
        if np.abs(body.inertia - np.diag(np.diag(body.inertia))).max() > 1e-9:
            lost.append("products of inertia")
        changed = [
            f"added mass by the box: {added:.3g} kg in every direction, {turned[1]:.3g} kg m^2 in pitch and {turned[2]:.3g} in yaw",
            f"drag of rotation by the box's faces: {', '.join(f'{name} = {value:.3g}' for name, value in rotation.items())}",
        ]
        return Carried(motion_of(other), tuple(lost), tuple(changed), _actuators(vehicle))

    def write(self, vehicle: ExportedVehicle, statement: Statement) -> dict[str, str]:
        """See `Exporter`."""
        notes = [
            "axes: forward, starboard, down; the box has the displaced volume, not the hull's shape",
            "propeller.obj is to be given: the mesh of a propeller is drawn, and needed for nothing else",
            "added mass cannot be set: give the mesh of the hull in place of the box, and compare the motion again",
        ]
        return {"vehicle.scn": HEAD + comment([*statement.lines, *notes]) + _scenario(self, vehicle)}


def box(vehicle: ExportedVehicle, density: float) -> Float[np.ndarray, " 3"]:
    """Half lengths of a box of the displaced volume, m, as long as the vehicle's fins and thrusters stand apart."""
    volume = vehicle.hull.buoyancy / (density * GRAVITY)
    terms = sorted_terms(vehicle.forces)
    places = [abs(float(drive.place[0])) for drive in drives_of(vehicle)[0]]
    for force, moment, fin in ((1, 5, "delta_r"), (2, 4, "delta_s")):
        if terms.fin.get((force, fin)):
            places.append(abs(terms.fin.get((moment, fin), 0.0) / terms.fin[force, fin]))
    length = max([_SPAN * place for place in places] + [volume ** (1 / 3)])
    side = (volume / length) ** 0.5
    return 0.5 * np.array([length, side, side])


def geometry_added_mass(half: Float[np.ndarray, " 3"], density: float) -> tuple[float, Float[np.ndarray, " 3"]]:
    """Added mass that Stonefish gives the box: kg, the mean of three directions, and kg m^2 about the three axes."""
    x, y, z = half
    ring = 0.5 * (y + z)
    eccentric = 1.0 - ring**2 / x
    if 0 < eccentric < 1:
        part = 2 * (1 - eccentric**2) / eccentric**2 * (0.5 * log((1 + eccentric) / (1 - eccentric)) - eccentric)
        lamb = part / (2 - part)
    else:
        lamb = 1.0
    ball = 4 / 3 * pi * density
    masses = (lamb * ball * x * ring**2, ball * z * z * x, ball * y * y * x)
    turns = np.array([0.0, pi * density * y**2 * x**3 / 12, pi * density * z**2 * x**3 / 12])
    return float(np.mean(masses)), turns


def face_torque(half: Float[np.ndarray, " 3"], axis: int) -> float:
    """Integral of arm^3 over the faces that meet the water in a turn about an axis, m^5; the mesh of 768 triangles is nearly that."""
    others = [i for i in range(3) if i != axis]
    return float(sum(half[axis] * half[i] ** 4 for i in others))


def drag_multipliers(
    vehicle: ExportedVehicle, density: float
) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
    """`quadratic_drag` and `viscous_drag` by which drag in surge, sway and heave comes out; 0 where the vehicle has none."""
    half, terms = box(vehicle, density), sorted_terms(vehicle.forces)
    quadratic, viscous = np.zeros(3), np.zeros(3)
    for i in range(3):
        j, k = (other for other in range(3) if other != i)
        front, side = 4 * half[j] * half[k], 8 * half[i] * (half[j] + half[k])
        quadratic[i] = max(0.0, -2 * terms.modulus.get((i, i, i), 0.0) / (density * front))
        viscous[i] = max(0.0, -terms.linear.get((i, i), 0.0) / (density * side))
    return quadratic, viscous


def _actuators(vehicle: ExportedVehicle) -> dict[str, Actuator]:
    """Those of the thrusters: their lags, and limits that are the same both ways."""
    drives = {drive.control for drive in drives_of(vehicle)[0]}
    found = {}
    for name, one in vehicle.actuators.items():
        top = max(abs(one.lower), abs(one.upper))
        if name in drives:
            found[name] = Actuator(one.time_constant, -top, top)
    return found


def _products_without_axes(vehicle: ExportedVehicle) -> tuple[float, float, float]:
    """Products of inertia about the origin that come from the centre of gravity alone."""
    x, y, z = vehicle.hull.centre_of_gravity
    m = vehicle.hull.mass or 0.0
    return m * x * y, m * x * z, m * y * z


def _scenario(options: Stonefish, vehicle: ExportedVehicle) -> str:
    body, half = body_of(vehicle.rigid_mass), box(vehicle, options.density)
    drag, friction = drag_multipliers(vehicle, options.density)
    name = identifier(vehicle.name)
    lines = [
        "<scenario>",
        "  <environment>",
        '    <ned latitude="0.0" longitude="0.0"/>',
        f'    <ocean>\n      <water density="{number(options.density)}" jerlov="0.2"/>\n      <waves height="0.0"/>\n    </ocean>',
        '    <atmosphere>\n      <sun azimuth="20.0" elevation="50.0"/>\n    </atmosphere>',
        "  </environment>",
        '  <materials>\n    <material name="hull" density="1000.0" restitution="0.5"/>\n  </materials>',
        '  <looks>\n    <look name="hull" gray="0.5" roughness="0.5"/>\n  </looks>',
        f'  <robot name="{text(name)}" fixed="false" self_collisions="false">',
        '    <base_link name="base_link" type="box" physics="submerged" buoyant="true">',
        f'      <dimensions xyz="{numbers(2 * half)}"/>',
        f'      <origin xyz="{numbers(vehicle.hull.centre_of_buoyancy)}" rpy="0 0 0"/>',
        '      <material name="hull"/>\n      <look name="hull"/>',
        f'      <mass value="{number(body.mass)}"/>',
        f'      <inertia xyz="{numbers(np.diag(body.inertia))}"/>',
        f'      <cg xyz="{numbers(body.centre)}" rpy="0 0 0"/>',
        f'      <hydrodynamics viscous_drag="{numbers(friction)}" quadratic_drag="{numbers(drag)}"/>',
        "    </base_link>",
        *(_actuator(vehicle, drive) for drive in drives_of(vehicle)[0]),
        '    <world_transform xyz="0.0 0.0 10.0" rpy="0 0 0"/>',
        "  </robot>",
        f"  <!-- weight {number(vehicle.hull.weight)} N at {number(gravity_of(vehicle))} m/s^2; Stonefish takes {GRAVITY} -->",
        "</scenario>",
    ]
    return "\n".join(lines) + "\n"


def _actuator(vehicle: ExportedVehicle, drive: Drive) -> str:
    actuator = vehicle.actuators.get(drive.control)
    lag = 0.0 if actuator is None else actuator.time_constant
    top = max(abs(drive.lower), abs(drive.upper))
    top = top if isfinite(top) else 1000.0
    x, y, z = drive.direction
    rotor = (
        f'<rotor_dynamics type="first_order">\n        <time_constant value="{number(lag)}"/>\n      </rotor_dynamics>'
        if lag > 0
        else '<rotor_dynamics type="zero_order"/>'
    )
    if drive.factor is None:
        model = (
            f'<thrust_model type="linear_interpolation">\n        <input value="{numbers((-top, top))}"/>\n'
            f'        <output value="{numbers((-top * drive.share, top * drive.share))}"/>\n      </thrust_model>'
        )
    else:
        model = f'<thrust_model type="quadratic">\n        <thrust_coeff value="{number(drive.factor)}"/>\n      </thrust_model>'
    return "\n".join(
        [
            f'    <actuator name="{drive_name(drive)}" type="thruster">',
            '      <link name="base_link"/>',
            f'      <origin xyz="{numbers(drive.place)}" rpy="{numbers((0.0, -asin(max(-1.0, min(1.0, float(z)))), atan2(y, x)))}"/>',
            f'      <specs max_setpoint="{number(top)}" inverted_setpoint="false" normalized_setpoint="false"/>',
            '      <propeller diameter="0.1" right="true">',
            '        <mesh filename="propeller.obj" scale="1.0"/>\n        <material name="hull"/>\n        <look name="hull"/>',
            "      </propeller>",
            f"      {rotor}",
            f"      {model}",
            "    </actuator>",
        ]
    )
