"""Clocks: an even one rebuilt from bursts, against the truth and a linear programme; repeated stamps dropped."""

import numpy as np
import pytest
from scipy.optimize import linprog

from seatrial.logs.align import align
from seatrial.logs.inspect import inspect_log
from seatrial.logs.log_table import read_log_table
from seatrial.logs.time_stamps import even_clock, lost_after
from tests.logs.log_cases import GOOD, SPEED, refusal, source, written


def bursts(seed, rows=3000, period=0.02, start=5.0, jitter=1e-3, longest=1.3):
    """Arrivals of rows that left evenly: a little late each, and now and then held back and released together."""
    rng = np.random.default_rng(seed)
    truth = start + period * np.arange(rows)
    arrival = truth + rng.exponential(jitter, rows)
    at = start - 1.0
    while at < truth[-1]:
        held, at = at, at + rng.uniform(0.05, longest)
        late = (truth >= held) & (truth < at)
        arrival[late] = np.maximum(arrival[late], at + 2e-6 * np.arange(late.sum()))
        at += rng.uniform(0.0, 0.3)
    return truth, np.maximum.accumulate(arrival)


@pytest.mark.parametrize("seed", range(8))
def test_even_clock_finds_the_truth_below_bursts(seed):
    truth, arrival = bursts(seed)
    time, notes = even_clock(arrival)
    assert np.max(arrival - truth) > 0.5
    assert np.min(arrival - time) > -1e-9
    # Rows between two bursts are late by an exponential delay of 1 ms: some are nearly on time.
    assert np.max(np.abs(time - truth)) < 2e-3
    assert np.ptp(np.diff(time)) < 1e-9
    assert np.diff(time).mean() == pytest.approx(0.02, rel=1e-4)
    assert "period 0.02" in notes[0]
    assert np.max(np.abs(arrival - truth - np.median(arrival - truth))) > 100 * np.max(np.abs(time - truth))


@pytest.mark.parametrize("seed", range(4))
def test_even_clock_solves_the_linear_programme(seed):
    _, arrival = bursts(seed, rows=400)
    index = np.arange(400.0)
    result = linprog(
        [-400.0, -index.sum()],
        A_ub=np.column_stack([np.ones(400), index]),
        b_ub=arrival,
        bounds=[(None, None), (0, None)],
    )
    time, _ = even_clock(arrival)
    assert np.sum(arrival - time) == pytest.approx(arrival.sum() + result.fun, rel=1e-9)


def test_even_clock_of_even_stamps_changes_nothing():
    time = 3.0 + 0.05 * np.arange(200)
    np.testing.assert_allclose(even_clock(time)[0], time, atol=1e-12)


def test_even_clock_from_a_file(tmp_path):
    truth, arrival = bursts(3)
    text = "t,speed\n" + "".join(f"{stamp:.4f},{k}\n" for k, stamp in enumerate(arrival.tolist()))
    table = read_log_table(source(written(tmp_path, text), channels={"u": SPEED}, clock="even"))
    assert np.max(np.abs(float(table.epoch) + table.time - truth)) < 2e-3
    assert any("clock rebuilt" in note for note in table.notes)
    with refusal("run.csv", 'column "t", row', "same time stamp"):
        read_log_table(source(written(tmp_path, text), channels={"u": SPEED}))


def without(truth, arrival, first, seconds):
    """Return the rows of a log that lost some after one of them."""
    kept = (truth <= truth[first]) | (truth > truth[first] + seconds)
    return truth[kept], arrival[kept]


@pytest.mark.parametrize("seed", range(8))
def test_rows_that_were_held_back_are_not_lost(seed):
    assert lost_after(np.round(bursts(seed)[1], 4)).size == 0
    sends = np.arange(3000)
    assert lost_after(5.0 * (sends // 50) + 1e-3 * (sends % 50)).size == 0


@pytest.mark.parametrize("seconds", [4.0, 250.0])
def test_rows_of_a_hole_are_lost(seconds):
    truth = 0.1 * np.arange(3600)
    arrival = np.round(truth + np.random.default_rng(0).normal(0, 0.005, truth.size), 3)
    assert lost_after(without(truth, arrival, 700, seconds)[1]).tolist() == [700]


@pytest.mark.parametrize("seed", range(4))
def test_even_clock_is_even_between_the_holes(seed):
    truth, arrival = without(*bursts(seed), 1200, 8.0)
    time, notes = even_clock(arrival)
    assert np.max(np.abs(time - truth)) < 2e-3
    assert "in each of 2 stretches, separated by lost rows: period 0.02 s" in notes[0]


REPEATED = "t,rpm,speed\n0,1,1\n0.1,1,2\n0.1,1,3\n0.1,1,4\n0.2,1,5\n0.3,1,6\n"


def test_drop_repeated_keeps_the_first_row(tmp_path):
    table = read_log_table(source(written(tmp_path, REPEATED), clock="drop_repeated"))
    assert table.columns["u"].tolist() == [1, 2, 5, 6]
    np.testing.assert_allclose(table.time, [0, 0.1, 0.2, 0.3], atol=1e-15)
    assert any("2 of 6 rows repeated a stamp" in note for note in table.notes)
    assert len(read_log_table(source(written(tmp_path, GOOD), clock="drop_repeated")).notes) == 1


@pytest.mark.parametrize("clock", ["drop_repeated", "even"])
def test_no_clock_mends_time_that_runs_backwards(tmp_path, clock):
    with refusal("run.csv", 'column "t", row 8', "backwards"):
        read_log_table(source(written(tmp_path, REPEATED + "0.2,1,7\n"), clock=clock))


@pytest.mark.parametrize(
    ("column", "unit", "asked"),
    [("t_ms", "s", "ms"), ("time [us]", "ms", "us"), ("t_ms", "ms", None), ("ts", "ms", None), ("sonar_s", "ms", None)],
)
def test_a_unit_in_the_name_of_the_clock_is_held_against_the_map(tmp_path, column, unit, asked):
    text = f"{column},rpm,speed\n" + "".join(f"{100 * k},{600 + k},{1 + 0.01 * k:.2f}\n" for k in range(20))
    found = read_log_table(source(written(tmp_path, text), time_column=column, time_unit=unit))
    expected = f'run.csv, time: the unit of column "{column}" is "{unit}" in the map; is it "{asked}"?'
    assert found.cautions == ((expected,) if asked else ())


@pytest.mark.parametrize(("step", "unit", "meant"), [(0.1, "ms", "s"), (100, "s", "ms")])
def test_a_clock_in_another_unit_is_told_with_the_one_that_fits(tmp_path, step, unit, meant):
    text = "clock,rpm,speed\n" + "".join(f"{step * k:.1f},{600 + k},{1 + 0.01 * k:.2f}\n" for k in range(40))
    table = read_log_table(source(written(tmp_path, text), time_column="clock", time_unit=unit))
    (said,) = table.cautions
    assert said.startswith('run.csv, time: column "clock" has a row every')
    assert (
        f'with the unit "{unit}", where 0.001 s to 10 s is usual; is it "{meant}"? Then it would be one every 0.1 s'
        in said
    )
    with refusal("start and end", "correct the unit of time first: run.csv has a row every", f'is it "{meant}"?'):
        align([table], start=1e5, end=2e5)


def test_a_grid_much_finer_than_every_channel_is_told(tmp_path):
    text = "clock,rpm,speed\n" + "".join(f"{100 * k},{600 + k},{1 + 0.01 * k:.2f}\n" for k in range(20))
    log = written(tmp_path, text)
    *_, told = align([read_log_table(source(log, time_column="clock"))], step=0.05).provenance.options["cautions"]
    assert "a sample only every 100 s, and the record one every 0.05 s. Check the unit of time" in told
    fine = align([read_log_table(source(log, time_column="clock", time_unit="ms"))], step=0.05)
    assert fine.provenance.options["cautions"] == []


def two_clocks(folder, factor):
    """A clock of seconds since 1970 that jitters, beside one that counts rows by a nominal step."""
    rng, rows = np.random.default_rng(3), np.arange(1681)
    time = 1.67e9 + 0.1 * rows + rng.uniform(0.0, 0.02, rows.size)
    lines = [
        f"{t:.6f},{factor * 0.1 * k:.9f},{600 + k // 20},{1 + 0.001 * k:.4f}" for k, t in zip(rows, time, strict=True)
    ]
    return written(folder, "stamp [s],t,rpm,speed\n" + "\n".join(lines) + "\n", "two.csv")


@pytest.mark.parametrize("stated", [("stamp [s]", "s"), ("t", "s"), (None, None)])
def test_two_clocks_of_a_table_that_disagree_are_told(tmp_path, stated):
    """153.5 s and 168.0 s, the shorter with an even step."""
    path = two_clocks(tmp_path, 153.5 / 168.0)
    expected = ("clocks disagree: t runs over 153.5 s, stamp [s] over 168", "t has an even step, and may count rows")
    read = read_log_table(source(path, time_column=stated[0], time_unit=stated[1]))
    (told,) = [text for text in read.cautions if "disagree" in text]
    assert told.startswith(str(path))
    assert f"the time is {stated[0] or 't'}: name the right one" in told
    lines = "\n".join(inspect_log(path).lines())
    assert all(part in text for part in expected for text in (told, lines))
    assert align([read]).cautions == read.cautions


@pytest.mark.parametrize("stated", [("stamp [s]", "s"), (None, None)])
def test_two_clocks_that_agree_are_not_told(tmp_path, stated):
    path = two_clocks(tmp_path, 1.0)
    assert read_log_table(source(path, time_column=stated[0], time_unit=stated[1])).cautions == ()
    assert "disagree" not in "\n".join(inspect_log(path).lines())
