from math import pi

import pytest

from seatrial.campaign.workflow.run import ENOUGH, next_words
from seatrial.core.display_units import shown_unit
from seatrial.manoeuvres.family import Family


@pytest.mark.parametrize(
    ("signal", "unit", "si", "shown"),
    [
        ("n", "rpm", 125.0, 1193.662),
        ("delta_r", "deg", pi, 180.0),
        ("r", "deg/s", pi, 180.0),
        ("tau_X", "N", 7.0, 7.0),
        ("tau_N", "N m", 7.0, 7.0),
        ("u", "m/s", 1.5, 1.5),
        ("udot", "m/s^2", 1.5, 1.5),
    ],
)
def test_signals_are_shown_in_units_of_the_trade(signal, unit, si, shown):
    factor, name = shown_unit(signal)
    assert name == unit
    assert si * factor == pytest.approx(shown)


def test_the_next_trial_is_said_in_rpm_or_advised_against():
    family = Family("n", 125.0, duration=60.0, active=40.0, sample_time=0.1)
    trial = {"amplitude": 200 * pi / 30, "period": 20.0, "gain_nat": 1.0}
    trial |= {"sd_before": {"X_u": 0.2}, "sd_after": {"X_u": 0.1}}
    words = next_words(trial, family)
    assert "±200 rpm about 1194 rpm in n, period 20 s" in words
    assert "X_u from 0.2 to 0.1" in words
    assert "teach little" in next_words({**trial, "gain_nat": ENOUGH / 2}, family)
