import numpy as np
import pytest

from seatrial.vehicles.actuators import Actuator, with_actuators
from seatrial.vehicles.hull import whole_hull
from seatrial.vehicles.simulate import simulate
from seatrial.vehicles.thrusters import Thruster, allocation
from seatrial.vehicles.whole import whole_vehicle

HULL = whole_hull("tug", 50.0, (None, None, None), thrust_deduction=0.2, wake=0.3)
TUG = whole_vehicle(HULL, ("X_u", "T_nabsn", "T_nu"), moves=("u",))
VALUES = {"X_u": -20.0, "T_nabsn": 0.01, "T_nu": -0.05}


def run(model, command, step=0.01, seconds=4.0, n_states=2):
    n = round(seconds / step) + 1
    states = simulate(model, VALUES, np.full((n, 1), command), np.full(n, step), np.zeros(n_states))
    return np.arange(n) * step, np.asarray(states)


def test_thrust_with_deduction_and_wake():
    u, n = 1.5, 40.0
    force = -20 * u + 0.8 * (0.01 * n**2 - 0.05 * n * 0.7 * u)
    assert TUG.derivative(VALUES, (u,), (n,)) == pytest.approx((force / 50,), rel=1e-13)


def test_a_lag_is_of_first_order():
    model = with_actuators(TUG, {"n": Actuator(0.5)})
    assert (model.states, model.controls) == (("u", "n_act"), ("n",))
    assert model.channel_units()["n_act"] == "rad/s"
    assert model.channel_units()["n_actdot"] == "rad/s^2"
    time, states = run(model, 40.0)
    assert np.abs(states[:, 1] - 40 * (1 - np.exp(-time / 0.5))).max() < 1e-7
    assert model.derivative(VALUES, (1.0, 30.0), (40.0,))[0] == pytest.approx(
        TUG.derivative(VALUES, (1.0,), (30.0,))[0]
    )


def test_limits_of_value_and_rate():
    time, states = run(with_actuators(TUG, {"n": Actuator(0.01, upper=25.0, rate=10.0)}), 40.0)
    assert np.abs(states[:, 1] - np.minimum(10 * time, 25.0)).max() < 0.15
    assert states[:, 1].max() < 25.0 + 1e-9


def test_an_actuator_without_lag_limits_at_once():
    model = with_actuators(TUG, {"n": Actuator(0.0, -10.0, 25.0)})
    assert model.states == ("u",)
    assert model.derivative(VALUES, (1.0,), (40.0,)) == pytest.approx(TUG.derivative(VALUES, (1.0,), (25.0,)))
    assert model.derivative(VALUES, (1.0,), (-40.0,)) == pytest.approx(TUG.derivative(VALUES, (1.0,), (-10.0,)))


CORNERS = tuple(Thruster((0.2 * a, 0.15 * b, 0.05), (a * 1.0, -b * 1.0, 0.0)) for a in (1, -1) for b in (1, -1))


def test_allocation_is_force_and_moment_of_each_thruster():
    matrix = allocation(CORNERS)
    for column, thruster in zip(matrix.T, CORNERS, strict=True):
        direction = np.array(thruster.direction) / np.sqrt(2)
        assert np.allclose(column, [*direction, *np.cross(thruster.place, direction)])


def test_thrusters_by_force_and_by_speed():
    hull = whole_hull("frame", 10.0, (0.3, 0.3, 0.4), thrust_deduction=0.1, wake=0.2)
    by_force = whole_vehicle(hull, (), thrusters=CORNERS)
    assert by_force.controls == ("f_1", "f_2", "f_3", "f_4")
    forces, nu = np.array([1.0, -2.0, 3.0, 0.5]), np.array([0.4, -0.3, 0.2, 0.5, -0.6, 0.7])
    still = by_force.derivative({}, tuple(np.zeros(6)), tuple(forces))
    assert np.allclose(np.array(still) * [10, 10, 10, 0.3, 0.3, 0.4], 0.9 * allocation(CORNERS) @ forces)
    by_speed = whole_vehicle(hull, ("T_nabsn", "T_absnu"), thrusters=CORNERS)
    assert by_speed.controls == ("n_1", "n_2", "n_3", "n_4")
    turns = np.array([100.0, -50.0, 80.0, 120.0])
    local = np.array([t.column[:3] @ (nu[:3] + np.cross(nu[3:], t.place)) for t in CORNERS])
    thrust = 1e-4 * turns * abs(turns) - 0.02 * abs(turns) * 0.8 * local
    values = {"T_nabsn": 1e-4, "T_absnu": -0.02}
    driven = np.array(by_speed.derivative(values, tuple(nu), tuple(turns)))
    coasting = np.array(by_speed.derivative(values, tuple(nu), (0.0,) * 4))
    assert np.allclose((driven - coasting) * [10, 10, 10, 0.3, 0.3, 0.4], 0.9 * allocation(CORNERS) @ thrust)
