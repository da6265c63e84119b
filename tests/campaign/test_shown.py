from math import pi

import pytest

from seatrial.core.display_units import shown_unit


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
