"""Files of a campaign that are damaged on disk: what can be made again is, and said; what was decided by hand is asked for."""

import pickle
import shutil

import h5py
import numpy as np
import pytest
import xarray as xr

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.data.simulate import Chosen, add_trial, later_trials
from seatrial.campaign.store.stored_result import (
    Store,
    is_current,
    load_checkpoint,
    read_json,
    save_checkpoint,
    stamp_of,
    write_dataset,
    write_stamped_json,
)
from seatrial.core.dataset_file import open_dataset, stored
from seatrial.core.errors import InputError
from tests.campaign.small import write_small

ARRAYS = {"z": np.arange(600.0).reshape(30, 20), "iteration": np.array(7), "names": np.array(["X_u", "T_nabsn"])}
DATA = xr.Dataset(
    {"draws": (("draw", "parameter"), np.arange(400.0).reshape(200, 2))}, {"parameter": ["X_u", "T_nabsn"]}
)
DAMAGE = {
    "emptied": lambda path: path.write_bytes(b""),
    "cut in half": lambda path: path.write_bytes(path.read_bytes()[: path.stat().st_size // 2]),
    "its end cut off": lambda path: path.write_bytes(path.read_bytes()[:-3]),
    "zeroed": lambda path: path.write_bytes(bytes(path.stat().st_size)),
    "another file": lambda path: path.write_text('{"key": "k"}'),
    "nested without end": lambda path: path.write_text("[" * 100_000),
    "no text": lambda path: path.write_bytes(b"\xff\xfe\x00"),
    "pickled": lambda path: path.write_bytes(pickle.dumps(ARRAYS)),
    "a folder": lambda path: (path.unlink(), path.mkdir()),
}


def write(path, key="k"):
    if path.suffix == ".npz":
        save_checkpoint(path, key, ARRAYS)
    elif path.suffix == ".json":
        write_stamped_json(path, {"terms": ["X_u"], "value": 1.5}, key)
    else:
        write_dataset(path, DATA, key)
    return path


def usable(path):
    return load_checkpoint(path, "k") is not None if path.suffix == ".npz" else is_current(path, "k")


@pytest.mark.parametrize("kind", ["npz", "json", "nc"])
@pytest.mark.parametrize("name", DAMAGE)
def test_what_is_damaged_is_kept_aside_and_made_again(tmp_path, caplog, kind, name):
    path = write(tmp_path / f"result.{kind}")
    assert usable(path)
    for number in ("", "1"):
        DAMAGE[name](path)
        assert not usable(path)
        assert not path.exists()
        assert (tmp_path / f"result.{kind}.damaged{number}").exists()
        said = caplog.records[-1].getMessage()
        assert f"{path} is damaged (" in said
        assert f"kept as result.{kind}.damaged{number}, and made again when needed" in said
        assert usable(write(path))


@pytest.mark.parametrize("kind", ["npz", "json", "nc"])
def test_no_bit_is_believed_that_was_not_written(tmp_path, kind):
    path = write(tmp_path / f"result.{kind}")
    whole, rng = path.read_bytes(), np.random.default_rng(0)
    for at in rng.integers(len(whole), size=150):
        damaged = bytearray(whole)
        damaged[at] ^= 1 << int(rng.integers(8))
        path.write_bytes(damaged)
        if kind == "npz":  # a zip archive has fields that nobody reads
            content = load_checkpoint(path, "k")
            assert content is None or all(np.array_equal(content[name], ARRAYS[name]) for name in ARRAYS)
        else:
            assert not is_current(path, "k")
        path.unlink(missing_ok=True)


def test_wrong_bits_never_reach_the_library(tmp_path, monkeypatch):
    """It may walk in circles in them for ever."""
    path = write(tmp_path / "result.nc")
    damaged = bytearray(path.read_bytes())
    damaged[len(damaged) // 3] ^= 4
    path.write_bytes(damaged)
    monkeypatch.setattr(h5py, "File", lambda *about: pytest.fail("opened"))
    for read in (open_dataset, lambda path: stored(path).__enter__()):
        with pytest.raises(InputError, match="content that does not match its hash"):
            read(path)


def test_what_another_tool_wrote_again_is_believed_by_its_content(tmp_path):
    path = write(tmp_path / "result.nc")
    for factor, believed in ((1.0, True), (2.0, False)):
        again = xr.load_dataset(path, engine="h5netcdf")
        again["draws"] = again["draws"] * factor
        again.to_netcdf(path, engine="h5netcdf")
        assert is_current(path, "k") is believed


def test_only_the_header_is_read_for_a_stamp(tmp_path, monkeypatch):
    path = write(tmp_path / "result.nc")
    monkeypatch.setattr("xarray.load_dataset", lambda *about, **options: pytest.fail("opened"))
    assert stamp_of(path) == "k"
    assert is_current(path, "k")


def test_asking_for_a_stamp_moves_nothing(tmp_path):
    path = write(tmp_path / "result.nc")
    path.write_bytes(b"")
    assert stamp_of(path) is None
    assert [one.name for one in tmp_path.iterdir()] == ["result.nc"]


def test_what_belongs_to_other_work_stays(tmp_path, caplog):
    for kind in ("npz", "json", "nc"):
        path = write(tmp_path / f"result.{kind}", key="other")
        assert not usable(path)
        assert path.is_file()
    assert not caplog.records


def test_a_result_that_is_read_for_itself_says_what_to_do(tmp_path):
    path = write(tmp_path / "summary.json")
    path.write_text("[" * 100_000)
    with pytest.raises(InputError, match="delete it and run `seatrial run` again"):
        read_json(path, "seatrial run")
    path.unlink()
    path.mkdir()
    with pytest.raises(InputError, match=r"(?s)a folder.*move it away and run `seatrial run` again"):
        read_json(path, "seatrial run")


def test_decided_trials_are_not_forgotten_in_silence(tmp_path):
    campaign = load_campaign(write_small(tmp_path))
    add_trial(campaign, Chosen("repeated-doublet", 10.0, 5.0))
    assert len(later_trials(campaign)) == 1
    path = Store(tmp_path).sequence
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(InputError, match=r"(?s)sequence\.json.*delete it and run `seatrial next") as caught:
        later_trials(campaign)
    assert caught.value.found.startswith("damaged JSON")
    assert path.is_file()


def test_a_damaged_record_is_simulated_again_bit_by_bit(tmp_path, caplog):
    campaign = load_campaign(write_small(tmp_path))
    before = get_trials(campaign).fit[0]
    store = Store(tmp_path)
    for path in (store.design, store.record(before.label)):
        path.write_bytes(path.read_bytes()[:-1000])
    again = get_trials(campaign).fit[0]
    np.testing.assert_array_equal(again.measurement, before.measurement)
    assert sum("is damaged" in one.getMessage() for one in caplog.records) == 2
    shutil.rmtree(store.results)


def test_a_checkpoint_that_swells_is_not_unpacked(tmp_path, caplog):
    path = tmp_path / "a.npz"
    np.savez_compressed(path, key=np.array("k"), z=np.zeros(1 << 20))
    assert load_checkpoint(path, "k") is None
    assert "compressed" in caplog.text
