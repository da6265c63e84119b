"""Steady motions and steering numbers against balances and responses computed apart."""

import numpy as np
import pytest
from scipy.signal import TransferFunction, step

from seatrial.vehicles.catalogue import load_vehicle
from seatrial.vehicles.hull import whole_hull
from seatrial.vehicles.linearise import Trim, linearise, trim
from seatrial.vehicles.simulate import simulate
from seatrial.vehicles.whole import whole_vehicle
from tests.vehicles import prestero_twin as twin
from tests.vehicles.steering import nomoto, steady_motion
from tests.vehicles.test_linearise import ENTRY, MODEL

REMUS = load_vehicle("remus100_hall_anstee")
WHOLE = REMUS.build(positions=("z",))
SHIP = whole_vehicle(
    whole_hull("ship", 100.0, (None, None, 60.0), fixed={"Y_vdot": -80.0, "N_rdot": -40.0}),
    ("Y_absuv", "Y_absur", "Y_uudelta_r", "N_absuv", "N_absur", "N_uudelta_r", "N_r3"),
    moves=("v", "r"),
    given=("u",),
)
STABLE = {
    "Y_absuv": -120.0, "Y_absur": 30.0, "Y_uudelta_r": 20.0, "N_absuv": -40.0, "N_absur": -70.0, "N_uudelta_r": -30.0,
    "N_r3": -200.0,
}  # fmt: skip
STRAIGHT = Trim((0.0, 0.0), (1.0, 0.0))


def named(model, values):
    return dict(zip(model.states, values.state, strict=True)) | dict(zip(model.controls, values.control, strict=True))


def test_level_flight_is_that_of_the_longitudinal_vehicle():
    expected = trim(MODEL, ENTRY.coefficients, n=120.0)
    found = steady_motion(MODEL, ENTRY.coefficients, {"n": 120.0, "zdot": 0.0})
    assert np.delete(found.state, 3) == pytest.approx(np.delete(expected.state, 3), abs=1e-9)
    assert found.control == pytest.approx(expected.control, abs=1e-9)


def test_speed_and_depth_rate_of_the_whole_vehicle():
    """The propeller's torque heels the vehicle; rudder and stern plane hold its course and depth rate."""
    found = steady_motion(WHOLE, REMUS.coefficients, {"u": 1.5, "zdot": 0.1, "r": 0.0})
    rates = dict(zip(WHOLE.states, WHOLE.derivative(REMUS.coefficients, *found), strict=True))
    assert max(abs(float(rates[name])) for name in ("u", "v", "w", "p", "q", "r", "q_w", "q_x", "q_y", "q_z")) < 1e-9
    assert float(rates["z"]) == pytest.approx(0.1)
    at = named(WHOLE, found)
    assert at["u"] == pytest.approx(1.5)
    heel = 2 * np.arctan2(at["q_x"], at["q_w"])
    assert heel == pytest.approx(-1.121e-5 * at["n"] ** 2 / (0.0196 * 30.48 * 9.81), rel=0.05)


@pytest.mark.proof
def test_a_steady_turn_for_given_controls():
    held = {"n": 120.0, "delta_r": -0.05, "delta_s": 0.02}
    model = REMUS.build(attitude="euler")
    found = named(model, steady_motion(model, REMUS.coefficients, held, guess={"r": 0.1}))
    assert {name: found[name] for name in held} == pytest.approx(held)
    assert abs(found["r"]) > 0.01
    drive = 120.0**2 * np.array([0.9 * 6.279e-4, -1.121e-5])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(twin, "W", 30.48 * 9.81)
        patch.setattr(twin, "B", 30.48 * 9.81 + 3.336)
        state = np.zeros(12)
        state[:6] = [found[name] for name in "uvwpqr"]
        state[9:11] = found["phi"], found["theta"]
        rate = twin.rate(state, -0.05, 0.02, drive, c={**twin.PUBLISHED, "X_uabsu": -2.9355})
    assert np.abs(np.delete(rate, [6, 7, 8, 11])).max() < 1e-8
    # The axis of a steady turn is the vertical.
    assert rate[11] == pytest.approx(np.linalg.norm(state[3:6]) * np.sign(rate[11]))


def test_nomoto_is_the_step_response_of_the_linear_ship():
    found = nomoto(SHIP, STABLE, STRAIGHT)
    a, b = (np.asarray(x) for x in linearise(SHIP, STABLE, *STRAIGHT))
    assert pytest.approx((-np.linalg.solve(a, b[:, 1]))[1], rel=1e-12) == found.K
    transfer = TransferFunction([found.K * found.T3, found.K], np.real(np.polymul([found.T1, 1], [found.T2, 1])))
    _time, response = step(transfer, T=np.linspace(0, 5, 51))
    control = np.tile([1.0, 1e-6], (501, 1))
    states = simulate(SHIP, STABLE, control, np.full(501, 0.01), np.zeros(2))
    assert np.abs(np.asarray(states)[::10, 1] * 1e6 - response).max() < 1e-5 * abs(found.K)
    assert pytest.approx(np.real(found.T1 + found.T2) - found.T3) == found.T
