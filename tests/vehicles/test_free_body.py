"""Bodies on which nothing dissipates: what Kirchhoff's equations keep, and attitudes known in closed form."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from seatrial.core.coefficients import CoefficientName
from seatrial.numerics.rotations import matrix_of_quaternion
from seatrial.vehicles.coriolis import matrix_products
from seatrial.vehicles.hull import added_mass_matrix, rigid_mass_matrix, whole_hull
from seatrial.vehicles.simulate import simulate
from seatrial.vehicles.whole import whole_vehicle

AXES, RATES = "XYZKMN", "uvwpqr"
START = np.array([0.8, -0.3, 0.4, 0.5, -0.6, 0.4, 1.0, 2.0, 3.0, 0.8, 0.2, -0.4, 0.4])


def odd_body(added=True):
    """A body without any symmetry, in neutral buoyancy about its centre of gravity, with a full added mass."""
    rng = np.random.default_rng(7)
    root = rng.normal(size=(6, 6))
    entries = -(root @ root.T + np.diag([20.0, 40.0, 30.0, 2.0, 5.0, 4.0]))
    fixed = {f"{AXES[i]}_{RATES[j]}dot": float(entries[i, j]) for i in range(6) for j in range(6)}
    centre = (0.05, -0.02, 0.04)
    return whole_hull(
        "odd body",
        30.0,
        (1.2, 4.0, 3.8),
        products=(0.1, -0.2, 0.15),
        centre_of_gravity=centre,
        centre_of_buoyancy=centre,
        fixed=fixed if added else {},
    )


def path(hull, step, duration=4.0, **options):
    model = whole_vehicle(hull, (), positions=("x", "y", "z"), added_coriolis="automatic", **options)
    n = round(duration / step) + 1
    start = START / np.concatenate([np.ones(9), np.full(4, np.linalg.norm(START[9:]))])
    return np.asarray(simulate(model, {}, np.zeros((n, 0)), np.full(n, step), start))


def kept(hull, states):
    """Energy, momentum and angular momentum about a fixed point, in fixed axes, shape (n, 7)."""
    matrix = rigid_mass_matrix(hull) + added_mass_matrix(hull.fixed)
    rows = []
    for state in states:
        momentum = matrix @ state[:6]
        turned = np.array(matrix_of_quaternion(tuple(state[9:])))
        linear = turned @ momentum[:3]
        angular = turned @ momentum[3:] + np.cross(state[6:9], linear)
        rows.append([0.5 * state[:6] @ momentum, *linear, *angular])
    return np.array(rows)


def test_energy_and_momentum_are_kept_in_an_ideal_fluid():
    hull = odd_body()
    values = kept(hull, path(hull, 0.005))
    assert np.abs(values - values[0]).max() < 1e-8 * np.abs(values[0]).max()


def test_a_rigid_body_in_a_vacuum_keeps_its_momentum_about_any_origin():
    hull = odd_body(added=False)
    values = kept(hull, path(hull, 0.005))
    assert np.abs(values - values[0]).max() < 1e-8 * np.abs(values[0]).max()


def test_the_step_is_of_fourth_order():
    ends = [path(odd_body(), step, 2.0)[-1] for step in (0.04, 0.02, 0.01)]
    order = np.log2(np.abs(ends[0] - ends[1]).max() / np.abs(ends[1] - ends[2]).max())
    assert order == pytest.approx(4.0, abs=0.2)


def test_coriolis_forces_do_no_work_whatever_the_mass():
    matrix = rigid_mass_matrix(odd_body()) + added_mass_matrix(odd_body().fixed)
    rng = np.random.default_rng(8)
    for nu in rng.normal(size=(20, 6)):
        signals = dict(zip(RATES, nu, strict=True))
        force = np.zeros(6)
        for product in matrix_products(matrix):
            force[AXES.index(product.name.axis)] += product.factor * product.name.regressor(signals, {})
        momentum = matrix @ nu
        expected = np.concatenate(
            [
                -np.cross(nu[3:], momentum[:3]),
                -np.cross(nu[:3], momentum[:3]) - np.cross(nu[3:], momentum[3:]),
            ]
        )
        assert np.allclose(force, expected, rtol=1e-12, atol=1e-12)
        assert abs(nu @ force) < 1e-11


def test_added_mass_makes_the_named_couplings_of_the_published_vehicle():
    """Prestero's X_wq = Z_wdot, Y_pq = -Z_qdot, M_uw = X_udot - Z_wdot and so on, out of Kirchhoff's equations."""
    added = {
        "X_udot": -0.93, "Y_vdot": -35.5, "Y_rdot": 1.93, "Z_wdot": -35.5, "Z_qdot": -1.93, "K_pdot": -0.0704,
        "M_wdot": -1.93, "M_qdot": -4.88, "N_vdot": 1.93, "N_rdot": -4.88,
    }  # fmt: skip
    found = {product.name: product.factor for product in matrix_products(added_mass_matrix(added))}
    expected = {
        "X_wq": -35.5, "X_qq": -1.93, "X_vr": 35.5, "X_rr": -1.93, "Y_ur": -0.93, "Y_wp": 35.5, "Y_pq": 1.93, "Z_uq": 0.93,
        "Z_vp": -35.5, "Z_rp": 1.93, "M_uw": 34.57, "M_vp": -1.93, "M_rp": 4.8096, "M_uq": 1.93, "N_uv": -34.57,
        "N_wp": -1.93, "N_pq": -4.8096, "N_ur": 1.93,
    }  # fmt: skip
    assert set(found) == {CoefficientName.parse(name) for name in expected}
    for name, value in expected.items():
        assert found[CoefficientName.parse(name)] == pytest.approx(value, rel=1e-12), name


def test_a_turn_through_the_vertical():
    """Two and a half loops at a steady pitch rate: no angle of 90 degrees stands in the way of a quaternion."""
    hull = whole_hull("sphere", 10.0, (1.0, 1.0, 1.0))
    n, step = 501, 0.02
    start = np.array([1.0, 0, 0, 0, np.pi / 2, 0, 1.0, 0, 0, 0])
    model = whole_vehicle(hull, ("X_theta",))
    states = np.asarray(simulate(model, {"X_theta": 0.0}, np.zeros((n, 0)), np.full(n, step), start))
    half = np.pi / 4 * step * np.arange(n)
    assert model.states[6:] == ("q_w", "q_x", "q_y", "q_z")
    assert np.abs(states[:, 6:] - np.column_stack([np.cos(half), 0 * half, np.sin(half), 0 * half])).max() < 1e-6
    # The force of inertia turns with the body: a straight path in space.
    assert np.abs(states[:, 0] - np.cos(2 * half)).max() < 1e-5


def test_a_tumbling_sphere_turns_as_the_exponential_says():
    hull = whole_hull("sphere", 10.0, (1.0, 1.0, 1.0))
    model = whole_vehicle(hull, (), moves=("p", "q", "r"), positions=("z",))
    omega, n, step = np.array([0.7, -1.1, 0.9]), 201, 0.02
    start = np.array([*omega, 0.0, 1.0, 0.0, 0.0, 0.0])
    final = np.asarray(simulate(model, {}, np.zeros((n, 0)), np.full(n, step), start))[-1, 4:]
    expected = Rotation.from_rotvec(omega * step * (n - 1)).as_quat()
    assert np.abs(final - np.array([expected[3], *expected[:3]])).max() < 1e-6


def test_a_length_in_error_is_pulled_to_one_without_turning():
    hull = whole_hull("sphere", 10.0, (1.0, 1.0, 1.0))
    model = whole_vehicle(hull, (), moves=("p", "q", "r"), positions=("z",))
    start = np.array([0.0, 0.0, 0.0, 0.0, *(1.02 * np.array([0.5, 0.5, -0.5, 0.5]))])
    final = np.asarray(simulate(model, {}, np.zeros((301, 0)), np.full(301, 0.05), start))[-1, 4:]
    assert np.abs(final - np.array([0.5, 0.5, -0.5, 0.5])).max() < 1e-9


def test_a_floating_body_rises_and_rights_itself():
    """Heave alone under net buoyancy; roll alone under the righting moment of a low centre of gravity."""
    hull = whole_hull(
        "float",
        10.0,
        (0.2, 0.5, 0.5),
        centre_of_gravity=(0, 0, 0.02),
        buoyancy=103.1,
        fixed={"Z_wdot": -5.0, "K_pdot": -0.1},
    )
    heave = whole_vehicle(hull, (), moves=("w",))
    assert heave.states == ("w",)
    assert heave.derivative({}, (0.3,), ()) == pytest.approx(((98.1 - 103.1) / 15.0,))
    roll = whole_vehicle(hull, (), moves=("p",))
    assert roll.states == ("p", "phi")
    assert roll.derivative({}, (0.0, 0.4), ()) == pytest.approx((-0.02 * 98.1 * np.sin(0.4) / 0.3, 0.0))
