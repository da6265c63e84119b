"""MuJoCo: a rigid body as XML, and a Python module whose callback is the water, with added mass.

MuJoCo has no added mass that turns with a body, and its fluid model has five numbers for each geom. So the callback solves our equation,
with M_RB + M_A and all forces in `xfrc_applied` and `qfrc_applied`, for the acceleration, and adds to `qfrc_passive` the force by which
MuJoCo's rigid body, with its own inertia, gravity and velocity, gets exactly this acceleration:

    qfrc_passive = M_RB a + bias - gravity - outside,    (M_RB + M_A) a = tau - C nu - g + outside

Source: MuJoCo's documentation of MJCF, `mjcb_passive` and `mjcb_act_dyn` (versions 3.0 to 4.0).
"""

from dataclasses import dataclass, replace
from math import isfinite, pi

from seatrial.export.equations import lagging, python_module
from seatrial.export.motion import motion_of
from seatrial.export.rigid_body import DENSITY, body_of, flip, gravity_of, volume_of
from seatrial.export.target import Carried, Exporter, Statement
from seatrial.export.vehicle import ExportedVehicle
from seatrial.export.xml_text import comment, identifier, number, numbers
from seatrial.vehicles.hull import rigid_mass_matrix

STEP = 0.01  # Step of the simulation, s


@dataclass(frozen=True)
class Mujoco(Exporter):
    """See the module."""

    name: str = "mjcf"
    target: str = "MuJoCo 3 and 4, MJCF with a Python callback"
    simulates = "moves"

    def carries(self, vehicle: ExportedVehicle) -> Carried:
        """See `Exporter`: everything; contacts and further joints see the body without its added mass."""
        changed = [
            "a contact or a further joint acts on the mass without added mass; xfrc_applied and qfrc_applied act on all of it"
        ]
        unknown = [f"I_{axis}{axis}" for axis, one in zip("xyz", vehicle.hull.inertia, strict=True) if one is None]
        if unknown:
            changed.append(
                f"{', '.join(unknown)} of the body: unknown, with a value that has no effect, because the callback holds these axes"
            )
        return Carried(motion_of(vehicle), changed=tuple(changed), actuators=vehicle.actuators)

    def write(self, vehicle: ExportedVehicle, statement: Statement) -> dict[str, str]:
        """See `Exporter`."""
        name = identifier(vehicle.name)
        text = python_module(_TEMPLATE, vehicle, statement.lines, _NOTES, NAME=name)
        return {f"{name}.xml": comment(statement.lines) + _model(vehicle, name), f"{name}.py": text}


def _model(vehicle: ExportedVehicle, name: str) -> str:
    """Return the model: forward, port, up from the same origin, in a world of north, west and up."""
    hull = vehicle.hull
    # Any inertia does for an axis that the callback holds; a moment like the others is one that a body can have.
    usual = max((one for one in hull.inertia if one is not None), default=hull.mass)
    inertia = tuple(usual if one is None else one for one in hull.inertia)
    body = body_of(flip(rigid_mass_matrix(replace(hull, inertia=inertia))))
    moments = [body.inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    radius = (3.0 * volume_of(vehicle, DENSITY) / (4.0 * pi)) ** (1 / 3)
    actuators = "".join(f"    {_actuator(vehicle, control, name)}\n" for control in vehicle.controls)
    return (
        f'<mujoco model="{name}">\n'
        f'  <option timestep="{number(STEP)}" integrator="RK4" gravity="0 0 {number(-gravity_of(vehicle))}"/>\n'
        f'  <worldbody>\n    <body name="{name}">\n'
        f'      <freejoint name="{name}" align="false"/>\n'
        f'      <inertial pos="{numbers(body.centre)}" mass="{number(body.mass)}" fullinertia="{numbers(moments)}"/>\n'
        f'      <geom name="{name}" type="sphere" size="{number(radius)}" contype="0" conaffinity="0" rgba="1 0.8 0.1 1"/>\n'
        f"    </body>\n  </worldbody>\n"
        f"  <actuator>\n{actuators}  </actuator>\n</mujoco>\n"
    )


def _actuator(vehicle: ExportedVehicle, control: str, name: str) -> str:
    """Return an actuator that carries a command, in SI, to the callback and pushes nothing itself."""
    actuator, limits = vehicle.actuators.get(control), ""
    if actuator is not None and isfinite(actuator.lower) and isfinite(actuator.upper):
        limits = f' ctrllimited="true" ctrlrange="{numbers((actuator.lower, actuator.upper))}"'
    lag = ' dyntype="user" actdim="1"' if control in lagging(vehicle) else ""
    return f'<general name="{control}" joint="{name}" gear="0 0 0 0 0 0" gainprm="0"{lag}{limits}/>'


_NOTES = (
    "The model has its axes forward, port and up, and a world of north, west and up; `nu_of` gives the velocities above. Use:",
    "    model = mujoco.MjModel.from_xml_path(...); data = mujoco.MjData(model); install(); begin(model, data)",
    "Load every model before `install`: MuJoCo's compiler calls a callback with a model that Python does not know, and stops.",
    "data.ctrl holds the commands, in SI and the order of CONTROLS; data.act what lagging actuators do: 0, until `begin` sets it to their",
    "commands. `water` is the velocity of the water, north, east and down, and `parameters` the list of PARAMETERS: both may be changed.",
    "Added mass: the callback solves the equation, forces of xfrc_applied and qfrc_applied included, for the acceleration, and adds the",
    "force by which MuJoCo's rigid body gets it. Contacts and further joints act on the body without added mass. The geom is a sphere of",
    "the displacement, to be seen only.",
)
_TEMPLATE = '''"""
@DOC@
"""

from math import asin, atan2, cos, sin, tan

import mujoco
import numpy as np

fmin, fmax = min, max
@SOURCE@

NAME = "@NAME@"
FLIP = np.array([1.0, -1.0, -1.0])
parameters = list(PARAMETERS.values())
water = [0.0, 0.0, 0.0]


def install():
    """Let MuJoCo call this module, for each model that has this vehicle; after the models are loaded."""
    mujoco.set_mjcb_passive(passive)
    mujoco.set_mjcb_act_dyn(follow)


def begin(model, data):
    """Set what lagging actuators do to their commands."""
    for i, value in zip(LAGGING, followed(commands(model, data))):
        data.act[model.actuator(CONTROLS[i]).actadr[0]] = value


def turn_of(model, data):
    """Rotation from MuJoCo's axes of the body to those of its world, by the attitude in qpos; xmat is that before the step."""
    at, turn = model.joint(NAME).qposadr[0], np.empty(9)
    mujoco.mju_quat2Mat(turn, data.qpos[at + 3 : at + 7] / np.linalg.norm(data.qpos[at + 3 : at + 7]))
    return turn.reshape(3, 3)


def nu_of(model, data):
    """Velocities through the water, forward, starboard and down."""
    at, turn = model.joint(NAME).dofadr[0], turn_of(model, data)
    across = FLIP * (turn.T @ (data.qvel[at : at + 3] - FLIP * water))
    return [*across.tolist(), *(FLIP * data.qvel[at + 3 : at + 6]).tolist()]


def passive(model, data):
    """Add the force of the water, and of weight and buoyancy beyond MuJoCo's weight."""
    joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, NAME)
    if joint < 0:
        return
    at, body = model.jnt_dofadr[joint], model.jnt_bodyid[joint]
    turn, centre = turn_of(model, data), model.body_ipos[body]
    push, twist = data.xfrc_applied[body, :3], data.xfrc_applied[body, 3:]
    push_here = turn.T @ (data.qfrc_applied[at : at + 3] + push)
    twist_here = data.qfrc_applied[at + 3 : at + 6] + turn.T @ twist + np.cross(centre, turn.T @ push)
    ours = FLIP[:, None] * turn * FLIP
    angles = [atan2(ours[2, 1], ours[2, 2]), -asin(max(-1.0, min(1.0, ours[2, 0]))), atan2(ours[1, 0], ours[0, 0])]
    nu = nu_of(model, data)
    acting, _ = actuate(actual(model, data), commands(model, data), parameters)
    outside = [*(FLIP * push_here).tolist(), *(FLIP * twist_here).tolist()]
    rates = np.array(accelerations(nu, angles, acting, parameters, outside))
    # From here in MuJoCo's axes: the rigid body that moves so, about its own centre of gravity.
    omega, alpha = data.qvel[at + 3 : at + 6], FLIP * rates[3:]
    origin = FLIP * (rates[:3] + np.cross(nu[3:], nu[:3]))
    moved = origin + np.cross(alpha, centre) + np.cross(omega, np.cross(omega, centre))
    force = model.body_mass[body] * (moved - turn.T @ model.opt.gravity)
    axes = np.empty(9)
    mujoco.mju_quat2Mat(axes, model.body_iquat[body])
    axes = axes.reshape(3, 3)
    inertia = axes * model.body_inertia[body] @ axes.T
    moment = inertia @ alpha + np.cross(omega, inertia @ omega) + np.cross(centre, force)
    data.qfrc_passive[at : at + 3] += turn @ (force - push_here)
    data.qfrc_passive[at + 3 : at + 6] += moment - twist_here


def follow(model, data, number):
    """Rate of what a lagging actuator does."""
    name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, number)
    order = [CONTROLS[i] for i in LAGGING]
    if name not in order:
        return 0.0
    return actuate(actual(model, data), commands(model, data), parameters)[1][order.index(name)]


def commands(model, data):
    return [float(data.ctrl[model.actuator(name).id]) for name in CONTROLS]


def actual(model, data):
    return [float(data.act[model.actuator(CONTROLS[i]).actadr[0]]) for i in LAGGING]
'''
