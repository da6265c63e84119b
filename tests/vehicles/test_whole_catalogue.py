"""Published vehicles against numbers recomputed from geometry, published steering numbers and published steady speeds."""

import numpy as np
import pytest
from scipy.integrate import quad

from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError
from seatrial.export.stability import dissipation_findings
from seatrial.vehicles.catalogue import load_vehicle, make_vehicle, vehicle_names
from seatrial.vehicles.coriolis import matrix_products
from seatrial.vehicles.hull import added_mass_matrix, asymmetric_pairs
from seatrial.vehicles.linearise import Trim
from seatrial.vehicles.remus100_fossen import remus100_fossen, spheroid
from seatrial.vehicles.thrusters import allocation
from tests.vehicles.steering import nomoto, steady_motion

RHO, DIAMETER, CENTRE = 1030.0, 0.191, 0.611
RPM = 2 * np.pi / 60


def radius(x):
    """Myring's profile of the REMUS 100, m, at x ahead of the centre of buoyancy."""
    back = CENTRE - x
    nose, middle, tail, angle = 0.191, 0.654, 0.541, 0.436
    first, last = nose - 0.0165, nose - 0.0165 + middle
    if back < first:
        return 0.5 * DIAMETER * np.sqrt(max(0.0, 1 - ((back + 0.0165 - nose) / nose) ** 2))
    if back < last:
        return 0.5 * DIAMETER
    s = back - last
    square = 1.5 * DIAMETER / tail**2 - np.tan(angle) / tail
    return 0.5 * DIAMETER - square * s**2 + (DIAMETER / tail**3 - np.tan(angle) / tail**2) * s**3


def section(x):
    """Added mass of a section, kg/m; fins reach 0.1306 m from the axis."""
    r, a = radius(x), 0.1306
    return np.pi * RHO * (a**2 - r**2 + r**4 / a**2 if -0.685 < x < -0.611 else r**2)


def strips(power):
    return quad(lambda x: x**power * section(x), -0.721, 0.61, points=(-0.685, -0.611, -0.218, 0.437), limit=200)[0]


@pytest.mark.parametrize("name", ["remus100_prestero", "remus100_hall_anstee"])
def test_remus_added_mass_from_the_hull(name):
    fixed = load_vehicle(name).hull.fixed
    assert fixed["Y_vdot"] == fixed["Z_wdot"] == pytest.approx(-strips(0), rel=0.02)
    assert fixed["M_wdot"] == pytest.approx(strips(1), rel=0.1)
    assert fixed["M_qdot"] == fixed["N_rdot"] == pytest.approx(-strips(2), rel=0.02)
    assert fixed["X_udot"] == pytest.approx(-4 / 3 * np.pi * RHO * 0.0359 * 0.665 * (DIAMETER / 2) ** 2, rel=0.02)
    assert fixed["K_pdot"] == pytest.approx(
        -5 * quad(lambda x: 2 / np.pi * RHO * 0.1306**4, -0.685, -0.611)[0], rel=0.01
    )


def test_remus_drag_and_fins():
    anstee, prestero = (load_vehicle(name).coefficients for name in ("remus100_hall_anstee", "remus100_prestero"))
    assert anstee["X_uabsu"] == pytest.approx(-0.5 * RHO * 0.2 * 0.0285, rel=1e-4)
    assert prestero["X_uabsu"] == pytest.approx(-0.5 * RHO * 0.11 * 0.0285, rel=0.01)
    assert prestero["Y_uudelta_r"] == pytest.approx(0.5 * RHO * 3.12 * 0.00665, rel=0.11)
    assert prestero["N_uudelta_r"] == pytest.approx(-0.638 * prestero["Y_uudelta_r"], rel=1e-3)
    assert prestero["X_0"] == pytest.approx(-prestero["X_uabsu"] * 1.543**2, rel=1e-3)
    differing = {name for name in {*anstee, *prestero} if anstee.get(name) != prestero.get(name)}
    assert differing == {"X_0", "X_uabsu", "K_0", "T_nabsn", "K_nabsn"}


@pytest.mark.parametrize("name", ["remus100_prestero", "remus100_hall_anstee"])
def test_remus_has_all_coriolis_forces_of_its_added_mass(name):
    vehicle = load_vehicle(name)
    together = {**vehicle.hull.fixed, **vehicle.coefficients}
    added = added_mass_matrix(together)
    assert {one.name for one in matrix_products(added)} <= {CoefficientName.parse(one) for one in together}
    assert not asymmetric_pairs(together)
    assert np.linalg.eigvalsh(added).min() > 0
    assert dissipation_findings(together) == []


def test_fossens_spheroid_and_steady_speeds():
    """Derived numbers of the public simulator, and the speeds it settles at."""
    shape = spheroid()
    assert (shape.mass, *shape.inertia[:2]) == pytest.approx((31.03, 0.112, 4.028), rel=2e-3)
    k = (shape.added[0] / shape.mass, shape.added[1] / shape.mass, shape.added[4] / shape.inertia[1])
    assert k == pytest.approx((0.027, 0.9487, 0.8506), rel=2e-3)
    model = remus100_fossen("euler", ("z",))
    for rpm, speed in ((1000, 1.67), (1525, 2.55)):
        found = steady_motion(model, {}, {"n": rpm * RPM, "delta_r": 0.0, "delta_s": 0.0})
        assert found.state[0] == pytest.approx(speed, abs=0.006)


def test_fossens_vehicle_in_one_point_by_hand():
    """Rates against the simulator's equations in matrix form."""
    nu, (n, rudder, plane) = np.array([1.4, 0.2, -0.1, 0.1, -0.2, 0.3]), (120.0, 0.1, -0.05)
    shape = spheroid()
    m, a = shape.mass, np.array(shape.added)
    skew = lambda x: np.array([[0, -x[2], x[1]], [x[2], 0, -x[0]], [-x[1], x[0], 0]])  # noqa: E731
    lever = np.eye(6)
    lever[:3, 3:] = -skew([0, 0, 0.02])
    rigid = lever.T @ np.diag([m, m, m, *shape.inertia]) @ lever

    def coriolis(matrix):
        p = matrix @ nu
        return np.block([[np.zeros((3, 3)), -skew(p[:3])], [-skew(p[:3]), -skew(p[3:])]])

    added = coriolis(np.diag(a))
    for i, j in ((5, 1), (1, 5), (5, 3), (3, 5), (6, 1), (1, 6), (6, 2), (2, 6)):
        added[i - 1, j - 1] = 0.0
    mass, weight, rho = rigid + np.diag(a), m * 9.81, 1026.0
    damping = np.diag(mass) * [
        1 / 20,
        1 / 20,
        1 / 20,
        0.6 * np.sqrt(weight * 0.02 / mass[3, 3]),
        1.6 * np.sqrt(weight * 0.02 / mass[4, 4]),
        1.0,
    ]
    speed = np.linalg.norm(nu[:3])
    damping[:2] *= np.exp(-3 * speed)
    turns, width = n / (2 * np.pi), 0.14
    va = 0.944 * speed / width / 0.6632 * turns
    thrust = rho * width**4 * (0.4566 * turns**2 + (0.1798 - 0.4566) * va)
    torque = rho * width**5 * (0.07 * turns**2 + (0.0312 - 0.07) * va)
    across, along = (0.5 * rho * 0.0133 * c * (nu[0] ** 2 + nu[k] ** 2) for c, k in ((0.5, 1), (0.7, 2)))
    tau = np.array(
        [0.9 * thrust - across * rudder**2 - along * plane**2, -across * rudder, -along * plane, 0.1 * torque, 0, 0]
    )
    tau[4:] = 0.8 * tau[2], -0.8 * tau[1]
    area = 0.7 * 1.6 * 0.19
    ratio = 0.19**2 / area
    angle = np.arctan2(nu[2], nu[0])
    lift = np.pi * ratio / (1 + np.sqrt(1 + ratio**2 / 4)) * angle
    drag = 0.42 * np.pi * 0.095**2 / area + lift**2 / (np.pi * 0.7 * ratio)
    tau[[0, 2]] += (
        0.5
        * rho
        * speed**2
        * area
        * np.array([[-np.cos(angle), np.sin(angle)], [-np.sin(angle), -np.cos(angle)]])
        @ [drag, lift]
    )
    x = np.arange(21) * 0.08 - 0.8  # 21 sections of a whole strip each, as in the simulator's crossFlowDrag
    local = nu[1] + x * nu[5]
    strip = -0.5 * rho * 0.19 * np.interp(0.5, [0.4933, 0.5585], [1.2108, 1.0836]) * 0.08 * local * abs(local)
    tau[[1, 5]] += strip.sum(), (x * strip).sum()
    expected = np.linalg.solve(mass, tau - (coriolis(rigid) + added) @ nu - damping * nu)
    found = remus100_fossen().derivative({}, (*nu, 1.0, 0.0, 0.0, 0.0), (n, rudder, plane))
    assert np.allclose(found[:6], expected, rtol=1e-11, atol=1e-12)


def test_mariner_steers_as_published():
    """K = 0.185 1/s, T1 = 118 s, T2 = 7.8 s, T3 = 18.5 s at 15 knots: the linear ship of Chislett and Strom-Tejsen in the textbooks."""
    vehicle = load_vehicle("mariner")
    model = vehicle.build()
    assert (model.states, model.controls) == (("u", "v", "r"), ("delta_r",))
    found = nomoto(model, vehicle.coefficients, Trim((7.7175, 0.0, 0.0), (0.0,)))
    assert pytest.approx(-0.185, abs=5e-4) == found.K
    assert (found.T1.real, found.T2.real, found.T3) == pytest.approx((118.0, 7.8, 18.5), abs=0.06)


def test_mariner_is_a_ship_of_its_displacement():
    """16 622 m^3 of sea water; a turn at 20 degrees of rudder is some six lengths across, and slows the ship."""
    vehicle = load_vehicle("mariner")
    assert vehicle.hull.mass == pytest.approx(16_622 * 1025, rel=1e-3)
    turn = steady_motion(vehicle.build(), vehicle.coefficients, {"delta_r": -np.radians(20)}, {"u": 6.0, "r": 0.01})
    u, v, r = turn.state
    assert 5 < 2 * np.hypot(u, v) / r / 160.93 < 7
    assert u < 6.5
    assert asymmetric_pairs(vehicle.hull.fixed)


def turned(angle, vector):
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]) @ vector


def test_bluerov_is_driven_on_every_axis():
    vehicle = load_vehicle("bluerov2_heavy")
    assert dissipation_findings({**vehicle.hull.fixed, **vehicle.coefficients}) == []
    matrix = allocation(vehicle.thrusters)
    assert np.linalg.matrix_rank(matrix) == 6
    assert np.abs(matrix[5, :4]) == pytest.approx(np.full(4, 0.1888), abs=1e-4)
    # The source's table: places and directions are one vector each, turned about the vertical; vertical thrusters push up.
    turns = (0.0, 5.05, 1.91, np.pi), (0.0, np.pi / 2, 3 * np.pi / 2, np.pi), (0.0, 4.15, 1.01, np.pi)
    place, direction, vertical = (
        np.array([turned(angle, vector) for angle in angles])
        for angles, vector in zip(turns, ([0.156, 0.111, 0.085], [1, -1, 0], [0.12, 0.218, 0.0]), strict=True)
    )
    places = np.concatenate([place, vertical])
    directions = np.concatenate([direction / np.sqrt(2), np.tile([0.0, 0.0, -1.0], (4, 1))])
    columns = np.concatenate([directions, np.cross(places, directions)], axis=1)
    np.testing.assert_allclose(matrix.T, columns, atol=2e-3)
    model = vehicle.build(actuators=True)
    assert model.controls == tuple(f"f_{i}" for i in range(1, 9))
    rest = np.array([*np.zeros(6), 1.0, 0.0, 0.0, 0.0])
    sinking = model.derivative(vehicle.coefficients, tuple(rest), (0.0,) * 8)
    assert np.asarray(sinking)[:6] == pytest.approx([0, 0, (132.57 - 131.588) / 32.18, 0, 0, 0], abs=1e-12)
    ahead = model.derivative(vehicle.coefficients, tuple(rest), (10.0, 10.0, -10.0, -10.0, *(0.0,) * 4))
    assert float(ahead[0]) == pytest.approx(40 * np.sqrt(0.5) / 19.86)
    limited = model.derivative(vehicle.coefficients, tuple(rest), (1e3, 1e3, -1e3, -1e3, *(0.0,) * 4))
    assert float(limited[0]) == pytest.approx(160 * np.sqrt(0.5) / 19.86)


@pytest.mark.parametrize("name", vehicle_names())
def test_every_vehicle_builds_and_says_where_it_is_from(name):
    vehicle = load_vehicle(name)
    model = vehicle.build()
    values = vehicle.coefficients
    assert {str(term) for term in model.coefficients} == set(values)
    state = [0.5 if name == "u" else 1.0 if name == "q_w" else 0.05 for name in model.states]
    assert np.isfinite(np.asarray(model.derivative(values, tuple(state), (0.1,) * len(model.controls)))).all()
    assert vehicle.controls == model.controls
    assert len(vehicle.notes) > 200 or name == "remus100_surge"
    assert set(model.channel_units()) >= set(model.states)


def test_reduced_vehicles_by_name():
    vehicle = load_vehicle("remus100_prestero")
    assert vehicle.build(("u",)).states == ("u",)
    assert vehicle.build(("v", "r"), given=("u",)).controls == ("u", "delta_r")
    assert "Y_uv" in vehicle.terms(("v", "r"), given=("u",))
    with pytest.raises(InputError, match="all six velocities"):
        load_vehicle("remus100_fossen").build(("u",))
    with pytest.raises(InputError, match="no such vehicle"):
        load_vehicle("remus200")


def test_a_vehicle_of_ones_own_is_the_published_one_of_the_same_numbers():
    published = load_vehicle("remus100_prestero")
    body, names = (
        published.hull,
        ("inertia", "products", "centre_of_gravity", "centre_of_buoyancy", "weight", "buoyancy"),
    )
    own = make_vehicle(
        body.name,
        body.mass,
        {**body.fixed, **published.coefficients},
        **{name: getattr(body, name) for name in (*names, "thrust_deduction", "wake", "trim")},
        actuators=published.actuators,
        added_coriolis=published.added_coriolis,
        symmetric=False,
    )
    assert own.moves == published.moves
    ours, theirs = own.build(), published.build()
    assert (ours.states, ours.controls) == (theirs.states, theirs.controls)
    state = tuple(0.1 * (i + 1) for i in range(len(ours.states)))
    control = tuple(100.0 if name == "n" else 0.1 for name in ours.controls)
    found = ours.derivative(own.coefficients, state, control)
    np.testing.assert_allclose(found, theirs.derivative(published.coefficients, state, control), rtol=1e-12)


def test_coefficients_left_open_and_the_others_as_published():
    """A model with some coefficients open moves as the one with all, given the published values; new terms may be open."""
    vehicle = load_vehicle("remus100_prestero")
    whole, part = vehicle.build(moves="uvr"), vehicle.build(moves="uvr", free=["N_r", "Y_uv", "N_rabsr", "N_vdot"])
    assert [term.text for term in part.coefficients] == ["N_r", "Y_uv", "N_rabsr", "N_vdot"]
    values = {
        name: {**vehicle.hull.fixed, **vehicle.coefficients}.get(name, 0.0)
        for name in ("N_r", "Y_uv", "N_rabsr", "N_vdot")
    }
    state = tuple(0.1 * (i + 1) for i in range(len(whole.states)))
    control = tuple(100.0 if name == "n" else 0.1 for name in whole.controls)
    assert part.states == whole.states
    np.testing.assert_allclose(
        part.derivative(values, state, control), whole.derivative(vehicle.coefficients, state, control), rtol=1e-12
    )
    rest, gone = vehicle.without("Y_uv").build(moves="uvr"), {**vehicle.coefficients, "Y_uv": 0.0}
    published = {name: value for name, value in vehicle.coefficients.items() if name != "Y_uv"}
    np.testing.assert_allclose(
        rest.derivative(published, state, control), whole.derivative(gone, state, control), rtol=1e-12
    )
    with pytest.raises(InputError, match='did you mean "Y_uv"'):
        vehicle.without("Y_uvv")
    with pytest.raises(InputError, match="leave moves, given and free out"):
        load_vehicle("remus100_fossen").build(free=["X_u"])
