"""How early or late a channel is: against a naive fit at each shift, and vehicles by Euler steps that differ from those expected."""

import numpy as np
import pytest

from seatrial.estimation.diagnostics.motion_checks import check_motion
from seatrial.estimation.diagnostics.timing_check import APART, EXPLAINED, _columns, _gridded, _left, find_timing

STEP = 0.2
TIME = np.arange(-200, 800) * STEP
INSIDE = (TIME >= 0) & (TIME < 120)
_RNG = np.random.default_rng(8)
LEVELS = np.interp(TIME, np.sort(_RNG.uniform(-40, 160, 30)), _RNG.choice([0.8, 1.0, 1.3], 30))
LEVELS = np.where(TIME < 0, 1.0, np.where(LEVELS > 1.05, 1.25, 0.85))
PERIODIC = 1.0 + 0.2 * np.sign(np.sin(2 * np.pi * TIME / 20.0))


def vehicle(command, settles):
    """Speed under square drag, by Euler's rule."""
    u = np.empty(TIME.size)
    u[0] = command[0]
    for k in range(TIME.size - 1):
        u[k + 1] = u[k] + STEP * (command[k] ** 2 - u[k] * abs(u[k])) / (2 * settles)
    return u


def seen(command, settles=2.5, late=0.0, noise=0.02, seed=1):
    """The channel of a vehicle whose clock is late by so much, a sample of it every other step."""
    values = np.interp(TIME[INSIDE] - late, TIME, vehicle(command, settles))
    values += noise * np.random.default_rng(seed).normal(size=values.size)
    values[::2] = np.nan
    return values


def vehicles(command):
    """Those of priors that take the vehicle to be quicker than it is."""
    return np.array([vehicle(command, settles)[INSIDE] for settles in (1.0, 0.7, 1.6)])


def test_residuals_are_those_of_a_least_squares_fit_at_each_shift():
    measured, expected = seen(LEVELS, late=3.0), vehicles(LEVELS)
    grid = _gridded(TIME[INSIDE], measured, expected, 6.0)
    e, tau = grid.moving[0], 2.0
    shifted, unshifted, turned = _left(grid, e, tau)

    first = round(3.0 / STEP)  # of 120 s a fortieth

    def fit(lag, cover):
        rows = [
            k
            for k in range(e.size)
            if first <= min(k, k - cover, k - lag) and max(k - cover, k - lag) < e.size and grid.weight[k]
        ]
        root = np.sqrt(grid.weight[rows])
        columns = np.array([_columns(e, grid.step, tau)[:, k - lag] for k in rows])
        found, (left,), *_ = np.linalg.lstsq(columns * root[:, None], grid.y[rows] * root, rcond=None)
        mean = np.average(grid.y[rows], weights=grid.weight[rows])
        return left, np.sum(grid.weight[rows] * (grid.y[rows] - mean) ** 2), found[1] + found[2] > 0

    for at in range(0, grid.lag.size, 7):
        lag = int(grid.lag[at])
        left, flat, goes_with = fit(lag, lag)
        assert shifted[at] == pytest.approx(left if goes_with else flat, rel=1e-4)
        left, flat, goes_with = fit(0, lag)
        assert unshifted[at] == pytest.approx(left if goes_with else flat, rel=1e-4)
        assert turned[at] == pytest.approx(flat if goes_with else left, rel=1e-4)


@pytest.mark.parametrize("late", [-20.0, -7.2, -3.0, -1.0, 5.0, 20.0])
def test_a_clock_set_wrong_is_found_though_the_vehicle_is_slower_than_any_of_the_priors(late):
    found = find_timing(TIME[INSIDE], seen(LEVELS, late=late), vehicles(LEVELS), 60.0)
    assert not found.is_in_time
    assert not found.is_reversed
    (one,) = found.likely
    assert one.least - STEP <= late <= one.greatest + STEP
    assert one.greatest - one.least < 3.0


@pytest.mark.parametrize("settles", [0.5, 1.0, 5.0])
def test_a_slower_or_quicker_vehicle_is_in_time(settles):
    for seed in range(10):
        found = find_timing(TIME[INSIDE], seen(LEVELS, settles, seed=seed), vehicles(LEVELS), 60.0)
        assert found.is_in_time
        assert len(found.likely) == 1
        assert found.within < 2.5


@pytest.mark.parametrize("late", [0.0, -7.0, 10.0])
def test_a_motion_that_repeats_is_early_or_late_by_any_number_of_periods(late):
    found = find_timing(TIME[INSIDE], seen(PERIODIC, late=late), vehicles(PERIODIC), 45.0)
    assert found.is_in_time == (late % 20 == 0)
    for period in (-20.0, 0.0, 20.0):
        assert any(one.least - STEP <= late + period <= one.greatest + STEP for one in found.likely)
    assert all(abs((one.best - late + 10) % 20 - 10) < 1.0 for one in found.likely)


def test_a_reversed_channel_is_no_shift_but_half_a_period_may_be():
    once = find_timing(TIME[INSIDE], -seen(LEVELS), vehicles(LEVELS), 60.0)
    assert once == ((), False, True)
    repeated = find_timing(TIME[INSIDE], -seen(PERIODIC), vehicles(PERIODIC), 45.0)
    assert repeated.is_reversed
    assert not repeated.is_in_time
    assert any(abs(one.best - 10.0) < 1.0 for one in repeated.likely)


def test_noise_stillness_and_few_samples_tell_nothing():
    time, expected = TIME[INSIDE], vehicles(LEVELS)
    assert find_timing(time, np.random.default_rng(2).normal(size=time.size), expected, 60.0) is None
    assert find_timing(time, seen(LEVELS), np.ones_like(expected), 60.0) is None
    assert find_timing(time, np.where(np.arange(time.size) < 20, seen(LEVELS), np.nan), expected, 60.0) is None
    assert 0 < EXPLAINED < 1
    assert APART < 20.0


@pytest.mark.parametrize(
    ("command", "late", "level", "code", "remedies"),
    [
        (LEVELS, 0.0, "pass", "clock-shift", ()),
        (LEVELS, -7.2, "caution", "clock-shift", ("correct-shift",)),
        (LEVELS, 7.2, "caution", "clock-shift", ("correct-shift",)),
        (PERIODIC, 0.0, "note", "clock-not-judged", ("compare-clocks",)),
        (PERIODIC, -7.0, "caution", "clock-shift", ("correct-shift",)),
        (None, 0.0, "note", "clock-not-judged", ("compare-clocks",)),
    ],
    ids=["in time", "early", "late", "repeats", "repeats and is early", "noise"],
)
def test_the_clock_of_another_file_is_judged(command, late, level, code, remedies):
    measured = np.random.default_rng(2).normal(size=INSIDE.sum()) if command is None else seen(command, late=late)
    expected = vehicles(LEVELS if command is None else command)
    found = check_motion("u", TIME[INSIDE], measured, expected[0], expected, file="dvl.csv")
    (timing,) = [one for one in found if one.code.startswith("clock")]
    assert (timing.code, timing.level, timing.remedies) == (code, level, remedies)
    assert timing.values["file"] == "dvl.csv"
    if code == "clock-shift" and level != "pass":
        assert timing.values["late"] == pytest.approx(late, abs=1.0)
        assert [round(one) for one in timing.values["others"]][:2] == ([13, -27] if command is PERIODIC else [])
    if code == "clock-not-judged":
        assert bool(timing.values["ranges"]) == (command is PERIODIC)
    assert command is None or [one.level for one in found if one.code == "direction-reversed"] == ["pass"]


def test_a_sign_that_half_a_period_explains_too_is_told_with_it():
    expected = vehicles(PERIODIC)
    (found,) = check_motion("u", TIME[INSIDE], seen(PERIODIC, late=10.0), expected[0], expected, file="dvl.csv")
    assert (found.code, found.level) == ("direction-reversed", "alarm")
    assert found.remedies == ("reverse-sign", "shift-clock")
    assert abs(found.values["late"]) == pytest.approx(10.0, abs=1.0)
