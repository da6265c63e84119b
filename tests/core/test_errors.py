"""Errors that travel between processes, and errors of the file system in the user's words."""

import errno
import os
import pickle
import re
import tomllib
from pathlib import Path

import pytest

import seatrial
from seatrial.core.errors import InputError, NumericalError, file_error, install_extra, located
from seatrial.core.files import write_text

ROOT = Path(__file__).parents[2]


def test_an_input_error_as_one_sentence():
    error = InputError("campaign.toml:3", found='"5 cm"', expected="a number", remedy="write 0.05")
    assert error.sentence() == '"5 cm"; expected a number; write 0.05'
    assert error.sentence(with_remedy=False) == '"5 cm"; expected a number'


def test_an_input_error_travels_whole():
    error = InputError("a.toml", found="b", expected="c", remedy="d")
    there = pickle.loads(pickle.dumps(error))
    assert type(there) is InputError
    assert str(there) == str(error)
    assert (there.where, there.found, there.expected, there.remedy) == ("a.toml", "b", "c", "d")
    assert str(pickle.loads(pickle.dumps(NumericalError("diverged")))) == "diverged"


def test_an_extra_is_installed_from_the_checkout_or_the_wheel():
    """Each extra that a message names is one of the package, and the wheel has the name that `make dist` gives it."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    sources = "\n".join(path.read_text() for path in (ROOT / "src").rglob("*.py"))
    assert set(re.findall(r"""(?:install|needing)_extra\(["'](\w+)["']""", sources)) <= set(extras)
    wheel = f"dist/seatrial-{seatrial.__version__}-py3-none-any.whl[ros]"
    assert install_extra("ros") == f'in the checkout, pip install -e ".[ros]"; or with the wheel, pip install "{wheel}"'


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.EROFS, "to your folder"),
        (errno.EACCES, "to your folder"),
        (errno.ENOSPC, "free some space"),
        (errno.ENOENT, "moved or deleted"),
        (errno.ENOTDIR, "move it away"),
        (errno.EIO, "permissions"),
    ],
)
def test_a_remedy_for_each_trouble_of_the_file_system(number, words):
    error = file_error(OSError(number, os.strerror(number), "/x/design.nc"))
    assert error.where == "/x/design.nc"
    assert error.found == os.strerror(number)
    assert words in error.remedy
    assert file_error(OSError("odd")).found == "odd"


def test_the_file_is_named_and_not_the_temporary_one(tmp_path):
    (tmp_path / "results").write_text("a file where a folder should be")
    with pytest.raises(OSError, match="results"):
        write_text(tmp_path / "results" / "design.json", "x")
    if os.geteuid() == 0:
        pytest.skip("root may write anywhere")
    (tmp_path / "kept").mkdir(mode=0o500)
    with pytest.raises(PermissionError) as refused:
        write_text(tmp_path / "kept" / "design.json", "x")
    assert refused.value.filename == str(tmp_path / "kept" / "design.json")


@pytest.mark.parametrize(
    ("inner", "where"),
    [
        ("trial.toml:13, key vehicle.mass", "trial.toml:13, key vehicle.mass"),
        ("log.csv, row 3", "trial.toml:11, key vehicle: log.csv, row 3"),
        ("inertia", "trial.toml:11, key vehicle: inertia"),
    ],
)
def test_a_place_in_the_same_file_stands_alone(inner, where):
    with pytest.raises(InputError) as caught, located("trial.toml:11, key vehicle"):
        raise InputError(inner, found="nothing", expected="more", remedy="add it")
    assert caught.value.where == where
