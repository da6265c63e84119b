"""UUV Simulator: its Fossen model, applied to the written file, gives the forces of our vehicle without what it loses."""

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.export.kept import without
from seatrial.export.targets.uuv import FILTERED, Uuv
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


def force(vehicle, nu, phi, theta, controls):
    """Hydrodynamics in forward, starboard, down; body, weight and buoyancy in forward, port, up, turned back."""
    root, rigid = read(vehicle)
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
    water = damping - rigid_coriolis(value["added_mass"], nu)
    down = SIGN[:3, None] * down_of(phi, theta)
    gravity = vehicle.hull.weight / vehicle.hull.mass
    buoyancy = float(own.findtext("volume")) * float(root.findtext(".//fluid_density")) * 9.81
    ones, mass = np.ones_like(down), rigid[0, 0]
    centre = np.array([rigid[1, 5], rigid[2, 3], rigid[0, 4]]) / mass
    at = np.array(own.findtext("center_of_buoyancy").split(), float)
    weight, lift = mass * gravity * down, -buoyancy * down
    body = np.concatenate([weight + lift, cross(centre[:, None] * ones, weight) + cross(at[:, None] * ones, lift)])
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
    flipped = SIGN[:, None] * nu
    return water + SIGN[:, None] * (body - rigid_coriolis(rigid, flipped))


@pytest.mark.parametrize("vehicle", [published(), rich()], ids=["published", "rich"])
def test_forces_are_those_of_the_vehicle_without_what_is_lost(vehicle):
    nu, phi, theta, controls = states(vehicle)
    kept = without(vehicle, ["K_nabsn", *CROSSED, *FINS])
    kept = with_terms(kept, M_rp=4.88 - 0.0704, N_pq=0.0704 - 4.88)
    found = force(vehicle, nu, phi, theta, controls)
    assert_equal(found, own_force(kept, nu, phi, theta, controls))
    mass = vehicle.rigid_mass + vehicle.added_mass
    assert_equal(found, mass @ Uuv().carries(vehicle).motion(nu, phi, theta, controls))


def test_all_forces_of_an_open_frame_are_ours():
    vehicle = published("bluerov2_heavy")
    nu, phi, theta, controls = states(vehicle)
    assert_equal(force(vehicle, nu, phi, theta, controls), own_force(vehicle, nu, phi, theta, controls))
    assert Uuv().carries(vehicle).lost == ()


def test_what_is_lost_is_named():
    lost = " ".join(Uuv().carries(published()).lost)
    for name in ("K_nabsn", *CROSSED, *FINS, "M_pr"):
        assert name in lost
    assert "greatest rate" in " ".join(Uuv().carries(rich()).lost)


def test_controllers_read_the_same_numbers():
    vehicle = published()
    text = written(Uuv(), vehicle)["params.yaml"]
    lines = dict(line.split(": ", 1) for line in text.splitlines() if ": " in line and line[0] not in "# -")
    assert float(lines["mass"]) == vehicle.hull.mass
    assert lines["quad_damping"] == "[-2.9355, -1310.0, -1310.0, -0.13, -188.0, -94.0]"
    assert lines["cog"] == "[0.0, 0.0, -0.0196]"


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
