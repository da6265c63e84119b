"""Settings of every test: hypothesis draws the same examples each time and keeps nothing on disk; files may lie anywhere."""

import pytest
from hypothesis import settings

from seatrial.core import engine

engine.configure()
settings.register_profile("reproducible", derandomize=True, deadline=None, database=None)
settings.load_profile("reproducible")


@pytest.fixture(autouse=True)
def unlimited(monkeypatch):
    """Let no test see the folders to which a dashboard before it kept this process."""
    monkeypatch.setenv("SEATRIAL_WITHIN", "")
    monkeypatch.delenv("SEATRIAL_WITHIN")
