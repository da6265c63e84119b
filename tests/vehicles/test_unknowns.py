"""What of a vehicle may be sought beside coefficients, against the same vehicle built with those numbers."""

from dataclasses import replace

import numpy as np
import pytest

from seatrial.vehicles.actuators import Actuator, with_actuators
from seatrial.vehicles.catalogue import load_vehicle
from seatrial.vehicles.thrusters import Thruster, ThrustLaw

ROV = load_vehicle("bluerov2_heavy")
STATE = {
    **{"u": 0.3, "v": -0.2, "w": 0.1, "p": 0.4, "q": -0.3, "r": 0.2},
    **{"q_w": 0.5, "q_x": -0.5, "q_y": 0.1, "q_z": 0.7},
}
FORCES = np.array([3.0, -2.0, 5.0, -8.0, 4.0, -1.0, 2.0, -6.0])


def rates(vehicle, params=(), unknowns=(), forces=FORCES):
    model = vehicle.build(attitude="quaternion", unknowns=unknowns)
    state = tuple(STATE[name] for name in model.states)
    return np.array(model.derivative({**vehicle.coefficients, **dict(params)}, state, tuple(forces)))


def test_weight_and_centre_of_buoyancy_are_those_of_the_hull():
    hull = replace(ROV.hull, buoyancy=ROV.hull.weight - 3.0, centre_of_buoyancy=(0.02, -0.01, -0.03))
    sought = {"net_weight": 3.0, "x_b": 0.02, "y_b": -0.01, "z_b": -0.03}
    np.testing.assert_allclose(rates(ROV, sought, tuple(sought)), rates(replace(ROV, hull=hull)), atol=1e-12)
    # A name without a value is as stated.
    np.testing.assert_allclose(rates(ROV, (), tuple(sought)), rates(ROV), atol=1e-12)


def test_gains_and_the_share_astern_scale_each_thrust():
    gains = np.array([1.0, 1.0, 0.7, 1.0, 1.0, -1.0, 1.0, 1.0])
    sought = {"gain_f_3": 0.7, "gain_f_6": -1.0, "gain_f": 0.9, "reverse_f": 0.5}
    real = 0.9 * gains * FORCES
    real = np.where(real < 0, 0.5 * real, real)
    np.testing.assert_allclose(rates(ROV, sought, tuple(sought)), rates(ROV, forces=real), atol=1e-12)


def test_a_balanced_body_keeps_its_attitude_where_its_balance_is_sought():
    balanced = replace(ROV, hull=replace(ROV.hull, buoyancy=ROV.hull.weight, centre_of_buoyancy=(0.0, 0.0, 0.0)))
    assert "q_w" not in balanced.build().states
    assert "q_w" in balanced.build(unknowns=("z_b",)).states


def test_a_lag_that_is_sought_is_that_of_the_actuator():
    late = {name: Actuator(0.2) for name in ROV.build().controls}
    model = with_actuators(ROV.build(attitude="quaternion"), late, ("lag_f", "lag_f_2"))
    assert [one.name for one in model.unknowns] == ["lag_f", "lag_f_2"]
    state = (*(STATE[name] for name in model.states[:-8]), *np.zeros(8))
    found = np.array(model.derivative({**ROV.coefficients, "lag_f": 0.5, "lag_f_2": 0.1}, state, tuple(FORCES)))[-8:]
    np.testing.assert_allclose(found, FORCES / np.where(np.arange(8) == 1, 0.1, 0.5))


def test_law_of_thrust_against_its_definition():
    law = ThrustLaw(polynomial=(0.0, 0.05, 1e-5), neutral=1500.0, dead_zone=(1475.0, 1525.0), reverse=0.8)
    command = np.array([1100.0, 1470.0, 1475.0, 1525.0, 1530.0, 1900.0, np.nan])  # the ends of the zone are dead
    expected = [0.8 * (0.05 * -400 + 1.6), 0.8 * (0.05 * -30 + 0.009), 0.0, 0.0, 1.5 + 0.009, 20 + 1.6]
    np.testing.assert_allclose(law.thrust(command)[:-1], expected, rtol=1e-12)
    assert np.isnan(law.thrust(command)[-1])
    tabled = ThrustLaw("t.csv", reverse=2.0)
    np.testing.assert_array_equal(tabled.thrust(command[:2], lambda _: np.array([-3.0, 1.0])), [-6.0, 1.0])


def test_places_make_moments():
    assert Thruster((0.1, 0.2, 0.3), (0, 0, -2)).column == pytest.approx((0, 0, -1, -0.2, 0.1, 0))
