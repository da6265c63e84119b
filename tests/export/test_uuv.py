"""UUV Simulator: its Fossen model, applied to the written file as its code applies it, gives our forces without what it loses.

Velocities are those of the link's origin; the plugin's force acts at the link's centre of gravity, and the centre of buoyancy counts
from there.
"""

import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.export.targets.uuv import FILTERED, Uuv
from seatrial.export.terms import without
from tests.export.cases import (
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
    with_terms,
    written,
)

CROSSED = ("Y_rabsr", "Z_qabsq", "M_wabsw", "N_vabsv")
FINS = ("Y_uudelta_r", "Z_uudelta_s", "M_uudelta_s", "N_uudelta_r")


def read(vehicle):
    root = ElementTree.fromstring(written(Uuv(), vehicle)["vehicle.urdf"])
    places = {joint.find("child").get("link"): joint.find("origin").get("xyz") for joint in root.findall("joint")}
    rigid = np.zeros((6, 6))
    for link in root.findall("link"):
        inertial, at = link.find("inertial"), np.array(places.get(link.get("name"), "0 0 0").split(), float)
        e = {key: float(value) for key, value in inertial.find("inertia").attrib.items()}
        tensor = [[e["ixx"], e["ixy"], e["ixz"]], [e["ixy"], e["iyy"], e["iyz"]], [e["ixz"], e["iyz"], e["izz"]]]
        centre = at + np.array(inertial.find("origin").get("xyz").split(), float)
        rigid += spatial_inertia(float(inertial.find("mass").get("value")), centre, np.array(tensor))
    return root, rigid


def link_place(vehicle):
    """Where the link stands, forward, starboard, down of the coefficients' origin: the hull without propellers of 1 g each."""
    places = [np.array(one.place) for one in vehicle.thrusters] or [np.zeros(3)]
    hull = vehicle.hull.mass - 1e-3 * len(places)
    return (vehicle.hull.mass * np.array(vehicle.hull.centre_of_gravity) - 1e-3 * sum(places)) / hull


def acceleration(vehicle, nu, phi, theta, controls):
    """At our origin; hydrodynamics in forward, starboard, down, the rest in forward, port, up, turned back."""
    root, rigid = read(vehicle)
    at = link_place(vehicle)[:, None] * np.ones_like(nu[:3])
    nu = np.concatenate([nu[:3] + cross(nu[3:], at), nu[3:]])
    own = root.find(".//plugin/link")
    model = own.find("hydrodynamic_model")
    size = {
        "added_mass": (6, 6),
        "linear_damping": (6, 6),
        "linear_damping_forward_speed": (6, 6),
        "quadratic_damping": (6,),
    }
    value = {key: np.array(model.findtext(key).split(), float).reshape(shape) for key, shape in size.items()}
    damping = value["linear_damping"] @ nu + nu[0] * (value["linear_damping_forward_speed"] @ nu)
    damping += value["quadratic_damping"][:, None] * np.abs(nu) * nu
    water = SIGN[:, None] * (damping - rigid_coriolis(value["added_mass"], nu))
    down = SIGN[:3, None] * down_of(phi, theta)
    gravity = vehicle.hull.weight / vehicle.hull.mass
    buoyancy = float(own.findtext("volume")) * float(root.findtext(".//fluid_density")) * gravity
    ones, mass = np.ones_like(down), rigid[0, 0]
    centre = np.array([rigid[1, 5], rigid[2, 3], rigid[0, 4]]) / mass
    base = np.array(root.find("link/inertial/origin").get("xyz").split(), float)
    cob = base + np.array(own.findtext("center_of_buoyancy").split(), float)
    weight, lift = mass * gravity * down, -buoyancy * down
    body = np.concatenate([weight + lift, cross(centre[:, None] * ones, weight) + cross(cob[:, None] * ones, lift)])
    body += water + np.concatenate([np.zeros_like(down), cross(base[:, None] * ones, water[:3])])
    joints = {joint.get("name"): joint for joint in root.findall("joint")}
    for plugin in root.findall(".//plugin")[1:]:
        joint = joints[plugin.findtext("jointName")]
        axis, place = (np.array(joint.find(k).get("xyz").split(), float) for k in ("axis", "origin"))
        number = int(plugin.findtext("thrusterID")) + 1
        x = controls["n"] if "n" in controls else controls[f"f_{number}"]
        if plugin.findtext("conversion/type") == "Basic":
            x = float(plugin.findtext("conversion/rotorConstant")) * x * np.abs(x)
        else:
            tables = [
                np.array(plugin.findtext(f"conversion/{k}").split(), float) for k in ("inputValues", "outputValues")
            ]
            x = np.interp(x, *tables)
        body = body + np.multiply.outer(np.concatenate([axis, np.cross(place, axis)]), x)
    found = SIGN[:, None] * (body - rigid_coriolis(rigid, SIGN[:, None] * nu))
    rates = np.linalg.solve(rigid * np.outer(SIGN, SIGN) + value["added_mass"], found)
    return np.concatenate([rates[:3] - cross(rates[3:], at), rates[3:]])


def own_acceleration(vehicle, nu, phi, theta, controls):
    return np.linalg.solve(vehicle.rigid_mass + vehicle.added_mass, own_force(vehicle, nu, phi, theta, controls))


def centred(vehicle):
    """The same with its origin in the centre of gravity, where nothing is moved; the propeller weighs nothing there."""
    x, y, z = vehicle.hull.centre_of_buoyancy
    hull = replace(vehicle.hull, centre_of_gravity=(0.0, 0.0, 0.0), centre_of_buoyancy=(x, y, z - 0.02))
    return replace(vehicle, hull=hull)


@pytest.mark.parametrize("vehicle", [published(), rich()], ids=["published", "rich"])
def test_the_motion_is_as_predicted(vehicle):
    state = states(vehicle)
    assert_equal(acceleration(vehicle, *state), Uuv().carries(vehicle).motion(*state))


@pytest.mark.parametrize("vehicle", [centred(published()), centred(rich())], ids=["published", "rich"])
def test_forces_are_those_of_the_vehicle_without_what_is_lost(vehicle):
    kept = without(vehicle, ["K_nabsn", *CROSSED, *FINS])
    kept = with_terms(kept, M_rp=4.88 - 0.0704, N_pq=0.0704 - 4.88)
    state = states(vehicle)
    assert_equal(acceleration(vehicle, *state), own_acceleration(kept, *state))


def test_all_forces_of_an_open_frame_are_ours():
    vehicle = published("bluerov2_heavy")
    state = states(vehicle)
    assert_equal(acceleration(vehicle, *state), own_acceleration(vehicle, *state), 5e-3)  # propellers of 1 g below
    assert_equal(acceleration(vehicle, *state), Uuv().carries(vehicle).motion(*state))
    assert Uuv().carries(vehicle).lost == ()


@pytest.mark.parametrize("vehicle", [published(), rich(), published("bluerov2_heavy")], ids=["one", "rich", "frame"])
def test_a_tilted_vehicle_rights_itself_as_ours_does(vehicle):
    """From rest at 10 degrees of roll: weight and buoyancy alone, of the same size as ours."""
    still = {name: np.zeros(1) for name in vehicle.controls}
    state = np.zeros((6, 1)), np.radians([10.0]), np.zeros(1), still
    assert_equal(acceleration(vehicle, *state), own_acceleration(vehicle, *state))


def test_what_is_lost_is_named():
    lost = " ".join(Uuv().carries(published()).lost)
    for name in ("K_nabsn", *CROSSED, *FINS, "M_pr"):
        assert name in lost
    lost = " ".join(Uuv().carries(rich()).lost)
    assert "greatest rate 573 rpm/s of n" in lost
    assert "lag 0.5 s" not in lost
    assert "lag 0.1 s and greatest rate 57.3 deg/s and limits -11.46 to 14.32 deg of delta_r" in lost


def test_controllers_read_the_same_numbers():
    vehicle = published()
    text = written(Uuv(), vehicle)["params.yaml"]
    lines = dict(line.split(": ", 1) for line in text.splitlines() if ": " in line and line[0] not in "# -")
    assert float(lines["mass"]) == vehicle.hull.mass
    assert lines["quad_damping"] == "[-2.9355, -1310.0, -1310.0, -0.13, -188.0, -94.0]"
    cog, cob = (np.array(lines[key].strip("[]").split(","), float) for key in ("cog", "cob"))
    np.testing.assert_allclose(cob - cog, [0.0, 0.0, 0.0196], atol=1e-9)


@pytest.mark.parametrize(("ratio", "stays"), [(0.97 * FILTERED, True), (1.03 * FILTERED, False)])
def test_the_filtered_acceleration_runs_away_beyond_the_limit(ratio, stays):
    filtered, acceleration = 0.0, 1.0
    for _ in range(2000):
        filtered = 0.7 * filtered + 0.3 * acceleration
        acceleration = 1.0 - ratio * filtered
    assert (abs(acceleration) < 10) == stays
    vehicle = published("bluerov2_heavy")
    heavy = replace(vehicle, coefficients={**vehicle.coefficients, "Z_wdot": -13.5 * ratio})
    if stays:
        Uuv().check(heavy)
    else:
        with pytest.raises(InputError, match="Z_wdot"):
            Uuv().check(heavy)


def test_controllers_read_the_whole_vehicle():
    """Inertia about the centre of gravity in forward, port, up; volume and a cube of it; added mass and damping of the plugin."""
    vehicle = rich()
    text = written(Uuv(), vehicle)["params.yaml"]
    body = "\n".join(line for line in text.splitlines() if not line.startswith("#"))
    numbers = {key: float(value) for key, value in re.findall(r"^ *(\w+): ([-\d.e+]+)$", body, re.MULTILINE)}
    hull = vehicle.hull
    tensor = np.diag(hull.inertia) - np.array(
        [
            [0, hull.products[0], hull.products[1]],
            [hull.products[0], 0, hull.products[2]],
            [hull.products[1], hull.products[2], 0],
        ]
    )
    centre = np.array(hull.centre_of_gravity)
    about = (tensor - hull.mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))) * np.outer(
        SIGN[:3], SIGN[:3]
    )
    for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        assert numbers[f"i{'xyz'[i]}{'xyz'[j]}"] == pytest.approx(about[i, j], abs=1e-9)
    assert numbers["volume"] * numbers["density"] * hull.weight / hull.mass == pytest.approx(hull.buoyancy)
    for key in ("length", "width", "height"):
        assert numbers[key] ** 3 == pytest.approx(numbers["volume"])
    root, _ = read(vehicle)
    model = root.find(".//hydrodynamic_model")
    blocks = dict(re.findall(r"^(\w+):((?:\n  - \[.*\])+)", body, re.MULTILINE))
    for key, tag in (("Ma", "added_mass"), ("linear_damping", "linear_damping")):
        listed = np.array([row.split("[")[1].rstrip("]").split(",") for row in blocks[key].strip().splitlines()], float)
        np.testing.assert_allclose(listed.ravel(), np.array(model.findtext(tag).split(), float))
    forward = np.array(model.findtext("linear_damping_forward_speed").split(), float).reshape(6, 6)
    shown = re.search(r"linear_damping_forward_speed: \[(.*)\]", body)[1].split(",")
    np.testing.assert_allclose(np.array(shown, float), np.diag(forward))
    sizes = [float(root.findtext(f".//box/{key}")) for key in ("width", "length", "height")]
    assert np.prod(sizes) == pytest.approx(float(root.findtext(".//plugin/link/volume")))


def test_thrusters_are_clamped_and_lag_as_the_vehicle_s():
    (thruster,) = read(rich())[0].findall(".//plugin[thrusterID]")
    assert [float(thruster.findtext(key)) for key in ("clampMin", "clampMax")] == [0.0, 157.0]
    assert thruster.findtext("dynamics/type") == "FirstOrder"
    assert float(thruster.findtext("dynamics/timeConstant")) == 0.5
    (bare,) = read(published())[0].findall(".//plugin[thrusterID]")
    assert bare.find("clampMin") is None
    assert bare.findtext("dynamics/type") == "ZeroOrder"
    frame = published("bluerov2_heavy")
    for number, one in enumerate(read(frame)[0].findall(".//plugin[thrusterID]")):
        ends = [np.array(one.findtext(f"conversion/{key}").split(), float) for key in ("inputValues", "outputValues")]
        assert ends[0].tolist() == [-40.0, 40.0]
        assert ends[1] == pytest.approx((1 - frame.hull.thrust_deduction) * ends[0])
        assert one.findtext("thrusterID") == str(number)
        assert float(one.findtext("clampMax")) == 40.0
