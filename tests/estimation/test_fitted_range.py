"""What leaves the fitted range is named with how far; noise, outliers and headings are not."""

import numpy as np
import pytest

from seatrial.core.record import Channel, Provenance, make_record
from seatrial.estimation.prediction import fitted_range
from seatrial.messages.predictions import outside_text

TIME = np.arange(500) * 0.1
CHANNELS = (
    Channel("delta_r", "rad", "control"),
    Channel("u", "m/s", "measurement"),
    Channel("psi", "rad", "measurement"),
)


def outside_fitted(fitted, record):
    return tuple(map(outside_text, fitted_range.outside_fitted(fitted, record)))


def record(rudder_deg, speed, label="1", heading=1.0):
    wave = np.sin(0.5 * TIME)
    columns = {"delta_r": np.radians(rudder_deg) * wave, "u": 0.6 + (speed - 0.6) * wave, "psi": heading * wave}
    return make_record(TIME, columns, CHANNELS, Provenance("own", ""), label)


def test_a_run_that_goes_further_is_named_with_how_far_the_furthest_first():
    said = outside_fitted([record(10, 1.2), record(5, 0.9, "2")], record(35, 1.9, "3", heading=9.0))
    assert said[0] in {
        "delta_r up to 35 deg (fitted up to 10)",
        "delta_r down to -35 deg (fitted down to -10)",
    }
    assert "u up to 1.9 m/s (fitted up to 1.2)" in said
    assert len(said) == 4


def test_the_same_range_is_not_left():
    assert outside_fitted([record(10, 1.2)], record(10.5, 1.22)) == ()


def test_an_outlier_or_a_gap_leaves_nothing():
    other = record(10, 1.2)
    other.measurement[7, 0] = 40.0
    other.measurement[30:40, 0] = np.nan
    assert outside_fitted([record(10, 1.2)], other) == ()


@pytest.mark.parametrize("value", [0.0, 0.3])
def test_an_input_that_never_moved_in_the_fit(value):
    still = record(0, 1.2)
    still.control[:] = value
    assert any(words.startswith("delta_r up to") for words in outside_fitted([still], record(30, 1.2)))


def speeds(values):
    """A record whose rudder never moves, with such speeds at its first samples and 1 m/s elsewhere."""
    u = np.append(values, np.full(500 - len(values), 1.0))
    columns = {"delta_r": np.zeros(500), "u": u, "psi": 0.01 * TIME}
    return make_record(TIME, columns, CHANNELS, Provenance("own", ""), "1")


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ([2.09] * 5, ()),
        ([2.11] * 5, ("u up to 2.11 m/s (fitted up to 2)",)),
        ([2.11] * 4, ()),
        ([0.91] * 5, ()),
        ([0.89] * 5, ("u down to 0.89 m/s (fitted down to 1)",)),
        ([2.2] * 5 + [0.7] * 5, ("u down to 0.7 m/s (fitted down to 1)", "u up to 2.2 m/s (fitted up to 2)")),
    ],
)
def test_a_range_is_left_by_a_tenth_of_it_and_by_a_hundredth_of_the_samples(values, said):
    """Fitted from 1 to 2 m/s: 0.1 m/s outside is reported, and five of 500 samples; the furthest comes first."""
    assert outside_fitted([speeds([2.0])], speeds(values)) == said


def test_full_turns_of_roll_are_not_beyond_what_was_fitted():
    channels = (Channel("delta_r", "rad", "control"), Channel("phi", "rad", "measurement"))

    def rolling(reach):
        columns = {"delta_r": np.sin(TIME), "phi": np.radians(reach) * np.sin(0.5 * TIME)}
        return make_record(TIME, columns, channels, Provenance("own", ""), "1")

    assert outside_fitted([rolling(185)], rolling(735)) == ()
    assert outside_fitted([rolling(20)], rolling(60))[0].endswith("60 deg (fitted up to 20)")
