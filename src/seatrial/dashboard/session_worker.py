"""The other side of a session: it runs commands as the command line does, one after another."""

import gc
import json
import os
import signal
import sys
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from pathlib import Path

from seatrial.cli.main import main
from seatrial.cli.running import Exit
from seatrial.compiled import engine
from seatrial.core.files import open_regular


def answer(handle: str, memory: str) -> None:
    """Run the commands that come through a pipe, until it is closed or the process has grown too large.

    Args:
        handle: number of the pipe's end.
        memory: bytes beyond which the process ends after its command.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    engine.configure()
    with Connection(int(handle)) as channel:
        while True:
            try:
                asked = json.loads(channel.recv_bytes())
            except (EOFError, OSError):
                os._exit(Exit.OK)
            with _printing_to(asked["log"]):
                code = _run(asked["words"])
            last = _has_joined_a_cluster() or _held() > int(memory)
            with suppress(OSError):  # nobody waits any more
                channel.send_bytes(json.dumps({"code": code, "last": last}).encode())
            if last:
                return


def _run(words: list[str]) -> int:
    """Run one command as if it alone were run; returns its exit code."""
    sys.argv = ["seatrial", *words]
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with warnings.catch_warnings():  # each command warns anew
            main()
        return Exit.OK
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else Exit.OK if end.code is None else Exit.BUG
    except KeyboardInterrupt:
        return Exit.INTERRUPTED
    except Exception:
        traceback.print_exc()
        return Exit.BUG
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        gc.collect()


@contextmanager
def _printing_to(log: str) -> Iterator[None]:
    """Add the output of the block to a file."""
    before = {stream: os.dup(stream) for stream in (1, 2)}
    with open_regular(Path(log), "ab") as printed:
        for stream in before:
            os.dup2(printed.fileno(), stream)
    try:
        yield
    finally:
        for stream, kept in before.items():
            os.dup2(kept, stream)
            os.close(kept)


def _held() -> int:
    """Bytes of memory that this process holds; the most it has held where the system does not tell."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        import resource

        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def _has_joined_a_cluster() -> bool:
    """Whether machines are held for this process, which its end gives back."""
    place = sys.modules.get("seatrial.campaign.compute.place")
    return place is not None and place.has_joined()
