"""One process on a campaign at a time: the second is told, a killed one leaves nothing locked, progress is there to be read."""

import os
import signal
import subprocess
import sys
import time

import pytest

from seatrial.cli.campaign_lock import FILE_NAME, occupant_of, occupying, release_all
from seatrial.cli.console import ConsoleReporter
from seatrial.core.errors import InputError
from seatrial.dashboard.jobs import Jobs, log_of

HOLD = """
import sys, time
from pathlib import Path
from seatrial.cli.campaign_lock import occupying
with occupying(Path(sys.argv[1])) as held:
    told = held.progress("estimate M-0")
    told(25, 100)
    held.noted = 0.0
    told(50, 100)
    print("held", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def other(tmp_path):
    """A process that holds a campaign."""
    process = subprocess.Popen([sys.executable, "-c", HOLD, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    yield process
    process.kill()
    process.wait()


def test_a_second_process_is_told_who_is_first(tmp_path, other):
    with pytest.raises(InputError, match=f"process {other.pid} on"), occupying(tmp_path):
        pass
    there = occupant_of(tmp_path)
    assert there is not None
    assert there.alive
    assert there.pid == other.pid
    assert there.work[0]["title"] == "estimate M-0"
    assert (there.work[0]["done"], there.work[0]["total"]) == (50, 100)


def test_a_killed_process_leaves_its_name_and_no_lock(tmp_path, other):
    other.kill()
    other.wait()
    there = occupant_of(tmp_path)
    assert there is not None
    assert not there.alive
    assert Jobs().look(tmp_path).killed
    with occupying(tmp_path):
        assert occupant_of(tmp_path).pid == os.getpid()
    assert list(tmp_path.iterdir()) == []


def test_it_is_released_when_the_work_ends_or_fails(tmp_path):
    with pytest.raises(ZeroDivisionError), occupying(tmp_path):
        raise ZeroDivisionError
    assert occupant_of(tmp_path) is None
    context = occupying(tmp_path)
    context.__enter__()
    release_all()
    assert list(tmp_path.iterdir()) == []


def test_looking_at_it_does_not_keep_anyone_out(tmp_path):
    """Many looks while others come and go: a look locks the file for an instant."""
    looking = subprocess.Popen(
        [
            sys.executable,
            "-c",
            "import sys; from pathlib import Path; from seatrial.cli.campaign_lock import occupant_of\nprint('on', flush=True)\n"
            "while True: occupant_of(Path(sys.argv[1]))",
            str(tmp_path),
        ],
        stdout=subprocess.PIPE,
    )
    assert looking.stdout is not None
    looking.stdout.readline()
    try:
        for _ in range(200):
            with occupying(tmp_path) as held:
                assert held is not None
    finally:
        looking.kill()
        looking.wait()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_cannot_be_written_is_no_obstacle(tmp_path):
    tmp_path.chmod(0o500)
    with occupying(tmp_path) as held:
        assert held is None


def test_a_full_disk_costs_the_progress_only(tmp_path, monkeypatch):
    with occupying(tmp_path) as held, open("/dev/full", "wb", buffering=0) as full:
        monkeypatch.setattr(held, "notes", full)
        held.noted = 0.0
        held.progress("x")(1, 2)
        monkeypatch.undo()


def test_a_damaged_file_is_no_reason_to_fail(tmp_path):
    for content in (b"", b"{", b"[]", b"{}", b'{"pid": 1}'):
        (tmp_path / FILE_NAME).write_bytes(content)
        there = occupant_of(tmp_path)
        assert there is not None
        assert not there.alive


def test_piped_progress_tells_the_time_left_now_and_then(monkeypatch):
    said, clock = [], [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: clock[0])
    reporter = ConsoleReporter()
    monkeypatch.setattr(reporter, "say", said.append)
    told = []
    reporter.also = lambda title: lambda done, total, seconds: told.append((title, done, total))
    report = reporter.progress("estimate M-1")
    for second in range(0, 41):
        clock[0] = float(second)
        report(second, 40)
    assert said == [
        "estimate M-1: 25% after 10 s, about 30 s remaining",
        "estimate M-1: 50% after 20 s, about 20 s remaining",
        "estimate M-1: 75% after 30 s, about 10 s remaining",
        "estimate M-1: done in 40.0 s",
    ]
    assert told[-1] == ("estimate M-1", 40, 40)


def test_jobs_refuse_what_is_no_command_and_what_would_be_second(tmp_path, other):
    jobs = Jobs()
    with pytest.raises(InputError, match="no such command"):
        jobs.start(tmp_path, "rm")
    with pytest.raises(InputError, match="another command at work"):
        jobs.start(tmp_path, "run")
    assert not log_of(tmp_path).exists()


def test_stopping_interrupts_whoever_is_at_work(tmp_path, other):
    Jobs().stop(tmp_path)
    assert other.wait(20) == -signal.SIGINT or other.returncode == 1
    with pytest.raises(InputError, match="nothing at work"):
        Jobs().stop(tmp_path)
