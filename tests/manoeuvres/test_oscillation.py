"""Indices of a self-oscillating test, held against a closed form and against an independent integration with events."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from seatrial.manoeuvres.relay import RelayFamily, oscillation

GAIN, LAG, RUDDER = 0.2, 3.0, 0.17


def family(duration=120.0, output="psi", effect=1.0, **other):
    return RelayFamily((("delta_r", 0.0),), "delta_r", output, 0.0, duration, 0.005, 1.0, effect=effect, **other)


def zigzag(threshold, duration):
    """Heading of T dr/dt + r = K delta, integrated from reversal to reversal by SciPy, on the family's samples."""
    time, heading = family(duration).time(), np.zeros(round(duration / 0.005))
    start, state, side, turns = 1.0, np.zeros(2), 1.0, []
    while start < duration:

        def rate(_, x, side=side):
            return [x[1], (GAIN * side * RUDDER - x[1]) / LAG]

        def crossing(_, x, side=side):
            return side * x[0] - threshold

        crossing.terminal, crossing.direction = True, 1.0
        run = solve_ivp(rate, (start, duration), state, events=crossing, rtol=1e-10, atol=1e-12, dense_output=True)
        inside = (time >= start) & (time <= run.t[-1])
        heading[inside] = run.sol(time[inside])[0]
        if not run.t_events[0].size:
            break
        start, state, side = float(run.t[-1]), run.y[:, -1], -side
        turns.append(start)
    return time, heading, np.array(turns)


def test_zigzag_against_an_integration_with_events():
    threshold = np.deg2rad(10)
    time, heading, turns = zigzag(threshold, 120.0)
    found = oscillation(family(), heading[None], heading[None], threshold)
    assert found.reversals[0] == turns.size
    assert found.period[0] == pytest.approx(np.median(np.diff(turns[::2])), abs=0.01)
    first = heading[(time >= turns[0]) & (time <= turns[1])].max() - threshold
    second = -heading[(time >= turns[1]) & (time <= turns[2])].min() - threshold
    assert found.first_overshoot[0] == pytest.approx(first, abs=1e-9)
    assert found.second_overshoot[0] == pytest.approx(second, abs=1e-9)
    assert second > first > 0


def test_a_relay_on_a_first_order_output_has_the_period_of_the_closed_form():
    """Between -a and a of y' = (K - y) / T it takes T ln((K + a) / (K - a)) each way, without overshoot."""
    shared = family(60.0, "r")
    level, threshold = 0.5, 0.3
    y, side, seen = 0.0, 1.0, []
    for t in shared.time():
        seen.append(y)
        if t >= 1.0:
            side = -1.0 if y >= threshold else 1.0 if y <= -threshold else side
            y = side * level + (y - side * level) * np.exp(-0.005 / LAG)
    found = oscillation(shared, np.array([seen]), np.array([seen]), threshold)
    assert found.period[0] == pytest.approx(2 * LAG * np.log((level + threshold) / (level - threshold)), abs=0.02)
    assert 0 <= found.first_overshoot[0] < 0.005 * level / LAG


def test_an_output_that_falls_when_the_control_rises_and_gaps():
    _, heading, turns = zigzag(0.1, 60.0)
    gaps = np.where(np.arange(heading.size) % 10 == 0, -heading, np.nan)
    found = oscillation(family(60.0, effect=-1.0), -heading[None], gaps[None], 0.1)
    assert found.reversals[0] == turns.size


def test_a_relay_that_never_switches_has_no_indices():
    still = np.zeros((1, family(20.0).time().size))
    found = oscillation(family(20.0), still, still, 0.1)
    assert found.reversals[0] == 0
    assert np.isnan([found.period[0], found.first_overshoot[0], found.second_overshoot[0]]).all()
