"""The standard manoeuvre in which exports are compared: its commands by the clock, and what it makes of simple motions."""

from dataclasses import replace

import numpy as np
import pytest

from seatrial.export.manoeuvre import (
    DEFAULT_SPEED,
    DURATION,
    STEP,
    ManoeuvrePlan,
    changes,
    growth_rate,
    plan_for,
    run_manoeuvre,
    simulate,
)
from seatrial.export.motion import motion_of
from seatrial.export.target import MotionChange
from seatrial.export.write import _change_words, loss_words
from seatrial.vehicles.actuators import Actuator
from seatrial.vehicles.thrusters import allocation
from tests.export.cases import published

TRIM = 1.3


def torpedo(**trim):
    """The published torpedo with a trim."""
    vehicle = published()
    return replace(vehicle, hull=replace(vehicle.hull, trim=trim))


CLOCK = [(0.0, 0), (1.99, 0), (2.0, 1), (5.99, 1), (6.0, -1), (9.99, -1), (10.0, 0), (12.5, 0), (39.0, 0)]
"""Times and the side of the doublet."""


def spans(first, last):
    """Times just outside and inside a step."""
    return [(first - 0.01, False), (first, True), (last - 0.01, True), (last, False)]


def test_commands_of_a_torpedo_by_the_clock():
    """The propeller holds the trim speed, 20 % more and less; rudder of 4 degrees from 12 to 18 s, stern plane of 2 from 22 to 28 s."""
    vehicle = torpedo(u=TRIM)
    motion = motion_of(vehicle)
    plan = plan_for(vehicle, motion)
    assert plan.speed == TRIM
    steady = plan.controls(0.0)["n"]
    ahead = np.array([plan.speed, 0, 0, 0, 0, 0])
    assert motion(ahead, 0.0, 0.0, {"n": steady, "delta_r": 0.0, "delta_s": 0.0})[0] == pytest.approx(0.0, abs=1e-9)
    for time, side in CLOCK:
        assert plan.controls(time)["n"] == pytest.approx(steady * (1 + 0.2 * side))
    for name, size, first in (("delta_r", 4.0, 12.0), ("delta_s", 2.0, 22.0)):
        for time, there in spans(first, first + 6):
            assert plan.controls(time)[name] == pytest.approx(np.radians(size) * there)
    assert plan.words == (
        f"{plan.speed:.2f} m/s ahead, a doublet of 20 % in n, a rudder step of 4 deg for 6 s, a stern plane step of 2 deg for 6 s"
    )


def test_forces_of_an_open_frame_by_the_clock():
    """10 N ahead and astern, 2 N m of yaw from 12 to 18 s and 5 N of heave from 22 to 28 s, and nothing besides."""
    vehicle = published("bluerov2_heavy")
    plan, b = plan_for(vehicle, motion_of(vehicle)), allocation(vehicle.thrusters)
    assert plan.speed == 0.0
    names = [name for name in vehicle.model().controls if name.startswith("f_")]
    assert sorted(names) == sorted(f"f_{i + 1}" for i in range(b.shape[1]))

    def wrench(time):
        controls = plan.controls(time)
        assert set(controls) == set(vehicle.model().controls)
        return b @ [controls[f"f_{i + 1}"] for i in range(b.shape[1])]

    for time, side in CLOCK:
        yaw = 2.0 if 12 <= time < 18 else 0.0
        assert wrench(time) == pytest.approx([10.0 * side, 0, 0, 0, 0, yaw], abs=1e-9)
    for axis, size, first in ((5, 2.0, 12.0), (2, 5.0, 22.0)):
        for time, there in spans(first, first + 6):
            assert wrench(time) == pytest.approx(size * there * np.eye(6)[axis], abs=1e-9)


def drag_of(thrust, push):
    """u' = push + thrust n - u |u|, alone."""
    return lambda nu, phi, theta, controls: np.array(
        [push + thrust * controls.get("n", 0.0) - nu[0] * abs(nu[0]), 0, 0, 0, 0, 0]
    )


@pytest.mark.parametrize(
    ("thrust", "push", "steady", "speed"),
    [
        (1.0, 0.0, "u2", "trim"),
        (1e-3, 0.0, "u2", "trim"),
        (0.0, 0.49, 0.0, 0.7),
        (0.0, -1.0, 0.0, "trim"),
        (1.0, 90.25, 0.0, 9.5),
    ],
)
def test_the_drive_holds_the_speed_or_the_speed_is_the_one_that_is_held(thrust, push, steady, speed):
    """u |u| of drag against the drive n; what no drive holds settles where what pushes balances drag, if anywhere up to 10 m/s."""
    trim = TRIM
    plan = plan_for(torpedo(u=TRIM), drag_of(thrust, push))
    assert plan.controls(0.0)["n"] == pytest.approx(trim**2 / thrust if steady == "u2" else steady)
    assert plan.speed == pytest.approx(trim if speed == "trim" else speed)


def test_speed_of_a_vehicle_without_trim():
    bare = torpedo()
    assert plan_for(bare, motion_of(bare)).speed == DEFAULT_SPEED == 1.5


def test_actuators_lag_saturate_and_hold_over_a_step():
    """v' = n with n' = 2 (wanted - n) from n(0) = 0, wanted 3 from 0.5 s on and 2 at most: in closed form."""
    actuators = {"n": Actuator(0.5, -2.0, 2.0), "free": Actuator(0.0, -1.0, 1.0)}

    def motion(nu, phi, theta, controls):
        return np.array([controls["n"], controls["free"], controls["other"], 0, 0, 0])

    def controls(t):
        return {"n": 3.0 if t >= 0.5 - 1e-9 else 0.0, "free": -4.0, "other": 7.0}

    found = simulate(motion, actuators, controls, np.zeros(8), 2.0, 0.05)
    time = np.arange(41) * 0.05
    on = np.maximum(time - 0.5, 0.0)
    assert found.shape == (41, 8)
    assert found[:, 0] == pytest.approx(2.0 * (on - 0.5 * (1 - np.exp(-2 * on))), abs=1e-5)
    assert found[:, 1] == pytest.approx(-time)
    assert found[:, 2] == pytest.approx(7.0 * time)
    slow = simulate(motion, {"n": Actuator(0.5, -2.0, 2.0, 0.8)}, controls, np.zeros(8), 1.0, 0.05)
    assert slow[-1, 0] == pytest.approx(0.5 * 0.8 * 0.5**2)


def test_angles_turn_with_the_rates():
    """Level and pitched turns: roll and pitch rates are those of Euler's angles."""
    start = np.array([0, 0, 0, 0.1, 0.2, -0.3, 0.3, 0.4])
    found = simulate(lambda *_: np.zeros(6), {}, lambda t: {}, start, 1e-4, 1e-4)
    phi, theta = 0.3, 0.4
    rates = (found[1, 6:] - found[0, 6:]) / 1e-4
    turn = 0.2 * np.sin(phi) - 0.3 * np.cos(phi)
    assert rates == pytest.approx([0.1 + np.tan(theta) * turn, 0.2 * np.cos(phi) + 0.3 * np.sin(phi)], abs=1e-4)


def test_the_current_is_given_in_body_axes():
    """A vehicle that turned by 90 degrees to the east has a current to the north from its port side: -1 m/s to starboard."""
    seen = []

    def motion(nu, phi, theta, controls):
        seen.append([controls[name] for name in sorted(controls)])
        return np.zeros(6)

    start = np.zeros(8)
    start[5] = np.pi / 2
    simulate(motion, {}, lambda t: {}, start, 1.0, 0.05, (1.0, 0.0, 0.5))
    assert sorted(seen[0]) == pytest.approx([0.0, 0.5, 1.0], abs=1e-12)
    assert sorted(seen[-1]) == pytest.approx([-1.0, 0.0, 0.5], abs=1e-2)
    assert all(not seen_now for seen_now in _controls_in_still_water())


def _controls_in_still_water():
    seen = []

    def motion(nu, phi, theta, controls):
        seen.append(dict(controls))
        return np.zeros(6)

    simulate(motion, {}, lambda t: {}, np.zeros(8), 0.1, 0.05)
    return seen


def test_motion_that_runs_away_ends_in_nan():
    """u' = u from 1 m/s passes 1000 m/s after 6.9 s; what comes after is not given."""
    plan = ManoeuvrePlan(1.0, lambda t: {}, "")
    found = run_manoeuvre(lambda nu, *_: np.array([nu[0], 0, 0, 0, 0, 0]), {}, plan)
    assert found.shape == (round(DURATION / STEP) + 1, 6)
    last = int(np.flatnonzero(np.isfinite(found[:, 0]))[-1])
    assert last * STEP == pytest.approx(np.log(1000), abs=STEP)
    assert found[last, 0] == pytest.approx(np.exp(last * STEP), rel=1e-4)
    assert np.isnan(found[last + 1 :]).all()


def test_growth_of_small_motions_is_the_largest_eigenvalue():
    """Sway and yaw coupled by a matrix, about a speed at which it doubles."""
    matrix = np.array([[-1.0, 2.0], [0.5, -0.2]])

    def motion(nu, phi, theta, controls):
        v, r = controls["gain"] * nu[0] * matrix @ [nu[1], nu[5]]
        return np.array([-3 * (nu[0] - 2), v, 0, 0, 0, r])

    plan = ManoeuvrePlan(2.0, lambda t: {"gain": 1.0 if t == 0 else 0.0}, "")
    assert growth_rate(motion, plan) == pytest.approx(2 * np.linalg.eigvals(matrix).real.max(), rel=1e-6)


def test_changes_are_the_largest_differences_of_what_moves():
    """Of each velocity that the vehicle has or the target moves in; endless where only the target runs away."""
    vehicle = replace(published(), moves=("u", "r"))
    own, other = np.zeros((5, 6)), np.zeros((5, 6))
    own[:, 0], other[:, 0] = [0, 1, 2, 3, 2], [0, 1, 2.5, 1, 2]
    own[:, 5] = [0, -1, 0, 1, 0]
    other[:, 2] = [0, 0, 0.25, 0, -0.5]
    other[3:, 5] = np.nan
    surge, heave, yaw = changes(vehicle, own, other)
    assert surge == MotionChange("u", "m/s", 2.0, 3.0)
    assert heave == MotionChange("w", "m/s", 0.5, 0.0)
    assert yaw == MotionChange("r", "rad/s", np.inf, 2.0)
    own[3:, 5] = np.nan
    assert changes(vehicle, own, other)[-1].largest == 1.0


def test_changes_in_words():
    assert _change_words(MotionChange("u", "m/s", 0.5, 2.0)) == "u by 0.5 m/s (25% of its range)"
    assert _change_words(MotionChange("w", "m/s", 0.5, 0.0)) == "w by 0.5 m/s (its range is 0)"
    assert _change_words(MotionChange("r", "rad/s", np.inf, 1.0)) == "r diverges in the target"
    few = [MotionChange("u", "m/s", 1e-12, 2.0), MotionChange("v", "m/s", 0.1, 2.0)]
    assert loss_words(few) == "v by 0.1 m/s (5% of its range)"
    assert loss_words(few[:1]) == "none"
