"""The shift between two clocks: against a naive correlation at each shift, and against clocks set wrong by a known time."""

from dataclasses import replace
from decimal import Decimal

import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.logs.align import align
from seatrial.logs.clock_shift import MIN_COMMON_STEPS, MIN_OVERLAP, Samples, _correlations, shift_between
from seatrial.logs.log_table import read_log_table
from tests.logs.log_cases import column


def turning(time):
    """A yaw rate that never repeats: straight lines between independent levels."""
    return np.interp(time, 1.5 * np.arange(100), np.random.default_rng(11).normal(size=100))


def test_correlations_are_those_of_a_loop_over_every_shift():
    rng = np.random.default_rng(3)
    a, b = rng.normal(size=60), rng.normal(size=41)
    b[:3] = 0.0
    lags, found = _correlations(a, b)
    naive = {}
    for lag in range(1 - b.size, a.size):
        pairs = [(a[i + lag], b[i]) for i in range(b.size) if 0 <= i + lag < a.size]
        if len(pairs) >= max(MIN_COMMON_STEPS, MIN_OVERLAP * b.size):
            naive[lag] = np.corrcoef(np.array(pairs).T)[0, 1]
    assert list(lags) == list(naive)
    np.testing.assert_allclose(found, list(naive.values()), atol=1e-12)


@pytest.mark.parametrize(("late", "sign"), [(0.0, 1), (12.34, 1), (-7.77, -1), (1.7e9, 1), (-1.7e9 + 0.4, 1)])
def test_a_clock_set_wrong_is_found_to_a_tenth_of_a_step(late, sign):
    rng = np.random.default_rng(5)
    first = 3.0 + np.arange(0, 120, 0.1)
    second = np.cumsum(rng.uniform(0.01, 0.03, 4000)) + 20.0
    noisy = turning(first) + rng.normal(0, 0.05, first.size)
    found = shift_between(Samples(first, noisy), Samples(second - late, sign * (4.0 * turning(second) + 9.0)))
    assert found.shift == pytest.approx(late, abs=0.01)
    assert sign * found.correlation > 0.99
    assert found.rival is None


def test_the_peak_of_a_slow_motion_is_blunt():
    time = np.arange(0, 120, 0.1)
    quick, slow = turning(time), turning(time / 8.0)
    sharp, blunt = (shift_between(Samples(time, one), Samples(time - 2.0, one)) for one in (quick, slow))
    for found in (sharp, blunt):
        assert found.lower <= found.shift <= found.upper
        assert found.shift == pytest.approx(2.0, abs=0.01)
    assert sharp.upper - sharp.lower < 0.5
    assert blunt.upper - blunt.lower > 3 * (sharp.upper - sharp.lower)
    later = blunt.later(10.0)
    assert (later.shift, later.lower, later.upper) == (blunt.shift + 10, blunt.lower + 10, blunt.upper + 10)
    assert later.correlation == blunt.correlation


def test_a_motion_that_repeats_names_another_shift():
    time = np.arange(0, 60, 0.1)
    wave = np.sign(np.sin(2 * np.pi * time / 10.0)) + 0.001 * np.cos(time)
    found = shift_between(Samples(time, wave), Samples(time, wave))
    assert found.shift == pytest.approx(0.0, abs=1e-9)
    assert abs(found.rival) == pytest.approx(5.0, abs=0.11)  # half a period, reversed


def test_what_never_moves_has_no_shift():
    time = np.arange(0, 10, 0.1)
    for flat in (np.ones(100), np.full(100, np.nan)):
        with pytest.raises(InputError, match="second curve to align"):
            shift_between(Samples(time, turning(time)), Samples(time, flat))


def test_a_log_is_read_on_the_clock_of_another(tmp_path):
    time = np.arange(100, 110, 0.1)
    rows = [f"{t:.1f}" for t in time]
    control = column(tmp_path, "thrust.csv", rows, "tau_X", np.floor(time), "control")
    speed = column(tmp_path, "speed.csv", [f"{t - 100:.1f}" for t in time], "u", time - 98.0, "measurement")
    with pytest.raises(InputError, match="no common time"):
        align([read_log_table(control), read_log_table(speed)])
    shifted = read_log_table(replace(speed, shift=100.000000001))
    assert shifted.epoch == read_log_table(speed).epoch + Decimal("100.000000001")
    record = align([read_log_table(control), read_log_table(replace(speed, shift=100.0))], step=0.1)
    np.testing.assert_allclose(record.channel("u"), 2.0 + record.time, atol=1e-9)
    assert [file["shift"] for file in record.provenance.options["files"]] == [0.0, 100.0]
    with pytest.raises(InputError, match="shift"):
        read_log_table(replace(speed, shift=float("nan")))
