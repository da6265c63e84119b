"""A file that grows no further ends in an error, and leaves an interpreter that ends as it should."""

import subprocess
import sys

import pytest

pytest.importorskip("resource")

WRITES = """
import resource, signal, sys
from pathlib import Path
import numpy as np
import xarray as xr
from seatrial.core.dataset_file import write_dataset

signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000))
try:
    write_dataset(Path(sys.argv[1]), xr.Dataset({"a": ("x", np.random.default_rng(0).normal(size=10_000))}))
except OSError as error:
    print(error)
"""


def test_netcdf_on_a_full_disk(tmp_path):
    done = subprocess.run([sys.executable, "-c", WRITES, tmp_path / "a.nc"], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert "File too large" in done.stdout
    assert list(tmp_path.iterdir()) == []
