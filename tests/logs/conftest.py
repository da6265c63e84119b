"""Logs are read in this process: a process for each of thousands of small files would take minutes."""

import pytest

from seatrial.core import processes as apart


@pytest.fixture(autouse=True)
def in_this_process(monkeypatch):
    monkeypatch.setattr(apart, "_is_apart", True)
