"""Settings of every test: hypothesis draws the same examples each time and keeps nothing on disk; files may lie anywhere."""

import pytest
from hypothesis import settings

from seatrial.core import engine

engine.configure()
settings.register_profile("reproducible", derandomize=True, deadline=None, database=None)
settings.load_profile("reproducible")


@pytest.fixture
def programs(caplog):
    """What JAX says of each program that is compiled or loaded while something is done."""
    import jax

    def made_by(work, *args):
        caplog.clear()
        with jax.log_compiles():
            work(*args)
        said = [one.getMessage() for one in caplog.records]
        return [text for text in said if text.startswith(("Finished XLA compilation of ", "Loaded program "))]

    return made_by


@pytest.fixture(autouse=True)
def unlimited(monkeypatch):
    """Let no test see the folders to which a dashboard before it kept this process."""
    monkeypatch.setenv("SEATRIAL_WITHIN", "")
    monkeypatch.delenv("SEATRIAL_WITHIN")
