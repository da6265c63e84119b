"""Parts are computed once, kept, and computed again when anything they depend on has changed."""

import signal
import subprocess
import sys
import time
from dataclasses import replace
from threading import Barrier, Thread

import h5py
import jax
import numpy as np
import pytest
import xarray as xr

from seatrial.core.reporter import run_side_by_side
from studies.remus100.run import run_paper
from studies.remus100.study import Study
from studies.remus100.tests.studies import TINY, A, B

PARTS = ("one", "two", "three")


class Counted:
    """Random parts that count how often they are computed, of which some fail."""

    def __init__(self, *failing):
        self.failing, self.calls = set(failing), []

    def study(self, folder, **options) -> Study:
        parts = {name: self.part(name) for name in PARTS}
        return Study(folder, **{"reading": A, "sizes": TINY, "parts": parts, **options})

    def part(self, name):
        def compute(study):
            self.calls.append(name)
            if name in self.failing:
                raise KeyboardInterrupt
            return xr.Dataset({"x": ("i", np.asarray(jax.random.normal(study.random_key(name), (50,))))})

        return compute


def run(study):
    return run_side_by_side([lambda name=name: study.part(name) for name in PARTS])


def test_a_part_is_computed_once(tmp_path):
    counted = Counted()
    first = counted.study(tmp_path)
    assert first.part("one") is first.part("one")
    again = counted.study(tmp_path).part("one")
    xr.testing.assert_identical(first.part("one"), again)
    assert counted.calls == ["one"]


def test_parts_have_random_keys_of_their_own(tmp_path):
    found = [dataset["x"].values for dataset in run(Counted().study(tmp_path / "a"))]
    assert not np.isin(found[0], found[1]).any()
    other = run(Counted().study(tmp_path / "b", seed=1))
    assert not np.isin(found[0], other[0]["x"]).any()


@pytest.mark.parametrize(
    "change", [{"sizes": replace(TINY, draws=1100)}, {"seed": 1}, {"reading": B}], ids=["sizes", "seed", "reading"]
)
def test_a_change_recomputes(tmp_path, change):
    counted = Counted()
    before = counted.study(tmp_path)
    before.part("one")
    after = counted.study(tmp_path, **change)
    after.part("one")
    assert counted.calls == ["one", "one"]
    assert before.key("one") != after.key("one") != after.key("two")
    counted.study(tmp_path, **change).part("one")
    assert len(counted.calls) == 2


def test_an_interrupted_run_resumes_to_the_same_bits(tmp_path):
    straight = run(Counted().study(tmp_path / "straight"))
    counted = Counted("two")
    with pytest.raises(KeyboardInterrupt):
        [counted.study(tmp_path / "stopped").part(name) for name in PARTS]
    assert sorted(path.name for path in (tmp_path / "stopped" / "results").iterdir()) == ["one.nc"]
    counted.failing.clear()
    resumed = run(counted.study(tmp_path / "stopped"))
    assert sorted(counted.calls) == ["one", "three", "two", "two"]
    for ours, theirs in zip(resumed, straight, strict=True):
        xr.testing.assert_identical(ours, theirs)


def test_a_part_that_fails_is_tried_again_by_the_same_study(tmp_path):
    counted = Counted("one")
    study = counted.study(tmp_path)
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            study.part("one")
    counted.failing.clear()
    assert study.part("one")["x"].size == 50


def test_asked_by_many_at_once_it_is_computed_once(tmp_path):
    counted, together, found = Counted(), Barrier(8), []
    study = counted.study(tmp_path)

    def ask():
        together.wait()
        found.append(study.part("one"))

    threads = [Thread(target=ask) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert counted.calls == ["one"]
    assert len(found) == 8
    assert all(dataset is found[0] for dataset in found)


def damage_bytes(path):
    path.write_bytes(path.read_bytes()[:-200])


def damage_number(path):
    with h5py.File(path, "r+") as file:
        dataset = file["x"]
        assert isinstance(dataset, h5py.Dataset)
        dataset[3] = 7.0


@pytest.mark.parametrize("damage", [damage_bytes, damage_number, lambda path: path.write_text("not a result")])
def test_a_damaged_result_is_never_believed(tmp_path, damage):
    counted = Counted()
    whole = counted.study(tmp_path).part("one")
    damage(tmp_path / "results" / "one.nc")
    again = counted.study(tmp_path).part("one")
    assert counted.calls == ["one", "one"]
    xr.testing.assert_identical(whole, again)


KILLED = """
import sys
from pathlib import Path
from studies.remus100.run import run_paper
from studies.remus100.tests.studies import A, TINY
run_paper(Path(sys.argv[1]), A, TINY, ["figure-4", "table-3"])
"""


@pytest.mark.proof
def test_killed_in_the_middle_it_ends_with_the_same_bits(tmp_path):
    """Killed while the chain runs: the doublet's file stays as it is, the chain is sampled anew."""
    command = [sys.executable, "-c", KILLED]
    process = subprocess.Popen([*command, str(tmp_path / "killed")])
    doublet, chain = (tmp_path / "killed" / "results" / name for name in ("chosen-doublet.nc", "chain-3.nc"))
    deadline = time.monotonic() + 120
    while not doublet.exists():
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.002)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not chain.exists()
    written = doublet.stat().st_mtime_ns
    subprocess.run([*command, str(tmp_path / "killed")], check=True)
    run_paper(tmp_path / "straight", A, TINY, ["figure-4", "table-3"])
    assert doublet.stat().st_mtime_ns == written
    for name in ("chosen-doublet", "chain-3"):
        ours, theirs = (
            xr.load_dataset(tmp_path / folder / "results" / f"{name}.nc", engine="h5netcdf")
            .drop_vars("seconds", errors="ignore")
            .drop_attrs()
            for folder in ("killed", "straight")
        )
        xr.testing.assert_identical(ours, theirs)
