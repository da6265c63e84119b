"""Real logs, where they are: sample counts against Python's own csv reader, bursts mended, garbage columns refused."""

import csv
import gzip
import os
from pathlib import Path

import numpy as np
import pytest

from seatrial.logs.align import align
from seatrial.logs.log_table import read_log_table
from seatrial.logs.source import ColumnMap, LogSource
from tests.logs.log_cases import refusal

DATA = Path(os.environ.get("SEATRIAL_DATA", Path(__file__).parents[2] / "../shared/data"))
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="no real records: set SEATRIAL_DATA to their folder")
POOL = DATA / "tauv_pool"
MOTION = {
    "u": ColumnMap("field.velocity.x", "m/s", "measurement"),
    "v": ColumnMap("field.velocity.y", "m/s", "measurement"),
}
GARBAGE = {
    "udot": ("acceleration.x", "m/s^2"),
    "vdot": ("acceleration.y", "m/s^2"),
    "wdot": ("acceleration.z", "m/s^2"),
    "p": ("angular_velocity.x", "rad/s"),
    "q": ("angular_velocity.y", "rad/s"),
    "r": ("angular_velocity.z", "rad/s"),
}


def navigation(run, channels=None):
    return read_log_table(
        LogSource(POOL / f"navigation_state_{run}.csv.gz", "field.header.stamp", "ns", channels or MOTION)
    )


def wrench(run):
    force = ColumnMap("field.force.x", "N", "control")
    return read_log_table(LogSource(POOL / f"wrench_{run}.csv.gz", "%time", "ns", {"tau_X": force}, clock="even"))


def by_hand(name, *columns):
    with gzip.open(POOL / name, "rt", newline="") as stream:
        return [[row[column] for column in columns] for row in csv.DictReader(stream)]


@pytest.mark.parametrize("run", range(10))
def test_every_pool_run(run):
    control, motion = wrench(run), navigation(run)
    rows = by_hand(f"navigation_state_{run}.csv.gz", "field.header.stamp", "field.velocity.x")
    commands = by_hand(f"wrench_{run}.csv.gz", "%time", "field.force.x")
    assert motion.time.size == len(rows)
    assert np.rint(motion.time * 1e9).astype(np.int64).tolist() == [int(stamp) - int(rows[0][0]) for stamp, _ in rows]
    assert motion.columns["u"].tolist() == [float(speed) for _, speed in rows]
    assert control.columns["tau_X"].tolist() == [float(force) for _, force in commands]
    assert np.diff(control.time).mean() == pytest.approx(0.02, rel=1e-3)

    record = align([control, motion], step=0.05)
    first = max(float(control.epoch - motion.epoch) + control.time[0], 0.0)
    instants = {int((int(stamp) - int(rows[0][0])) / 1e9 / 0.05 - first / 0.05 + 0.5 + 100) - 100 for stamp, _ in rows}
    assert np.flatnonzero(np.isfinite(record.channel("u"))).tolist() == sorted(instants & set(range(record.time.size)))
    assert record.time[-1] > 58


@pytest.mark.parametrize("name", GARBAGE)
@pytest.mark.parametrize("run", range(10))
def test_garbage_columns_are_refused(run, name):
    column, unit = GARBAGE[name]
    table = navigation(run, {name: ColumnMap(f"field.{column}", unit, "measurement")})
    with refusal(f"navigation_state_{run}.csv.gz", f'channel "{name}"', "magnitudes a vehicle can have"):
        align([table])


def test_ship_log_without_header_among_spaces():
    names = ("t", "x", "y", "heading", "vx", "vy", "rate", "c8", "rudder", "propeller", "thrust", "torque")
    channels = {
        "r": ColumnMap("rate", "deg/s", "measurement"),
        "delta_r": ColumnMap("rudder", "deg", "control", scale=-1.0),
        "n": ColumnMap("propeller", "rev/s", "control"),
    }
    path = DATA / "kvlcc2_hsva" / "HSVA_CPMC_KVLCC2_Z_20_10_P.dat.gz"
    table = read_log_table(
        LogSource(path, "t", "s", channels, names=names, delimiter="whitespace", skip_rows=4, encoding="cp1252")
    )
    record = align([table], step=0.05)
    assert np.degrees(np.abs(record.channel("delta_r")).max()) == pytest.approx(20, abs=2)
    assert np.median(record.channel("n")) == pytest.approx(2 * np.pi * 10.2, rel=0.05)
    assert record.time.size == table.time.size


def test_ship_log_with_too_few_digits():
    channels = {"r": ColumnMap("c9", "deg/s", "measurement")}
    names = tuple(f"c{k}" for k in range(1, 12))
    path = DATA / "kvlcc2_marin" / "MARIN_FREE_KVLCC2_zz_20_m.dat.gz"
    with refusal(path.name, 'column "c1"', "same time stamp"):
        read_log_table(LogSource(path, "c1", "s", channels, names=names, delimiter="\t", skip_rows=3))
    table = read_log_table(LogSource(path, "c1", "s", channels, "even", names=names, delimiter="\t", skip_rows=3))
    assert np.diff(table.time).mean() == pytest.approx(0.1353, rel=2e-3)
    assert any("empty rows at the end" in note for note in table.notes)
