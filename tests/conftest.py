"""Settings of every test: hypothesis draws the same examples each time and keeps nothing on disk; files may lie anywhere."""

import gc

import pytest
from hypothesis import settings

from seatrial.core import engine

engine.configure()
gc.set_threshold(200_000, 20, 100)
"""JAX clears up at every collection of garbage: that was a seventh of the time of all tests."""
settings.register_profile("reproducible", derandomize=True, deadline=None, database=None)
settings.load_profile("reproducible")


@pytest.fixture
def programs():
    """How many programs are compiled or loaded while something is done, on all threads."""
    from seatrial.core.programs import counts

    def made_by(work, *args):
        before = sum(counts())
        work(*args)
        return sum(counts()) - before

    return made_by


@pytest.fixture(autouse=True)
def unlimited(monkeypatch):
    """Let no test see the folders to which a dashboard before it kept this process."""
    monkeypatch.setenv("SEATRIAL_WITHIN", "")
    monkeypatch.delenv("SEATRIAL_WITHIN")
