"""Every control of every vehicle, pushed free-running in the formulas of each target, moves it as it moves the vehicle."""

import json
import math
import sys
from types import ModuleType
from xml.etree import ElementTree

import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.core.signals import RATES
from seatrial.export.equations import source_of
from seatrial.export.manoeuvre import command_line, contrary_to, motion_senses, plan_for, simulate
from seatrial.export.motion import motion_of
from seatrial.export.reading import read_exported
from seatrial.export.targets.fossen import controls_of
from seatrial.export.write import make_exporter
from seatrial.vehicles.catalogue import load_vehicle, vehicle_names
from seatrial.vehicles.control_signs import push_of, sense_of
from tests.export.cases import FLIPPED, SIGN, TARGETS, published, with_terms, written
from tests.export.test_approximate import holoocean_rates, total_of, u_control
from tests.export.test_fossen import BASE
from tests.export.test_gz import Simulated

VEHICLES = {
    **{name: published(name) for name in vehicle_names() if load_vehicle(name).written is None},
    "flipped": with_terms(published(), **FLIPPED),
}
"""All that are exportable, and one whose fins have the other sign."""


def gz(exporter, vehicle, folder):
    files = written(exporter, vehicle)
    target = Simulated(files["model.sdf"], files["world.sdf"])
    mass = target.rigid + target.added

    def accelerate(nu, phi, theta, commands):
        force = target.force((SIGN * nu)[:, None], np.array([phi]), np.array([theta]), columns(commands))
        return SIGN * np.linalg.solve(mass, force[:, 0])

    return accelerate


def stonefish(exporter, vehicle, folder):
    """Its thrusters and rudders alone, in forward, starboard, down: what drags and turns the box has no sign of a command."""
    root = ElementTree.fromstring(written(exporter, vehicle)["vehicle.scn"])
    density = float(root.find(".//water").get("density"))
    mass = np.diag(vehicle.rigid_mass + vehicle.added_mass)

    def accelerate(nu, phi, theta, commands):
        force, thrusters = np.zeros(6), 0
        for actuator in root.findall(".//actuator"):
            origin = actuator.find("origin")
            place, (roll, pitch, yaw) = (np.array(origin.get(key).split(), float) for key in ("xyz", "rpy"))
            if actuator.get("type") == "rudder":
                specs = actuator.find("specs")
                angle = commands.get(actuator.get("name"), 0.0) * (-1.0 if specs.get("inverted") == "true" else 1.0)
                strength = 0.5 * density * float(specs.get("area")) * float(specs.get("lift_coeff"))
                push = strength * angle * nu[0] ** 2 * np.array([0.0, np.cos(roll), np.sin(roll)])
            else:
                thrusters += 1
                x, model = commands.get(f"f_{thrusters}", commands.get("n")), actuator.find("thrust_model")
                if model.get("type") == "quadratic":
                    x = float(model.find("thrust_coeff").get("value")) * x * abs(x)
                else:
                    ends = (model.find(key).get("value").split() for key in ("input", "output"))
                    x = np.interp(x, *(np.array(end, float) for end in ends))
                push = x * np.array([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), -np.sin(pitch)])
            force += np.concatenate([push, np.cross(place, push)])
        return force / mass

    return accelerate


def fossen(exporter, vehicle, folder):
    """The generated class itself, on a stand-in of the simulator's; its commands in its own order and units."""
    ((_, text),) = written(exporter, vehicle).items()
    made = ModuleType("made")
    exec(compile(text, "made.py", "exec"), made.__dict__)  # the file that is tested
    (kind,) = [one for name, one in vars(made).items() if isinstance(one, type) and name != "remus100"]
    target, order = kind(), controls_of(vehicle)

    def accelerate(nu, phi, theta, commands):
        units = {"n": 30 / np.pi}
        command = [units.get(name, 1.0) * commands.get(name, 0.0) for name in order]
        return target.acceleration(np.array([0, 0, 0, phi, theta, 0.0]), nu, np.array(command))

    return accelerate


def holoocean(exporter, vehicle, folder):
    (agent,) = json.loads(written(exporter, vehicle)["agent.json"])["agents"]
    mass = total_of(agent)

    def accelerate(nu, phi, theta, commands):
        fins = u_control((), **{"n": 0.0, **commands})
        return np.linalg.solve(mass, holoocean_rates(agent, nu, phi, theta, fins))

    return accelerate


def own_json(exporter, vehicle, folder):
    path = folder / "vehicle.json"
    path.write_text(written(exporter, vehicle)["vehicle.json"])
    return motion_of(read_exported(path)[0])


def table(exporter, vehicle, folder):
    lines = written(exporter, vehicle)["coefficients.csv"].splitlines()
    values = {line.split(",")[0]: line.split(",")[1] for line in lines if not line.startswith("#")}
    return motion_of(with_terms(vehicle, **{name: float(values[name]) for name in vehicle.coefficients}))


def printed(exporter, vehicle, folder):
    """The source that the files contain; its own programs run them in tests of their own."""
    source, space = source_of(vehicle), {"fmin": min, "fmax": max, **vars(math)}
    assert any(source in str(content) for content in written(exporter, vehicle).values()) or exporter.name == "fmu"
    exec(source, space)
    values = list(space["PARAMETERS"].values())
    return lambda nu, phi, theta, commands: np.array(
        space["accelerations"](list(nu), [phi, theta, 0.0], [commands[name] for name in space["CONTROLS"]], values)
    )


TWINS = {
    "gz": gz,
    "stonefish": stonefish,
    "fossen": fossen,
    "holoocean": holoocean,
    "json": own_json,
    "csv": table,
    "casadi": printed,
    "fmu": printed,
    "mjcf": printed,
}


def columns(commands):
    return {name: np.array([value]) for name, value in commands.items()}


@pytest.fixture(autouse=True)
def stand_in(monkeypatch):
    for name in ("python_vehicle_simulator", "python_vehicle_simulator.vehicles"):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    base = ModuleType("python_vehicle_simulator.vehicles.remus100")
    exec(BASE, base.__dict__)
    monkeypatch.setitem(sys.modules, base.__name__, base)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(*one.values, marks=[*one.marks, *([] if one.values == ("gz",) else [pytest.mark.proof])])
        for one in TARGETS
        if one.values[0] in TWINS  # the others hold no one vehicle that moves
    ],
)
def test_every_control_moves_the_target_as_it_moves_the_vehicle(name, tmp_path):
    exporter, tried = make_exporter(name), []
    for label, vehicle in VEHICLES.items():
        try:
            exporter.check(vehicle)
        except InputError:
            continue
        carried, own = exporter.carries(vehicle), motion_of(vehicle)
        plan = plan_for(vehicle, own)
        kept, ours = (motion_senses(vehicle, motion, plan) for motion in (carried.motion, own))
        accelerate = TWINS[name](exporter, vehicle, tmp_path)
        for control in vehicle.controls:
            if not kept[control]:
                assert f"uu{control}" in " ".join(carried.lost), f"{control} of {label} is gone, and not said to be"
                continue
            found = pushed(accelerate, carried.reversed, plan, control)
            theirs = sense_of(control, dict(zip(RATES, found, strict=True)))
            assert theirs == kept[control] == ours[control], (label, control)
            tried.append(control)
    assert tried


def pushed(accelerate, reversed_controls, plan, control):
    """Change of the target's velocities by a positive push of our control, free-running."""
    held, start = plan.controls(0.0), np.zeros(8)
    start[0] = plan.speed

    def end(push):
        ours = {**held, control: held[control] + push}
        commands = {name: -value if name in reversed_controls else value for name, value in ours.items()}
        return simulate(accelerate, {}, lambda t: commands, start, 0.3, 0.1)[-1, :6]

    return end(push_of(control)) - end(-push_of(control))


def test_targets_of_one_convention_turn_the_same_way_for_the_same_command():
    """Published fins and their contrary: the same command means the same motion, and the statement says whose sign is turned."""
    for name, rudder in (
        ("fossen", "turns to starboard"),
        ("holoocean", "turns to starboard"),
        ("gz", "turns to port"),
    ):
        lines = {}
        for label in ("remus100_hall_anstee", "flipped"):
            vehicle = VEHICLES[label]
            plan = plan_for(vehicle, motion_of(vehicle))
            lines[label] = command_line(vehicle, make_exporter(name).carries(vehicle), plan)
            assert f"delta_r {rudder}" in lines[label]
            assert "delta_s nose down" in lines[label]
        assert sum("minus seatrial's delta_r" in line for line in lines.values()) == 1
        assert sum("minus seatrial's delta_s" in line for line in lines.values()) == 1
        assert "minus seatrial's delta_s" in lines["flipped"]


def test_a_vehicle_that_follows_the_convention_is_contrary_to_none():
    convention = {"delta_r": {"r": -1}, "delta_s": {"q": -1}, "n": {"u": 1}}
    assert contrary_to(VEHICLES["remus100_hall_anstee"], convention) == ()
    assert contrary_to(VEHICLES["flipped"], convention) == ("delta_r", "delta_s")
    assert contrary_to(VEHICLES["remus100_surge"], convention) == ()
