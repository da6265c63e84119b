"""Conditions on words: modes of a text, of a bag, of a recording of BlueOS, and of an autopilot that numbers them."""

import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.logs.log_table import read_log_table
from seatrial.logs.run_conditions import parse_condition, spans_of
from seatrial.logs.source import ColumnMap, LogSource
from tests.logs.log_writers import ROWS, STAMPS, json_mcap, mavlink_json, ros_1, ros_2

EPOCH = STAMPS[0]


def spans(path, when, table=None, time=None, unit=None):
    found = spans_of(LogSource(path, time, unit, {}, table=table), parse_condition(when, "file, when"))
    return [(float(begin), float(end)) for begin, end in found]


@pytest.fixture
def text(tmp_path):
    path = tmp_path / "run.csv"
    modes = ["MANUAL"] * 3 + [""] + ["ALT_HOLD"] * 4 + ["MANUAL"] * 2
    path.write_text("time,mode,volts\n" + "".join(f"{k}.0,{mode},{15 - k}\n" for k, mode in enumerate(modes)))
    return path


@pytest.mark.parametrize(
    ("when", "expected"),
    [
        ('mode == "MANUAL"', [(0, 3), (8, 9)]),
        ('mode != "MANUAL"', [(4, 8)]),
        ('mode == "ALT_HOLD" and volts > 9.5', [(4, 6)]),
        ("volts > 9.5", [(0, 6)]),
    ],
)
def test_words_of_a_text(text, when, expected):
    assert spans(text, when) == expected
    assert spans(text, when, time="time", unit="s") == expected


def test_a_word_that_is_never_said_lists_those_that_are(text):
    with pytest.raises(InputError, match=r'no "MANUEL"[^$]*one of ALT_HOLD, MANUAL[^$]*did you mean "MANUAL"'):
        spans(text, 'mode == "MANUEL"')


def test_words_are_no_channel_and_numbers_no_words(text):
    with pytest.raises(InputError, match='no "MANUAL" in any row'):
        spans(text, 'volts == "MANUAL"', "rows")
    with pytest.raises(InputError, match="words"):
        read_log_table(LogSource(text, None, None, {"u": ColumnMap("mode", "m/s", "measurement")}))


@pytest.mark.parametrize("when", ['mode > "MANUAL"', 'mode == "MANUAL', "mode == MANUAL", 'mode == "A" or mode == "B"'])
def test_what_is_no_condition(when):
    with pytest.raises(InputError, match="comparisons of a column with a number or a word"):
        parse_condition(when, "file, when")


def test_a_word_may_hold_and():
    (one,) = parse_condition('mode == "hold and wait"', "file, when")
    assert one.value == "hold and wait"


@pytest.mark.parametrize("write", [ros_1, ros_2])
def test_words_of_a_bag(tmp_path, write):
    """The mode of message k is k % 4 letters long."""
    written = write(tmp_path)
    found = spans(written.path, 'mode == "mm"', written.table)
    stamps = [(float(STAMPS[k]) / 1e9, float(STAMPS[min(k + 1, ROWS - 1)]) / 1e9) for k in range(2, ROWS, 4)]
    np.testing.assert_allclose(found, stamps, rtol=0, atol=2e-6)


def test_modes_that_an_autopilot_numbers_have_the_names_of_ardusub(tmp_path):
    rows = [
        ("mavlink/1/1/HEARTBEAT", int(STAMPS[k]), mavlink_json("HEARTBEAT", custom_mode=19 if k < 10 else 2))
        for k in range(20)
    ]
    path = json_mcap(tmp_path / "recorder.mcap", rows)
    (found,) = spans(path, 'message.custom_mode == "MANUAL"', "mavlink/1/1/HEARTBEAT")
    np.testing.assert_allclose(found, (STAMPS[0] / 1e9, STAMPS[10] / 1e9), rtol=0, atol=1e-6)
    with pytest.raises(InputError, match=r'no "SURFACE"[^$]*one of ALT_HOLD, MANUAL'):
        spans(path, 'message.custom_mode == "SURFACE"', "mavlink/1/1/HEARTBEAT")


def test_names_of_ardusub_are_those_of_pymavlink():
    mavutil = pytest.importorskip("pymavlink.mavutil")
    from seatrial.logs.known_messages import ARDUSUB_MODES

    assert mavutil.mode_mapping_sub.items() <= ARDUSUB_MODES.items()
