"""UUV Simulator (Gazebo Classic): a URDF with its underwater object and thruster plugins, and the parameters of its controllers.

The plugin's force is (D_lin + u D_forward + diag(d_j |nu_j|)) nu - C_A(nu) nu, negative where it dissipates, in forward-starboard-down
axes; added mass acts on the acceleration of the step before, through a filter of 0.3. Its products are those of the added mass's
Coriolis forces and, by D_forward, every product with u. nu is of the link's origin, but the force acts at the link's centre of gravity,
and the centre of buoyancy counts from there: so the link stands in the centre of gravity here, and the matrices are taken there,

    nu = H nu_g,  tau_g = H^T tau,  H = (1, S(r_g); 0, 1):   D_g = H^T D H,  M_g = H^T M H

Sources: uuv_simulator `uuv_gazebo_plugins/src/{HydrodynamicModel,BuoyantObject,UnderwaterObjectPlugin,ThrusterConversionFcn}.cc`,
Gazebo Classic `physics/ode/ODELink.cc`, `uuv_trajectory_control/config/models`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from seatrial.export.motion import Motion, coriolis_force, force_of, motion_with
from seatrial.export.rigid_body import (
    DENSITY,
    Body,
    Drive,
    body_of,
    drive_name,
    drives_of,
    flip,
    flu,
    gravity_of,
    point_mass,
    volume_of,
)
from seatrial.export.stability import check_explicit_added_mass, check_stable
from seatrial.export.target import Carried, Statement
from seatrial.export.terms import (
    Pair,
    actuator_losses,
    all_products,
    mass_products,
    product_losses,
    sorted_terms,
    term_losses,
)
from seatrial.export.vehicle import ExportedVehicle, require_whole
from seatrial.export.xml_text import HEAD, comment, identifier, matrix, number, numbers
from seatrial.vehicles.actuators import Actuator

FILTERED = 1.7 / 0.3
"""Added mass over the vehicle's own at which the simulator's filtered acceleration runs away."""
_NO_LIMIT = 1e9
"""Reach of a thruster's table where no limit is known, N."""
PART, PART_INERTIA = 1e-3, 1e-6
"""Mass, kg, and moments of inertia, kg m^2, of a propeller; they are taken out of the hull's."""


@dataclass(frozen=True)
class Uuv:
    """See the module; `density` is the water's, kg/m^3."""

    name: str = "uuv"
    target: str = "UUV Simulator (Gazebo Classic, last version of 2020)"
    density: float = DENSITY

    def check(self, vehicle: ExportedVehicle) -> None:
        """See `Exporter`."""
        require_whole(vehicle, self.name)
        check_stable(vehicle, self.name)
        check_explicit_added_mass(vehicle, self.name, FILTERED, "export to gz, whose DART engine solves for it")

    def carries(self, vehicle: ExportedVehicle) -> Carried:
        """See `Exporter`."""
        terms = sorted_terms(vehicle.forces)
        _, thrust = drives_of(vehicle)
        crossed = [name for name in vehicle.forces if _is_crossed(name)]
        fins = [name for name in vehicle.forces if sorted_terms({name: 1.0}).fin]
        plugin, actuators = plugin_of(vehicle), _actuators(vehicle)
        masses = [name for name in vehicle.coefficients if name not in vehicle.forces]
        driving = [name for name in terms.thrust if name not in thrust]
        rest = replace(
            vehicle,
            coefficients={name: vehicle.coefficients[name] for name in (*masses, *driving)},
            added_coriolis="named",
        )
        lost = (
            *term_losses(vehicle, terms.other),
            *term_losses(vehicle, thrust),
            *term_losses(vehicle, crossed, ": only the diagonal of quadratic damping is used"),
            *term_losses(
                vehicle, fins, ": its fins lift by the local angle of attack too, which Y_uv and Z_uw hold here"
            ),
            *product_losses(plugin.own, plugin.products, "about the hull's centre of gravity"),
            *actuator_losses(vehicle, actuators),
        )
        shifted = plugin.quadratic.any() and plugin.centre.any()
        distance = float(np.linalg.norm(plugin.centre))
        changed = (
            "added mass: by the filtered acceleration of the steps before, some 4 ms late at steps of 1 ms; fast oscillations fade less",
            f"quadratic damping: at the centre of gravity of the hull, {distance:.2g} m from the origin",
        )
        return Carried(
            motion_with(rest, force_of(rest), _plugin_force(plugin)),
            lost,
            changed if shifted else changed[:1],
            actuators,
        )

    def write(self, vehicle: ExportedVehicle, statement: Statement) -> dict[str, str]:
        """See `Exporter`."""
        name = identifier(vehicle.name)
        notes = [
            "axes: forward, port, up of the link; the hydrodynamic matrices forward, starboard, down, as the plugin reads them",
            f"the link stands in the hull's centre of gravity, ({', '.join(f'{x:.6g}' for x in plugin_of(vehicle).centre)}) m "
            "forward, starboard and down of the coefficients' origin: the plugin's forces act there",
            f"set the world's gravity to {gravity_of(vehicle):.9g} m/s^2, by which buoyancy and weight come out",
            "the box is of the displaced volume, not of the hull's shape",
        ]
        yaml = "".join(f"# {line}\n" for line in [*statement.lines, *notes]) + _parameters(self, vehicle)
        return {
            "vehicle.urdf": HEAD + comment([*statement.lines, *notes]) + _robot(self, vehicle, name),
            "params.yaml": yaml,
        }


class Plugin(NamedTuple):
    """What the plugin gets, about the hull's centre of gravity, in forward-starboard-down axes; damping is negative where it dissipates.

    Attributes:
        centre: of gravity of the hull without its propellers, m from the coefficients' origin.
        added: added mass, positive.
        linear: D_lin.
        forward: D_forward.
        quadratic: diagonal of quadratic damping.
        own: the vehicle's products of velocities, taken there.
        products: those of the target.
    """

    centre: Float[np.ndarray, " 3"]
    added: Float[np.ndarray, "6 6"]
    linear: Float[np.ndarray, "6 6"]
    forward: Float[np.ndarray, "6 6"]
    quadratic: Float[np.ndarray, " 6"]
    own: Mapping[Pair, float]
    products: Mapping[Pair, float]


def plugin_of(vehicle: ExportedVehicle) -> Plugin:
    """Return the plugin's parameters."""
    terms, centre = sorted_terms(vehicle.forces), flu(_hull(vehicle).centre)
    shift = _shift(centre)
    linear, quadratic, tensor = np.zeros((6, 6)), np.zeros(6), np.zeros((6, 6, 6))
    for (i, j), value in terms.linear.items():
        linear[i, j] += value
    for (i, j, k), value in terms.modulus.items():
        if i == j == k:
            quadratic[i] += value
    for key, value in all_products(vehicle).items():
        tensor[key] += value
    tensor = np.einsum("ai,abc,bj,ck->ijk", shift, tensor, shift, shift)
    added = shift.T @ vehicle.added_mass @ shift
    own, made = _products_of(tensor), mass_products(added)
    products = {key: own.get(key, 0.0) if key[1] == 0 else made.get(key, 0.0) for key in {*own, *made}}
    forward = np.zeros((6, 6))
    for i, j, k in products:
        if j == 0:
            forward[i, k] = own.get((i, j, k), 0.0) - made.get((i, j, k), 0.0)
    return Plugin(centre, added, shift.T @ linear @ shift, forward, quadratic, own, products)


def _shift(centre: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "6 6"]:
    """Return H: velocities at the origin from those at the centre."""
    x, y, z = centre
    result = np.eye(6)
    result[:3, 3:] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
    return result


def _products_of(tensor: Float[np.ndarray, "6 6 6"]) -> dict[Pair, float]:
    """Return the products with ascending velocities; what is rounding beside the largest of its axis is left out."""
    results = {}
    for i in range(6):
        for j in range(6):
            for k in range(j, 6):
                value = tensor[i, j, k] + (tensor[i, k, j] if k > j else 0.0)
                if abs(value) > 1e-12 * np.abs(tensor[i]).max():
                    results[i, j, k] = float(value)
    return results


def _plugin_force(plugin: Plugin) -> Motion:
    """Return the plugin's force, about our origin."""
    back = np.linalg.inv(_shift(plugin.centre))

    def force(nu: Any, phi: Any, theta: Any, controls: Mapping[str, Any]) -> Any:
        there = np.tensordot(back, np.asarray(nu, float), 1)
        result = np.tensordot(plugin.linear, there, 1) + there[0] * np.tensordot(plugin.forward, there, 1)
        result = result + (plugin.quadratic * (np.abs(there) * there).T).T - coriolis_force(plugin.added, there)
        return np.tensordot(back.T, result, 1)

    return force


def _is_crossed(name: str) -> bool:
    return any(not i == j == k for i, j, k in sorted_terms({name: 1.0}).modulus)


def _actuators(vehicle: ExportedVehicle) -> dict[str, Actuator]:
    """Return those of the thrusters without their rates; there are no fins."""
    drives = {drive.control for drive in drives_of(vehicle)[0]}
    return {name: replace(one, rate=np.inf) for name, one in vehicle.actuators.items() if name in drives}


def _hull(vehicle: ExportedVehicle) -> Body:
    """Return the hull in the link's axes, without what its propellers weigh."""
    parts = [point_mass(PART, PART_INERTIA, flu(drive.place)) for drive in drives_of(vehicle)[0]]
    return body_of(flip(vehicle.rigid_mass) - sum(parts, start=np.zeros((6, 6))))


def _robot(options: Uuv, vehicle: ExportedVehicle, name: str) -> str:
    body, base = _hull(vehicle), f"{name}/base_link"
    drives, _ = drives_of(vehicle)
    plugin = plugin_of(vehicle)
    volume = volume_of(vehicle, options.density)
    side = volume ** (1 / 3)
    sizes = "".join(f"<{key}>{number(side)}</{key}>" for key in ("width", "length", "height"))
    lines = [
        f'<robot name="{name}">',
        f'  <link name="{base}">',
        _inertial(body.mass, np.zeros(3), body.inertia),
        "  </link>",
        *(_thruster_link(base, name, drive, plugin.centre) for drive in drives),
        "  <gazebo>",
        '    <plugin filename="libuuv_underwater_object_ros_plugin.so" name="hydrodynamics">',
        f"      <fluid_density>{number(options.density)}</fluid_density>",
        "      <flow_velocity_topic>hydrodynamics/current_velocity</flow_velocity_topic>",
        f'      <link name="{base}">',
        "        <neutrally_buoyant>0</neutrally_buoyant>",
        f"        <volume>{number(volume)}</volume>",
        f"        <box>{sizes}</box>",
        f"        <center_of_buoyancy>{numbers(_buoyancy_at(vehicle, plugin))}</center_of_buoyancy>",
        "        <hydrodynamic_model>",
        "          <type>fossen</type>",
        f"          <added_mass>{matrix(plugin.added)}</added_mass>",
        f"          <linear_damping>{matrix(plugin.linear)}</linear_damping>",
        f"          <linear_damping_forward_speed>{matrix(plugin.forward)}</linear_damping_forward_speed>",
        f"          <quadratic_damping>{numbers(plugin.quadratic)}</quadratic_damping>",
        "        </hydrodynamic_model>",
        "      </link>",
        "    </plugin>",
        *(_thruster_plugin(vehicle, name, number_, drive) for number_, drive in enumerate(drives)),
        "  </gazebo>",
        "</robot>",
    ]
    return "\n".join(lines) + "\n"


def _buoyancy_at(vehicle: ExportedVehicle, plugin: Plugin) -> Float[np.ndarray, " 3"]:
    """Return the centre of buoyancy from the centre of gravity, forward, port, up."""
    return flu(np.array(vehicle.hull.centre_of_buoyancy) - plugin.centre)


def _inertial(mass: float, centre: np.ndarray, inertia: np.ndarray) -> str:
    pairs = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    moments = " ".join(f'{key}="{number(inertia[at])}"' for key, at in pairs.items())
    return (
        f'    <inertial>\n      <origin xyz="{numbers(centre)}" rpy="0 0 0"/>\n'
        f'      <mass value="{number(mass)}"/>\n      <inertia {moments}/>\n    </inertial>'
    )


def _thruster_link(base: str, name: str, drive: Drive, centre: np.ndarray) -> str:
    part = f"{name}/{drive_name(drive)}"
    return (
        f'  <link name="{part}">\n{_inertial(PART, np.zeros(3), PART_INERTIA * np.eye(3))}\n  </link>\n'
        f'  <joint name="{part}_joint" type="continuous">\n'
        f'    <origin xyz="{numbers(flu(drive.place - centre))}" rpy="0 0 0"/>\n    <axis xyz="{numbers(flu(drive.direction))}"/>\n'
        f'    <parent link="{base}"/>\n    <child link="{part}"/>\n  </joint>'
    )


def _thruster_plugin(vehicle: ExportedVehicle, name: str, index: int, drive: Drive) -> str:
    part = f"{name}/{drive_name(drive)}"
    actuator = vehicle.actuators.get(drive.control)
    lag = 0.0 if actuator is None else actuator.time_constant
    dynamics = (
        f"<type>FirstOrder</type><timeConstant>{number(lag)}</timeConstant>" if lag > 0 else "<type>ZeroOrder</type>"
    )
    if drive.factor is None:
        top = min(max(abs(drive.lower), abs(drive.upper)), _NO_LIMIT)
        conversion = (
            f"<type>LinearInterp</type><inputValues>{numbers((-top, top))}</inputValues>"
            f"<outputValues>{numbers((-top * drive.share, top * drive.share))}</outputValues>"
        )
    else:
        conversion = f"<type>Basic</type><rotorConstant>{number(drive.factor)}</rotorConstant>"
    clamps = "".join(
        f"<{key}>{number(bound)}</{key}>"
        for key, bound in (("clampMin", drive.lower), ("clampMax", drive.upper))
        if isfinite(bound)
    )
    return (
        f'    <plugin filename="libuuv_thruster_ros_plugin.so" name="{drive_name(drive)}">\n'
        f"      <linkName>{part}</linkName><jointName>{part}_joint</jointName><thrusterID>{index}</thrusterID>\n"
        f"      <gain>1</gain>{clamps}\n      <dynamics>{dynamics}</dynamics>\n"
        f"      <conversion>{conversion}</conversion>\n    </plugin>"
    )


def _parameters(options: Uuv, vehicle: ExportedVehicle) -> str:
    """Return what the simulator's controllers read: the same numbers, their damping without products."""
    body, plugin = body_of(flip(vehicle.rigid_mass)), plugin_of(vehicle)
    volume = volume_of(vehicle, options.density)
    side = number(volume ** (1 / 3))
    pairs = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}

    def listed(values: np.ndarray) -> str:
        return "[" + ", ".join(number(x) for x in values) + "]"

    def rows(values: np.ndarray) -> str:
        return "".join(f"\n  - {listed(row)}" for row in values)

    return (
        f"mass: {number(body.mass)}\ninertial:\n"
        + "".join(f"  {key}: {number(body.inertia[at])}\n" for key, at in pairs.items())
        + f"cog: {listed(body.centre - flu(plugin.centre))}\ncob: {listed(_buoyancy_at(vehicle, plugin))}\n"
        + f"volume: {number(volume)}\nlength: {side}\nwidth: {side}\nheight: {side}\n"
        + f"density: {number(options.density)}\nbase_link: base_link\nMa:{rows(plugin.added)}\n"
        + f"linear_damping:{rows(plugin.linear)}\nlinear_damping_forward_speed: {listed(np.diag(plugin.forward))}\n"
        + f"quad_damping: {listed(plugin.quadratic)}\n"
    )
