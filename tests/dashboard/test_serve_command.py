"""`seatrial serve` before it serves: what it needs, and what it refuses."""

import socket
import subprocess
import sys

import pytest

from seatrial.cli.running import Exit
from tests.cli.test_cli import run

WITHOUT = """
import sys
sys.modules.update(dict.fromkeys(("nicegui", "uvicorn", "fastapi", "starlette")))
from seatrial.__main__ import main
main()
"""


def test_without_its_extra_it_says_how_to_get_it(tmp_path):
    done = subprocess.run([sys.executable, "-c", WITHOUT, "serve", tmp_path], capture_output=True, text=True)
    assert done.returncode == Exit.BAD_INPUT
    assert 'pip install -e ".[dashboard]"' in done.stderr
    assert "Traceback" not in done.stderr


def test_a_weak_token_is_refused(monkeypatch, capsys, tmp_path):
    code, _, err = run(monkeypatch, capsys, "serve", tmp_path, "--host", "0.0.0.0", "--token", "password")
    assert code == Exit.BAD_INPUT
    assert "16 plain characters" in err


def test_no_folder_and_no_port(monkeypatch, capsys, tmp_path):
    pytest.importorskip("nicegui", reason="the dashboard needs NiceGUI: pip install -e '.[dashboard]'")
    code, _, err = run(monkeypatch, capsys, "serve", tmp_path / "no" / "where", "--no-browser")
    assert code == Exit.BAD_INPUT
    assert "seatrial init" in err
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        code, out, err = run(monkeypatch, capsys, "serve", tmp_path / "new", "--no-browser", "--port", port)
    assert code == Exit.BAD_INPUT
    assert "new did not exist and was made, for new campaigns" in out
    assert (tmp_path / "new").is_dir()
    assert "--port" in err
    assert "Traceback" not in err
