import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pandas
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
        _ = seatrial.CoefficientNam  # pyright: ignore[reportAttributeAccessIssue]


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


@pytest.mark.proof
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


def python_of(version):
    """Return an interpreter of a version; without one the test is skipped."""
    code = "import sys; print('%d.%d' % sys.version_info[:2])"
    kept = sorted((Path.home() / ".pyenv" / "versions").glob(f"{version}.*/bin/python3"))
    for place in filter(None, (shutil.which(f"python{version}"), *kept)):
        if subprocess.run([place, "-c", code], capture_output=True, text=True).stdout.strip() == version:
            return place
    pytest.skip(f"there is no Python {version} here: no python{version} on PATH, nor under ~/.pyenv/versions")


@pytest.fixture(scope="module")
def coefficients_here(tmp_path_factory):
    """The demonstration as the Python of these tests runs it."""
    folder = tmp_path_factory.mktemp("demo") / "remus100"
    for command in ("init", "run"):
        words, plain = [sys.executable, "-m", "seatrial", command, folder], {**os.environ, "XLA_FLAGS": ""}
        subprocess.run(words, check=True, capture_output=True, env=plain)
    return pandas.read_csv(folder / "results" / "coefficients.csv")


@pytest.mark.proof
@pytest.mark.parametrize("version", ["3.12", "3.13"])
def test_other_pythons_run_the_demonstration_and_the_quick_tests(version, clone, coefficients_here):
    """In an environment of the locked packages, which make sets up as it does for a user: with a later JAX, and the numbers of this one."""
    outer = ("PYTHONPATH", "VIRTUAL_ENV", "MAKEFLAGS", "MFLAGS", "MAKELEVEL")
    environment = {name: value for name, value in os.environ.items() if name not in outer} | {"XLA_FLAGS": ""}
    demo = f"outputs/demo-{version}"
    chosen = [f"PYTHON={python_of(version)}", f"VENV=.venv-{version}", f"DEMO={demo}"]
    for target in ("run", "quick"):
        done = subprocess.run(["make", *chosen, target], cwd=clone, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, (done.stdout + done.stderr)[-3000:]
    theirs = pandas.read_csv(clone / demo / "results" / "coefficients.csv")
    columns = ["structure", "name", "unit", "mean", "sd", "probability"]
    pandas.testing.assert_frame_equal(theirs[columns], coefficients_here[columns], rtol=1e-5)
