"""A record of a table in memory is what `make_record` makes of its columns in SI."""

import numpy as np
import pandas as pd
import pytest

import seatrial as st

T = 0.1 * np.arange(60)
RPM = 1000.0 + 200.0 * (np.arange(60) // 20)
KNOTS = 3.0 + 0.01 * np.arange(60)
KNOTS[7] = np.nan
TABLE = {"t": 5.0 + T, "rpm": RPM, "SOG_kn": KNOTS}
ASKED = {"u": ("SOG_kn", "kn"), "n": ("rpm", "rpm"), "commanded": ["n"]}


def expected(**more):
    columns = {"u": KNOTS * 1852 / 3600, "n": RPM * 2 * np.pi / 60}
    channels = st.Channel("n", "rad/s", "control"), st.Channel("u", "m/s", "measurement")
    return st.make_record(T, columns, channels, st.Provenance("a table", ""), **more)


def check(record, other):
    assert (record.controls, record.measured, record.label) == (other.controls, other.measured, other.label)
    assert record.provenance.options["between"] == other.provenance.options["between"]
    np.testing.assert_allclose(record.time, other.time, atol=1e-9)
    np.testing.assert_allclose(record.control, other.control, rtol=1e-14)
    np.testing.assert_allclose(record.measurement, other.measurement, rtol=1e-14)


START = pd.Timestamp("2026-05-01 10:00:00.5")
STAMPS = {
    "seconds": TABLE["t"],
    "dates": pd.Series(START + pd.to_timedelta(T, unit="s")),
    "dates of a zone": pd.Series(START.tz_localize("Australia/Brisbane") + pd.to_timedelta(T, unit="s")),
    "texts": [f"2026-05-01T10:00:{t:06.3f}Z" for t in T],
    "datetime64": np.datetime64("2026-05-01T10:00:00") + (1000 * T).round().astype("timedelta64[ms]"),
}


@pytest.mark.parametrize("stamps", STAMPS)
@pytest.mark.parametrize("kind", [dict, pd.DataFrame])
def test_a_table_is_what_its_columns_are(stamps, kind):
    check(st.record(kind(TABLE | {"t": STAMPS[stamps]}), time="t", **ASKED), expected())


def test_units_of_time_and_gaps():
    whole = pd.DataFrame(TABLE | {"t": (1000 * TABLE["t"]).round().astype(int)})
    whole["SOG_kn"] = whole["SOG_kn"].astype("Float64")  # a gap is NA
    check(st.record(whole, ("t", "ms"), label="run 1", **ASKED), expected(label="run 1"))


def test_a_control_that_was_measured():
    table = TABLE | {"rpm": RPM + np.arange(60)}
    record = st.record(table, "t", between={"n": "line"}, **ASKED)
    np.testing.assert_allclose(record.channel("n")[0], 1000.5 * 2 * np.pi / 60)
    with pytest.warns(UserWarning, match=r'"line"}} in record'.replace("}}", "}")):
        guessed = st.record(table | {"rpm": RPM + 5 * np.sin(np.arange(60))}, "t", **ASKED)
    assert len(guessed.cautions) == 1


def test_a_unit_that_the_name_contradicts():
    with pytest.warns(UserWarning, match='by its name "kn"'):
        record = st.record(TABLE, "t", **ASKED | {"u": ("SOG_kn", "m/s")})
    assert "SOG_kn" in record.cautions[0]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"time": "time"}, r'record .trial., time\n.*no column "time"\n.*one of t, rpm, SOG_kn'),
        ({"u": ("speed", "kn")}, r'channel "u"\n.*no column "speed"'),
        ({"u": "SOG_kn"}, r'channel "u"\n.*\n.*a column and its unit\n.*write for example u='),
        ({"u": ("SOG_kn", "kg")}, r'channel "u", unit\n.*kg'),
        ({"uu": ("SOG_kn", "kn")}, r'channel "uu"\n.*the name .uu.\n.*the name of a signal'),
        ({"commanded": ["m"]}, r'commanded\n.*"m"'),
        ({"commanded": "n"}, r"commanded\n"),
        ({"between": {"u": "line"}}, r'between\n.*"u"'),
        ({"time": ("t", "kg")}, r"time, column .t., unit\n.*kg"),
        ({"table": TABLE | {"rpm": ["fast"] * 60}}, r'channel "n", column "rpm"\n'),
        ({"table": TABLE | {"t": ["2026-05-01T10:00Z", "noon"] + ["2026-05-01T10:01Z"] * 58}}, r"row 2\n.*noon"),
        ({"table": TABLE | {"t": T[::-1]}}, "time"),
    ],
)
def test_what_cannot_be_read_is_refused(changes, message):
    with pytest.raises(st.InputError, match=message):
        st.record(**{"table": TABLE, "time": "t", **ASKED, **changes})
