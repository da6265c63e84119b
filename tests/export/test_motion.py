"""The exporters' own evaluation of a vehicle against the package's model."""

import numpy as np
import pytest

from seatrial.export.motion import force_of, motion_of
from seatrial.export.terms import all_products, automatic_products, product_name, sorted_terms
from tests.export.cases import assert_equal, own_force, published, rich, states


@pytest.mark.parametrize(
    "vehicle", [published(), rich(), published("bluerov2_heavy")], ids=["published", "rich", "frame"]
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
    assert product_name((0, 4, 4)) == "X_q2"
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
