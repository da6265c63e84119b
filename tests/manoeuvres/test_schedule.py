"""Schedules as tables: what is written is read again, jumps and ramps as they are meant, and every mistake by its row."""

from itertools import pairwise

import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.manoeuvres.family import Family
from seatrial.manoeuvres.manoeuvre import Limits
from seatrial.manoeuvres.schedule import Schedule, read_rows, schedule_of, table_text
from seatrial.manoeuvres.shapes import SHAPES, Steps

RPM = np.pi / 30
STEP = 0.1


def rows(folder, text, controls=("n", "delta_r")):
    path = folder / "mine.csv"
    path.write_text(text)
    return read_rows(path, controls)


def test_what_is_written_is_read_again(tmp_path):
    """Random levels with a ramp between some, of two controls; no row where nothing bends."""
    rng, time = np.random.default_rng(4), np.arange(300) * STEP
    n = np.interp(time, [0, 8, 9, 29.9], [100.0, 100.0, 140.0, 131.0])
    rudder = np.repeat(rng.normal(size=10), 30)
    bends = Schedule(time, {"n": n, "delta_r": rudder}).bends()
    assert bends.time.size < 30
    found = rows(tmp_path, table_text(bends.time, bends.controls)).schedule(STEP)
    np.testing.assert_allclose(found.time, time)
    np.testing.assert_allclose(found.controls["n"], n, rtol=1e-9)
    np.testing.assert_allclose(found.controls["delta_r"], rudder, rtol=1e-9)
    columns = found.columns([("u", 1.5), ("n", 7.0), ("delta_r", 0.0)])
    assert list(columns) == ["u", "n", "delta_r"]
    assert set(columns["u"]) == {1.5}


def test_lines_are_straight_and_two_rows_of_one_time_are_a_jump(tmp_path):
    text = "# by hand\ntime_ms , n_rpm\n0,1000\n\n500,1100\n500,900\n1000,900\n"
    found = rows(tmp_path, text).schedule(STEP)
    expected = [1000, 1020, 1040, 1060, 1080, 900, 900, 900, 900, 900, 900]
    np.testing.assert_allclose(found.controls["n"] / RPM, expected, rtol=1e-6)


def test_names_may_hold_what_parts_them_from_their_unit(tmp_path):
    found = rows(tmp_path, "time_s,tau_X_kN,n_1_rpm\n0,1,2\n1,3,4\n", ("tau_X", "n", "n_1"))
    np.testing.assert_allclose(found.controls["tau_X"], [1000, 3000])
    np.testing.assert_allclose(found.controls["n_1"] / RPM, [2, 4])


@pytest.mark.parametrize(
    ("text", "where", "found"),
    [
        ("", "mine.csv", "0 rows"),
        ("time_s,n_rpm\n0,1\n", "mine.csv", "1 row below"),
        ("time_s;n_rpm\n0;1\n1;1\n", "mine.csv:1", "commas"),
        ("t,n_rpm\n0,1\n1,1\n", "mine.csv:1", 'column "t"'),
        ("time_s,rpm\n0,1\n1,1\n", "mine.csv:1", 'column "rpm"'),
        ("time_s,n_rpm,n_rpm\n0,1,1\n1,1,1\n", "mine.csv:1", "a second one of n"),
        ("time_s,n\n0,1\n1,1\n", "mine.csv:1", "without a unit"),
        ("time_s,n_deg\n0,1\n1,1\n", "mine.csv:1", 'unit "deg"'),
        ("time_s\n0\n1\n", "mine.csv:1", "no control"),
        ("n_rpm\n0\n1\n", "mine.csv:1", "no time"),
        ("# a\ntime_s,n_rpm\n0,1\n1\n", "mine.csv:4", "1 cell"),
        ("time_s,n_rpm\n0,1\n1,nan\n", "mine.csv:3", '"nan"'),
        ("time_s,n_rpm\n0,1\n1,\n", "mine.csv:3", '""'),
        ("time_s,n_rpm\n0,1\n\n2,1\n1,1\n", "mine.csv:5", "1 s after 2 s"),
        ("time_s,n_rpm\n0,1\n1,1\n1,2\n1,3\n", "mine.csv:5", "1 s after 1 s"),
        ("time_s,n_rpm\n3,1\n4,1\n", "mine.csv:2", "3 s in the first row"),
    ],
)
def test_mistakes_name_their_row(tmp_path, text, where, found):
    with pytest.raises(InputError, match=found) as caught:
        rows(tmp_path, text)
    assert caught.value.where.endswith(where) or f"{where}," in caught.value.where


def test_files_that_are_no_text(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_rows(tmp_path / "none.csv", ("n",))
    (tmp_path / "mine.csv").write_bytes(b"time_s,n_rpm\n0,\xff\n")
    with pytest.raises(InputError, match=r"mine.csv:2[^$]*0xff"):
        read_rows(tmp_path / "mine.csv", ("n",))


@pytest.mark.parametrize("end", [0.15, 1e9])
def test_samples_are_neither_too_few_nor_too_many(tmp_path, end):
    with pytest.raises(InputError, match="3 to 200000 samples"):
        rows(tmp_path, f"time_s,n_rpm\n0,1\n{end},1\n").schedule(STEP)


@pytest.mark.parametrize(
    ("limits", "row", "found"),
    [
        (Limits(upper=1450 * RPM), 4, "1500 rpm at 2 s"),
        (Limits(lower=900 * RPM), 5, "800 rpm at 3 s"),
        (Limits(rate=600 * RPM), 4, "700 rpm/s at 2 s"),
    ],
)
def test_limits_name_the_row_that_breaks_them(tmp_path, limits, row, found):
    table = rows(tmp_path, "time_s,n_rpm\n0,1000\n1,1000\n2,1500\n3,800\n")
    with pytest.raises(InputError, match=found) as caught:
        table.check_limits("n", limits, table.schedule(STEP))
    assert caught.value.where.endswith(f"mine.csv:{row}")
    table.check_limits(
        "n", Limits(800 * RPM * (1 + 1e-8), 1500 * RPM * (1 - 1e-8), 700 * RPM * (1 - 1e-8)), table.schedule(STEP)
    )


@pytest.mark.parametrize(
    ("text", "row"), [("0,1000\n5,1000\n5,1500\n9,1500\n", 4), ("0,1000\n4.9,1000\n5,1500\n9,1500\n", 3)]
)
def test_a_jump_is_told_where_it_is_and_the_limit_as_it_was_given(tmp_path, text, row):
    table = rows(tmp_path, f"time_s,n_rpm\n{text}")
    with pytest.raises(InputError, match=r"rpm/s at (5|4\.9) s") as caught:
        table.check_limits("n", Limits(rate=600 * RPM), table.schedule(STEP))
    assert caught.value.expected == "within the rate limit of 600 rpm/s, [limits.n]"
    assert caught.value.where.endswith(f"mine.csv:{row}")


def test_rows_between_samples_are_told(tmp_path):
    table = rows(tmp_path, "time_s,n_rpm\n0,1000\n0.25,1000\n0.27,1200\n0.3,1000\n0.3,1100\n1,1100\n")
    assert table.skipped(table.schedule(STEP)) == (3, 4)
    assert table.skipped(table.schedule(0.01)) == ()


@pytest.mark.parametrize(
    ("time", "controls", "message"),
    [
        ([0.0], {"n": [1.0]}, "1 sample"),
        ([0.0, 0.1, 0.1], {"n": [1.0, 2.0, 3.0]}, "not rising throughout"),
        ([0.1, 0.2], {"n": [1.0, 2.0]}, "two or more times that rise from 0 s"),
        ([0.0, np.nan], {"n": [1.0, 2.0]}, r"time\[1\]"),
        (None, {"n": [1.0]}, "schedule, time"),
        ([0.0, 0.1], {"n": [1.0]}, r"shape \(2,\)"),
        ([0.0, 0.1], {"n": [1.0, np.inf]}, r"control n\[1\]"),
        ([0.0, 0.1], {"n": "ab"}, "control n"),
        ([0.0, 0.1], [[1.0, 2.0]], "a mapping of names"),
    ],
)
def test_what_cannot_be_commanded(time, controls, message):
    with pytest.raises(InputError, match=message):
        Schedule(time, controls)


def test_lists_are_taken_for_arrays():
    schedule = Schedule([0, 0.1, 0.2], {"n": [1, 2, 3]})
    np.testing.assert_array_equal(schedule.columns([("n", 0.0)])["n"], [1.0, 2.0, 3.0])


STEPPED = {
    kind: (shape.levels, shape.parts)
    for kind, shape in SHAPES.items()
    if isinstance(shape, Steps) and not isinstance(shape.levels, str)
}


@pytest.mark.parametrize("ramp", [0.0, 0.2])
@pytest.mark.parametrize("kind", STEPPED)
def test_the_table_of_a_design_has_the_levels_that_were_asked_for(kind, ramp):
    """Levels of 1175 ± 200 rpm at times that are samples: no cell has a digit more than these have."""
    shares, parts = STEPPED[kind]
    family = Family("n", 1175 * RPM, duration=60.0, active=40.0, sample_time=0.1, start=5.0, ramp=ramp, kind=kind)
    rows = schedule_of(family.manoeuvre(200 * RPM, 0.8 * parts), 0.1).bends()
    cells = [line.split(",") for line in table_text(rows.time, rows.controls).splitlines()[1:]]
    levels = {f"{1175 + 200 * level:g}" for level in (0.0, *shares)}
    between = {f"{1175 + 100 * (a + b):g}" for a, b in pairwise((0.0, *shares * 2, 0.0))}
    assert {value for _, value in cells} <= levels | (between if ramp else set())
    assert all(round(float(time), 1) == float(time) for time, _ in cells)


def test_a_chirp_begins_at_trim():
    family = Family("n", 1175 * RPM, duration=60.0, active=40.0, sample_time=0.1, start=5.0, kind="chirp")
    time, value = family.manoeuvre(200 * RPM, 8.0).sample(0.1)
    np.testing.assert_allclose(value[time <= 5.0], 1175 * RPM, rtol=1e-13)
