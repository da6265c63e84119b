"""Work that the server itself does not do: results and records in a process each, the vehicle (with JAX) in a third.

Records may be long, and are read ahead: what is short, such as a sweep of designs, does not wait for that.

The server only passes answers on, so that it always has time for its viewers; answers are kept until the files change that they
were made from.
"""

import asyncio
import multiprocessing
import signal
from collections import OrderedDict
from collections.abc import Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from importlib import import_module
from pathlib import Path
from typing import Any

from seatrial.core.errors import NumericalError, SeatrialError
from seatrial.core.processes import end_with_parent
from seatrial.dashboard.view_models import plain_error

KEPT = 400
"""Answers that are kept."""


ENDED = "the process ended without a message, perhaps because memory ran out"


class WorkerPool:
    """Three processes that answer questions, and the answers so far."""

    def __init__(self):
        self.pools: dict[str, ProcessPoolExecutor] = {}
        self.answers: OrderedDict[tuple, Future] = OrderedDict()

    async def draw(self, question: str, *about: Any, files: Sequence[Path] = ()) -> Any:
        """Ask a function of `result_plots`; the answer is kept while the files stay as they are."""
        return await self._ask("result_plots", question, about, files)

    async def think(self, question: str, *about: Any, files: Sequence[Path] = ()) -> Any:
        """Ask a function of `model_queries`; kept likewise."""
        return await self._ask("model_queries", question, about, files)

    async def try_out(self, question: str, *about: Any) -> Any:
        """Ask a function of `model_queries` what is hardly asked twice, such as what a slider shows; the answer is not kept."""
        try:
            return await self._ask("model_queries", question, about, ())
        finally:
            self.answers.pop(("model_queries", question, about, ()), None)

    async def view(self, question: str, *about: Any, files: Sequence[Path] = ()) -> Any:
        """Ask a function of `record_views`; the answer is kept likewise."""
        return await self._ask("record_views", question, about, files)

    def warm(self) -> None:
        """Start all processes, so that the first viewer does not wait for what they import."""
        for pool in ("result_plots", "record_views", "model_queries"):
            self._submit(pool, "ready", ())

    def close(self) -> None:
        """End all processes, and wait until they have ended: threads that still watch them would fail at the end of the interpreter."""
        for pool in self.pools.values():
            for process in list(pool._processes.values()):
                process.terminate()
            pool.shutdown(cancel_futures=True)
        self.pools.clear()

    async def _ask(self, pool: str, question: str, about: tuple, files: Sequence[Path]) -> Any:
        name = (pool, question, about, tuple(map(stamp, files)))
        future = self.answers.get(name)
        if future is None:
            future = self._submit(pool, question, about)
            self.answers[name] = future
            while len(self.answers) > KEPT:
                self.answers.popitem(last=False)
        self.answers.move_to_end(name)
        try:
            return await asyncio.shield(asyncio.wrap_future(future))
        except BrokenProcessPool as cause:
            self.pools.pop(pool, None)
            self.answers.pop(name, None)
            raise NumericalError(ENDED) from cause
        except Exception:
            self.answers.pop(name, None)
            raise

    def _submit(self, pool: str, question: str, about: tuple) -> Future:
        if pool not in self.pools:
            context = multiprocessing.get_context("spawn")
            self.pools[pool] = ProcessPoolExecutor(1, mp_context=context, initializer=_begin)
        try:
            return self.pools[pool].submit(answered, pool, question, *about)
        except BrokenProcessPool:
            self.pools.pop(pool)
            return self._submit(pool, question, about)


def stamp(path: Path) -> tuple[str, int, int]:
    """What tells that a file has changed: size and time of change; zeros if it is missing."""
    try:
        there = path.stat()
    except OSError:
        return str(path), 0, 0
    return str(path), there.st_size, there.st_mtime_ns


def answered(pool: str, question: str, *about: Any) -> Any:
    """Answer in the other process, or raise an error that is meant for the user with its fields.

    The question goes by its name, so that the process that asks need not import what answers it.
    """
    answers = import_module(f"seatrial.dashboard.{pool}")
    try:
        return getattr(answers, question)(*about)
    except (SeatrialError, OSError) as error:
        raise plain_error(error) from None


def _begin() -> None:
    """First thing that a process does: it leaves Ctrl-C to the server, and ends with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()
