"""Warm processes: each command as if it alone were run, nothing compiled twice, and nothing lost however one ends."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
import xarray as xr

from seatrial.campaign.store.stored_result import Store
from seatrial.cli.campaign_lock import occupant_of
from seatrial.cli.running import Exit
from seatrial.dashboard.jobs import KEPT, Jobs, log_of
from seatrial.dashboard.session import Session, how_it_ended
from tests.campaign.small import NO_X_U, write_small

PARENT = """
import os, sys, time
from pathlib import Path
from seatrial.dashboard.session import Session
session = Session()
if sys.argv[2] == "works":
    session.start(["estimate", sys.argv[1]], Path(sys.argv[1]) / "log")
part = Path(sys.argv[3] + ".part")
part.write_text(str(session.process.pid))
os.replace(part, sys.argv[3])
time.sleep(120)
"""


def makes_programs(said):
    """Whether what JAX said tells of programs that were compiled or loaded."""
    return "Finished XLA compilation" in said or "Loaded program" in said


def until(true, seconds=120.0):
    deadline = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def everything(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_command_runs_as_if_alone_and_compiles_once(monkeypatch, tmp_path):
    folder = write_small(tmp_path / "boat", *NO_X_U)
    monkeypatch.setenv("JAX_LOG_COMPILES", "1")
    session = Session()
    log = tmp_path / "log"

    def design():
        Store(folder).design.unlink(missing_ok=True)
        log.unlink(missing_ok=True)
        session.start(["design", str(folder)], log)
        assert session.code(120) == Exit.OK
        return log.read_text(), xr.load_dataset(Store(folder).design)

    said, first = design()
    assert makes_programs(said)
    text = (folder / "campaign.toml").read_text()
    assert text.count('"1500 rpm"') == 1
    (folder / "campaign.toml").write_text(text.replace('"1500 rpm"', '"1350 rpm"'))
    said, limited = design()
    assert "best design" in said
    assert not limited.equals(first)
    (folder / "campaign.toml").write_text(text)
    said, again = design()
    assert not makes_programs(said)
    xr.testing.assert_equal(again, first)
    session.close()
    assert session.process.wait(20) == Exit.OK


def test_errors_end_a_command_and_an_interrupt_its_process_and_nothing_is_lost(tmp_path):
    folder, log = write_small(tmp_path / "boat", *NO_X_U), tmp_path / "log"
    session = Session()

    def run(*words):
        log.unlink(missing_ok=True)
        session.start(words, log)
        return session.code(120)

    assert run("next", str(folder), "--bogus") == Exit.BAD_INPUT
    assert "--bogus" in log.read_text()
    text = (folder / "campaign.toml").read_text()
    (folder / "campaign.toml").write_text("[campaign]\nname = 3\n")
    assert run("design", str(folder)) == Exit.BAD_INPUT
    assert "error:" in log.read_text()
    assert "Traceback" not in log.read_text()
    (folder / "campaign.toml").write_text(text)
    assert run("simulate", str(folder), "--quiet") == Exit.OK
    before = everything(folder)
    session.interrupt()  # nothing is at work: nothing happens
    session.start(["estimate", str(folder)], log)
    until(lambda: occupant_of(folder) is not None)
    session.interrupt()
    assert session.code(60) == Exit.INTERRUPTED
    assert "run the same command again to resume" in log.read_text()
    assert not session.is_usable
    assert occupant_of(folder) is None
    assert before.items() <= everything(folder).items()
    session.close()


def test_a_process_that_has_grown_ends_after_its_command(tmp_path):
    small = Session(memory=1)
    small.start(["vehicle"], tmp_path / "log")
    assert small.code(60) == Exit.OK
    assert not small.is_usable
    assert small.process.wait(20) == Exit.OK
    small.close()


def test_a_process_that_is_killed_is_told_and_replaced(tmp_path):
    folder = write_small(tmp_path)
    jobs = Jobs()
    jobs.start(folder, "prior")
    first = jobs.sessions[folder]
    first.kill()
    until(lambda: not jobs.look(folder).running)
    assert "ended without a message (SIGKILL)" in log_of(folder).read_text()
    jobs.start(folder, "design", "--bogus")
    assert jobs.sessions[folder] is not first
    until(lambda: not jobs.look(folder).running)
    assert "--bogus" in jobs.look(folder).output
    jobs.close()
    assert how_it_ended(Exit.INTERRUPTED) == how_it_ended(Exit.ALARMS) == ""


def test_each_campaign_has_its_own_process_and_few_wait(tmp_path, monkeypatch):
    made = []

    class Idle:
        is_usable, is_busy, is_closed = True, False, False

        def __init__(self):
            made.append(self)

        def close(self):
            self.is_closed = True

    monkeypatch.setattr("seatrial.dashboard.jobs.Session", Idle)
    jobs, folders = Jobs(), [tmp_path / name for name in "abc"]
    for folder in folders:
        jobs.session_of(folder)
    made[1].is_busy = True
    jobs.session_of(folders[0])
    assert [one.is_closed for one in made] == [True, False, False, False]
    assert list(jobs.sessions) == [*folders[1:], folders[0]]
    assert len(jobs.sessions) == KEPT + 1


def test_a_process_without_work_ends_with_the_one_that_started_it(tmp_path):
    command = [sys.executable, "-c", PARENT, str(tmp_path), "idle", str(tmp_path / "child")]
    parent = subprocess.Popen(command)
    until((tmp_path / "child").exists)
    child = int((tmp_path / "child").read_text())
    parent.kill()
    parent.wait()
    until(lambda: not os.path.exists(f"/proc/{child}"), 30)


@pytest.mark.proof
def test_a_command_at_work_outlives_the_process_that_started_it(tmp_path):
    folder = write_small(tmp_path / "boat", *NO_X_U)
    command = [sys.executable, "-c", PARENT, str(folder), "works", str(tmp_path / "child")]
    parent = subprocess.Popen(command)
    until(lambda: occupant_of(folder) is not None)
    child = int((tmp_path / "child").read_text())
    parent.kill()
    parent.wait()
    until(lambda: not os.path.exists(f"/proc/{child}"), 120)
    assert "sigma_u" in (folder / "log").read_text()
    assert Store(folder).posterior("M-0").is_file()
