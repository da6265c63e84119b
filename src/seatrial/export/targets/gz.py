"""Gazebo (gz-sim): rigid body, added mass and buoyancy in SDFormat, damping and lift in its hydrodynamics plugin, thrusters and fins.

The plugin's force on axis i is sum (lin_ij + abs_ijk |nu_k| + quad_ijk nu_k) nu_j in forward-port-up axes of the link's origin, negative
where it dissipates. With DART the added mass stands under <inertial>, and its Coriolis forces come with it: products of velocities
are written as what is left after them. Other engines get the plugin's own added mass, with its Coriolis forces off and ours as products.
Sources: gz-sim `src/systems/{hydrodynamics,thruster,lift_drag,buoyancy}`, sdformat `sdf/1.11/inertial.sdf`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement
from math import isfinite
from typing import Any

import numpy as np

from seatrial.core.errors import InputError
from seatrial.core.signals import RATES
from seatrial.export import rigid_body
from seatrial.export.motion import Motion, cross, current_in, force_of, motion_with
from seatrial.export.stability import check_explicit_added_mass
from seatrial.export.target import Carried, Exporter, Statement
from seatrial.export.terms import (
    actuator_losses,
    all_products,
    automatic_products,
    sorted_terms,
    term_losses,
    thrust_law_losses,
    with_gains,
    without,
)
from seatrial.export.vehicle import ExportedVehicle
from seatrial.export.xml_text import XML_HEAD, comment, identifier, inertia_elements, number, numbers, pose, text
from seatrial.vehicles.actuators import Actuator
from seatrial.vehicles.hull import AXES

ENGINES = ("dart", "other")
DIAMETER = 0.1  # Of every propeller, m: only its product with the thrust coefficient counts
# Mass, kg, and moments of inertia, kg m^2, of a propeller or fin; they are taken out of the hull's.
PART, PART_INERTIA = 1e-3, 1e-6
_NO_LIMIT = 1e9  # Limit of a command where none is known; without one Gazebo takes 1000


@dataclass(frozen=True)
class Gz(Exporter):
    """See the module.

    Attributes:
        engine: `dart`, or `other` for an engine without <fluid_added_mass>.
        density: of the water, kg/m^3.
    """

    name: str = "gz"
    target: str = "Gazebo (gz-sim 8 and later, SDFormat 1.11)"
    engine: str = "dart"
    density: float = rigid_body.DENSITY
    simulates = "all"

    def check(self, vehicle: ExportedVehicle) -> None:
        """See `Exporter`."""
        if self.engine not in ENGINES:
            raise InputError(
                "export to gz, engine",
                found=f'"{self.engine}"',
                expected=" or ".join(ENGINES),
                remedy="dart is Gazebo's default",
            )
        super().check(vehicle)
        added = vehicle.added_mass
        if np.abs(added - added.T).max() > 1e-6 * np.abs(added).max():
            raise InputError(
                f'vehicle "{vehicle.name}", added mass',
                found="a matrix that differs from its transpose",
                expected="a symmetric one: <fluid_added_mass> has only its upper half",
                remedy="export to fossen or json",
            )
        if self.engine == "other":
            check_explicit_added_mass(vehicle, self.name, 1.0, "use Gazebo's DART engine, `--engine dart`")

    def carries(self, vehicle: ExportedVehicle) -> Carried:
        """See `Exporter`."""
        terms = sorted_terms(vehicle.forces)
        drives, thrust = rigid_body.drives_of(vehicle)
        fins, odd = rigid_body.fins_of(terms)
        finned = [name for name in vehicle.forces if sorted_terms({name: 1.0}).fin]
        kept, weaker = with_gains(without(vehicle, [*terms.other, *thrust, *finned])), []
        if drives and drives[0].factor is None:  # the plugin gives a commanded force whole
            weaker = [
                f"{drive.share:.4g} of the force commanded by {drive.control}" for drive in drives if drive.share != 1
            ]
            kept = replace(without(kept, terms.thrust), hull=replace(kept.hull, thrust_deduction=0.0), numbers={})
        actuators = {name: Actuator(0.0, one.lower, one.upper) for name, one in vehicle.actuators.items()}
        drifting = _drift_losses(self.engine, vehicle, fins)
        lost = (
            *term_losses(vehicle, terms.other),
            *term_losses(vehicle, thrust),
            *thrust_law_losses(vehicle),
            *weaker,
            *odd,
            *actuator_losses(vehicle, actuators),
            *drifting,
        )
        changed = [rigid_body.fin_words(fins)] if fins else []
        if self.engine == "dart" and vehicle.added_coriolis == "named":
            changed.append(
                "products of velocities: minus the Coriolis forces of added mass that DART adds, with the same sum"
            )
        forces = [force_of(kept), rigid_body.fin_force(fins)] + (
            [_drift_force(vehicle)] if self.engine == "dart" else []
        )
        return Carried(
            motion_with(kept, *forces),
            lost,
            tuple(changed),
            actuators,
            reversed=tuple(fin.control for fin in fins if fin.turns < 0),
        )

    def write(self, vehicle: ExportedVehicle, statement: Statement) -> dict[str, str]:
        """See `Exporter`."""
        name = identifier(vehicle.name)
        notes = _notes(self, vehicle, name)
        model = _model(self, vehicle, name)
        head = XML_HEAD + comment([*statement.lines, *notes])
        return {
            "model.sdf": f'{head}<sdf version="1.11">\n{model}</sdf>\n',
            "model.config": f"{XML_HEAD}{comment(statement.lines)}<model>\n  <name>{name}</name>\n  <version>1.0</version>\n"
            f'  <sdf version="1.11">model.sdf</sdf>\n  <description>{text(vehicle.name)}</description>\n</model>\n',
            "world.sdf": f'{head}<sdf version="1.11">\n{_world(self, vehicle, model)}</sdf>\n',
        }


def _drift_losses(engine: str, vehicle: ExportedVehicle, fins: tuple[rigid_body.Fin, ...]) -> tuple[str, ...]:
    """Return what is wrong in a current, in words."""
    parts = []
    if engine == "dart" and vehicle.added_mass.any():
        parts.append(
            "M_A (omega x current) is missing, because the added mass of DART uses the velocity over ground; so do its Coriolis forces "
            "before gz-sim 8.12 and 10.2"
        )
    if fins:
        parts.append("fins do not feel it")
    return ("in a current: " + ", and ".join(parts),) if parts else ()


def _drift_force(vehicle: ExportedVehicle) -> Motion:
    """Return the force that is too much, M_A (omega x current): nudot_r = nudot + omega x current, and DART has M_A nudot."""
    added = vehicle.added_mass[:, :3]

    def force(nu: Any, phi: Any, theta: Any, controls: Mapping[str, Any]) -> Any:
        return np.tensordot(added, cross(nu[3:], current_in(controls)), 1)

    return force


def plugin_terms(vehicle: ExportedVehicle, engine: str) -> dict[str, float]:
    """Return the parameters of the hydrodynamics plugin by element."""
    terms, results, sign = sorted_terms(vehicle.forces), {}, rigid_body.SIGN
    axis, rate = [name.lower() for name in AXES], [name.upper() for name in RATES]
    if engine == "other":
        for i, j in np.argwhere(vehicle.added_mass != 0):
            results[f"{axis[i]}Dot{rate[j]}"] = -float(rigid_body.flip(vehicle.added_mass)[i, j])
    for (i, j), value in terms.linear.items():
        results[f"{axis[i]}{rate[j]}"] = value * sign[i] * sign[j]
    for (i, j, k), value in terms.modulus.items():
        results[f"{axis[i]}{rate[j]}abs{rate[k]}"] = value * sign[i] * sign[j]
    own, made = all_products(vehicle), automatic_products(vehicle) if engine == "dart" else {}
    for key in sorted({*own, *made}):
        i, j, k = key
        wanted, automatic = own.get(key, 0.0), made.get(key, 0.0)
        if abs(wanted - automatic) > 1e-12 * max(abs(wanted), abs(automatic)):
            results[f"{axis[i]}{rate[j]}{rate[k]}"] = (wanted - automatic) * sign[i] * sign[j] * sign[k]
    return results


def _notes(options: Gz, vehicle: ExportedVehicle, name: str) -> list[str]:
    """Return what a user of these files must know."""
    drives, _ = rigid_body.drives_of(vehicle)
    kind = "N to /model/{0}/joint/{1}_joint/cmd_thrust" if drives and drives[0].factor is None else None
    kind = kind or "rad/s to /model/{0}/joint/{1}_joint/cmd_vel"
    lines = ["axes: forward, port, up from the link's origin; SI", "run: gz sim -r world.sdf"]
    lines += [f"drive: {kind.format(name, rigid_body.drive_name(drive))}" for drive in drives]
    fins, _ = rigid_body.fins_of(sorted_terms(vehicle.forces))
    lines += [f"{fin.control}: rad to /model/{name}/joint/{fin.control}_joint/0/cmd_pos" for fin in fins]
    lines += (
        ["fins turn by the right hand about their joints' axes, down and to starboard, and lift accordingly"]
        if fins
        else []
    )
    if any(not isfinite(drive.upper) for drive in drives):
        lines.append("the limits of the drive are unknown: none are set")
    if options.engine == "dart":
        lines.append("engine: DART only; others ignore the added mass here: export again with --engine other")
    else:
        lines.append(
            "engine: any without the added mass of DART; the Coriolis matrix of the plugin is off, because it has the wrong sign"
        )
    return [
        *lines,
        "Gazebo warns of parameters like yUV: they are intended products without a modulus",
        "the box is one of the displaced volume, not the hull's shape",
    ]


def _model(options: Gz, vehicle: ExportedVehicle, name: str) -> str:
    drives, _ = rigid_body.drives_of(vehicle)
    fins, _ = rigid_body.fins_of(sorted_terms(vehicle.forces))
    parts = [rigid_body.flu(drive.place) for drive in drives] + [np.array([fin.place, 0.0, 0.0]) for fin in fins]
    own = rigid_body.flip(vehicle.rigid_mass) - sum(
        (rigid_body.point_mass(PART, PART_INERTIA, at) for at in parts), start=np.zeros((6, 6))
    )
    body = rigid_body.body_of(own)
    size = rigid_body.box_of(rigid_body.volume_of(vehicle, options.density), [float(at[0]) for at in parts])
    place = pose(rigid_body.flu(vehicle.hull.centre_of_buoyancy))
    box = f"<pose>{place}</pose><geometry><box><size>{numbers(size)}</size></box></geometry>"
    lines = [
        f'  <model name="{name}">',
        '    <link name="base_link">',
        f"      <inertial>\n        <pose>{pose(body.centre)}</pose>\n        <mass>{number(body.mass)}</mass>",
        f"        <inertia>{inertia_elements(body.inertia)}</inertia>",
        *([_added_mass(vehicle)] if options.engine == "dart" else []),
        "      </inertial>",
        *(f'      <{kind} name="displacement">{box}</{kind}>' for kind in ("collision", "visual")),
        "    </link>",
        *(_drive(options, drive, name) for drive in drives),
        *(_fin(vehicle, fin) for fin in fins),
        '    <plugin filename="gz-sim-hydrodynamics-system" name="gz::sim::systems::Hydrodynamics">',
        "      <link_name>base_link</link_name>",
        *(["      <disable_coriolis>true</disable_coriolis>"] if options.engine == "other" else []),
        *(f"      <{key}>{number(value)}</{key}>" for key, value in plugin_terms(vehicle, options.engine).items()),
        "    </plugin>",
        "  </model>",
    ]
    return "\n".join(lines) + "\n"


def _added_mass(vehicle: ExportedVehicle) -> str:
    matrix, keys = rigid_body.flip(vehicle.added_mass), combinations_with_replacement(enumerate("xyzpqr"), 2)
    rows = [f"          <{a}{b}>{number(matrix[i, j])}</{a}{b}>" for (i, a), (j, b) in keys]
    return "\n".join(["        <fluid_added_mass>", *rows, "        </fluid_added_mass>"])


def _part(name: str, place: np.ndarray, axis: np.ndarray, limit: str) -> str:
    moments = inertia_elements(PART_INERTIA * np.eye(3))
    return (
        f'    <link name="{name}_link">\n      <pose>{pose(place)}</pose>\n'
        f"      <inertial><mass>{number(PART)}</mass><inertia>{moments}</inertia></inertial>\n    </link>\n"
        f'    <joint name="{name}_joint" type="revolute">\n'
        f"      <parent>base_link</parent>\n      <child>{name}_link</child>\n"
        f"      <axis><xyz>{numbers(axis)}</xyz>{limit}</axis>\n    </joint>"
    )


def _drive(options: Gz, drive: rigid_body.Drive, name: str) -> str:
    by_speed = drive.factor is not None
    limits = [
        f"      <{key}>{number(np.clip(bound, -_NO_LIMIT, _NO_LIMIT))}</{key}>"
        for key, bound in (("max_thrust_cmd", drive.upper), ("min_thrust_cmd", drive.lower))
    ]
    factor = (1.0 if drive.factor is None else drive.factor) / (options.density * DIAMETER**4)
    part = rigid_body.drive_name(drive)
    return "\n".join(
        [
            _part(part, rigid_body.flu(drive.place), rigid_body.flu(drive.direction), ""),
            '    <plugin filename="gz-sim-thruster-system" name="gz::sim::systems::Thruster">',
            f"      <namespace>{name}</namespace>",
            f"      <joint_name>{part}_joint</joint_name>",
            f"      <thrust_coefficient>{number(factor)}</thrust_coefficient>",
            f"      <fluid_density>{number(options.density)}</fluid_density>",
            f"      <propeller_diameter>{number(DIAMETER)}</propeller_diameter>",
            "      <velocity_control>true</velocity_control>",
            f"      <use_angvel_cmd>{'true' if by_speed else 'false'}</use_angvel_cmd>",
            *limits,
            "    </plugin>",
        ]
    )


def _fin(vehicle: ExportedVehicle, fin: rigid_body.Fin) -> str:
    """Return a fin; with a density of 2 and an area of 1 the plugin's lift is the coefficient times V^2.

    Its joint turns by the right hand about an axis down or to starboard, and the lift goes where the leading edge points.
    """
    actuator = vehicle.actuators.get(fin.control)
    limit = ""
    if actuator is not None and isfinite(actuator.lower) and isfinite(actuator.upper):
        lower, upper = sorted((fin.turns * actuator.lower, fin.turns * actuator.upper))
        limit = f"<limit><lower>{number(lower)}</lower><upper>{number(upper)}</upper></limit>"
    place = np.array([fin.place, 0.0, 0.0])
    axis, up = np.zeros(3), np.zeros(3)
    axis[3 - fin.axis], up[fin.axis] = -1.0, 1.0
    return "\n".join(
        [
            _part(fin.control, place, axis, limit),
            '    <plugin filename="gz-sim-lift-drag-system" name="gz::sim::systems::LiftDrag">',
            "      <link_name>base_link</link_name>",
            f"      <control_joint_name>{fin.control}_joint</control_joint_name>",
            f"      <control_joint_rad_to_cl>{number(-fin.turns * fin.lift)}</control_joint_rad_to_cl>",
            "      <air_density>2</air_density><area>1</area><a0>0</a0>",
            "      <cla>0</cla><cda>0</cda><cma>0</cma><cla_stall>0</cla_stall><cda_stall>0</cda_stall><cma_stall>0</cma_stall>",
            f"      <cp>{numbers(place)}</cp><forward>1 0 0</forward><upward>{numbers(up)}</upward>",
            "    </plugin>",
            '    <plugin filename="gz-sim-joint-position-controller-system" name="gz::sim::systems::JointPositionController">',
            f"      <joint_name>{fin.control}_joint</joint_name>",
            "      <use_velocity_commands>true</use_velocity_commands>",
            "    </plugin>",
        ]
    )


def _world(options: Gz, vehicle: ExportedVehicle, model: str) -> str:
    placed = model.replace(">\n", ">\n    <pose>0 0 -10 0 0 0</pose>\n", 1)
    systems = {
        "physics": "Physics",
        "user-commands": "UserCommands",
        "scene-broadcaster": "SceneBroadcaster",
    }
    engine = "gz-physics-dartsim-plugin" if options.engine == "dart" else "gz-physics-bullet-featherstone-plugin"
    lines = [
        '  <world name="water">',
        f"    <gravity>0 0 {number(-rigid_body.gravity_of(vehicle))}</gravity>",
        '    <physics name="steps" type="ignored"><max_step_size>0.001</max_step_size></physics>',
        *(
            f'    <plugin filename="gz-sim-{file}-system" name="gz::sim::systems::{name}">'
            + (f"<engine><filename>{engine}</filename></engine>" if file == "physics" else "")
            + "</plugin>"
            for file, name in systems.items()
        ),
        '    <plugin filename="gz-sim-buoyancy-system" name="gz::sim::systems::Buoyancy">',
        f"      <uniform_fluid_density>{number(options.density)}</uniform_fluid_density>",
        "    </plugin>",
        '    <light type="directional" name="sun"><pose>0 0 10 0 0 0</pose><direction>-0.5 0.1 -0.9</direction></light>',
    ]
    return "\n".join(lines) + "\n" + placed + "  </world>\n"
