"""One time axis for several logs: controls held, measurements not moved more than said, nothing invented."""

import json
from dataclasses import replace
from decimal import Decimal
from math import pi

import numpy as np
import pytest

from seatrial.core.files import sha256_of, sha256_of_json
from seatrial.core.record_file import read_record, write_record
from seatrial.logs.align import align
from seatrial.logs.log_table import read_log_table
from tests.logs.log_cases import GOOD, column, refusal, source, written


@pytest.fixture
def control(tmp_path):
    """Thrust at 50 Hz from 100 s to 110 s, one level a second."""
    time = 100 + 0.02 * np.arange(501)
    level = np.floor(time + 1e-6)
    return read_log_table(column(tmp_path, "thrust.csv", [f"{t:.2f}" for t in time], "tau_X", level, "control"))


@pytest.fixture
def velocity(tmp_path):
    """Speed at about 7 Hz from 98 s to 112 s, its own time as value."""
    time = 98 + np.cumsum(np.random.default_rng(7).uniform(0.12, 0.16, 100))
    return read_log_table(
        column(tmp_path, "speed.csv", [f"{t:.6f}" for t in time], "u", np.round(time, 6), "measurement")
    )


def test_grid_holds_controls_and_snaps_measurements(control, velocity):
    record = align([control, velocity], step=0.05)
    np.testing.assert_allclose(record.time, 0.05 * np.arange(201), atol=1e-12)
    np.testing.assert_allclose(record.channel("tau_X"), np.floor(100 + record.time + 1e-6), rtol=1e-9)
    measured = np.isfinite(record.channel("u"))
    taken = (velocity.columns["u"] >= 99.975) & (velocity.columns["u"] <= 110.025)
    assert measured.sum() == taken.sum()
    shift = np.abs(record.channel("u")[measured] - 100 - record.time[measured])
    assert shift.max() < 0.025
    assert f"moved by at most {shift.max():.3g} s" in record.provenance.options["notes"][1]


def test_union_keeps_every_stamp_and_every_value(control, velocity):
    record = align([velocity, control])
    stamps = np.unique(
        np.round(
            np.concatenate(
                [
                    control.time,
                    velocity.time[(velocity.columns["u"] >= 100) & (velocity.columns["u"] <= 110)]
                    + float(velocity.epoch)
                    - 100,
                ]
            ),
            9,
        )
    )
    np.testing.assert_allclose(record.time, stamps, atol=1e-9)
    assert record.time[0] == 0
    measured = np.isfinite(record.channel("u"))
    np.testing.assert_allclose(record.channel("u")[measured], 100 + record.time[measured], atol=1e-9)
    np.testing.assert_allclose(record.channel("tau_X"), np.floor(100 + record.time + 1e-6), rtol=1e-9)
    assert [channel.name for channel in record.channels] == ["tau_X", "u"]


def test_control_is_known_from_its_first_sample_to_its_last(tmp_path, velocity):
    values = np.array([np.nan, np.nan, 1.0, np.nan, 2.0, 3.0, np.nan])
    stamps = [f"{t}" for t in range(99, 106)]
    gappy = read_log_table(column(tmp_path, "gappy.csv", stamps, "tau_X", values, "control"))
    record = align([gappy, velocity], step=0.5)
    np.testing.assert_array_equal(record.channel("tau_X"), [1, 1, 1, 1, 2, 2, 3])
    assert Decimal(record.provenance.options["begins_at"]) == 101


def test_nanosecond_files_meet_on_one_exact_clock(tmp_path):
    first, n = 1669909203330211715, 50
    sent = [first + 20_000_000 * k for k in range(n)]
    seen = [first + 20_000_000 * k + 1_000_003 for k in range(-5, n)]
    a = column(tmp_path, "a.csv", sent, "tau_X", np.arange(n) + 0.0, "control", "ns")
    b = column(tmp_path, "b.csv", seen, "u", np.arange(-5, n) + 0.0, "measurement", "ns")
    record = align([read_log_table(a), read_log_table(b)])
    nanoseconds = np.rint(record.time * 1e9).astype(np.int64)
    expected = np.sort(np.concatenate([20_000_000 * np.arange(n), 20_000_000 * np.arange(n - 1) + 1_000_003]))
    np.testing.assert_array_equal(nanoseconds, expected)
    np.testing.assert_allclose(record.time, expected / 1e9, atol=1e-15)
    assert record.provenance.options["begins_at"] == "1669909203.330211715"


def test_files_of_the_same_stamps_share_their_instants(tmp_path):
    stamps = [f"{1669909203 + 0.1 * k:.1f}" for k in range(30)]
    a = column(tmp_path, "a.csv", stamps[3:], "tau_X", np.arange(27.0), "control")
    b = column(tmp_path, "b.csv", stamps, "u", np.arange(30.0), "measurement")
    record = align([read_log_table(a), read_log_table(b)])
    assert record.time.size == 27
    np.testing.assert_array_equal(record.channel("u"), record.channel("tau_X") + 3)
    on_grid = align([read_log_table(a), read_log_table(b)], step=0.1)
    np.testing.assert_array_equal(on_grid.measurement, record.measurement)
    np.testing.assert_array_equal(on_grid.control, record.control)


def test_measurements_that_meet_are_averaged_and_a_heading_goes_on_over_the_turn(tmp_path):
    stamps = [f"{0.02 * k:.2f}" for k in range(100)]
    turning = pi + 0.005 * (np.arange(100) - 50.5)
    heading = (turning + pi) % (2 * pi) - pi
    tables = [
        read_log_table(column(tmp_path, "psi.csv", stamps, "psi", heading, "measurement")),
        read_log_table(column(tmp_path, "u.csv", stamps, "u", np.arange(100.0), "measurement")),
    ]
    record = align(tables, step=0.1)
    # The grid instant 0.1 k takes the stamps from 0.1 k - 0.04 to 0.1 k + 0.04; the first one has none before it.
    means = np.array([1.0, *(5.0 * np.arange(1, 20))])
    np.testing.assert_allclose(record.channel("u")[:20], means)
    np.testing.assert_allclose(record.channel("psi")[:20], pi + 0.005 * (means - 50.5), atol=1e-12)
    assert np.ptp(heading) > 6
    assert "instants have the mean of two or more" in record.provenance.options["notes"][1]


def test_a_measurement_midway_makes_no_mean_late(tmp_path):
    stamps = [f"{0.05 * k:.2f}" for k in range(40)]
    table = read_log_table(column(tmp_path, "u.csv", stamps, "u", np.arange(40.0), "measurement"))
    record = align([table], step=0.1)
    np.testing.assert_allclose(record.channel("u"), 2.0 * np.arange(20))
    assert "20 midway between two instants were left out" in record.provenance.options["notes"][0]


def test_samples_half_a_step_off_the_grid_neither_meet_nor_miss(tmp_path, control):
    stamps = [f"{100.05 + 0.1 * k:.2f}" for k in range(99)]
    late = read_log_table(column(tmp_path, "late.csv", stamps, "u", np.arange(99.0), "measurement"))
    record = align([control, late], step=0.1, start=0.0, end=9.8)
    # The grid begins with the first measurement, so shift it by half a step through a second channel.
    early = read_log_table(
        column(tmp_path, "early.csv", ["100.0", "105.0", "110.0"], "v", np.arange(3.0), "measurement")
    )
    shifted = align([control, late, early], step=0.1)
    np.testing.assert_array_equal(record.channel("u"), np.arange(99.0))
    np.testing.assert_array_equal(shifted.channel("u")[:99], np.arange(99.0))


def test_trim_counts_from_the_common_beginning(control, velocity):
    whole = align([control, velocity], step=0.05)
    part = align([control, velocity], step=0.05, start=2.0, end=5.0, label="part")
    np.testing.assert_allclose(part.time, whole.time[:61], atol=1e-12)
    np.testing.assert_allclose(part.control, whole.control[40:101], rtol=1e-12)
    np.testing.assert_array_equal(part.measurement[1:-1], whole.measurement[41:100])
    assert part.label == "part"
    options = part.provenance.options
    assert (options["start"], options["end"], options["available"]) == pytest.approx((2.0, 5.0, 10.0))
    assert align([control, velocity], step=0.05, start=-3.0, end=99.0).time.size == whole.time.size


@pytest.mark.parametrize(
    ("start", "end"),
    [(20.0, None), (5.0, 5.0), (5.0, 2.0), (None, 0.0), (None, 0.05), (float("nan"), None), (None, float("nan"))],
)
def test_trim_that_leaves_nothing(control, velocity, start, end):
    with refusal('record "trial", start and end', f"start {start or 0.0:g} s", "0 s and 10 s"):
        align([control, velocity], step=0.05, start=start, end=end)


@pytest.mark.parametrize("step", [0.0, -0.1, float("nan"), float("inf"), 1e-9])
def test_step_that_is_no_step(control, velocity, step):
    with refusal('record "trial", step', repr(step)):
        align([control, velocity], step=step)


def test_provenance_tells_everything_but_the_machine(tmp_path, control, velocity):
    record = align([control, velocity], step=0.05)
    provenance = record.provenance
    assert provenance.source == "thrust.csv, speed.csv"
    hashes = [sha256_of(tmp_path / name) for name in ("thrust.csv", "speed.csv")]
    assert provenance.sha256 == sha256_of_json(hashes)
    assert [file["sha256"] for file in provenance.options["files"]] == hashes
    assert str(tmp_path) not in json.dumps(provenance.options, allow_nan=False)
    single = align([read_log_table(source(written(tmp_path, GOOD)))], step=0.1)
    assert single.provenance.sha256 == sha256_of(tmp_path / "run.csv")
    write_record(record, tmp_path / "record.nc")
    again = read_record(tmp_path / "record.nc")
    assert again.provenance == provenance
    np.testing.assert_array_equal(again.measurement, record.measurement)


def test_chosen_channels_in_the_order_asked(tmp_path, control):
    table = read_log_table(source(written(tmp_path, GOOD)))
    assert [channel.name for channel in align([table], channels=["u", "n"]).channels] == ["n", "u"]
    assert align([table], channels=["u"]).controls == ()
    with refusal("channels", '"w"', "use one of: n, u"):
        align([table], channels=["u", "w"])


def test_no_overlap_shows_both_spans(tmp_path, control):
    table = read_log_table(source(written(tmp_path, GOOD)))
    with refusal("thrust.csv, run.csv", "tau_X of thrust.csv: 100 s to 110 s", "u of run.csv: 0 s to 1.9 s", "overlap"):
        align([control, replace(table, channels=table.channels[1:])])


def test_measurement_outside_the_record(tmp_path, control, velocity):
    early = read_log_table(column(tmp_path, "early.csv", ["1", "2", "3", "4"], "v", np.arange(4.0), "measurement"))
    with refusal('early.csv, channel "v"', "none of them within the record"):
        align([control, velocity, early], step=0.05)


def test_channel_given_twice_or_not_at_all(tmp_path, control):
    with refusal('thrust.csv, channel "tau_X"', "thrust.csv gives too"):
        align([control, control])
    with refusal("tables", "none"):
        align([])


@pytest.mark.parametrize(
    ("values", "parts"),
    [
        (1e-155 * np.arange(1, 6), ('channel "p"', "at most 5.0e-155 rad/s", "invalid")),
        (np.full(5, 0.25), ('channel "p"', "0.25", "varies")),
    ],
)
def test_garbage_is_refused(tmp_path, values, parts):
    table = read_log_table(column(tmp_path, "rates.csv", ["0", "1", "2", "3", "4"], "p", values, "measurement"))
    with refusal("rates.csv", *parts):
        align([table])


def test_a_control_faster_than_the_grid_is_averaged(tmp_path):
    """A square wave of 10 Hz, of which samples every 0.1 s would see one level alone; against a fine sum."""
    time, grid = 0.02 * np.arange(501), 0.1 * np.arange(101)
    time[1:-1] += 0.004 * np.sin(np.arange(499.0))
    values = np.where(np.arange(501) % 5 < 2, 10.0, -3.0)
    logs = [
        column(tmp_path, "fast.csv", [f"{t:.9f}" for t in time], "tau_X", values, "control"),
        column(tmp_path, "speed.csv", [f"{t:.9f}" for t in grid], "u", grid, "measurement"),
    ]
    record = align([read_log_table(log) for log in logs], step=0.1)
    assert record.provenance.options["notes"][0] == "tau_X: 100 instants have the mean of the value held until the next"
    for i in (0, 7, 60):
        fine = grid[i] + 1e-5 * (np.arange(10000) + 0.5)
        held = values[np.searchsorted(time, fine, side="right") - 1]
        assert record.channel("tau_X")[i] == pytest.approx(held.mean(), abs=1e-2)


def test_a_hole_has_instants_of_the_usual_spacing(tmp_path):
    """One step over the hole would be too long to simulate: nothing is measured there, and the control is held."""
    stamps = [f"{t:.1f}" for t in (*np.arange(0.0, 2.05, 0.1), *np.arange(5.0, 7.05, 0.1))]
    values = np.arange(len(stamps), dtype=float)
    table = [
        read_log_table(column(tmp_path, f"{name}.csv", stamps, name, values, role))
        for name, role in (("u", "measurement"), ("tau_X", "control"))
    ]
    record = align(table)
    assert np.diff(record.time) == pytest.approx(0.1, abs=1e-6)
    hole = (record.time > 2.05) & (record.time < 4.95)
    assert hole.sum() == 29
    assert not np.isfinite(record.channel("u")[hole]).any()
    assert (record.channel("tau_X")[hole] == 20.0).all()
    (said,) = record.provenance.options["cautions"]
    assert said.startswith("no sample of tau_X, u from 2.00 s to 5.00 s, but usually one every 0.1 s")
    assert "simulated across it with the last value of tau_X" in said
    assert 'end = "2 s" in [import.trim.RUN]' in said


def test_clocks_a_millisecond_apart_make_no_holes(tmp_path):
    """Half of the steps are a millisecond: the others are the usual spacing of each log, and nothing is put between them."""
    late = [f"{0.1 * k + 0.001:.3f}" for k in range(50)]
    logs = [([f"{0.1 * k:.3f}" for k in range(50)], "u", "measurement"), (late, "tau_X", "control")]
    record = align(
        [read_log_table(column(tmp_path, f"{name}.csv", t, name, np.arange(50.0), role)) for t, name, role in logs]
    )
    assert record.time.size == 98


@pytest.mark.parametrize("step", [None, 0.1, 0.05])
@pytest.mark.parametrize("late", [0.002, -0.002])
def test_clocks_that_differ_by_a_constant_are_told_and_the_remedy_unites_them(tmp_path, late, step):
    """Commands 2 ms after the measurements, or before them, on clocks since 1970: taken together, they make one record."""
    stamps = 1.67e9 + 0.1 * np.arange(1156)
    random = np.random.default_rng(1)
    pushed, moved = np.repeat(random.normal(size=58), 20)[: stamps.size], random.normal(size=stamps.size)

    def record_of(late, shift=0.0):
        speed = column(tmp_path, "speed.csv", [f"{t:.3f}" for t in stamps], "u", moved, "measurement")
        thrust = column(tmp_path, "thrust.csv", [f"{t + late:.3f}" for t in stamps], "tau_X", pushed, "control")
        return align([read_log_table(speed), read_log_table(replace(thrust, shift=shift))], step=step)

    whole, apart = record_of(0.0), record_of(late)
    assert whole.cautions == ()
    if step is None:
        assert (whole.time.size, apart.time.size) == (1156, 2310)
    (told,) = [text for text in apart.cautions if "[import] blurs" not in text]
    side = "after" if late > 0 else "before"
    assert told.startswith(f"thrust.csv: each stamp is 0.002 s {side} one of speed.csv")
    assert f'write shift = "{-late:g} s"' in told
    followed = record_of(late, shift=-late)
    assert followed.cautions == ()
    for name in ("time", "control", "measurement"):
        np.testing.assert_array_equal(getattr(followed, name), getattr(whole, name))


def test_clocks_that_rounding_alone_parts_are_one(tmp_path):
    """Seconds since 1970 in double precision are multiples of 0.24 us: the union would have two instants of most."""
    stamps = 1.67e9 + 0.1 * np.arange(300)
    other = np.nextafter(stamps, np.where(np.arange(300) % 3, np.inf, 0.0))
    logs = [(stamps, "u", "measurement"), (other, "tau_X", "control")]
    record = align(
        [
            read_log_table(
                column(tmp_path, f"{name}.csv", map(repr, t.tolist()), name, np.arange(300) // 20 + 0.5, role)
            )
            for t, name, role in logs
        ]
    )
    np.testing.assert_allclose(record.time, 0.1 * np.arange(300), atol=1e-6)
    np.testing.assert_array_equal(record.channel("u"), record.channel("tau_X"))
    assert record.cautions == ()
    assert record.provenance.options["notes"][0] == "tau_X.csv: stamps moved by at most 3e-07 s onto those of u.csv"


@pytest.mark.parametrize(
    "other",
    [
        pytest.param(0.1 * np.arange(300) + 0.04, id="interleaved"),
        pytest.param(
            0.1 * np.arange(300) + 0.002 + np.random.default_rng(1).uniform(-0.002, 0.002, 300), id="jittered"
        ),
        pytest.param(0.1002 * np.arange(300), id="another rate"),
    ],
)
def test_clocks_that_differ_otherwise_are_not_told(tmp_path, other):
    logs = [(0.1 * np.arange(300), "u", "measurement"), (other, "tau_X", "control")]
    tables = [
        read_log_table(
            column(tmp_path, f"{name}.csv", [f"{one:.6f}" for one in t], name, np.arange(300) // 20 + 0.5, role)
        )
        for t, name, role in logs
    ]
    assert align(tables).cautions == ()


def test_a_command_within_a_step_acts_as_its_mean_and_not_a_step_late(tmp_path):
    """At most one new command in a step: the impulse of the held record is that of the commands, as a plain sum says."""
    random = np.random.default_rng(5)
    changes = 0.01 * np.cumsum(np.r_[0, random.integers(11, 30, 80)])
    pushed = random.normal(size=changes.size)
    moved = np.arange(0.0, changes[-1], 0.1)
    record = align(
        [
            read_log_table(column(tmp_path, "thrust.csv", [f"{t:.2f}" for t in changes], "tau_X", pushed, "control")),
            read_log_table(column(tmp_path, "speed.csv", [f"{t:.2f}" for t in moved], "u", moved, "measurement")),
        ],
        step=0.1,
    )
    fine = np.repeat(pushed[:-1], np.diff(np.rint(100 * changes).astype(int)))
    count = record.time.size - 1
    np.testing.assert_allclose(record.control[:-1, 0], fine[: 10 * count].reshape(count, 10).mean(1), atol=1e-12)


@pytest.mark.parametrize(("noise", "is_told"), [(0.002, True), (0.2, False)])
def test_samples_that_a_grid_moves_by_more_than_their_noise_are_told(tmp_path, noise, is_told):
    at = np.arange(0.0, 60.0, 0.13)
    moved = np.sin(at) + noise * np.random.default_rng(1).normal(size=at.size)
    tables = [
        read_log_table(column(tmp_path, "thrust.csv", [f"{t:.2f}" for t in at], "tau_X", np.zeros(at.size), "control")),
        read_log_table(column(tmp_path, "speed.csv", [f"{t:.2f}" for t in at], "u", moved, "measurement")),
    ]
    told = [text for text in align(tables, step=0.1).provenance.options["cautions"] if "blurs the record" in text]
    assert len(told) == is_told
    assert not any("e+" in text for text in told)
    assert not any("blurs" in text for text in align(tables).provenance.options["cautions"])


def test_an_even_log_is_not_blurred_by_a_step_of_several_of_its_own(tmp_path):
    """Four of its steps: each instant has as many samples before as after it, but for the first."""
    at = 0.05 * np.arange(2000)
    quiet = np.sin(0.2 * at) + 1e-5 * np.random.default_rng(1).normal(size=at.size)
    tables = [
        read_log_table(column(tmp_path, f"{name}.csv", [f"{t:.2f}" for t in at], name, values, role))
        for name, values, role in (("tau_X", np.zeros(at.size), "control"), ("u", quiet, "measurement"))
    ]
    assert not any("blurs" in text for text in align(tables, step=0.2).provenance.options["cautions"])
