"""Which way a positive control moves a vehicle: against signs of coefficients, columns of the allocation, and the published vehicles."""

from dataclasses import replace

import pytest

from seatrial.vehicles.catalogue import load_vehicle
from seatrial.vehicles.control_signs import control_senses, sense_words
from seatrial.vehicles.hull import whole_hull
from seatrial.vehicles.whole import whole_vehicle


def senses(name, **changed):
    vehicle = load_vehicle(name)
    return control_senses(vehicle.build(), {**vehicle.coefficients, **changed}, vehicle.hull.trim.get("u", 1.5))


@pytest.mark.parametrize(
    ("name", "rudder", "plane"),
    [
        ("remus100_prestero", -1, -1),
        ("remus100_hall_anstee", -1, -1),
        ("remus100_fossen", 1, -1),
        ("remus100_longitudinal", None, -1),
        ("mariner", -1, None),
    ],
)
def test_published_fins(name, rudder, plane):
    """REMUS of Prestero and of Fossen turn to opposite sides for the same rudder."""
    found = senses(name)
    assert found.get("delta_r") == (None if rudder is None else {"r": rudder})
    assert found.get("delta_s") == (None if plane is None else {"q": plane})


def test_a_fin_of_the_other_sign_has_the_other_sense():
    found = senses("remus100_hall_anstee", Y_uudelta_r=-9.64, N_uudelta_r=6.15, Z_uudelta_s=9.64, M_uudelta_s=6.15)
    assert found == {"n": {"u": 1}, "delta_r": {"r": 1}, "delta_s": {"q": 1}}
    assert [sense_words(one) for one in found.values()] == ["pushes ahead", "turns to starboard", "nose up"]


def test_a_propeller_that_would_brake_when_slow_pushes_ahead_from_the_speed_that_holds():
    """At 1.5 m/s a propeller of a few turns is towed, and more turns brake more at first."""
    assert senses("remus100_fossen")["n"] == {"u": 1}


def test_thrusters_move_what_their_columns_say():
    vehicle = load_vehicle("bluerov2_heavy")
    found = control_senses(vehicle.build(), vehicle.coefficients, 0.0)
    for thruster, sense in zip(vehicle.thrusters, found.values(), strict=True):
        column = {rate: value for rate, value in zip("uvwpqr", thruster.column, strict=True) if abs(value) > 0.01}
        assert sense == {rate: 1 if value > 0 else -1 for rate, value in column.items()}


def test_a_control_without_effect_has_no_sense():
    hull = replace(whole_hull("box", 10.0, (1.0, 1.0, 1.0)), buoyancy=98.1, weight=98.1)
    model = whole_vehicle(hull, ("X_u", "N_r", "N_uudelta_r"), attitude="euler")
    found = control_senses(model, {"X_u": -1.0, "N_r": -1.0, "N_uudelta_r": 0.0})
    assert found == {"delta_r": {}}
    assert sense_words(found["delta_r"]) == "does nothing"
