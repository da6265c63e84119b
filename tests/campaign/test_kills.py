"""Commands killed without warning while each sampler runs, and run again: what they leave is the same to the last bit."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from seatrial.campaign.store import Store
from seatrial.sampling.sampler import SAMPLERS
from tests.campaign.small import write_small

ALONE = ('always = ["X_uabsu", "T_nabsn"]\noptional = ["X_u"]', 'always = ["X_uabsu", "T_nabsn", "X_u"]')
SIZES = {"nuts": "chains = 4\nwarmup = 500\ndraws = 1500"}
USUAL = "chains = 8\nwarmup = 500\ndraws = 6000"
COMMANDS = [
    *(("estimate", name, "checkpoints/posterior-M-0.npz") for name in SAMPLERS),
    ("select", "select", "checkpoints/evidence-M-0-0.npz"),
]
"""Command, its campaign's folder, and what is there when it is in the midst of its work."""
ALL_OF_THEM = """
import sys
from seatrial.apps.cli import main
for line in sys.argv[1:]:
    sys.argv = ["seatrial", *line.split("|")]
    try:
        main()
    except SystemExit as ended:
        if ended.code not in (None, 0, 3):
            raise
"""
"""One process for several commands, since starting one takes longer than the commands do."""


def write_campaigns(folder: Path) -> Path:
    """One small campaign of a single structure for each command."""
    for command, name, _ in COMMANDS:
        sampler = name if command == "estimate" else "adaptive-metropolis"
        size = f'sampler = "{sampler}"\n{SIZES.get(sampler, USUAL)}'
        write_small(
            folder / name,
            ALONE,
            ('sample_time = "0.1 s"', 'sample_time = "0.25 s"'),
            ("chains = 16\nwarmup = 500\ndraws = 1000", size),
            ("particles = 256\nrepeats = 2", "particles = 256\nrepeats = 3"),
        )
    return folder


def start(folder: Path, caches: Path) -> subprocess.Popen:
    lines = ["|".join([command, str(folder / name), "-q"]) for command, name, _ in COMMANDS]
    return subprocess.Popen(
        [sys.executable, "-c", ALL_OF_THEM, *lines],
        env={**os.environ, "XDG_CACHE_HOME": str(caches)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )


def finish(process: subprocess.Popen) -> None:
    said = process.communicate(timeout=600)[1].decode()
    assert process.returncode == 0, said


def kill_in_the_midst(folder: Path, caches: Path, name: str, sign: str, after: float) -> None:
    """Start the commands, and kill them a moment after a checkpoint of one of them has appeared."""
    process, deadline = start(folder, caches), time.monotonic() + 300
    while not (folder / name / "results" / sign).exists():
        assert process.poll() is None, f"{name} ended before it could be killed"
        assert time.monotonic() < deadline
        time.sleep(0.001)
    time.sleep(after)
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()


def datasets(folder: Path) -> dict[str, xr.Dataset]:
    paths = folder.rglob("*.nc")
    return {str(path.relative_to(folder)): xr.load_dataset(path, engine="h5netcdf") for path in paths}


@pytest.mark.thorough
def test_killed_in_every_sampler_it_ends_with_the_same_bits(tmp_path):
    whole, killed, caches = (
        write_campaigns(tmp_path / "whole"),
        write_campaigns(tmp_path / "killed"),
        tmp_path / "caches",
    )
    finish(start(whole, caches))
    delays = np.random.default_rng(11).uniform(0.0, 0.03, len(COMMANDS))
    for (_, name, sign), after in zip(COMMANDS, delays, strict=True):
        kill_in_the_midst(killed, caches, name, sign, after)
        stopped = (killed / name / "results" / sign).exists()
        assert stopped, f"{name} had ended when it was killed"
    finish(start(killed, caches))
    ours, theirs = datasets(whole), datasets(killed)
    assert set(ours) == set(theirs)
    assert {f"{name}/results/posterior/M-0.nc" for name in SAMPLERS} <= set(ours)
    for path in ours:
        xr.testing.assert_identical(ours[path], theirs[path])
    selections = [json.loads(Store(folder / "select").selection.read_text()) for folder in (whole, killed)]
    assert selections[0] == selections[1]
    assert not list(killed.rglob("*.npz"))
