"""A dashboard in a process of its own, on a free port."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx


@contextmanager
def served(folder: Path, *options: str, kill: bool = False) -> Iterator[tuple[str, subprocess.Popen]]:
    """Serve a folder while the block runs; gives the address, a token included, and the process.

    Args:
        folder: to serve.
        options: of the command.
        kill: whether the process is killed at the end instead of interrupted.
    """
    command = [
        sys.executable,
        "-m",
        "seatrial",
        "serve",
        str(folder),
        "--port",
        "0",
        "--no-browser",
        *options,
    ]
    log = folder.parent / f"{folder.name}-serve.log"
    with log.open("w") as stream:
        process = subprocess.Popen(command, stdout=stream, stderr=stream, env={**os.environ, "PYTHONUNBUFFERED": "1"})
    try:
        yield _address(process, log), process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGKILL if kill else signal.SIGINT)
        process.wait(30)


def _address(process: subprocess.Popen, log: Path) -> str:
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline:
        assert process.poll() is None, log.read_text()
        if found := re.search(r"http://\S+", log.read_text()):
            try:
                httpx.get(found[0], timeout=60)
                return found[0]
            except httpx.TransportError:
                pass
        time.sleep(0.1)
    raise TimeoutError(log.read_text())
