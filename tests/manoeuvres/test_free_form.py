"""Free-form inputs against interpolation written out, and their linear bounds against dense samples."""

import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.manoeuvres.free_form import SteppedInput, nearest_levels
from seatrial.manoeuvres.manoeuvre import Limits, check_limits

TIMING = {"control": "n", "trim": 80.0, "duration": 30.0, "start": 2.0, "active": 24.0}
LEVELS = np.array([95.0, 60.0, 70.0, 100.0, 100.0, 61.0, 88.0, 99.0])
STEPS, RAMPS = SteppedInput(**TIMING, size=8), SteppedInput(**TIMING, size=8, edge=0.7)
FORMS = pytest.mark.parametrize("form", [STEPS, RAMPS], ids=["steps", "ramps"])


def test_steps_hold_each_level_and_return_to_trim():
    time, control = STEPS.manoeuvre(LEVELS).sample(0.01)
    expected = np.full(time.size, 80.0)
    for i, level in enumerate(LEVELS):
        expected[200 + 300 * i : 500 + 300 * i] = level
    assert np.array_equal(control, expected)


@pytest.mark.parametrize("edge", [0.7, 3.0])
def test_ramps_are_straight_lines(edge):
    form = SteppedInput(**TIMING, size=8, edge=edge)
    levels = np.array([80.0, *LEVELS, 80.0])
    begins = 2.0 + 3.0 * np.arange(9)
    knots = np.column_stack([begins, begins + edge]).ravel()
    heights = np.column_stack([levels[:-1], levels[1:]]).ravel()
    time, control = form.manoeuvre(LEVELS).sample(0.01)
    np.testing.assert_allclose(control, np.interp(time, knots, heights), atol=1e-6)
    assert control[-1] == 80.0


@FORMS
def test_linear_in_the_levels(form):
    time = np.linspace(0.0, 30.0, 777)
    expected = form.trim + form.basis(time) @ (LEVELS - form.trim)
    np.testing.assert_allclose(form.manoeuvre(LEVELS).signal(time), expected, atol=1e-12)
    assert np.ptp(form.manoeuvre(np.full(8, form.trim)).signal(time)) == 0.0


@FORMS
def test_levels_are_the_extremes_and_rate_rows_contain_the_rate(form):
    """At every sample of many random inputs, and tight."""
    time, rng = np.arange(0.0, 30.0, 0.01), np.random.default_rng(0)
    for levels in rng.uniform(-1, 1, (50, 8)):
        control = form.basis(time) @ levels
        assert control.min() == pytest.approx(min(levels.min(), 0.0), abs=1e-12)
        assert control.max() == pytest.approx(max(levels.max(), 0.0), abs=1e-12)
        if form.rates().size:
            fastest, bound = np.abs(np.diff(control)).max() / 0.01, np.abs(form.rates() @ levels).max()
            assert fastest <= bound + 1e-9
            assert bound <= 1.001 * fastest


def test_rate_rows_decide_as_the_limits_do():
    levels = np.array([90.0, 70.0, 75.0, 80.0, 80.0, 80.0, 80.0, 80.0])
    fastest = np.abs(RAMPS.rates() @ (levels - 80.0)).max()
    assert fastest == pytest.approx(20 / 0.7)
    check_limits(RAMPS.manoeuvre(levels), Limits(rate=fastest * (1 + 1e-6)), 0.01)
    with pytest.raises(InputError, match="rate limit"):
        check_limits(RAMPS.manoeuvre(levels), Limits(rate=fastest * 0.99), 0.01)


@FORMS
def test_levels_are_found_again(form):
    time, control = form.manoeuvre(LEVELS).sample(0.05)
    np.testing.assert_allclose(nearest_levels(form, time, control), LEVELS, atol=1e-8)


def test_settings_are_those_given():
    settings = RAMPS.manoeuvre(LEVELS).parameters
    assert [settings[f"level {i + 1}"] for i in range(8)] == LEVELS.tolist()
    assert settings["edge"] == 0.7


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"size": 0}, "at least 1"),
        ({"start": -1.0}, "0 or later"),
        ({"active": 0.0}, "positive active time"),
        ({"active": float("nan")}, "positive active time"),
        ({"active": 28.0, "edge": 0.5}, "0.5 s late"),
        ({"edge": 3.5, "active": 20.0}, "at most the interval"),
        ({"edge": -0.1}, "at most the interval"),
    ],
)
def test_impossible_timing(change, message):
    with pytest.raises(InputError, match=message):
        SteppedInput(**TIMING | {"size": 8} | change)


@pytest.mark.parametrize("levels", [LEVELS[:3], np.full(8, np.nan)])
def test_impossible_levels(levels):
    with pytest.raises(InputError, match="8 finite numbers"):
        STEPS.manoeuvre(levels)
