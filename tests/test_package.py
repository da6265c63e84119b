import re
import subprocess
import sys
from pathlib import Path

import pytest

import seatrial


def test_import_loads_neither_jax_nor_pandas():
    code = "import sys, seatrial; print([name for name in ('jax', 'pandas', 'xarray', 'pint') if name in sys.modules])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


@pytest.mark.parametrize("name", seatrial.__all__)
def test_public_names_resolve(name):
    assert getattr(seatrial, name) is not None


def test_unknown_attribute():
    with pytest.raises(AttributeError, match="no attribute 'CoefficientNam'"):
        _ = seatrial.CoefficientNam


def test_every_locked_dependency_has_hashes_and_no_address():
    lock = (Path(__file__).parents[1] / "requirements.lock").read_text()
    blocks = re.split(r"\n(?=\S)", lock.strip())
    assert len(blocks) > 100
    for block in blocks:
        first, *hashes = block.replace("\\\n", "\n").splitlines()
        assert re.fullmatch(r"[a-z0-9-]+==[^\s;]+( ; .+)?", first.strip()), first
        assert hashes, first
        assert all(re.fullmatch(r"\s+--hash=sha256:[0-9a-f]{64}\s*", one) for one in hashes), first
    assert len(lock) < 1 << 20


def test_the_environment_is_set_up_by_hashes():
    makefile = (Path(__file__).parents[1] / "Makefile").read_text()
    assert "--require-hashes --requirement requirements.lock" in makefile
    assert "--generate-hashes" in makefile


def test_extras_are_imported_where_they_are_used():
    """Every module imports without the extras, but for the dashboard's and the cluster's own."""
    code = """
import importlib, pkgutil, sys
for name in ("rosbags", "pymavlink", "pyarrow", "nicegui", "starlette", "distributed", "dask_jobqueue"):
    sys.modules[name] = None
import seatrial
for module in pkgutil.walk_packages(seatrial.__path__, "seatrial."):
    if not module.name.endswith(("__main__", "mavlink_script", "dask_workers")) and ".dashboard" not in module.name:
        importlib.import_module(module.name)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-1500:]
