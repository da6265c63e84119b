"""Stonefish: what its own library made of our files, drag face by face, and what the written numbers say.

Numbers of the library are those of Stonefish 1.6 (b21eb8e), as `release/simulators/stonefish.py` runs it, at 2000 steps a second.
"""

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from seatrial.export.manoeuvre import simulate
from seatrial.export.motion import force_of
from seatrial.export.targets import stonefish
from seatrial.export.targets.stonefish import Stonefish
from seatrial.vehicles.actuators import Actuator
from tests.export.cases import own_force, published, rich, with_terms, written

FILE = Path(__file__).parents[2] / "release" / "simulators" / "stonefish.py"
DENSITY = 1025.0
REMUS, BLUEROV2 = "remus100_hall_anstee", "bluerov2_heavy"
LIBRARY = {
    REMUS: (
        {"n": 100.0, "delta_r": 0.1, "delta_s": -0.06},
        (1.2, 0.15, -0.1, 0.2, -0.1, 0.15, 0.1, -0.05),
        {
            0.5: (1.18556, 0.07067, -0.09764, -0.42906, 0.00478, 0.09041, -0.06319, -0.07379),
            1.0: (1.17927, 0.04573, -0.06948, 0.52023, 0.08127, 0.03453, -0.00927, -0.04885),
            2.0: (1.18404, 0.04188, 0.02667, 0.06287, 0.09146, -0.02927, -0.09724, 0.05149),
        },
        (58.089999796929391, 0.0, 6.6215857877632667, 5.3226703265868052),
    ),
    BLUEROV2: (
        {f"f_{number}": force for number, force in enumerate((3.0, -2.0, 1.0, 4.0, -2.0, -1.0, -2.0, 3.0), 1)},
        (0.3, -0.2, 0.1, 0.3, 0.2, -0.4, 0.1, -0.05),
        {
            0.5: (0.06705, -0.01877, 0.05452, 0.69542, -0.27237, -0.60648, 0.38872, -0.04771),
            1.0: (0.00271, 0.00354, 0.03709, 0.55934, -0.41463, -0.80471, 0.72664, 0.00046),
            2.0: (-0.02184, -0.00463, 0.0367, 0.27103, -0.64312, -0.87474, 0.94546, 0.33983),
        },
        (26.740026814542105, 0.0, 0.17214049086100475, 0.13837275723334858),
    ),
}
"""By vehicle: controls, start (u v w p q r phi theta), the same at some seconds, and added mass with its moments of inertia."""


@pytest.mark.parametrize("name", LIBRARY)
def test_the_library_moves_as_is_stated(name):
    """Drag, fins, thrusters, buoyancy and added mass together, in free motion from a start with all velocities."""
    controls, start, wanted, _ = LIBRARY[name]
    carried = Stonefish().carries(published(name))
    found = simulate(carried.motion, carried.actuators, lambda t: controls, np.array(start), 2.0, 0.01)
    for second, state in wanted.items():
        np.testing.assert_allclose(found[round(second / 0.01)], state, atol=5e-4)


@pytest.mark.parametrize("name", LIBRARY)
def test_the_library_adds_the_mass_that_is_stated(name):
    vehicle, wanted = published(name), LIBRARY[name][3]
    solid = stonefish.solid_of(vehicle, DENSITY)
    np.testing.assert_allclose([solid.added, *solid.turned], wanted, rtol=1e-7)
    assert f"{wanted[0]:.3g} kg in every direction" in Stonefish().carries(vehicle).changed[0]
    assert not {"K_pdot", "M_qdot", "N_rdot"} & set(" ".join(Stonefish().carries(vehicle).lost).split())


@pytest.mark.parametrize("name", LIBRARY)
def test_a_moment_turns_the_box_as_it_turns_the_vehicle(name):
    vehicle = published(name)
    solid = stonefish.solid_of(vehicle, DENSITY)
    for axis in range(3):
        moment = np.zeros(6)
        moment[3 + axis] = 1.0
        own = np.linalg.solve(vehicle.rigid_mass + vehicle.added_mass, moment)[3 + axis]
        assert 1.0 / (solid.inertia + solid.turned)[axis] == pytest.approx(own)


def naive_drag(solid, points, nu):
    """Drag about the origin from triangles given by their corners, one after the other, as the module's formulas say."""
    sums = np.zeros((2, 2, 3))
    for a, b, c in points:
        across = np.cross(b - a, c - a)
        area, normal, arm = np.linalg.norm(across) / 2, across / np.linalg.norm(across), (a + b + c) / 3 - solid.centre
        water = -(nu[:3] + np.cross(nu[3:], arm + solid.centre))
        push = area * np.linalg.norm(water) * water * max(0.0, -(water @ normal))
        skin = area * (water - (water @ normal) * normal)
        sums += [[push, np.cross(arm, push)], [skin, np.cross(arm, skin)]]
    total = np.zeros((2, 3))
    for part, by in zip(sums, (0.5 * DENSITY * solid.quadratic, DENSITY * solid.viscous), strict=True):
        for i, vector in enumerate(part):
            total[i] += abs(vector) @ by / np.linalg.norm(vector) * vector
    return np.concatenate([total[0], total[1] + np.cross(solid.centre, total[0])])


def test_drag_is_the_sum_over_the_faces():
    """Side walls of 8 x 8 squares, each of two triangles: 768 in all; order and diagonals are not Stonefish's, integrals nearly are."""
    solid = stonefish.solid_of(rich(), DENSITY)
    mesh = stonefish.box_mesh(solid.half)
    assert (len(mesh.vertices), len(mesh.faces)) == (486, 768)
    corners = mesh.vertices[mesh.faces] + solid.floats
    outward = np.einsum(
        "ij,ij->i", np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), corners.mean(1)
    )
    assert (outward > 0).all(), "the faces look outward"
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert volume == pytest.approx(8 * np.prod(solid.half))
    force = stonefish.drag_force(solid, DENSITY)
    for nu in np.random.default_rng(3).normal(size=(5, 6)):
        np.testing.assert_allclose(force(nu, 0.0, 0.0, {}), naive_drag(solid, corners, nu), rtol=1e-9)
    assert (force(np.zeros(6), 0.0, 0.0, {}) == 0).all()


def test_drag_is_cubic_in_speed():
    """With drag that agrees at 1 m/s, forces at which a quadratic law ends at 0.051 and 2.08 m/s end at 0.137 and 1.63."""
    solid = stonefish.solid_of(published(), DENSITY)
    front = 4 * np.array([solid.half[1] * solid.half[2], solid.half[0] * solid.half[2], solid.half[0] * solid.half[1]])
    coefficients = np.array([3.9, 131.0, 131.0])
    solid = solid._replace(quadratic=2 * coefficients / (DENSITY * front), viscous=np.zeros(3))
    force = stonefish.drag_force(solid, DENSITY)
    for axis, quadratic, cubic in ((2, 0.051, 0.1375), (0, 2.08, 1.629)):
        nu = np.zeros(6)
        nu[axis] = cubic
        assert -force(nu, 0.0, 0.0, {})[axis] == pytest.approx(coefficients[axis] * quadratic**2, rel=2e-3)


@pytest.mark.parametrize(("name", "speed"), [(REMUS, 1.5), (BLUEROV2, 0.222)])
def test_drag_is_matched_at_the_trim_speed_and_at_half_of_it(name, speed):
    vehicle = with_terms(published(), X_u=-1.2) if name == REMUS else published(name)
    solid = stonefish.solid_of(vehicle, DENSITY)
    assert solid.speed == pytest.approx(speed, rel=0.05)
    force = stonefish.drag_force(solid, DENSITY)
    own = force_of(vehicle)
    none = dict.fromkeys(vehicle.controls, 0.0)
    for share, tolerance in ((1.0, 1e-6), (0.5, 1e-6), (0.75, 0.09), (0.25, 0.25)):
        nu = np.array([share * solid.speed, 0, 0, 0, 0, 0])
        assert force(nu, 0.0, 0.0, {})[0] == pytest.approx(own(nu, 0.0, 0.0, none)[0], rel=tolerance)
    across = force(np.array([0.0, 0.0, solid.speed, 0, 0, 0]), 0.0, 0.0, {})[2]
    if name == BLUEROV2:
        still = own(np.zeros(6), 0.0, 0.0, none)[2]
        assert across == pytest.approx(own(np.array([0.0, 0.0, solid.speed, 0, 0, 0]), 0, 0, none)[2] - still, rel=1e-6)


def test_net_force_and_righting_moment_are_the_vehicles():
    """By Stonefish's gravity of 9.81 m/s^2, from the written file; the vehicle has another."""
    vehicle = rich()
    link = ElementTree.fromstring(written(Stonefish(), vehicle)["vehicle.scn"]).find(".//base_link")

    def read(tag, key):
        return np.array(link.find(tag).get(key).split(), float)

    weight = float(link.find("mass").get("value")) * 9.81
    buoyancy = DENSITY * 9.81 * np.prod(read("dimensions", "xyz"))
    assert weight - buoyancy == pytest.approx(vehicle.hull.weight - vehicle.hull.buoyancy)
    righting = read("cg", "xyz") * weight - read("origin", "xyz") * buoyancy
    np.testing.assert_allclose(righting, vehicle.hull.righting, atol=1e-9)
    still = np.zeros((6, 1))
    angles = (np.array([0.3]), np.array([-0.2]))
    none = {name: np.zeros(1) for name in vehicle.controls}
    own = own_force(vehicle, still, *angles, none)
    solid = stonefish.solid_of(vehicle, DENSITY)
    motion = Stonefish().carries(vehicle).motion(still[:, 0], 0.3, -0.2, dict.fromkeys(vehicle.controls, 0.0))
    total = solid.mass + solid.added
    push = total * (motion[:3] + np.cross(motion[3:], solid.centre))
    np.testing.assert_allclose(push, own[:3, 0], atol=1e-9)


def test_thrusters_push_along_their_axis():
    vehicle = published(BLUEROV2)
    root = ElementTree.fromstring(written(Stonefish(), vehicle)["vehicle.scn"])
    for thruster, actuator in zip(vehicle.thrusters, root.findall(".//actuator"), strict=True):
        _, pitch, yaw = map(float, actuator.find("origin").get("rpy").split())
        ahead = [np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), -np.sin(pitch)]
        np.testing.assert_allclose(ahead, thruster.column[:3], atol=1e-12)
        assert actuator.find("specs").get("max_setpoint") == "40.0"


def test_fins_give_the_vehicles_lift():
    """Head on, u^2 delta for small angles; with a slip, Y_uv and Z_uw of hull and fins together."""
    vehicle = published()
    carried, level = Stonefish().carries(vehicle), dict.fromkeys(vehicle.controls, 0.0)
    mass = stonefish.solid_of(vehicle, DENSITY)

    def push(nu, **controls):
        """Force that comes with controls or a slip, without what the faces drag."""
        own = np.array(nu, float)
        total = carried.motion(own, 0.0, 0.0, {**level, **controls}) - carried.motion(own, 0.0, 0.0, level)
        return (mass.mass + mass.added) * (total[:3] + np.cross(total[3:], mass.centre))

    for control, axis in (("delta_r", 1), ("delta_s", 2)):
        found = push([1.2, 0, 0, 0, 0, 0], **{control: 0.01})[axis]
        assert found == pytest.approx(vehicle.coefficients[f"{'XYZ'[axis]}_uu{control}"] * 1.2**2 * 0.01, rel=1e-3)
        lifts = sum(
            stonefish.rudder_force(fin)(np.array([1.2, 0.01, 0.01, 0, 0, 0]), 0, 0, {})
            for fin in stonefish.rudders_of(vehicle)
        )
        name = ("", "Y_uv", "Z_uw")[axis]
        assert lifts[axis] == pytest.approx(vehicle.coefficients[name] * 1.2 * 0.01, rel=1e-3)
        assert name not in " ".join(carried.lost)


def test_lags_of_thrusters_are_kept_and_those_of_fins_are_lost():
    vehicle = rich()
    assert vehicle.actuators["n"].time_constant == 0.5
    carried = Stonefish().carries(vehicle)
    assert carried.actuators["n"] == Actuator(0.5, -157.0, 157.0)
    assert carried.actuators["delta_r"] == Actuator(0.0, -0.25, 0.25)
    words = " ".join(carried.lost)
    assert "greatest rate 573 rpm/s and limits 0 to 1499 rpm of n" in words
    assert "lag 0.1 s and greatest rate 57.3 deg/s and limits -11.46 to 14.32 deg of delta_r" in words
    root = ElementTree.fromstring(written(Stonefish(), vehicle)["vehicle.scn"])
    assert root.find(".//actuator[@name='propeller']/rotor_dynamics/time_constant").get("value") == "0.5"
    assert root.find(".//actuator[@name='delta_r']/specs").get("max_angle") == "0.25"


def test_an_ellipsoid_about_points_holds_nearly_all_of_them():
    """The search ends early: points lie outside by less than the 20 % of volume that it allows, or after ten steps by more."""
    ball = np.random.default_rng(0).normal(size=(400, 3))
    ball *= np.array([3.0, 1.0, 0.5]) / np.linalg.norm(ball, axis=1)[:, None]
    ball = np.concatenate([ball, -ball])
    axes = stonefish.enclosing_ellipsoid(ball)
    np.testing.assert_allclose(axes, [3.0, 1.0, 0.5], rtol=0.25)


def test_inertia_that_stonefish_exceeds_is_said():
    """A slender vehicle with hardly any inertia: what is written stays positive, and the added inertia counts as lost."""
    vehicle = published()
    light = replace(vehicle, hull=replace(vehicle.hull, inertia=(0.177, 0.3, 0.3)))
    light = with_terms(light, M_qdot=-0.1, N_rdot=-0.1)
    solid = stonefish.solid_of(light, DENSITY)
    assert (solid.inertia > 0).all()
    words = " ".join(Stonefish().carries(light).lost)
    assert "M_qdot" in words
    assert "K_pdot" not in words


def test_the_laboratory_tells_the_driver_our_commands_by_the_names_of_the_scenario(tmp_path):
    """With a driver of our own that answers the start at each sample."""
    spec = importlib.util.spec_from_file_location("stonefish_laboratory", FILE)
    laboratory = sys.modules["stonefish_laboratory"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(laboratory)
    driver = tmp_path / "driver"
    driver.write_text(
        f"#!{sys.executable}\n"
        "import sys\n"
        "words = open(sys.argv[2]).read().split()\n"
        "print('mass 1 0 2 3')\n"
        "for _ in range(int(words[1])): print('state', *words[3:11])\n"
    )
    driver.chmod(0o755)
    twin = laboratory.twin_of(published(), driver, "1", tmp_path)
    assert twin.actuators == {"n": "propeller", "delta_r": "delta_r", "delta_s": "delta_s"}
    assert {path.name for path in twin.folder.iterdir()} >= {"vehicle.scn", "part.obj"}
    start = np.linspace(0.1, 0.8, 8)
    found = twin.run(start, lambda t: {"n": 90.0 + t, "delta_r": 0.1, "delta_s": -0.1}, 0.2)
    np.testing.assert_array_equal(found, np.tile(start, (3, 1)))
    lines = (twin.folder / "plan.txt").read_text().splitlines()
    assert lines[2:4] == ["0.0 0.0 0.0", "3 propeller delta_r delta_s"]
    assert len(lines) == 4 + 0.2 * laboratory.RATE
    np.testing.assert_allclose(np.array(lines[54].split(), float), [90.1, 0.1, -0.1])
    np.testing.assert_array_equal(twin.added_mass(), [1, 0, 2, 3])
