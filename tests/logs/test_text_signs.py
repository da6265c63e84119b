"""Tables of text as teams have them are read alike: without a header, with units, dates, decimal commas, stamps in two columns."""

from datetime import UTC, datetime

import numpy as np
import pytest

from seatrial.logs.formats.protocol import LogFile
from seatrial.logs.formats.text_layout import signs_of
from seatrial.logs.guess import best
from seatrial.logs.inspect import inspect_log
from seatrial.logs.log_table import read_log_table
from seatrial.logs.source import ColumnMap, LogSource
from tests.logs.log_cases import refusal, source, written

ROWS = [(100 * k, 1 + k / 8, 1500 + (k * 7) % 90) for k in range(20)]
"""Milliseconds, speed and a pulse width."""


def _date(ms: int, zone: str) -> str:
    return (
        datetime.fromtimestamp(1_700_000_000 + ms / 1e3, UTC).isoformat(timespec="milliseconds").replace("+00:00", zone)
    )


TEXTS = {
    "plain": ("t,speed,pwm_1", ",", lambda ms, u, n: (f"{ms / 1e3:.1f}", f"{u}", f"{n}")),
    "units": ("t,speed,pwm_1\n[s],[m/s],[us]", ",", lambda ms, u, n: (f"{ms / 1e3:.1f}", f"{u}", f"{n}")),
    "semicolons": ("t;speed;pwm_1", ";", lambda ms, u, n: (f"{ms / 1e3:.1f}", f"{u}", f"{n}")),
    "decimal commas": (
        "t;speed;pwm_1",
        ";",
        lambda ms, u, n: (f"{ms / 1e3:.1f}".replace(".", ","), f"{u}".replace(".", ","), f"{n}"),
    ),
    "dates": ("timestamp,speed,pwm_1", ",", lambda ms, u, n: (_date(ms, "Z"), f"{u}", f"{n}")),
    "dates of a zone": (
        "when,speed,pwm_1",
        ",",
        lambda ms, u, n: (_date(ms, "+02:00").replace("T", " "), f"{u}", f"{n}"),
    ),
    "spaces": ("t speed pwm_1", " ", lambda ms, u, n: (f"{ms / 1e3:.1f}", f"{u}", f"{n}")),
    "no header": ("", ",", lambda ms, u, n: (f"{ms / 1e3:.1f}", f"{u}", f"{n}")),
    "stamps in two": (
        *("header.stamp.sec,header.stamp.nanosec,speed,pwm_1", ","),
        lambda ms, u, n: (f"{1_700_000_000 + ms // 1000}", f"{ms % 1000 * 10**6}", f"{u}", f"{n}"),
    ),
}


@pytest.mark.parametrize("name", TEXTS)
def test_every_layout_gives_the_same_table(tmp_path, name):
    head, mark, cells = TEXTS[name]
    lines = [*([head] if head else []), *(mark.join(cells(*row)) for row in ROWS)]
    path = written(tmp_path, "\n".join(lines) + "\n", "run.txt" if mark == " " else "run.csv")
    speed, pulse = ("column_2", "column_3") if name == "no header" else ("speed", "pwm_1")
    found = inspect_log(path)
    assert found.tables[0].clock.rate == pytest.approx(10.0)
    if name != "no header":
        assert [(guess.channel, guess.column) for guess in best(found.guesses)] == [("u", "speed"), ("f_1", "pwm_1")]
    maps = {"u": ColumnMap(speed, "m/s", "measurement"), "f_1": ColumnMap(pulse, "N", "control")}
    table = read_log_table(LogSource(path, None, None, maps))
    np.testing.assert_allclose(table.time, [row[0] / 1e3 for row in ROWS], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(table.columns["u"], [row[1] for row in ROWS])
    np.testing.assert_array_equal(table.columns["f_1"], [row[2] for row in ROWS])


def test_dates_of_two_zones_are_no_clock(tmp_path):
    rows = [f"{_date(100 * k, 'Z' if k else '+01:00')},{k},{600 + k}" for k in range(20)]
    path = written(tmp_path, "\n".join(["t,speed,rpm", *rows]))
    with refusal("run.csv, row 3", "in the zone of the first"):
        read_log_table(source(path))


def test_a_separator_inside_quotation_marks_is_text(tmp_path):
    rows = "".join(f"0,{k};{1000 + k};1,{k % 3 + 2}\n" for k in range(9))
    path = written(tmp_path, 'Zeit;rpm;"v, m/s"\n' + rows, "run.csv")
    maps = {"u": ColumnMap("v, m/s", "m/s", "measurement"), "n": ColumnMap("rpm", "rpm", "control")}
    table = read_log_table(LogSource(path, "Zeit", "s", maps))
    np.testing.assert_allclose(table.time, np.arange(9) / 10, rtol=0, atol=1e-12)
    np.testing.assert_allclose(table.columns["u"], [1.2, 1.3, 1.4] * 3)
    plain = written(tmp_path, 't,"speed; m/s"\n' + "".join(f"0.{k},1.{k}\n" for k in range(9)), "plain.csv")
    assert [one.name for one in inspect_log(plain).tables[0].columns] == ["t", "speed; m/s"]


@pytest.mark.parametrize(("mark", "separator"), [("\t", "\t"), (" ", "whitespace"), (";", ";"), (",", ",")])
def test_the_separator_is_found_below_remarks(tmp_path, mark, separator):
    """As basins write their records: some lines of words, then the numbers, under a suffix that says nothing."""
    rows = "".join(mark.join([f"{0.1 * k:.1f}", f"{k % 7}", f"{600 + k}"]) + "\n" for k in range(30))
    path = written(tmp_path, f"A basin\nTurning circle: 35 deg, rudder to port\n\n{rows}", "run.dat")
    assert signs_of(LogFile(path)).separator == separator
    maps = {"u": ColumnMap("u", "m/s", "measurement")}
    table = read_log_table(LogSource(path, "t", "s", maps, skip_rows=3, names=("t", "u", "n")))
    np.testing.assert_array_equal(table.columns["u"], np.arange(30) % 7)
