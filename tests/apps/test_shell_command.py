"""`seatrial shell`: the commands of the command line, a line each, in one process that stays."""

import os
import pty
import select
import signal
import subprocess
import sys
import time

import pytest

from seatrial.apps.campaign_lock import occupant_of
from seatrial.apps.commands.shell import _completion, _filled_in, _words
from seatrial.apps.running import Exit
from tests.campaign.small import NO_X_U, write_small

PIPED = """
# begins with nothing
init --template design

estimat
prior 'unfinished
serve
help next
vehicle
quit
next
"""


def shell(folder, lines, **settings):
    command = [sys.executable, "-m", "seatrial", "shell", str(folder)]
    return subprocess.run(command, input=lines, capture_output=True, text=True, timeout=120, **settings)


def test_piped_lines_are_run_one_after_another_whatever_fails(tmp_path):
    done = shell(tmp_path / "boat", PIPED)
    assert done.returncode == Exit.BAD_INPUT
    first, *others = done.stdout.splitlines()
    assert first.startswith(f"wrote {tmp_path}/boat/campaign.toml")
    assert any(line.startswith("Usage: seatrial next") for line in others)
    assert others[-1].startswith("remus100_surge")  # and nothing after `quit`
    assert "Did you mean 'estimate'" in done.stderr
    assert "no closing quotation" in done.stderr
    assert "serve runs until it is stopped" in done.stderr
    assert "Traceback" not in done.stderr
    assert shell(tmp_path / "boat", "help\n").returncode == Exit.OK


def test_the_folder_is_filled_in_where_a_command_takes_one(tmp_path):
    filled = {line: _filled_in(_words(line), tmp_path) for line in ("estimate --by mode", "export --to gz", "vehicle")}
    assert filled["estimate --by mode"] == ["estimate", str(tmp_path), "--by", "mode"]
    assert filled["export --to gz"] == ["export", str(tmp_path), "--to", "gz"]
    assert filled["vehicle"] == ["vehicle"]
    assert _filled_in(["inspect", "a log.csv"], tmp_path) == ["inspect", "a log.csv"]
    assert _filled_in(["help", "run"], tmp_path) == ["run", "--help"]
    assert _words("simulate --label 'a b'  # again") == ["simulate", "--label", "a b"]
    assert [_completion("re", number) for number in range(3)] == ["rehearse ", "report ", None]


class Terminal:
    """A session at a terminal."""

    def __init__(self, folder, home):
        self.ours, theirs = pty.openpty()
        settings = {**os.environ, "XDG_CACHE_HOME": str(home), "TERM": "dumb"}
        command = [sys.executable, "-m", "seatrial", "shell", str(folder), "--cold"]
        self.process = subprocess.Popen(
            command, stdin=theirs, stdout=theirs, stderr=theirs, env=settings, start_new_session=True
        )
        os.close(theirs)
        self.said = ""

    def until(self, words, seconds=60.0):
        deadline = time.monotonic() + seconds
        while words not in self.said:
            assert time.monotonic() < deadline, self.said
            if select.select([self.ours], [], [], 0.2)[0]:
                self.said += os.read(self.ours, 4096).decode(errors="replace")
        self.said = self.said.partition(words)[2]

    def type(self, text):
        os.write(self.ours, text.encode())


@pytest.mark.proof
def test_ctrl_c_ends_the_command_and_not_the_session(tmp_path):
    folder = write_small(tmp_path / "boat", *NO_X_U)
    terminal = Terminal(folder, tmp_path / "home")
    terminal.until("boat> ")
    time.sleep(1.0)  # until it waits for a key
    terminal.type("desi")
    terminal.until("desi")
    time.sleep(1.0)
    terminal.process.send_signal(signal.SIGINT)
    terminal.until("boat> ")
    terminal.type("estimate\n")
    deadline = time.monotonic() + 60
    while occupant_of(folder) is None:
        assert time.monotonic() < deadline
        time.sleep(0.05)
    terminal.process.send_signal(signal.SIGINT)
    terminal.until("interrupted; run the same command again to resume")
    terminal.until("boat> ")
    terminal.type("vehicle\n")
    terminal.until("remus100_surge")
    terminal.until("boat> ")
    terminal.type("exit\n")
    assert terminal.process.wait(20) == Exit.OK
    remembered = (tmp_path / "home" / "seatrial" / "history").read_text()
    assert remembered.split() == ["estimate", "vehicle", "exit"]
    assert list((folder / "results").rglob("*.part")) == []
