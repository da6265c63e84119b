"""Work in other processes: asked once while its files stay, errors in words, and a process that dies costs its question only."""

import asyncio
import os
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from seatrial.core.errors import InputError, NumericalError, SeatrialError
from seatrial.core.processes import end_all
from seatrial.dashboard.jobs import Jobs
from seatrial.dashboard.logs import isolated
from seatrial.dashboard.view_models import plain_error, words_of
from seatrial.dashboard.worker_pool import WorkerPool, answered, stamp
from seatrial.logs.formats.protocol import NoColumn

COMPUTES = """
import asyncio, os
from seatrial.dashboard.worker_pool import WorkerPool

def hold():
    part = os.path.join(os.path.dirname(__file__), "part")
    with open(part, "w") as told:
        told.write(str(os.getpid()))
    os.replace(part, os.path.join(os.path.dirname(__file__), "child"))
    return 3 ** 3 ** 19  # one instruction, which never lets another thread run

async def in_a_pool():
    here = WorkerPool()
    await here._ask("record_views", "text_of", (1,), ())
    here.pools["record_views"].submit(hold)
    await asyncio.sleep(60)

if __name__ == "__main__":
    from asks import hold  # by a name that other processes know too

    asyncio.run(in_a_pool())
"""


def test_a_question_is_asked_once_while_its_files_stay(tmp_path):
    asked = []

    class Counting(WorkerPool):
        def _submit(self, pool, question, about):
            asked.append(question)
            return super()._submit(pool, question, about)

    async def main():
        worker_pool, file = Counting(), tmp_path / "x"
        file.write_text("1")
        try:
            many = [worker_pool._ask("record_views", "text_of", (b"y",), [file]) for _ in range(20)]
            assert await asyncio.gather(*many) == ["y"] * 20
            assert len(asked) == 1
            file.write_text("22")
            await worker_pool._ask("record_views", "text_of", (b"y",), [file])
            assert len(asked) == 2
            with pytest.raises(InputError, match="no such file"):
                await worker_pool._ask("record_views", "about_record", (tmp_path / "none.nc",), ())
            process = next(iter(worker_pool.pools["record_views"]._processes))
            os.kill(process, 9)
            with pytest.raises(NumericalError, match="ended without a message"):
                await worker_pool._ask("record_views", "text_of", (b"z",), ())
            assert await worker_pool._ask("record_views", "text_of", (b"z",), ()) == "z"
        finally:
            worker_pool.close()

    asyncio.run(main())


def test_no_thread_watches_processes_that_were_ended():
    """One that still did would fail at the end of the interpreter, which wakes it."""
    before = set(threading.enumerate())
    worker_pool = WorkerPool()
    future = worker_pool._submit("record_views", "text_of", (b"y",))
    assert set(threading.enumerate()) > before
    worker_pool.close()
    assert set(threading.enumerate()) == before
    assert future.done()


def test_who_reads_results_loads_neither_jax_nor_xarray():
    kinds = "result_plots", "record_views"
    ready = "; ".join(f"{kind}.ready()" for kind in kinds)
    code = f"import sys; from seatrial.dashboard import {', '.join(kinds)}; {ready}; print({{'jax', 'xarray'}} & {{*sys.modules}})"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "set()\n"


def test_errors_pass_between_processes_with_their_fields(tmp_path):
    with pytest.raises(InputError, match="no such file") as refused:
        answered("result_plots", "swept", tmp_path / "missing.nc")
    assert str(tmp_path / "missing.nc") in refused.value.where
    assert answered("record_views", "text_of", b"a") == "a"
    special = plain_error(NoColumn("a.csv", found="b", expected="c", remedy="d"))
    assert type(special) is InputError
    assert str(special) == str(NoColumn("a.csv", found="b", expected="c", remedy="d"))
    assert type(plain_error(NumericalError("singular"))) is SeatrialError


def test_a_process_that_computes_ends_with_the_one_that_asked(tmp_path):
    script = tmp_path / "asks.py"
    script.write_text(COMPUTES)
    parent, told = subprocess.Popen([sys.executable, str(script)]), tmp_path / "child"
    deadline = time.monotonic() + 60
    while not told.exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    child = int(told.read_text())
    parent.kill()
    parent.wait()
    deadline = time.monotonic() + 20
    while os.path.exists(f"/proc/{child}") and time.monotonic() < deadline:
        time.sleep(0.05)
    ended = not os.path.exists(f"/proc/{child}")
    if not ended:
        os.kill(child, 9)
    assert ended


def test_a_server_that_stops_does_not_wait_for_a_log(in_others):
    with ThreadPoolExecutor(1) as pool:
        reading = pool.submit(isolated, "a log", time.sleep, 250.0)
        while not reading.done():
            end_all()
            time.sleep(0.05)
    with pytest.raises(InputError, match="breaks its reader"):
        reading.result()


def test_troubles_of_the_file_system_are_said_in_words(tmp_path):
    assert "space left" in words_of(OSError(28, "No space left on device", "/x"))
    assert words_of(InputError("a", found="b", expected="c", remedy="d")).startswith("a\n")
    (tmp_path / "results").write_text("a file where a folder should be")
    with pytest.raises(OSError, match="exists") as refused:
        Jobs().start(tmp_path, "run")
    assert "move it away" in words_of(refused.value)
    assert stamp(tmp_path / "nothing") == (str(tmp_path / "nothing"), 0, 0)
