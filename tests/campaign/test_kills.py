"""Commands killed without warning, and run again: what they leave is the same to the last bit.

Killed are the default sampler and the repeats of the evidence; that a run of any sampler goes on with the same bits from
what was stored after each block is in tests/sampling/test_sampler.py.
"""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import xarray as xr

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.store.stored_result import Store
from seatrial.campaign.workflow.loop import run_loop
from tests.campaign.small import write_small


def command(name: str, folder: Path) -> list[str]:
    return [sys.executable, "-m", "seatrial", name, "--quiet", str(folder)]


def kill_in_the_midst(name: str, folder: Path, sign: str) -> None:
    """Start a command, and kill it when one of its checkpoints has appeared."""
    checkpoint = Store(folder).checkpoint(sign)
    process = subprocess.Popen(command(name, folder), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 300
    while not checkpoint.exists():
        assert process.poll() is None, "it ended before it could be killed"
        assert time.monotonic() < deadline
        time.sleep(0.001)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert checkpoint.exists(), "it had ended when it was killed"


def finish(name: str, folder: Path) -> None:
    subprocess.run(command(name, folder), check=True, stdout=subprocess.DEVNULL)


def assert_same_datasets(whole: Path, killed: Path, *names: str) -> None:
    ours, theirs = ({str(path.relative_to(base)): path for path in base.rglob("*.nc")} for base in (whole, killed))
    assert set(ours) == set(theirs) >= {f"results/{name}" for name in names}
    for name in ours:
        xr.testing.assert_identical(*(xr.load_dataset(paths[name], engine="h5netcdf") for paths in (ours, theirs)))
    assert not list(killed.rglob("*.npz"))


@pytest.mark.proof
def test_killed_in_the_chains_and_in_the_evidence_the_loop_ends_with_the_same_bits(tmp_path):
    whole, killed = write_small(tmp_path / "whole"), write_small(tmp_path / "killed")
    run_loop(load_campaign(whole))
    for sign in ("posterior-M-0", "evidence-M-0-smc-0"):
        kill_in_the_midst("run", killed, sign)
        assert not Store(killed).summary.exists()
    finish("run", killed)
    assert_same_datasets(whole, killed, "design.nc", "records/trial.nc", "posterior/M-0.nc", "next.nc")
    ours, theirs = (
        [json.loads(path.read_text()) for path in (Store(folder).selection, Store(folder).summary)]
        for folder in (whole, killed)
    )
    assert ours == theirs
