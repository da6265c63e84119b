"""Long records in pieces, and numbers that a curve explains."""

import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.core.record import Channel, Provenance, make_record
from seatrial.logs.align import align
from seatrial.logs.curve import read_curve
from seatrial.logs.cut_record import cut
from seatrial.logs.log_table import read_log_table
from seatrial.logs.source import ColumnMap, LogSource
from tests.logs.log_cases import refusal, written

CHANNELS = (Channel("u", "m/s", "measurement"), Channel("n", "rad/s", "control"))


def long_record(n=101):
    time = np.cumsum(np.where(np.arange(n) % 3, 0.1, 0.13))
    time -= time[0]
    provenance = Provenance("log.csv", "0" * 64, {"cautions": ["a hole"], "notes": []})
    return make_record(time, {"u": np.arange(n) + 0.5, "n": -np.arange(n)}, CHANNELS, provenance, "7")


@pytest.mark.parametrize("length", [2.0, 3.3, 5.0])
def test_pieces_are_the_record_again(length):
    record = long_record()
    parts = cut(record, length)
    assert len(parts) == round(record.time[-1] / length)
    assert [part.label for part in parts] == [f"7.{i + 1}" for i in range(len(parts))]
    for name in ("u", "n"):
        np.testing.assert_array_equal(np.concatenate([part.channel(name) for part in parts]), record.channel(name))
    starts = [part.provenance.options["piece"][0] for part in parts]
    again = np.concatenate([part.time + start for part, start in zip(parts, starts, strict=True)])
    np.testing.assert_allclose(again, record.time, atol=1e-12)
    assert all(part.time[0] == 0.0 for part in parts)
    assert [part.provenance.options["cautions"] for part in parts] == [["a hole"]] + [[]] * (len(parts) - 1)


def test_a_short_record_stays_whole_and_crumbs_are_refused():
    record = long_record()
    assert cut(record, 10.0) == (record,)
    for length in (0.0, -1.0, 0.5, float("nan")):
        with refusal('record "7", split', "at least 10 samples"):
            cut(record, length)


def test_thrust_of_a_pulse_width(tmp_path):
    curve = written(tmp_path, "pwm,thrust\n1100,-40\n1475,0\n1525,0\n1900,50\n", "t200.csv")
    log = written(tmp_path, "t,ch1\n0,1100\n1,1287.5\n2,\n3,1500\n4,1900\n", "log.csv")
    column = ColumnMap("ch1", "N", "control", curve=read_curve(curve, "campaign.toml"))
    table = read_log_table(LogSource(log, "t", "s", {"tau_X": column}))
    np.testing.assert_allclose(table.columns["tau_X"], [-40.0, -20.0, np.nan, 0.0, 50.0])
    assert table.options["channels"]["tau_X"]["curve"] == "t200.csv"


BEFORE_ARMING = "t,ch1,speed\n0,0,0\n1,0,0\n2,1500,0\n3,1900,0.1\n4,1900,0.2\n5,1100,0.3\n6,,0.2\n7,0,0.1\n8,0,0\n"


def unarmed(folder):
    curve = written(folder, "pwm,thrust\n1100,-40\n1475,0\n1525,0\n1900,50\n", "t200.csv")
    log = written(folder, BEFORE_ARMING, "log.csv")
    force = ColumnMap("ch1", "N", "control", curve=read_curve(curve, "campaign.toml"))
    return LogSource(log, "t", "s", {"tau_X": force, "u": ColumnMap("speed", "m/s", "measurement")})


def test_a_curve_need_not_reach_rows_that_are_not_kept(tmp_path):
    """The row at the end of the record is held over none of its steps."""
    record = align([read_log_table(unarmed(tmp_path))], start=2.0, end=7.0)
    np.testing.assert_allclose(record.channel("tau_X"), [0.0, 50.0, 50.0, -40.0, -40.0, -40.0])
    assert record.time[-1] == 5.0


@pytest.mark.parametrize(
    ("ends", "parts"),
    [
        ({}, ("3 of the 7 rows kept", "the first is 0, 0 s into the log")),
        ({"start": 1.5}, ("2 of the 6 rows kept", "1 s into the log")),
        ({"start": 2.0, "end": 7.5, "step": 0.5}, ("1 of the 5 rows kept", "7 s into the log")),
    ],
)
def test_a_curve_has_to_reach_rows_that_are_kept(tmp_path, ends, parts):
    with refusal('log.csv, column "ch1"', *parts, "1100 to 1900", "[[import.keep]]", "add a point to t200.csv"):
        align([read_log_table(unarmed(tmp_path))], **ends)


def test_a_curve_that_reaches_no_row(tmp_path):
    source = unarmed(tmp_path)
    written(tmp_path, "t,ch1,speed\n0,0,0\n1,0,0\n2,0,0\n", "log.csv")
    with refusal("3 of the 3 rows kept", "1100 to 1900"):
        read_log_table(source)


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("pwm,thrust\n1100,-40\n1100,0\n", ("row 3", "1100 after 1100")),
        ("1100,-40\n1500,0\n1900,50\n", ("row 1", "1100,-40", "a header")),
        ("pwm,thrust\n1100,-40\n", ("1 rows of 2",)),
        ("pwm,thrust,more\n1,2,3\n2,3,4\n", ("2 rows of 3",)),
        ("pwm,thrust\n1100,low\n1200,1\n", ("low",)),
        ("pwm,thrust\n1100,nan\n1200,1\n", ("2 rows",)),
    ],
)
def test_bad_curves(tmp_path, text, parts):
    with refusal("curve.csv", *parts):
        read_curve(written(tmp_path, text, "curve.csv"), "campaign.toml")


def test_no_curve(tmp_path):
    with pytest.raises(InputError, match=r"campaign\.toml, key x"):
        read_curve(tmp_path / "none.csv", "campaign.toml, key x")
