"""Settings of every test: hypothesis draws the same examples each time and keeps nothing on disk; files may lie anywhere."""

import gc
import shutil
import subprocess
from pathlib import Path

import pytest
from hypothesis import settings

from seatrial.compiled import engine
from seatrial.core import processes

engine.configure()
gc.set_threshold(200_000, 20, 100)
"""JAX clears up at every collection of garbage: that was a seventh of the time of all tests."""
settings.register_profile("reproducible", derandomize=True, deadline=None, database=None)
settings.load_profile("reproducible")


@pytest.fixture
def programs():
    """How many programs are compiled or loaded while something is done, on all threads."""
    from seatrial.compiled.programs import counts

    def made_by(work, *args):
        before = sum(counts())
        work(*args)
        return sum(counts()) - before

    return made_by


@pytest.fixture(scope="session")
def clone(tmp_path_factory):
    """A copy of what git has of the repository: without a build, an environment or outputs."""
    root, folder = Path(__file__).parents[1], tmp_path_factory.mktemp("clone") / "seatrial"
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=root, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip("this is no clone of the repository")
    for name in filter(None, listed.stdout.split("\0")):
        if (root / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(root / name, folder / name)
    return folder


@pytest.fixture(autouse=True)
def unlimited(monkeypatch):
    """Let no test see the folders to which a dashboard before it kept this process."""
    monkeypatch.setenv("SEATRIAL_WITHIN", "")
    monkeypatch.delenv("SEATRIAL_WITHIN")


@pytest.fixture(autouse=True)
def in_this_process(monkeypatch):
    """Read logs in this process: the start of another one for each of thousands of small files would take minutes."""
    monkeypatch.setattr(processes, "_is_apart", True)


@pytest.fixture
def in_others(in_this_process, monkeypatch):
    """Read logs as a command does, each in a process of its own."""
    monkeypatch.setattr(processes, "_is_apart", False)
