"""UUV Simulator (Gazebo Classic): a URDF with its underwater object and thruster plugins, and the parameters of its controllers.

The plugin's force is (D_lin + u D_forward + diag(d_j |nu_j|)) nu - C_A(nu) nu, negative where it dissipates, in forward-starboard-down
axes; added mass acts on the acceleration of the step before, through a filter of 0.3. Its products are those of the added mass's
Coriolis forces and, by D_forward, every product with u.
Sources: uuv_simulator `uuv_gazebo_plugins/src/{HydrodynamicModel,ThrusterConversionFcn}.cc`, `uuv_trajectory_control/config/models`.
"""

from dataclasses import dataclass
from math import isfinite

import numpy as np
from jaxtyping import Float

from seatrial.export.drives import Drive, drive_name, drives_of
from seatrial.export.exact import DENSITY, Body, body_of, flip, flu, gravity_of, point_mass
from seatrial.export.kept import actuator_losses, product_losses, term_losses, with_only_products, without
from seatrial.export.motion import motion_of
from seatrial.export.stability import check_explicit_added_mass, check_stable
from seatrial.export.target import Carried, Statement
from seatrial.export.terms import Pair, all_products, automatic_products, sorted_terms
from seatrial.export.vehicle import ExportedVehicle, require_whole
from seatrial.export.xml_text import HEAD, comment, identifier, matrix, number, numbers
from seatrial.vehicles.hull import GRAVITY

FILTERED = 1.7 / 0.3
"""Added mass over the vehicle's own at which the simulator's filtered acceleration runs away."""
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
        products = _products(vehicle)
        kept = with_only_products(without(vehicle, [*terms.other, *thrust, *crossed, *fins]), products)
        lost = (
            *term_losses(vehicle, terms.other),
            *term_losses(vehicle, thrust),
            *term_losses(vehicle, crossed, ": only the diagonal of quadratic damping is used"),
            *term_losses(
                vehicle, fins, ": its fins lift by the local angle of attack too, which Y_uv and Z_uw hold here"
            ),
            *product_losses(vehicle, products),
            *_lag_losses(vehicle),
        )
        return Carried(motion_of(kept), lost)

    def write(self, vehicle: ExportedVehicle, statement: Statement) -> dict[str, str]:
        """See `Exporter`."""
        name = identifier(vehicle.name)
        notes = [
            "axes: forward, port, up of the link; the hydrodynamic matrices forward, starboard, down, as the plugin reads them",
            f"set the world's gravity to {gravity_of(vehicle):.9g} m/s^2; the plugin's buoyancy takes {GRAVITY} m/s^2",
            "the box is of the displaced volume, not of the hull's shape",
        ]
        yaml = "".join(f"# {line}\n" for line in [*statement.lines, *notes]) + _parameters(self, vehicle)
        return {
            "vehicle.urdf": HEAD + comment([*statement.lines, *notes]) + _robot(self, vehicle, name),
            "params.yaml": yaml,
        }


def damping_matrices(
    vehicle: ExportedVehicle,
) -> tuple[Float[np.ndarray, "6 6"], Float[np.ndarray, "6 6"], Float[np.ndarray, " 6"]]:
    """D_lin, D_forward and the diagonal of quadratic damping, negative where they dissipate, in our axes."""
    terms = sorted_terms(vehicle.forces)
    linear, forward, quadratic = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros(6)
    for (i, j), value in terms.linear.items():
        linear[i, j] += value
    for (i, j, k), value in terms.modulus.items():
        if i == j == k:
            quadratic[i] += value
    own, made = all_products(vehicle), automatic_products(vehicle)
    for i, j, k in {*own, *made}:
        if j == 0:
            forward[i, k] = own.get((i, j, k), 0.0) - made.get((i, j, k), 0.0)
    return linear, forward, quadratic


def _products(vehicle: ExportedVehicle) -> dict[Pair, float]:
    """Products of the target: every one with u is the vehicle's own, the others are those of the added mass."""
    own, made = all_products(vehicle), automatic_products(vehicle)
    return {key: own.get(key, 0.0) if key[1] == 0 else made.get(key, 0.0) for key in {*own, *made}}


def _is_crossed(name: str) -> bool:
    return any(not i == j == k for i, j, k in sorted_terms({name: 1.0}).modulus)


def _lag_losses(vehicle: ExportedVehicle) -> tuple[str, ...]:
    """The lag of a thruster is carried; its rate is not, nor is anything of a fin's."""
    drives = {drive.control for drive in drives_of(vehicle)[0]}
    return tuple(
        line
        for line in actuator_losses(vehicle)
        if line.split(" of ")[-1].split(" ")[0] not in drives or "rate" in line
    )


def _hull(vehicle: ExportedVehicle) -> Body:
    """The hull in the link's axes, without what its propellers weigh."""
    parts = [point_mass(PART, PART_INERTIA, flu(drive.place)) for drive in drives_of(vehicle)[0]]
    return body_of(flip(vehicle.rigid_mass) - sum(parts, start=np.zeros((6, 6))))


def _robot(options: Uuv, vehicle: ExportedVehicle, name: str) -> str:
    body, base = _hull(vehicle), f"{name}/base_link"
    drives, _ = drives_of(vehicle)
    linear, forward, quadratic = damping_matrices(vehicle)
    volume = vehicle.hull.buoyancy / (options.density * GRAVITY)
    side = volume ** (1 / 3)
    sizes = "".join(f"<{key}>{number(side)}</{key}>" for key in ("width", "length", "height"))
    lines = [
        f'<robot name="{name}">',
        f'  <link name="{base}">',
        _inertial(body.mass, body.centre, body.inertia),
        "  </link>",
        *(_thruster_link(base, name, drive) for drive in drives),
        "  <gazebo>",
        '    <plugin filename="libuuv_underwater_object_ros_plugin.so" name="hydrodynamics">',
        f"      <fluid_density>{number(options.density)}</fluid_density>",
        "      <flow_velocity_topic>hydrodynamics/current_velocity</flow_velocity_topic>",
        f'      <link name="{base}">',
        "        <neutrally_buoyant>0</neutrally_buoyant>",
        f"        <volume>{number(volume)}</volume>",
        f"        <box>{sizes}</box>",
        f"        <center_of_buoyancy>{numbers(flu(vehicle.hull.centre_of_buoyancy))}</center_of_buoyancy>",
        "        <hydrodynamic_model>",
        "          <type>fossen</type>",
        f"          <added_mass>{matrix(vehicle.added_mass)}</added_mass>",
        f"          <linear_damping>{matrix(linear)}</linear_damping>",
        f"          <linear_damping_forward_speed>{matrix(forward)}</linear_damping_forward_speed>",
        f"          <quadratic_damping>{numbers(quadratic)}</quadratic_damping>",
        "        </hydrodynamic_model>",
        "      </link>",
        "    </plugin>",
        *(_thruster_plugin(vehicle, name, number_, drive) for number_, drive in enumerate(drives)),
        "  </gazebo>",
        "</robot>",
    ]
    return "\n".join(lines) + "\n"


def _inertial(mass: float, centre: np.ndarray, inertia: np.ndarray) -> str:
    pairs = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    moments = " ".join(f'{key}="{number(inertia[at])}"' for key, at in pairs.items())
    return (
        f'    <inertial>\n      <origin xyz="{numbers(centre)}" rpy="0 0 0"/>\n'
        f'      <mass value="{number(mass)}"/>\n      <inertia {moments}/>\n    </inertial>'
    )


def _thruster_link(base: str, name: str, drive: Drive) -> str:
    part = f"{name}/{drive_name(drive)}"
    return (
        f'  <link name="{part}">\n{_inertial(PART, np.zeros(3), PART_INERTIA * np.eye(3))}\n  </link>\n'
        f'  <joint name="{part}_joint" type="continuous">\n'
        f'    <origin xyz="{numbers(flu(drive.place))}" rpy="0 0 0"/>\n    <axis xyz="{numbers(flu(drive.direction))}"/>\n'
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
        conversion = (
            f"<type>LinearInterp</type><inputValues>-1000.0 1000.0</inputValues>"
            f"<outputValues>{numbers((-1000.0 * drive.share, 1000.0 * drive.share))}</outputValues>"
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
    """What the simulator's controllers read: the same numbers, their damping without products."""
    body = body_of(flip(vehicle.rigid_mass))
    linear, forward, quadratic = damping_matrices(vehicle)
    volume = vehicle.hull.buoyancy / (options.density * GRAVITY)
    side = number(volume ** (1 / 3))
    pairs = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}

    def listed(values: np.ndarray) -> str:
        return "[" + ", ".join(number(x) for x in values) + "]"

    def rows(values: np.ndarray) -> str:
        return "".join(f"\n  - {listed(row)}" for row in values)

    return (
        f"mass: {number(body.mass)}\ninertial:\n"
        + "".join(f"  {key}: {number(body.inertia[at])}\n" for key, at in pairs.items())
        + f"cog: {listed(body.centre)}\ncob: {listed(flu(vehicle.hull.centre_of_buoyancy))}\n"
        + f"volume: {number(volume)}\nlength: {side}\nwidth: {side}\nheight: {side}\n"
        + f"density: {number(options.density)}\nbase_link: base_link\nMa:{rows(vehicle.added_mass)}\n"
        + f"linear_damping:{rows(linear)}\nlinear_damping_forward_speed: {listed(np.diag(forward))}\n"
        + f"quad_damping: {listed(quadratic)}\n"
    )
