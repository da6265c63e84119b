"""Gazebo: its hydrodynamics, lift, thruster and buoyancy formulas, applied to the written file, give our forces."""

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.export.rigid_body import drives_of
from seatrial.export.targets.gz import Gz
from tests.export.cases import (
    FLIPPED,
    SIGN,
    assert_equal,
    cross,
    down_of,
    own_force,
    published,
    rich,
    rigid_coriolis,
    spatial_inertia,
    states,
    with_law,
    with_terms,
    written,
)

AXES, RATES = "xyzkmn", "UVWPQR"


class Simulated:
    """The file as Gazebo reads it: forward, port, up."""

    def __init__(self, text, world):
        self.model = ElementTree.fromstring(text).find("model")
        world = ElementTree.fromstring(world).find("world")
        self.gravity = -float(world.findtext("gravity").split()[2])
        self.density = float(world.findtext(".//uniform_fluid_density"))
        self.plugins = self.model.findall("plugin")
        self.rigid = sum(map(self.inertia_of, self.model.findall("link")))
        self.base = self.model.find("link")
        self.added = np.zeros((6, 6))
        entries = self.base.find("inertial/fluid_added_mass")
        for entry in [] if entries is None else entries:
            i, j = ("xyzpqr".index(c) for c in entry.tag)
            self.added[i, j] = self.added[j, i] = float(entry.text)

    def inertia_of(self, link):
        inertial = link.find("inertial")
        place = np.array((link.findtext("pose") or "0 0 0 0 0 0").split(), float)[:3]
        place = place + np.array((inertial.findtext("pose") or "0 0 0 0 0 0").split(), float)[:3]
        e = {one.tag: float(one.text) for one in inertial.find("inertia")}
        tensor = [[e["ixx"], e["ixy"], e["ixz"]], [e["ixy"], e["iyy"], e["iyz"]], [e["ixz"], e["iyz"], e["izz"]]]
        return spatial_inertia(float(inertial.findtext("mass")), place, np.array(tensor))

    def plugin(self, name):
        return [one for one in self.plugins if one.get("name").endswith(name)]

    def damping(self, nu):
        """Force of the plugin: sum (lin + abs |nu_k| + quad nu_k) nu_j."""
        (plugin,), found = self.plugin("Hydrodynamics"), np.zeros_like(nu)
        for entry in plugin:
            tag = entry.tag
            if tag[0] not in AXES or tag[1] not in RATES:
                continue
            i, j, rest = AXES.index(tag[0]), RATES.index(tag[1]), tag[2:]
            factor = 1.0
            if rest:
                other = nu[RATES.index(rest[-1])]
                factor = np.abs(other) if rest.startswith("abs") else other
            found[i] += float(entry.text) * factor * nu[j]
        return found

    def lift(self, nu, controls):
        """LiftDrag: the lift stands across the flow in the plane of `forward` and `upward`, at `cp`; nothing astern."""
        found = np.zeros_like(nu)
        for plugin in self.plugin("LiftDrag"):
            cp = np.array(plugin.findtext("cp").split(), float)[:, None]
            forward, up = (np.array(plugin.findtext(key).split(), float) for key in ("forward", "upward"))
            span = np.cross(forward, up)[:, None]
            velocity = nu[:3] + cross(nu[3:], cp * np.ones_like(nu[:3]))
            inside = velocity - (span * velocity).sum(0) * span
            across = cross(span * np.ones_like(inside), inside)
            across = across / np.linalg.norm(across, axis=0)
            control = controls[plugin.findtext("control_joint_name").removesuffix("_joint")]
            pressure = 0.5 * float(plugin.findtext("air_density")) * (inside**2).sum(0)
            size = (
                float(plugin.findtext("control_joint_rad_to_cl")) * control * pressure * float(plugin.findtext("area"))
            )
            force = np.where(forward @ velocity > 0, size, 0.0) * across
            found += np.concatenate([force, cross(cp * np.ones_like(force), force)])
        return found

    def thrust(self, controls):
        found = 0.0
        for plugin in self.plugin("Thruster"):
            name = plugin.findtext("joint_name")
            joint = next(one for one in self.model.findall("joint") if one.get("name") == name)
            link = next(one for one in self.model.findall("link") if one.get("name") == joint.findtext("child"))
            place = np.array(link.findtext("pose").split(), float)[:3]
            axis = np.array(joint.findtext("axis/xyz").split(), float)
            part = name.removesuffix("_joint")
            key = {"propeller": "n"}.get(part) or next(c for c in controls if c.split("_")[-1] == part.split("_")[-1])
            value = controls[key]
            if plugin.findtext("use_angvel_cmd") == "true":
                size = float(plugin.findtext("propeller_diameter")) ** 4 * float(plugin.findtext("fluid_density"))
                value = float(plugin.findtext("thrust_coefficient")) * size * value * np.abs(value)
            column = np.concatenate([axis, np.cross(place, axis)])
            found = found + np.multiply.outer(column, value)
        return found

    def restoring(self, phi, theta):
        down = SIGN[:3, None] * down_of(phi, theta)
        mass = self.rigid[0, 0]
        centre = np.array([self.rigid[1, 5], self.rigid[2, 3], self.rigid[0, 4]]) / mass
        box = self.base.find("collision")
        volume = np.prod(np.array(box.findtext(".//size").split(), float))
        at = np.array(box.findtext("pose").split(), float)[:3]
        weight, lift = mass * self.gravity * down, -self.density * volume * self.gravity * down
        ones = np.ones_like(down)
        moments = cross(centre[:, None] * ones, weight) + cross(at[:, None] * ones, lift)
        return np.concatenate([weight + lift, moments])

    def force(self, nu, phi, theta, controls, implicit=True):
        inertia = self.rigid + (self.added if implicit else 0.0)
        return (
            self.damping(nu)
            + self.lift(nu, controls)
            + self.thrust(controls)
            + self.restoring(phi, theta)
            - rigid_coriolis(inertia, nu)
        )


def simulated(vehicle, **options):
    files = written(Gz(**options), vehicle)
    return Simulated(files["model.sdf"], files["world.sdf"])


def without(vehicle, *names):
    from seatrial.export.terms import without as less

    return less(vehicle, names)


@pytest.mark.parametrize("vehicle", [published(), rich()], ids=["published", "rich"])
def test_forces_but_of_fins_and_propeller_torque_are_ours(vehicle):
    target = simulated(vehicle)
    nu, phi, theta, controls = states(vehicle)
    controls |= {"delta_r": 0 * phi, "delta_s": 0 * phi}
    np.testing.assert_allclose(target.rigid, vehicle.rigid_mass * np.outer(SIGN, SIGN), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(target.added, vehicle.added_mass * np.outer(SIGN, SIGN), rtol=1e-15)
    wanted = own_force(without(vehicle, "K_nabsn"), nu, phi, theta, controls)
    found = SIGN[:, None] * target.force(SIGN[:, None] * nu, phi, theta, controls)
    assert_equal(found, wanted)


def test_all_forces_of_an_open_frame_are_ours():
    vehicle = published("bluerov2_heavy")
    nu, phi, theta, controls = states(vehicle)
    found = SIGN[:, None] * simulated(vehicle).force(SIGN[:, None] * nu, phi, theta, controls)
    assert_equal(found, own_force(vehicle, nu, phi, theta, controls))


def test_fins_are_ours_head_on_and_as_predicted_elsewhere():
    vehicle = published()
    target = simulated(vehicle)
    nu, phi, theta, controls = states(vehicle)
    bare = without(vehicle, "K_nabsn")
    mass = vehicle.rigid_mass + vehicle.added_mass
    predicted = Gz().carries(vehicle).motion
    found = SIGN[:, None] * target.force(SIGN[:, None] * nu, phi, theta, controls)
    assert_equal(found, mass @ predicted(nu, phi, theta, controls))
    ahead = np.zeros_like(nu)
    ahead[0] = np.abs(nu[0])
    found = SIGN[:, None] * target.force(SIGN[:, None] * ahead, phi, theta, controls)
    assert_equal(found, own_force(bare, ahead, phi, theta, controls))


@pytest.mark.parametrize("vehicle", [rich(), published("bluerov2_heavy")], ids=["rich", "frame"])
def test_the_motion_in_a_current_is_as_predicted(vehicle):
    """DART's mass and rigid Coriolis forces go with the velocity over ground, the plugin's and C_A with that through the water."""
    target, state = simulated(vehicle), states(vehicle)
    nu, phi, theta, controls = state
    water = np.array([0.2, -0.3, 0.1])[:, None] * np.ones_like(nu[:3])
    over = np.concatenate([nu[:3] + water, nu[3:]])
    through, ground = SIGN[:, None] * nu, SIGN[:, None] * over
    force = target.damping(through) + target.lift(ground, controls) + target.thrust(controls)
    force += target.restoring(phi, theta) - rigid_coriolis(target.rigid, ground) - rigid_coriolis(target.added, through)
    rates = SIGN[:, None] * np.linalg.solve(target.rigid + target.added, force)
    rates[:3] += cross(nu[3:], water)
    told = dict(zip(("current_u", "current_v", "current_w"), water[:, 0], strict=True))
    assert_equal(Gz().carries(vehicle).motion(nu, phi, theta, {**controls, **told}), rates)
    assert "in a current: M_A (omega x current) is missing" in " ".join(Gz().carries(vehicle).lost)
    assert ("fins do not feel it" in " ".join(Gz().carries(vehicle).lost)) == ("delta_r" in controls)


def test_another_engine_gets_the_same_forces_without_added_mass_under_inertial():
    vehicle = with_terms(
        published(),
        X_udot=-0.9,
        Y_vdot=-20.0,
        Z_wdot=-20.0,
        Y_rdot=0.5,
        N_vdot=0.5,
        Z_qdot=-0.5,
        M_wdot=-0.5,
        M_qdot=-2.0,
        N_rdot=-2.0,
    )
    target = simulated(vehicle, engine="other")
    nu, phi, theta, controls = states(vehicle)
    controls |= {"delta_r": 0 * phi, "delta_s": 0 * phi}
    assert not target.added.any()
    (plugin,) = target.plugin("Hydrodynamics")
    assert plugin.findtext("disable_coriolis") == "true"
    legacy = np.zeros((6, 6))
    for entry in plugin:
        if entry.tag[1:4] == "Dot":
            legacy[AXES.index(entry.tag[0]), RATES.index(entry.tag[4])] = float(entry.text)
    np.testing.assert_allclose(-legacy, vehicle.added_mass * np.outer(SIGN, SIGN), rtol=1e-15)
    found = SIGN[:, None] * target.force(SIGN[:, None] * nu, phi, theta, controls)
    assert_equal(found, own_force(without(vehicle, "K_nabsn"), nu, phi, theta, controls))


def test_added_mass_never_stands_in_both_places():
    for engine in ("dart", "other"):
        vehicle = with_terms(published("bluerov2_heavy"), Z_wdot=-5.0)
        text = written(Gz(engine=engine), vehicle)["model.sdf"]
        assert ("<fluid_added_mass>" in text) != ("Dot" in text.split("-->")[-1])


def test_an_explicit_added_mass_that_runs_away_is_refused():
    with pytest.raises(InputError, match=r"N_rdot = -4\.88.*1\.56 times") as error:
        Gz(engine="other").check(published())
    assert "--engine dart" in error.value.remedy
    with pytest.raises(InputError, match="export to gz, engine"):
        Gz(engine="bullet").check(published())


def test_limits_are_those_of_the_command_that_the_thruster_takes():
    """`OnCmdAngVel` holds a speed, and `OnCmdThrust` a force, between min_thrust_cmd and max_thrust_cmd as they stand."""
    (thruster,) = simulated(rich()).plugin("Thruster")
    assert thruster.findtext("use_angvel_cmd") == "true"
    assert float(thruster.findtext("max_thrust_cmd")) == 157.0
    assert float(thruster.findtext("min_thrust_cmd")) == 0.0
    one, *_ = simulated(published("bluerov2_heavy")).plugin("Thruster")
    assert float(one.findtext("max_thrust_cmd")) == 40.0
    (unknown,) = simulated(published()).plugin("Thruster")
    assert float(unknown.findtext("max_thrust_cmd")) > 1e6


def test_box_displaces_the_vehicle_s_volume_and_reaches_what_stands_apart():
    for vehicle in (rich(), published("bluerov2_heavy")):
        base = simulated(vehicle).base
        for kind in ("collision", "visual"):
            size = np.array(base.find(kind).findtext(".//size").split(), float)
            at = np.array(base.find(kind).findtext("pose").split(), float)
            gravity = vehicle.hull.weight / vehicle.hull.mass
            assert np.prod(size) * 1025.0 * gravity == pytest.approx(vehicle.hull.buoyancy)
            np.testing.assert_allclose(at[:3], vehicle.hull.centre_of_buoyancy * SIGN[:3], atol=1e-12)
            assert size[1] == pytest.approx(size[2])
            assert size[0] >= size[1] - 1e-12
    links = simulated(rich()).model.findall("link")[1:]
    reach = max(abs(float(link.findtext("pose").split()[0])) for link in links)
    size = np.array(simulated(rich()).base.find("collision").findtext(".//size").split(), float)
    assert size[0] == pytest.approx(max(2 * reach, np.prod(size) ** (1 / 3)))


@pytest.mark.parametrize(
    ("vehicle", "contrary"),
    [(rich(), ()), (with_terms(rich(), **FLIPPED), ("delta_r", "delta_s"))],
    ids=["ours", "contrary"],
)
def test_limits_of_fins_turn_with_their_joints(vehicle, contrary):
    """Joints turn by the right hand about axes to starboard and down; limits of commands that turn otherwise change ends and sign."""
    asked = {name: (vehicle.actuators[name].lower, vehicle.actuators[name].upper) for name in ("delta_r", "delta_s")}
    reversed_ = Gz().carries(vehicle).reversed
    assert reversed_ == contrary
    model = simulated(vehicle).model
    for name, (lower, upper) in asked.items():
        joint = next(one for one in model.findall("joint") if one.get("name") == f"{name}_joint")
        found = [float(joint.findtext(f"axis/limit/{key}")) for key in ("lower", "upper")]
        assert found == pytest.approx([-upper, -lower] if name in reversed_ else [lower, upper])


def test_a_gain_is_kept_by_speed_and_named_by_force():
    """gz gives a commanded force whole; a dead zone and weaker thrust astern it has of no thruster."""
    carried = Gz().carries(with_law())
    for words in (
        "0.63 of the force commanded by f_3",
        "0.9 of the force commanded by f_1",
        "dead_f = 2 N",
        "reverse_f = 0.8 1",
    ):
        assert words in carried.lost
    law = with_law()
    turning = replace(with_terms(law, T_nabsn=0.01), numbers={"gain_n_3": law.numbers["gain_f_3"]}, actuators={})
    assert not any("gain" in line or "commanded" in line for line in Gz().carries(turning).lost)
    assert drives_of(turning)[0][2].factor == pytest.approx(0.007)
    nu, phi, theta, controls = states(turning, count=20)
    assert_equal(
        (turning.rigid_mass + turning.added_mass) @ Gz().carries(turning).motion(nu, phi, theta, controls),
        own_force(turning, nu, phi, theta, controls),
    )
