"""The dashboard, and whatever it starts, reads what campaign files name below the folders that are served, and nowhere else."""

import asyncio
import logging
import os

import pytest

from seatrial.core.errors import InputError

pytest.importorskip("nicegui", reason="the dashboard needs NiceGUI: pip install -e '.[dashboard]'")

import uvicorn

from seatrial.campaign.config.named_files import VARIABLE, keep_within
from seatrial.dashboard.jobs import Jobs
from seatrial.dashboard.server import serve
from seatrial.dashboard.worker_pool import WorkerPool
from tests.campaign.small import LOGGED, write_small
from tests.campaign.test_named_files import FILE


def test_the_server_keeps_all_it_starts_to_what_it_serves(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv(VARIABLE, "/")
    (tmp_path / "served").mkdir()
    (tmp_path / "records").mkdir()
    kept = []
    monkeypatch.setattr(uvicorn.Server, "run", lambda *_, **__: kept.append(os.environ[VARIABLE]))
    serve(tmp_path / "served", "127.0.0.1", 0, None, browser=False)
    serve(tmp_path / "served", "127.0.0.1", 0, None, browser=False, also=[tmp_path / "records"])
    assert kept == [f"{tmp_path}/served", f"{tmp_path}/served\n{tmp_path}/records"]
    assert f"read only files below {tmp_path}/served and {tmp_path}/records" in capsys.readouterr().out


def test_the_server_leaves_the_loggers_of_others_alone(tmp_path, monkeypatch):
    monkeypatch.setenv(VARIABLE, "/")
    monkeypatch.setattr(uvicorn.Server, "run", lambda *_, **__: None)
    monkeypatch.setattr(logging.Handler, "close", lambda handler: closed.append(handler))
    closed, foreign = [], logging.StreamHandler()
    serve(tmp_path, "127.0.0.1", 0, None, browser=False)
    assert foreign not in closed


@pytest.mark.proof
def test_neither_a_page_nor_a_command_reads_a_curve_outside(tmp_path, monkeypatch):
    monkeypatch.setenv(VARIABLE, "")
    (tmp_path / "secret.txt").write_text("the secret\n1,2\n3,4\n")
    folder = tmp_path / "boat"
    folder.mkdir()
    (folder / "log.csv").write_text("t,pwm,u\n0,1,1\n1,2,1\n2,3,1\n")
    write_small(folder, (LOGGED[0], FILE.format(path="log.csv", curve="../secret.txt")))
    keep_within([folder])

    async def shown():
        worker_pool = WorkerPool()
        try:
            await worker_pool.think("whole_log", str(folder), "a", ())
        finally:
            worker_pool.close()

    with pytest.raises(InputError, match="which lies outside"):
        asyncio.run(shown())
    jobs = Jobs()
    jobs.start(folder, "import")
    jobs.sessions[folder].code(120)
    output = jobs.look(folder).output
    assert "which lies outside" in output
    assert "the secret" not in output
    jobs.close()
