"""The exporters' own evaluation of a vehicle against the package's model."""

from dataclasses import replace

import numpy as np
import pytest

from seatrial.export.motion import force_of, motion_of
from seatrial.export.rigid_body import body_of, drives_of, fin_force, fins_of, point_mass, volume_of
from seatrial.export.terms import all_products, automatic_products, sorted_terms
from tests.export.cases import assert_equal, commanded, own_force, published, rich, states, towing, with_terms


@pytest.mark.parametrize(
    "vehicle",
    [published(), rich(), published("bluerov2_heavy"), commanded(), towing()],
    ids=["published", "rich", "frame", "commanded", "tether"],
)
def test_forces_are_those_of_the_model(vehicle):
    nu, phi, theta, controls = states(vehicle)
    wanted = own_force(vehicle, nu, phi, theta, controls)
    assert_equal(force_of(vehicle)(nu, phi, theta, controls), wanted)
    mass = vehicle.rigid_mass + vehicle.added_mass
    assert_equal(mass @ motion_of(vehicle)(nu, phi, theta, controls), wanted)


def test_every_term_has_one_form():
    vehicle = rich()
    found = sorted_terms(vehicle.forces)
    assert sum(map(len, vars(found).values())) == len(vehicle.forces)
    assert found.modulus[1, 5, 5] == vehicle.coefficients["Y_rabsr"]
    assert found.product[0, 2, 4] == vehicle.coefficients["X_wq"]
    assert found.fin[5, "delta_r"] == vehicle.coefficients["N_uudelta_r"]
    assert set(found.other) == {"K_nabsn"}


def test_products_of_the_added_mass_are_minus_its_coriolis_force():
    vehicle = published("bluerov2_heavy")
    assert all_products(vehicle) == automatic_products(vehicle)
    values = automatic_products(vehicle)
    assert values[5, 0, 1] == pytest.approx(-7.12 + 6.36), "the Munk moment in yaw, (Y_vdot - X_udot) u v"
    assert np.isfinite(list(values.values())).all()


def test_terms_that_are_no_force_on_the_hull_are_of_no_form():
    """The propeller's torque is on no axis, and neither changes from trim nor speeds of rotation are products of velocities."""
    assert sorted_terms({"Q_u": 2.0, "Q_uv": 3.0, "X_du": 4.0, "N_n": 5.0}).other == {
        "Q_u": 2.0,
        "Q_uv": 3.0,
        "X_du": 4.0,
        "N_n": 5.0,
    }
    assert sorted_terms({"T_nabsn": 1.0}).thrust == {"T_nabsn": 1.0}


@pytest.mark.parametrize(
    ("name", "form", "key"),
    [
        ("N_v", "linear", (5, 1)),
        ("Z_q", "linear", (2, 4)),
        ("K_pabsp", "modulus", (3, 3, 3)),
        ("M_wabsq", "modulus", (4, 2, 4)),
        ("M_qabsw", "modulus", (4, 4, 2)),
        ("X_rv", "product", (0, 1, 5)),
        ("X_q2", "product", (0, 4, 4)),
        ("M_uudelta_s", "fin", (4, "delta_s")),
        ("M_udelta_s", "other", "M_udelta_s"),
        ("M_uudelta_s2", "other", "M_uudelta_s2"),
        ("Y_v3", "other", "Y_v3"),
        ("Y_uvabsv", "other", "Y_uvabsv"),
        ("Y_uudelta_rdelta_s", "other", "Y_uudelta_rdelta_s"),
        ("X_0", "other", "X_0"),
    ],
)
def test_each_form_by_its_axis_and_velocities(name, form, key):
    found = vars(sorted_terms({name: 1.5}))
    assert {kind: values for kind, values in found.items() if values} == {form: {key: 1.5}}


def test_a_body_is_read_from_the_matrix_of_its_parts():
    """Two small parts turn about their common centre with the reduced mass times the square of their distance."""
    masses, places = (3.0, 5.0), np.array([[0.4, -0.1, 0.2], [-0.3, 0.3, 0.0]])
    whole = sum(point_mass(m, 0.1 * m, place) for m, place in zip(masses, places, strict=True))
    body, apart = body_of(whole), places[0] - places[1]
    assert body.mass == pytest.approx(8.0)
    np.testing.assert_allclose(body.centre, (3 * places[0] + 5 * places[1]) / 8)
    turning = 0.8 * np.eye(3) + 15 / 8 * (apart @ apart * np.eye(3) - np.outer(apart, apart))
    np.testing.assert_allclose(body.inertia, turning, atol=1e-12)


def test_fins_lift_across_the_flow_where_they_are():
    """Force of u^2 delta turned into the local flow, its moment by its place; nothing astern, and water that moves is no matter."""
    terms = {"Y_uudelta_r": 9.0, "N_uudelta_r": -6.3, "Z_uudelta_s": -8.0, "M_uudelta_s": -4.8, "K_uudelta_r": 0.2}
    fins, left = fins_of(sorted_terms(terms))
    assert left == ("K_uudelta_r",)
    assert [fin.place for fin in fins] == pytest.approx([-0.7, -0.6])
    nu, delta = np.array([1.5, 0.3, -0.2, 0.4, 0.25, -0.35]), {"delta_r": 0.1, "delta_s": -0.2}
    wanted = np.zeros(6)
    for lift, x, axis, angle in ((9.0, -0.7, 1, 0.1), (-8.0, -0.6, 2, -0.2)):
        place = np.array([x, 0.0, 0.0])
        local = nu[:3] + np.cross(nu[3:], place)
        local[3 - axis] = 0.0
        normal = np.zeros(3)
        normal[[0, axis]] = -local[axis], local[0]
        push = lift * angle * np.linalg.norm(local) * normal
        wanted += np.concatenate([push, np.cross(place, push)])
    np.testing.assert_allclose(fin_force(fins)(nu, 0.0, 0.0, delta), wanted, rtol=1e-12)
    assert not fin_force(fins)(-nu, 0.0, 0.0, delta).any()


def test_thrust_of_a_drive_is_net_of_the_deduction():
    """By the square of the speed, or as a share of a commanded force; limits are those of its actuator."""
    vehicle = rich()
    (drive,), others = drives_of(vehicle)
    net = (1 - vehicle.hull.thrust_deduction) * vehicle.coefficients["T_nabsn"]
    assert drive.factor == pytest.approx(net)
    assert (drive.control, drive.lower, drive.upper, others) == ("n", 0.0, 157.0, ())
    free = drives_of(replace(vehicle, actuators={}))[0][0]
    assert (free.lower, free.upper) == (-np.inf, np.inf)
    without, terms = drives_of(with_terms(replace(vehicle, coefficients={}), T_absnu=0.1))
    assert (without, terms) == ((), ("T_absnu",))
    drives, terms = drives_of(commanded())
    assert (drives[2].control, drives[2].factor, drives[2].share) == ("f_3", None, pytest.approx(0.85))
    assert terms == ("T_absf", "T_uabsf", "T_fdV")


def test_volume_displaces_the_buoyancy():
    """Under the gravity by which weight and mass agree."""
    vehicle = rich()
    gravity = 298.0 / vehicle.hull.mass
    assert volume_of(vehicle, 1000.0) * 1000.0 * gravity == pytest.approx(vehicle.hull.buoyancy)
