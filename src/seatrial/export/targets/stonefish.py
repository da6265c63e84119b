"""Stonefish: a box with the vehicle's weight, buoyancy and turning inertia, its thrusters and fins, and drag matched at one speed.

A face of the box's mesh, with centre r from the centre of gravity, normal n and area A, meets the water at v_c = -(v + omega x r):

    f = A |v_c| v_c max(0, -v_c . n)        s = A (v_c - (v_c . n) n)
    F = rho/2 C_F sum f + rho c_F sum s     C_F = (|F_x| C_x + |F_y| C_y + |F_z| C_z) / |F|,  F = sum f

Moments alike, weighed by their own direction. So drag is linear and cubic in speed: c |u| u becomes the straight line and the cubic that
equal it at half the matched speed and at that speed. Added mass is that of an ellipsoid about the box, as the mean of three directions.
Source: Stonefish 1.6 (b21eb8e), `ScenarioParser.cpp`, `SolidEntity.cpp`, `OpenGLContent.cpp`, `ActuatorDynamics.h`, `Rudder.cpp`; 1.4 and
1.5 compute the same. Before 1.4 drag was quadratic and thrusters were written otherwise: those versions do not read these files.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from math import asin, atan2, isfinite, log, pi
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import brentq

from seatrial.core.signals import RATES
from seatrial.export.manoeuvre import DEFAULT_SPEED, plan_for
from seatrial.export.motion import Motion, force_of, motion_of, motion_with
from seatrial.export.rigid_body import DENSITY, Drive, Fin, body_of, box_of, drive_name, drives_of, fins_of
from seatrial.export.target import Carried, Exporter, Statement
from seatrial.export.terms import (
    actuator_losses,
    added_mass_losses,
    sorted_terms,
    term_losses,
    thrust_law_losses,
    with_gains,
)
from seatrial.export.vehicle import ExportedVehicle
from seatrial.export.xml_text import XML_HEAD, comment, identifier, number, numbers, text
from seatrial.vehicles.actuators import Actuator
from seatrial.vehicles.hull import AXES, GRAVITY

_SUBDIVISIONS = 3  # How often Stonefish cuts each triangle of a box into four
_TOLERANCE, _ITERATIONS = 1.2 ** (2 / 3) - 1, 10  # Where Stonefish ends its search for an ellipsoid about the box
# Share of quadratic drag that becomes a straight line; the rest becomes a cubic, and both agree with it at half the
# matched speed.
_LINEAR = 1 / 3
# Share of the vehicle's own inertia that is written at least, where Stonefish adds more than the vehicle has.
_MIN_INERTIA_SHARE = 0.1
_HULL = "hull_"  # Before the name of a fixed fin that stands for lift of the hull
_FIN_LIMIT = pi / 2  # Greatest angle of a fin whose limit is not known


@dataclass(frozen=True)
class Stonefish(Exporter):
    """See the module; `density` is the water's, kg/m^3."""

    name: str = "stonefish"
    target: str = "Stonefish 1.4 to 1.6 (checked in 1.6)"
    density: float = DENSITY
    simulates = "all"

    def carries(self, vehicle: ExportedVehicle) -> Carried:
        """See `Exporter`."""
        solid, actuators = solid_of(vehicle, self.density), _actuators(vehicle)
        rest = [name for name in vehicle.forces if name not in _named(vehicle, solid)]
        kept = np.isclose(solid.inertia + solid.turned, _turning_inertia(vehicle), rtol=1e-9)
        lost = [
            *added_mass_losses(vehicle, [f"{AXES[3 + i]}_{RATES[3 + i]}dot" for i in range(3) if kept[i]]),
            *term_losses(vehicle, rest),
            *thrust_law_losses(vehicle),
            *actuator_losses(vehicle, actuators),
        ]
        inertia = body_of(vehicle.rigid_mass).inertia
        if np.abs(inertia - np.diag(np.diag(inertia))).max() > 1e-9:
            lost.append("products of inertia")
        matched = "surge, and as much in all directions" if solid.cruises else "surge, sway and heave"
        changed = [
            f"added mass by an ellipsoid about the box: {solid.added:.3g} kg in every direction, without moments on a body under way",
            f"drag by the box's faces, linear and cubic in speed, matched at {solid.speed:.3g} m/s in {matched}; it mixes the three "
            "directions, and drag of rotation follows from it",
        ]
        fins = [f"{', '.join(_fin_terms(fin))} at x = {fin.place:.3f} m" for fin in rudders_of(vehicle)]
        if fins:
            changed.append("; ".join(fins) + ": lift and drag of a fin, by its angle to the local flow")
        return Carried(solid_motion(vehicle, solid, self.density), tuple(lost), tuple(changed), actuators)

    def write(self, vehicle: ExportedVehicle, statement: Statement) -> dict[str, str]:
        """See `Exporter`."""
        notes = [
            "for Stonefish 1.4 to 1.6; older versions have another law of drag and do not read these thrusters",
            "axes: forward, starboard, down; the box has the displaced volume, not the hull's shape",
            "inertia: such that a moment turns the box as it turns the vehicle; minus the inertia that Stonefish adds",
            "part.obj is only drawn, for propellers and fins",
            "added mass cannot be set: a mesh of the hull instead of the box changes it and the drag; compare the motion again",
        ]
        head = [*statement.lines, *notes]
        return {
            "vehicle.scn": XML_HEAD + comment(head) + _scenario(self, vehicle),
            "part.obj": "".join(f"# {line}\n" for line in head) + _PART,
        }


class Mesh(NamedTuple):
    """Triangles: vertices (m, 3) and faces (n, 3) of their numbers."""

    vertices: Float[np.ndarray, "m 3"]
    faces: Int[np.ndarray, "n 3"]


class Solid(NamedTuple):
    """What the file says of the body, and what Stonefish makes of it; SI, axes forward, starboard, down from the origin.

    Attributes:
        half: half lengths of the box.
        mass: kg.
        centre: of gravity.
        floats: centre of the box, where buoyancy acts.
        inertia: as written, about the centre of gravity.
        added: kg, in every direction.
        turned: added inertia about the three axes.
        speed: m/s, at which drag is matched.
        cruises: whether the vehicle goes ahead at that speed, and one multiplier stands in all directions.
        quadratic: multipliers of the cubic part.
        viscous: multipliers of the linear part.
    """

    half: Float[np.ndarray, " 3"]
    mass: float
    centre: Float[np.ndarray, " 3"]
    floats: Float[np.ndarray, " 3"]
    inertia: Float[np.ndarray, " 3"]
    added: float
    turned: Float[np.ndarray, " 3"]
    speed: float
    cruises: bool
    quadratic: Float[np.ndarray, " 3"]
    viscous: Float[np.ndarray, " 3"]


def solid_of(vehicle: ExportedVehicle, density: float) -> Solid:
    """Return the box that stands for a vehicle.

    Stonefish's gravity is 9.81 m/s^2: buoyancy and its place are such that net force and righting moment are the vehicle's.
    """
    body = body_of(vehicle.rigid_mass)
    weight = body.mass * GRAVITY
    buoyancy = weight - (vehicle.hull.weight - vehicle.hull.buoyancy)
    places = [float(drive.place[0]) for drive in drives_of(vehicle)[0]] + [fin.place for fin in rudders_of(vehicle)]
    half = 0.5 * box_of(buoyancy / (density * GRAVITY), places)
    added, turned = geometry_added_mass(enclosing_ellipsoid(box_mesh(half).vertices), density)
    inertia = np.maximum(_turning_inertia(vehicle) - turned, _MIN_INERTIA_SHARE * np.diag(body.inertia))
    floats = (body.centre * weight - np.array(vehicle.hull.righting)) / buoyancy
    speed, cruises = matched_speed(vehicle)
    quadratic, viscous = drag_multipliers(vehicle, half, density, speed, cruises)
    return Solid(half, body.mass, body.centre, floats, inertia, added, turned, speed, cruises, quadratic, viscous)


def box_mesh(half: Float[np.ndarray, " 3"]) -> Mesh:
    """Return Stonefish's mesh of a box: 768 triangles, whose 486 vertices stand in its order, on which the ellipsoid depends."""
    signs, faces = _unit_mesh()
    return Mesh(signs * np.asarray(half, np.float32).astype(float), faces)


def enclosing_ellipsoid(points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, " 3"]:
    """Return the half axes of the ellipsoid that Stonefish finds about points, by axes of the body.

    P. Kumar and E. A. Yildirim, Computing Minimum-Volume Enclosing Axis-Aligned Ellipsoids, J. Optim. Theory Appl. 136 (2008) 211,
    ended early: a point may lie outside, and the centre aside.
    """
    low, high = np.argmin(points, axis=0), len(points) - 1 - np.argmax(points[::-1], axis=0)
    core = points[np.concatenate([low, high])]
    weights = np.where((points[:, None] == core).all(axis=2).any(axis=1), 1 / 6, 0.0)

    def spread() -> Float[np.ndarray, " 3"]:
        return 3 * (weights @ points**2 - (weights @ points) ** 2)

    for step in range(_ITERATIONS):
        outside = ((points - weights @ points) ** 2 / spread()).sum(axis=1)
        worst = int(np.argmax(outside))
        excess = outside[worst] - 1
        if excess <= _TOLERANCE:
            return np.sqrt(spread()) if step else 0.5 * np.ptp(points, axis=0)
        share = excess / (4 * (1 + excess))
        weights *= 1 - share
        weights[worst] += share
    return np.sqrt(spread())


def geometry_added_mass(axes: Float[np.ndarray, " 3"], density: float) -> tuple[float, Float[np.ndarray, " 3"]]:
    """Return the added mass that Stonefish gives an ellipsoid of these half axes: kg, a mean of three directions, and kg m^2."""
    x, y, z = axes
    ring = 0.5 * (y + z)
    eccentric = 1.0 - ring**2 / x
    lamb = 1.0
    if -1 < eccentric < 1:
        part = 2 * (1 - eccentric**2) / eccentric**2 * (0.5 * log((1 + eccentric) / (1 - eccentric)) - eccentric)
        lamb = part / (2 - part)
    ball = 4 / 3 * pi * density
    masses = (lamb * ball * x * ring**2, ball * z * z * x, ball * y * y * x)
    turns = np.array([0.0, pi * density * y**2 * x**3 / 12, pi * density * z**2 * x**3 / 12])
    return float(np.mean(masses)), turns


def matched_speed(vehicle: ExportedVehicle) -> tuple[float, bool]:
    """Return the speed ahead in the standard manoeuvre, m/s, and whether the vehicle cruises at it or is pushed up to it from rest."""
    motion = motion_of(vehicle)
    plan = plan_for(vehicle, motion)
    if plan.speed > 0:
        return plan.speed, True
    pushed = plan.controls(3.0)

    def surge(u: float) -> float:
        return float(motion(np.array([u, 0.0, 0.0, 0.0, 0.0, 0.0]), 0.0, 0.0, pushed)[0])

    held = surge(0.0) > 0 > surge(10.0)
    return (float(brentq(surge, 0.0, 10.0)) if held else DEFAULT_SPEED), False


def drag_multipliers(
    vehicle: ExportedVehicle, half: Float[np.ndarray, " 3"], density: float, speed: float, cruises: bool
) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
    """Return `quadratic_drag` and `viscous_drag`, which give the vehicle's drag in surge, sway and heave at a speed; 0 if it has none.

    Drag that is larger across than ahead would brake a vehicle that slips a little on its way: where it cruises, the multiplier of surge
    stands in all directions.

    Args:
        vehicle: whose drag is sought.
        half: half axes of the box, m.
        density: of the water, kg/m^3.
        speed: m/s.
        cruises: whether it goes ahead.
    """
    terms = sorted_terms(vehicle.forces)
    quadratic, viscous = np.zeros(3), np.zeros(3)
    for i in range(3):
        j, k = (other for other in range(3) if other != i)
        front, side = 4 * half[j] * half[k], 8 * half[i] * (half[j] + half[k])
        square, straight = max(0.0, -terms.modulus.get((i, i, i), 0.0)), -terms.linear.get((i, i), 0.0)
        share = 0.0 if cruises and i > 0 else _LINEAR
        quadratic[i] = 2 * (1 - share) * square / (density * front * speed)
        viscous[i] = max(0.0, straight + share * square * speed) / (density * side)
    return np.full(3, quadratic[0]) if cruises else quadratic, viscous


def solid_motion(vehicle: ExportedVehicle, solid: Solid, density: float) -> Motion:
    """Return the accelerations of the box in Stonefish, with the vehicle's thrusters and fins.

    Args:
        vehicle: with its thrusters and fins.
        solid: the box that stands for its hull.
        density: of the water, kg/m^3.
    """
    total, (x, y, z) = solid.mass + solid.added, (float(part) for part in solid.centre)
    about = solid.inertia + solid.turned + total * (solid.centre @ solid.centre - solid.centre**2)
    weight = solid.mass * GRAVITY
    hull = replace(
        vehicle.hull,
        mass=total,
        inertia=tuple(float(part) for part in about),
        products=(total * x * y, total * x * z, total * y * z),
        centre_of_gravity=(x, y, z),
        centre_of_buoyancy=tuple(float(part) for part in solid.floats),
        weight=weight,
        buoyancy=weight - (vehicle.hull.weight - vehicle.hull.buoyancy),
    )
    drives, other = drives_of(vehicle)
    thrust = {name: value for name, value in sorted_terms(vehicle.forces).thrust.items() if name not in other}
    moved = replace(with_gains(vehicle), hull=hull, coefficients=thrust if drives else {}, added_coriolis="named")
    return motion_with(
        moved, force_of(moved), drag_force(solid, density), *(rudder_force(fin) for fin in rudders_of(vehicle))
    )


def drag_force(solid: Solid, density: float) -> Motion:
    """Return the drag of the box's faces, about the origin; see the module."""
    mesh = box_mesh(solid.half)
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = 0.5 * np.linalg.norm(normals, axis=1)
    normals = normals / (2 * areas)[:, None]
    places = corners.mean(axis=1) + solid.floats
    arms = places - solid.centre
    turning = np.cross(places[:, :, None], np.eye(3)[None], axis=1)

    def force(nu: Any, phi: Any, theta: Any, controls: Mapping[str, Any]) -> Any:
        nu = np.asarray(nu, float)
        if nu.ndim > 1:
            return np.stack([force(column, phi, theta, controls) for column in nu.T], axis=1)
        water = turning @ nu[3:] - nu[:3]
        across = np.einsum("ij,ij->i", water, normals)
        speed = np.sqrt(np.einsum("ij,ij->i", water, water))
        push = (areas * speed * np.maximum(0.0, -across))[:, None] * water
        skin = areas[:, None] * (water - across[:, None] * normals)
        result = np.zeros(6)
        for faces, by in ((push, 0.5 * density * solid.quadratic), (skin, density * solid.viscous)):
            result[:3] += _weighed(faces.sum(axis=0), by)
            spread = arms.T @ faces
            result[3:] += _weighed(np.array([spread[i - 2, i - 1] - spread[i - 1, i - 2] for i in range(3)]), by)
        result[3:] += np.cross(solid.centre, result[:3])
        return result

    return force


def rudder_force(fin: Fin) -> Motion:
    """Return the force of Stonefish's rudder: lift by the angle to the local flow, and a drag by its square."""
    strength, x = abs(fin.lift), fin.place

    def force(nu: Any, phi: Any, theta: Any, controls: Mapping[str, Any]) -> Any:
        u, v, w, _, q, r = np.asarray(nu, float)
        local = np.array([u, v + r * x, w - q * x])
        ahead, across, speed = local[0], local[fin.axis], np.sqrt((local**2).sum(axis=0))
        turned = np.copysign(1.0, fin.lift) * np.asarray(controls.get(fin.control, 0.0))
        angle = np.arctan2(across, ahead) - turned
        angle = angle - pi * np.round(angle / pi)
        flow, still = np.hypot(ahead, across), np.finfo(float).tiny
        lift = strength * angle * speed**2 / np.maximum(flow, still)
        push = -strength * angle**2 * speed * local
        push[0] += lift * across
        push[fin.axis] -= lift * ahead
        return np.concatenate([push, [np.zeros_like(u), -x * push[2], x * push[1]]])

    return force


def rudders_of(vehicle: ExportedVehicle) -> tuple[Fin, ...]:
    """Return the fins that turn, and at the origin fixed ones that give the lift Y_uv and Z_uw that those leave."""
    terms = sorted_terms(vehicle.forces)
    result = fins_of(terms)[0]
    rest = {
        axis: -terms.product.get((axis, 0, axis), 0.0) - sum(abs(fin.lift) for fin in result if fin.axis == axis)
        for axis in (1, 2)
    }
    return result + tuple(Fin(f"{_HULL}{RATES[axis]}", axis, lift, 0.0) for axis, lift in rest.items() if lift > 0)


def _weighed(vector: Float[np.ndarray, " 3"], by: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 3"]:
    """Return a vector times the multiplier of its direction."""
    length = np.linalg.norm(vector)
    return (np.abs(vector) @ by / length) * vector if length > 0 else vector


def _fin_terms(fin: Fin) -> tuple[str, ...]:
    """Return the forces of the vehicle that a fin stands for."""
    axis = AXES[fin.axis]
    if fin.control.startswith(_HULL):
        return (f"{axis}_u{RATES[fin.axis]}",)
    return f"{axis}_uu{fin.control}", f"{AXES[6 - fin.axis]}_uu{fin.control}"


def _named(vehicle: ExportedVehicle, solid: Solid) -> set[str]:
    """Return the forces of the vehicle that the target has in one form or another."""
    terms = sorted_terms(vehicle.forces)
    drives, other = drives_of(vehicle)
    results = {name for name in terms.thrust if drives and name not in other}
    results |= {name for fin in rudders_of(vehicle) for name in _fin_terms(fin)}
    for i in range(6):
        own = f"{AXES[i]}_{RATES[i]}"
        results |= {f"{own}abs{RATES[i]}"} if i in (0, 3, 4, 5) or not solid.cruises else set()
        results |= {own}
    return results


def _turning_inertia(vehicle: ExportedVehicle) -> Float[np.ndarray, " 3"]:
    """Return the moment by the angular acceleration that it gives the vehicle, about each axis: its added mass and couplings count."""
    return 1.0 / np.diag(np.linalg.inv(vehicle.rigid_mass + vehicle.added_mass))[3:]


def _actuators(vehicle: ExportedVehicle) -> dict[str, Actuator]:
    """Return those of the thrusters, with their lags, and of the fins, which act at once; limits are the same both ways."""
    drives, fins = {drive.control for drive in drives_of(vehicle)[0]}, {fin.control for fin in rudders_of(vehicle)}
    results = {}
    for name, one in vehicle.actuators.items():
        top = max(abs(one.lower), abs(one.upper))
        if name in drives:
            results[name] = Actuator(one.time_constant, -top, top)
        elif name in fins:
            results[name] = Actuator(0.0, -top, top)
    return results


@lru_cache(1)
def _unit_mesh() -> Mesh:
    """Return a cube of half length 1: six faces of two triangles, each cut into four three times; new vertices are of edges, as met."""
    corners = ((-1, -1, -1), (-1, 1, -1), (1, 1, -1), (1, -1, -1), (1, 1, 1), (1, -1, 1), (-1, -1, 1), (-1, 1, 1))
    quads = ((0, 1, 2, 3), (3, 2, 4, 5), (6, 7, 1, 0), (5, 4, 7, 6), (4, 2, 1, 7), (3, 5, 6, 0))
    vertices = [np.array(corners[i], float) for quad in quads for i in quad]
    faces = [(4 * i, 4 * i + j, 4 * i + j + 1) for i in range(6) for j in (1, 2)]
    for _ in range(_SUBDIVISIONS):
        faces = _cut(vertices, faces)
    return Mesh(np.array(vertices), np.array(faces))


def _cut(vertices: list[Float[np.ndarray, " 3"]], faces: list[tuple[int, int, int]]) -> list[tuple[int, int, int]]:
    """Cut each triangle into four at the middles of its edges, which are added to the vertices."""
    middles: dict[tuple[int, int], int] = {}

    def middle(one: int, other: int) -> int:
        edge = (min(one, other), max(one, other))
        if edge not in middles:
            middles[edge] = len(vertices)
            vertices.append((vertices[one] + vertices[other]) / 2)
        return middles[edge]

    results = []
    for a, b, c in faces:
        ab, bc, ca = middle(a, b), middle(b, c), middle(c, a)
        results += [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
    return results


# A plate of 2 x 10 x 10 cm.
_PART = "".join(f"v {x} {y} {z}\n" for x in (-0.01, 0.01) for y in (-0.05, 0.05) for z in (-0.05, 0.05)) + "".join(
    f"f {a} {b} {c}\n"
    for a, b, c in ("124", "143", "578", "586", "156", "162", "348", "387", "137", "175", "268", "284")
)


def _scenario(options: Stonefish, vehicle: ExportedVehicle) -> str:
    solid, name = solid_of(vehicle, options.density), identifier(vehicle.name)
    lines = [
        "<scenario>",
        '  <solver>\n    <fluid_dynamics prescaler="1"/>\n  </solver>',
        "  <environment>",
        '    <ned latitude="0.0" longitude="0.0"/>',
        f'    <ocean>\n      <water density="{number(options.density)}" jerlov="0.2"/>\n      <waves height="0.0"/>\n    </ocean>',
        '    <atmosphere>\n      <sun azimuth="20.0" elevation="50.0"/>\n    </atmosphere>',
        "  </environment>",
        '  <materials>\n    <material name="hull" density="1000.0" restitution="0.5"/>\n  </materials>',
        '  <looks>\n    <look name="hull" gray="0.5" roughness="0.5"/>\n  </looks>',
        f'  <robot name="{text(name)}" fixed="false" self_collisions="false">',
        '    <base_link name="base_link" type="box" physics="submerged" buoyant="true">',
        f'      <dimensions xyz="{numbers(2 * solid.half)}"/>',
        f'      <origin xyz="{numbers(solid.floats)}" rpy="0 0 0"/>',
        '      <material name="hull"/>\n      <look name="hull"/>',
        f'      <mass value="{number(solid.mass)}"/>',
        f'      <inertia xyz="{numbers(solid.inertia)}"/>',
        f'      <cg xyz="{numbers(solid.centre)}" rpy="0 0 0"/>',
        f'      <hydrodynamics viscous_drag="{numbers(solid.viscous)}" quadratic_drag="{numbers(solid.quadratic)}"/>',
        "    </base_link>",
        *(_thruster(vehicle, drive) for drive in drives_of(vehicle)[0]),
        *(_rudder(vehicle, fin, options.density) for fin in rudders_of(vehicle)),
        '    <world_transform xyz="0.0 0.0 10.0" rpy="0 0 0"/>',
        "  </robot>",
        "</scenario>",
    ]
    return "\n".join(lines) + "\n"


def _thruster(vehicle: ExportedVehicle, drive: Drive) -> str:
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
            f"        {_DRAWN}",
            "      </propeller>",
            f"      {rotor}",
            f"      {model}",
            "    </actuator>",
        ]
    )


_DRAWN = '<mesh filename="part.obj" scale="1.0"/>\n        <material name="hull"/>\n        <look name="hull"/>'


def _rudder(vehicle: ExportedVehicle, fin: Fin, density: float) -> str:
    """Return a fin of 1 m^2, of which only the product of area and lift counts; a stern plane lies on its side, across towards the keel."""
    actuator = vehicle.actuators.get(fin.control, Actuator(0.0))
    top = min(_FIN_LIMIT, max(abs(actuator.lower), abs(actuator.upper)))
    roll = 0.0 if fin.axis == 1 else pi / 2
    specs = {
        "area": 1.0,
        "lift_coeff": 2 * abs(fin.lift) / density,
        "drag_coeff": 0.0,
        "max_angle": top,
        "stall_angle": 2.0,
    }
    shown = " ".join(f'{key}="{number(value)}"' for key, value in specs.items())
    return "\n".join(
        [
            f'    <actuator name="{fin.control}" type="rudder">',
            '      <link name="base_link"/>',
            f'      <origin xyz="{numbers((fin.place, 0.0, 0.0))}" rpy="{numbers((roll, 0.0, 0.0))}"/>',
            f'      <specs {shown} inverted="{"true" if fin.lift < 0 else "false"}"/>',
            f"      <visual>\n        {_DRAWN}\n      </visual>",
            "    </actuator>",
        ]
    )
