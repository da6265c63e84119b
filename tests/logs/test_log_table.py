"""Good files: every layout a log may have, exact stamps, units, and rows that are not parsed."""

import gzip
from dataclasses import replace
from decimal import Decimal
from math import pi

import numpy as np
import pytest

from seatrial.core.files import sha256_of
from seatrial.logs.log_table import read_log_table
from seatrial.logs.source import ColumnMap, LogSource
from tests.logs.log_cases import GOOD, PROPELLER, SPEED, source, written


def assert_good(table, rows=20):
    assert table.time.dtype == np.float64
    np.testing.assert_allclose(table.time, 0.1 * np.arange(rows), rtol=0, atol=1e-15)
    np.testing.assert_allclose(table.columns["n"], (600 + np.arange(rows)) * pi / 30, rtol=1e-15)
    np.testing.assert_allclose(table.columns["u"], 1 + 0.01 * np.arange(rows), rtol=1e-15)


LAYOUTS = {
    "plain": (GOOD.encode(), "a.csv", {}),
    "gzip": (gzip.compress(GOOD.encode()), "a.csv.gz", {}),
    "tabs": (GOOD.replace(",", "\t").encode(), "a.tsv", {}),
    "semicolons": (GOOD.replace(",", ";").encode(), "a.csv", {"delimiter": ";"}),
    "spaces": (GOOD.replace(",", "   ").replace("\n", " \n  ").encode(), "a.dat", {"delimiter": "whitespace"}),
    "carriage returns": (GOOD.replace("\n", "\r\n").encode(), "a.csv", {}),
    "old line ends": (GOOD.replace("\n", "\r").encode(), "a.csv", {}),
    "blank lines": (b"\n" + GOOD.replace("\n", "\n\n  \n").encode() + b"\n\n", "a.csv", {}),
    "no last line end": (GOOD.rstrip("\n").encode(), "a.csv", {}),
    "byte order mark": (b"\xef\xbb\xbf" + GOOD.encode(), "a.csv", {}),
    "utf-16": (GOOD.encode("utf-16"), "a.csv", {"encoding": "utf-16"}),
    "cp1252": (GOOD.replace("ok", "20 °C").encode("cp1252"), "a.csv", {"encoding": "cp1252"}),
    "quotes": (GOOD.replace("ok", '"all ""well"",\nso far"').encode(), "a.csv", {}),
    "quoted numbers": (GOOD.replace("speed", '"speed"').replace("1.05", '"1.05"').encode(), "a.csv", {}),
    "quotes within cells": (GOOD.replace("ok", 'o"k', 2).encode(), "a.csv", {}),
    "row of units": (GOOD.replace("\n", "\ns,rpm,m/s,-\n", 1).encode(), "a.csv", {"header_rows": 2}),
    "preamble": (('a "quote, and\nmore\n' + GOOD).encode(), "a.csv", {"skip_rows": 2}),
    "empty rows at the end": ((GOOD + ",,,\n" * 3).encode(), "a.csv", {}),
    "no header": (GOOD.split("\n", 1)[1].encode(), "a.csv", {"names": ("t", "rpm", "speed", "remark")}),
    "spaces around cells": (GOOD.replace(",", " , ").encode(), "a.csv", {}),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_layouts(tmp_path, layout):
    content, name, changes = LAYOUTS[layout]
    assert_good(read_log_table(source(written(tmp_path, content, name), **changes)))


def test_account_of_the_reading(tmp_path):
    path = written(tmp_path, GOOD.replace("1.05", ""))
    table = read_log_table(source(path))
    assert table.source == "run.csv"
    assert table.sha256 == sha256_of(path)
    assert table.options["channels"]["n"] == {
        "column": "rpm",
        "unit": "rpm",
        "role": "control",
        "scale": 1.0,
        "offset": 0.0,
    }
    assert str(tmp_path) not in str(table.options)
    assert table.notes[0].startswith("20 rows over 1.9 s; step 0.1 s")
    assert "u: 1 of 20 cells are empty" in table.notes
    assert np.flatnonzero(np.isnan(table.columns["u"])).tolist() == [5]


def test_scale_and_offset_act_in_the_unit_of_the_file(tmp_path):
    text = "t,angle\n" + "".join(f"{k},{k}\n" for k in range(4))
    rudder = ColumnMap("angle", "deg", "control", scale=-1.0, offset=2.0)
    table = read_log_table(LogSource(written(tmp_path, text), "t", "s", {"delta_r": rudder}))
    np.testing.assert_allclose(table.columns["delta_r"], np.radians(2.0 - np.arange(4)), rtol=1e-15, atol=1e-18)


def test_a_control_that_is_a_line_between_samples_has_the_means_of_it(tmp_path):
    """Of 0, 10, a gap, 40 and 20 held over each step; the last sample has no next one."""
    text = "t,rpm\n0,0\n1,10\n2,\n3,40\n4,20\n"
    line = replace(PROPELLER, between="line")
    table = read_log_table(LogSource(written(tmp_path, text), "t", "s", {"n": line}))
    np.testing.assert_allclose(table.columns["n"] * 30 / pi, [5.0, 25.0, np.nan, 30.0, 20.0])
    assert table.options["channels"]["n"]["between"] == "line"


def test_a_smooth_control_that_is_held_is_doubted(tmp_path):
    """As one of which nothing is said; not as one that is said to be a command, nor one that jumps."""
    at = np.arange(80)
    smooth, jumps = 1200 + 200 * np.sin(0.1 * at), 1200 + 200 * np.sign(np.sin(0.1 * at))
    text = "t,rpm,other\n" + "".join(f"{k},{smooth[k]:.3f},{jumps[k]:.3f}\n" for k in at)

    def cautions(column):
        return read_log_table(LogSource(written(tmp_path, text), "t", "s", {"n": column})).cautions

    (said,) = cautions(PROPELLER)
    assert 'add between = "line" to this channel' in said
    assert [cautions(replace(PROPELLER, between=one)) for one in ("held", "line")] == [(), ()]
    assert cautions(replace(PROPELLER, column="other")) == ()


def test_nanosecond_stamps_lose_nothing(tmp_path):
    first = 1669909203330211715
    stamps = first + np.cumsum(np.random.default_rng(1).integers(1_000_000, 50_000_000, 500))
    text = "t,speed\n" + "".join(f"{stamp},{k}\n" for k, stamp in enumerate(stamps.tolist()))
    channels = {"u": SPEED}
    table = read_log_table(LogSource(written(tmp_path, text), "t", "ns", channels))
    assert table.epoch == Decimal(int(stamps[0])).scaleb(-9)
    assert np.rint(table.time * 1e9).astype(np.int64).tolist() == (stamps - stamps[0]).tolist()
    decimal = "t,speed\n" + "".join(
        f"{stamp // 10**9}.{stamp % 10**9:09d},{k}\n" for k, stamp in enumerate(stamps.tolist())
    )
    as_seconds = read_log_table(LogSource(written(tmp_path, decimal), "t", "s", channels))
    assert as_seconds.epoch == table.epoch
    np.testing.assert_array_equal(as_seconds.time, table.time)


@pytest.mark.parametrize(
    ("unit", "seconds"), [("ns", 1e-9), ("us", 1e-6), ("ms", 1e-3), ("s", 1.0), ("min", 60.0), ("h", 3600.0)]
)
def test_time_units(tmp_path, unit, seconds):
    stamps = [round(0.25 * k / seconds, 12) for k in range(5)]
    text = "t,speed\n" + "".join(f"{stamp:.12g},{k}\n" for k, stamp in enumerate(stamps))
    table = read_log_table(LogSource(written(tmp_path, text), "t", unit, {"u": SPEED}))
    np.testing.assert_allclose(table.time, 0.25 * np.arange(5), rtol=1e-8)


def test_columns_that_are_not_mapped_are_not_judged(tmp_path):
    text = "t,rpm,speed,x,x\n" + "".join(f"{k},1,{k},,junk{k}\n" for k in range(4))
    assert read_log_table(source(written(tmp_path, text))).columns.keys() == {"n", "u"}


def test_one_column_may_serve_two_channels(tmp_path):
    both = {"u": SPEED, "v": replace(SPEED, scale=-1.0)}
    table = read_log_table(source(written(tmp_path, GOOD), channels=both))
    np.testing.assert_array_equal(table.columns["v"], -table.columns["u"])


def test_whole_numbers_too_long_for_a_machine_word_are_read_as_floats(tmp_path):
    text = "t,rpm,speed\n" + "".join(f"{k},{10**20 + k},{k}\n" for k in range(4))
    long = {"n": replace(PROPELLER, scale=1e-20)}
    table = read_log_table(source(written(tmp_path, text), channels=long))
    np.testing.assert_allclose(table.columns["n"], pi / 30)


@pytest.mark.parametrize("decimals", [0, 1, 3, 6, 9, 12])
@pytest.mark.parametrize("begin", ["0", "1669912345", "1669912345123456"])
def test_decimal_stamps_are_exact_however_many_digits(tmp_path, begin, decimals):
    steps = np.random.default_rng(decimals).integers(1, 10**decimals + 5, 60)
    exact = [Decimal(begin) + Decimal(int(step)).scaleb(-decimals) for step in np.cumsum(steps)]
    text = "t,rpm,speed\n" + "".join(f"{stamp:f},{k},{k}\n" for k, stamp in enumerate(exact))
    table = read_log_table(source(written(tmp_path, text)))
    assert table.epoch == exact[0]
    assert table.time.tolist() == [float(stamp - exact[0]) for stamp in exact]


def test_digits_beyond_those_of_a_float_are_kept(tmp_path):
    exact = [Decimal("1669912345.1234567891"), Decimal("1669912345.2234567893"), Decimal("1669912345.3234567892")]
    text = "t,rpm,speed\n" + "".join(f"{stamp},{k},{k}\n" for k, stamp in enumerate(exact))
    assert read_log_table(source(written(tmp_path, text))).time.tolist() == [float(stamp - exact[0]) for stamp in exact]
