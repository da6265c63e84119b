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
    about_centre = (solid.inertia + solid.turned) * motion[3:]
    np.testing.assert_allclose(about_centre + np.cross(solid.centre, push), own[3:, 0], atol=1e-9)


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


@pytest.mark.proof
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
    assert "for Stonefish 1.4 to 1.6; older versions" in (twin.folder / "vehicle.scn").read_text()
    start = np.linspace(0.1, 0.8, 8)
    found = twin.run(start, lambda t: {"n": 90.0 + t, "delta_r": 0.1, "delta_s": -0.1}, 0.2)
    np.testing.assert_array_equal(found, np.tile(start, (3, 1)))
    lines = (twin.folder / "plan.txt").read_text().splitlines()
    assert lines[2:4] == ["0.0 0.0 0.0", "3 propeller delta_r delta_s"]
    assert len(lines) == 4 + 0.2 * laboratory.RATE
    np.testing.assert_allclose(np.array(lines[54].split(), float), [90.1, 0.1, -0.1])
    np.testing.assert_array_equal(twin.added_mass(), [1, 0, 2, 3])


def actuators_of(vehicle):
    """Actuators of the written file by name: type, specs, place and angles."""
    root = ElementTree.fromstring(written(Stonefish(), vehicle)["vehicle.scn"])
    found = {}
    for one in root.findall(".//actuator"):
        origin = one.find("origin")
        place, angles = (np.array(origin.get(key).split(), float) for key in ("xyz", "rpy"))
        found[one.get("name")] = (one, one.find("specs"), place, angles)
    return found


def test_written_fins_are_the_vehicles():
    """Stonefish's lift is rho / 2 S c_l angle V^2: of each fin that of its term; a stern plane lies on its side."""
    vehicle = rich()
    found, fins = actuators_of(vehicle), stonefish.rudders_of(vehicle)
    assert {fin.control for fin in fins} >= {"delta_r", "delta_s"}
    for fin in fins:
        _, specs, place, angles = found[fin.control]
        number = {
            key: float(specs.get(key)) for key in ("area", "lift_coeff", "drag_coeff", "stall_angle", "max_angle")
        }
        assert 0.5 * DENSITY * number["area"] * number["lift_coeff"] == pytest.approx(abs(fin.lift), rel=1e-9)
        assert number["drag_coeff"] == 0.0
        assert number["max_angle"] < number["stall_angle"]
        np.testing.assert_allclose(place, [fin.place, 0, 0], atol=1e-9)
        np.testing.assert_allclose(angles, [0.0 if fin.axis == 1 else np.pi / 2, 0, 0], atol=1e-9)
        assert specs.get("inverted") == ("true" if fin.lift < 0 else "false")
    force, moment = (vehicle.coefficients[name] for name in ("Y_uudelta_r", "N_uudelta_r"))
    assert found["delta_r"][2][0] == pytest.approx(moment / force)
    force, moment = (vehicle.coefficients[name] for name in ("Z_uudelta_s", "M_uudelta_s"))
    assert found["delta_s"][2][0] == pytest.approx(-moment / force)


def test_written_thrusters_are_the_vehicles():
    """Their greatest command, lag, place, and thrust: quadratic in the speed, or the net share of a commanded force."""
    vehicle = rich()
    one, specs, place, _ = actuators_of(vehicle)["propeller"]
    share = 1 - vehicle.hull.thrust_deduction
    assert float(one.find("thrust_model/thrust_coeff").get("value")) == pytest.approx(
        share * vehicle.coefficients["T_nabsn"]
    )
    assert (specs.get("max_setpoint"), one.find("rotor_dynamics").get("type")) == ("157.0", "first_order")
    np.testing.assert_allclose(place, 0.0)
    frame = published(BLUEROV2)
    found = [value for name, value in actuators_of(frame).items()]
    for (one, _, place, _), thruster in zip(found, frame.thrusters, strict=True):
        ends = [np.array(one.find(f"thrust_model/{key}").get("value").split(), float) for key in ("input", "output")]
        np.testing.assert_allclose(ends[0], [-40.0, 40.0])
        np.testing.assert_allclose(ends[1], (1 - frame.hull.thrust_deduction) * ends[0])
        np.testing.assert_allclose(place, thruster.place)
        assert one.find("rotor_dynamics").get("type") == "zero_order"
    (unknown,) = [specs for one, specs, *_ in actuators_of(published()).values() if one.get("type") == "thruster"]
    assert float(unknown.get("max_setpoint")) == 1000.0


@pytest.mark.parametrize("control", ["delta_r", "delta_s"])
def test_force_of_a_rudder_by_its_flow(control):
    """Lift across the local flow in the fin's plane by the angle to it, and drag along the flow by its square; a naive twin."""
    fin = next(fin for fin in stonefish.rudders_of(rich()) if fin.control == control)
    force, i = stonefish.rudder_force(fin), fin.axis
    for nu in np.random.default_rng(5).uniform(-1, 1, (20, 6)) * [0.9, 0.3, 0.3, 0.3, 0.3, 0.3] + [1.5, 0, 0, 0, 0, 0]:
        angle = 0.2
        local = nu[:3] + np.cross(nu[3:], [fin.place, 0, 0])
        attack = np.arctan2(local[i], local[0]) - np.sign(fin.lift) * angle
        ahead, across = local[0], local[i]
        speed, flow = np.linalg.norm(local), np.hypot(ahead, across)
        push = -abs(fin.lift) * attack**2 * speed * local
        push[0] += abs(fin.lift) * attack * speed**2 * across / flow
        push[i] -= abs(fin.lift) * attack * speed**2 * ahead / flow
        wanted = np.concatenate([push, np.cross([fin.place, 0, 0], push)])
        np.testing.assert_allclose(force(nu, 0.0, 0.0, {control: angle}), wanted, rtol=1e-9, atol=1e-12)
    assert (force(np.zeros(6), 0.0, 0.0, {control: 0.1}) == 0).all()
    astern = force(np.array([-1.5, 0, 0, 0, 0, 0.0]), 0.0, 0.0, {control: 0.1})
    assert np.sign(astern[i]) == -np.sign(fin.lift), "astern a fin pushes to the other side"


@pytest.mark.parametrize(("hull", "there"), [(0.5, True), (-0.5, False)])
def test_a_fixed_fin_gives_the_lift_that_turning_ones_leave(hull, there):
    """Of Y_uv beyond what the rudder gives in a slip; none where the vehicle has less."""
    vehicle = published()
    lift = abs(vehicle.coefficients["Y_uudelta_r"])
    fins = stonefish.rudders_of(with_terms(vehicle, Y_uv=-lift - hull))
    fixed = [fin for fin in fins if fin.control not in ("delta_r", "delta_s") and fin.axis == 1]
    assert [fin.lift for fin in fixed] == pytest.approx([hull] if there else [])
    assert all(fin.place == 0.0 for fin in fixed)


def test_multipliers_give_the_vehicles_drag_face_by_face():
    """Of a frame at its speed: the cubic part on two faces and the linear part on four; of a cruiser the multiplier of surge alone."""
    half, speed = np.array([0.9, 0.2, 0.3]), 0.7
    vehicle = with_terms(published(BLUEROV2), X_u=-4.0, X_uabsu=-18.0, Y_v=-6.0, Y_vabsv=-22.0, Z_w=-5.0, Z_wabsw=-37.0)
    quadratic, viscous = stonefish.drag_multipliers(vehicle, half, DENSITY, speed, False)
    for i, (linear, square) in enumerate(((4.0, 18.0), (6.0, 22.0), (5.0, 37.0))):
        sides = np.delete(2 * half, i)
        cubic = 0.5 * DENSITY * quadratic[i] * np.prod(sides) * speed**3
        straight = DENSITY * viscous[i] * 2 * 2 * half[i] * sides.sum() * speed
        assert cubic + straight == pytest.approx(linear * speed + square * speed**2)
        half_way = cubic / 8 + straight / 2
        assert half_way == pytest.approx(linear * speed / 2 + square * speed**2 / 4, rel=1e-9)
    cruising, skin = stonefish.drag_multipliers(vehicle, half, DENSITY, speed, True)
    np.testing.assert_allclose(cruising, quadratic[0])
    assert skin[0] == pytest.approx(viscous[0])
    assert skin[1] * DENSITY * 8 * half[1] * (half[0] + half[2]) == pytest.approx(6.0)
    pushing = with_terms(vehicle, X_u=50.0, X_uabsu=3.0)
    assert stonefish.drag_multipliers(pushing, half, DENSITY, speed, False)[1][0] == 0.0
    assert stonefish.drag_multipliers(pushing, half, DENSITY, speed, False)[0][0] == 0.0


def test_box_holds_the_volume_and_is_as_long_as_what_stands_apart():
    for vehicle in (published(), published(BLUEROV2)):
        half, hull = stonefish.solid_of(vehicle, DENSITY).half, vehicle.hull
        displaced = hull.mass + (hull.buoyancy - hull.weight) / 9.81
        assert 8 * np.prod(half) == pytest.approx(displaced / DENSITY)
        assert half[1] == half[2]
        assert half[0] >= half[1]
        places = [abs(fin.place) for fin in stonefish.rudders_of(vehicle)]
        places += [abs(thruster.place[0]) for thruster in vehicle.thrusters]
        assert half[0] >= 0.9 * max(places)


def test_frame_s_speed_is_that_at_which_its_push_balances_drag():
    vehicle = published(BLUEROV2)
    speed, cruises = stonefish.matched_speed(vehicle)
    x_u, x_uu = (vehicle.coefficients.get(name, 0.0) for name in ("X_u", "X_uabsu"))
    assert not cruises
    assert (1 - vehicle.hull.thrust_deduction) * 10.0 + x_u * speed + x_uu * speed**2 == pytest.approx(0.0, abs=1e-6)
    assert stonefish.matched_speed(published()) == (pytest.approx(1.5), True)
