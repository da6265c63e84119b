"""Bad files and maps: each refused with the file, the place, what was found and what to do."""

import gzip
from dataclasses import replace

import h5py
import numpy as np
import pytest

from seatrial.logs.inspect import inspect_log
from seatrial.logs.log_table import read_log_table
from seatrial.logs.source import ColumnMap, LogSource
from tests.logs.log_cases import GOOD, PROPELLER, SPEED, refusal, source, written

LINES = GOOD.splitlines(keepends=True)


def edited(line: int, text: str) -> str:
    """Return the good log with one line, counted as an editor does, replaced."""
    return "".join([*LINES[: line - 1], text + "\n", *LINES[line:]])


FILES = {
    "binary": (b"t,rpm\n\x00\x01\x02", "a.csv", ("a.csv, row 2", "binary data")),
    "binary without zeros": (bytes(range(128, 256)), "a.csv", ("a.csv, row 1", "binary data", "utf-8")),
    "other encoding": (
        GOOD.replace("ok", "°").encode("cp1252"),
        "a.csv",
        ("row 2", "not utf-8", 'write encoding = "cp1252"', "under its [[import.files]]"),
    ),
    "gzip without suffix": (gzip.compress(GOOD.encode()), "a.csv", ("a.csv", "gzip data", ".gz")),
    "suffix without gzip": (GOOD.encode(), "a.csv.gz", ("a.csv.gz", "not gzip")),
    "spreadsheet": (b"PK\x03\x04\x00\x00", "a.csv", ("spreadsheet", "export")),
    "spreadsheet by its suffix": (
        b"PK\x03\x04\x00\x00",
        "a.xlsx",
        ("a.xlsx", "a spreadsheet", "export the sheet", "CSV"),
    ),
    "old spreadsheet": (b"\xd0\xcf\x11\xe0\x00\x00", "a.csv", ("a spreadsheet, not utf-8", "export the sheet")),
    "other encoding in gzip": (
        gzip.compress(GOOD.replace("ok", "°").encode("cp1252")),
        "a.csv.gz",
        ("row 2", "other data, not utf-8", 'write encoding = "cp1252"'),
    ),
    "truncated gzip": (gzip.compress(GOOD.encode())[:-20], "a.csv.gz", ("a.csv.gz", "cut off", "again")),
    "damaged gzip": (gzip.compress(GOOD.encode())[:30] + b"\xff" * 40, "a.csv.gz", ("a.csv.gz", "gzip", "again")),
    "bytes behind gzip": (
        gzip.compress(GOOD.encode()) + b"more",
        "a.csv.gz",
        ("followed by", "gzip -dc a.csv.gz > a.csv"),
    ),
    "gzip with a wrong checksum": (
        (whole := gzip.compress(GOOD.encode()))[:-8] + b"\0\0\0\0" + whole[-4:],
        "a.csv.gz",
        ("a wrong checksum", "copy the file again"),
    ),
    "utf-16": (GOOD.encode("utf-16"), "a.csv", ("UTF-16", '(or "utf-16")')),
    "empty": (b"", "a.csv", ("a.csv", "empty", "0 bytes")),
    "only spaces": (b" \n\n", "a.csv", ("empty",)),
    "empty gzip": (gzip.compress(b""), "a.csv.gz", ("empty",)),
    "only a header": (LINES[0].encode(), "a.csv", ("no row below the header\n", "export the log again")),
    "two rows": ("".join(LINES[:3]).encode(), "a.csv", ("2 samples", "at least 3")),
    "unknown suffix": (b"one\ntwo\n", "a.dat", ("a.dat, delimiter", "whitespace")),
}


@pytest.mark.parametrize("case", FILES)
def test_not_the_file_it_says(tmp_path, case):
    content, name, parts = FILES[case]
    with refusal(*parts):
        read_log_table(source(written(tmp_path, content, name)))


def test_no_file(tmp_path):
    with refusal("nowhere.csv", "no such file"):
        read_log_table(source(tmp_path / "nowhere.csv"))
    (tmp_path / "folder.csv").mkdir()
    with refusal("folder.csv", "a folder"):
        read_log_table(source(tmp_path / "folder.csv"))


TEXTS = {
    "word": (edited(5, "0.3,603,fast,ok"), ("row 5", 'column "speed"', "'fast'", "a number")),
    "truth": ("t,rpm,speed\n" + "".join(f"{k},1,True\n" for k in range(4)), ("row 2", "'True'")),
    "decimal comma": (edited(5, '0.3,603,"1,03",ok'), ("row 5", "'1,03'", "point")),
    "empty row between": (edited(5, ",,,"), ("row 5", 'column "t"', "empty cell")),
    "infinity": (edited(21, "1.9,619,inf,ok"), ("row 21", 'column "speed"', "'inf'", "finite")),
    "overflow": (edited(21, "1.9,619,1e999,ok"), ("row 21", "'1e999'", "finite")),
    "after a blank line": (edited(5, "0.3,603,1.03,ok\n\n0.35,603,fast,ok"), ("row 7", "'fast'")),
    "after a cell of two lines": (edited(5, '0.3,603,1.03,"o\nk"\n0.35,603,fast,ok'), ("row 7", "'fast'")),
    "no stamp": (edited(5, ",603,1.03,ok"), ("row 5", 'column "t"', "empty cell", "time stamp in every row")),
    "a date": (edited(5, "2022-12-01,603,1.03,ok"), ("row 5", 'column "t"', "'2022-12-01'")),
    "endless stamp": (edited(5, "inf,603,1.03,ok"), ("row 5", 'column "t"', "'inf'")),
    "stamp of nothing": (edited(5, "1e-99999999999999999999,603,1.03,ok"), ('column "t"', "stamps beyond any clock")),
    "impossible stamp": (edited(5, "1e99999999999999999999,603,1.03,ok"), ("row 5", 'column "t"', "a finite number")),
    "one cell": (edited(5, "0.3"), ("row 5", "1 cell; 1 of 20 rows is so")),
    "short row": (edited(5, "0.3,603,1.03"), ("row 5", "3 cells; 1 of 20", "4 cells")),
    "long row": (edited(5, "0.3,603,1.03,ok,ok"), ("row 5", "5 cells", "4 cells", "correct or delete")),
    "cut off": (GOOD[:-8], ("row 21", "3 cells", "last row is cut off")),
    "header too short": (GOOD.replace(",remark", ""), ("row 2", "20 of 20", "names")),
    "open quote": (edited(5, '0.3,603,1.03,"ok'), ("cannot be divided", "quotation mark in row 5")),
    "stray quotes": (edited(5, '0.3,603,"1.03,ok'), ("row 5", "cells", "quotation mark")),
    "column without numbers": (
        "t,rpm,speed\n" + "".join(f"{k},1,\n" for k in range(5)),
        ('column "speed"', "no number"),
    ),
    "repeated stamp": (edited(5, "0.2,603,1.03,ok"), ('column "t", row 5', "same time stamp", "drop_repeated")),
    "backwards": (edited(5, "0.1,603,1.03,ok"), ('column "t", row 5', "backwards")),
    "repeated after a blank line": (edited(5, "\n0.2,603,1.03,ok"), ("row 6", "same time stamp")),
    "misspelt header": (GOOD.replace("speed", "Speed"), ('column "speed"', '"Speed"?')),
    "missing header": (GOOD.replace("speed", "zz"), ('column "speed"', "one of the 4", "t, rpm, zz, remark")),
    "repeated header": (GOOD.replace("remark", "speed"), ('column "speed"', "positions 3, 4", "names")),
    "no header": (GOOD.replace(",ok", "").split("\n", 1)[1], ('column "t"', "no header", "column_1")),
}


@pytest.mark.parametrize("case", TEXTS)
def test_bad_cells_rows_and_headers(tmp_path, case):
    text, parts = TEXTS[case]
    with refusal("run.csv", *parts):
        read_log_table(source(written(tmp_path, text)))


MAPS = {
    "no channel": ({"channels": {}}, ("channels", "empty")),
    "unknown channel": ({"channels": {"upsilon": SPEED}}, ("channels", "upsilon", "tau_X")),
    "nearly a channel": ({"channels": {"delta_rr": PROPELLER}}, ("delta_rr", '"delta_r"?')),
    "angle has no rate": ({"channels": {"phidot": SPEED}}, ("phidot",)),
    "unit of another dimension": ({"channels": {"u": replace(SPEED, unit="rpm")}}, ('channel "u", unit', "rpm", "m/s")),
    "hertz is no rate": ({"channels": {"n": replace(PROPELLER, unit="Hz")}}, ('channel "n", unit', "Hz", "rad/s")),
    "unknown unit": ({"channels": {"u": replace(SPEED, unit="mph")}}, ('channel "u", unit', "mph")),
    "unknown role": ({"channels": {"u": replace(SPEED, role="sensor")}}, ('channel "u", role', "sensor")),
    "scale of zero": ({"channels": {"u": replace(SPEED, scale=0.0)}}, ('channel "u"', "scale 0.0")),
    "offset that is no number": ({"channels": {"u": replace(SPEED, offset=float("nan"))}}, ('channel "u"', "nan")),
    "unknown clock": ({"clock": "evn"}, ("clock", "evn", '"even"?')),
    "time unit of another dimension": ({"time_unit": "m"}, ("time_unit", '"m"')),
    "unknown time unit": ({"time_unit": "nsec"}, ("time_unit", "nsec")),
    "delimiter of two characters": ({"delimiter": ", "}, ("delimiter", "', '")),
    "delimiter within numbers": ({"delimiter": "."}, ("delimiter", "'.'")),
    "negative rows": ({"skip_rows": -1}, ("skip_rows", "-1")),
    "no header row": ({"header_rows": 0}, ("header_rows", "0")),
    "skips everything": ({"skip_rows": 1000}, ("no row below the 1000 lines that skip_rows", "skip_rows is too large")),
    "encoding of hosts": ({"encoding": "idna"}, ("encoding", "idna")),
    "encoding of labels": ({"encoding": "punycode"}, ("encoding", "punycode")),
    "encoding of source code": ({"encoding": "unicode_escape"}, ("encoding", "unicode_escape")),
    "no encoding at all": ({"encoding": "undefined"}, ("encoding", "undefined")),
    "encoding with a zero": ({"encoding": "utf-8\0"}, ("encoding", "utf-8")),
    "unknown encoding": ({"encoding": "utf-9"}, ("encoding", "utf-9")),
    "encoding that is not text": ({"encoding": "rot13"}, ("encoding", "rot13")),
}


@pytest.mark.parametrize("case", MAPS)
def test_bad_maps(tmp_path, case):
    changes, parts = MAPS[case]
    with refusal("run.csv", *parts):
        read_log_table(source(written(tmp_path, GOOD), **changes))


@pytest.mark.parametrize(
    ("step", "unit", "meant"),
    [
        (20_000_000, "s", "ns"),
        (20_000, "s", "us"),
        (20_000_000, "ms", "ns"),
        (50, "ns", "ms"),
        (5, "us", "ms"),
        (50, "min", "ms"),
    ],
)
def test_wrong_time_unit_is_recognised(tmp_path, step, unit, meant):
    text = "t,speed\n" + "".join(f"{1669909203330211715 + step * k},{k}\n" for k in range(5))
    with refusal("run.csv", 'column "t"', "median step", f'"{unit}"', f'is the unit "{meant}"?'):
        read_log_table(LogSource(written(tmp_path, text), "t", unit, {"u": ColumnMap("speed", "m/s", "measurement")}))


STAMPS = {
    "leap second": ("2016-12-31T23:59:60Z", "import two runs, before and after it"),
    "no day": ("2016-02-30T00:00:00Z", "correct the stamp"),
    "no instant": ("NaT", "remove the row"),
    "another zone": ("2016-12-31T23:59:59+01:00", "correct the stamp"),
}


@pytest.mark.parametrize("case", STAMPS)
def test_a_stamp_that_is_no_instant_is_named_and_stops_no_look_at_the_log(tmp_path, case):
    stamp, remedy = STAMPS[case]
    rows = [f"2016-12-31T23:59:{second:02d}Z" for second in range(50, 60)]
    text = "t,u\n" + "".join(f"{one},1.{row}\n" for row, one in enumerate([*rows, stamp]))
    path = written(tmp_path, text)
    with refusal("run.csv, row 12", 'column "t"', repr(stamp), remedy):
        read_log_table(LogSource(path, "t", "ns", {"u": ColumnMap("u", "m/s", "measurement")}))
    table = inspect_log(path).tables[0]
    assert {one.name: round(one.missing * 11) for one in table.columns} == {"t": 1, "u": 0}


@pytest.mark.parametrize("name", ["a.npz", "a.nc"])
def test_a_row_without_an_instant_is_named(tmp_path, name):
    time = np.datetime64("2020-01-01", "ns") + np.arange(9) * np.timedelta64(100, "ms")
    time[4] = "NaT"
    if name == "a.npz":
        np.savez(tmp_path / name, t=time, u=np.arange(9.0))
    else:
        with h5py.File(tmp_path / name, "w") as file:
            file["t"], file["u"] = time.astype(np.int64), np.arange(9.0)
    with refusal(name, 'column "t"', "row 5", "a time stamp in every row"):
        read_log_table(LogSource(tmp_path / name, "t", "ns", {"u": ColumnMap("u", "m/s", "measurement")}))
