"""The one interface to whatever does a campaign's work, and its first implementation: the cores of this machine.

A piece of work is a function at the top level of a module, something that all pieces share and an item of its own: data, and no
closures, so that a piece may run anywhere and be run again elsewhere if it is lost. It draws from a random key that its item names, so
that its bits depend neither on where it runs nor on what runs beside it.
"""

from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from functools import partial
from typing import Any, Protocol

from seatrial.core.processes import cores

Work = Callable[[Any, Any, Callable[[int, int], None]], Any]
"""`work(shared, item, report)`; it may report how far it has come, by `report(done, total)`."""
Done = Callable[[int, Any], Any]
"""`done(index, result)`; the item with which the same piece goes on, or None."""
OnProgress = Callable[[int, int, int], None]
"""`on_progress(index, done, total)`: how far a piece that still runs has come."""


def nobody(index: int, done: int, total: int) -> None:
    """Progress of pieces that nobody watches."""


class Workers(Protocol):
    """Does pieces of work. A sibling of this file for each kind; tests/campaign/test_workers.py runs over all of them."""

    def run(self, work: Work, shared: Any, items: Sequence[Any], done: Done, on_progress: OnProgress = nobody) -> None:
        """Do the work of every item, in any order, and hand over each result as soon as it is there.

        Args:
            work: function at the top level of a module.
            shared: what all pieces need, sent once.
            items: one for each piece; plain data.
            done: called in the caller's thread, one call at a time. What it returns, unless None, is the item with which that piece
                goes on; pieces that are begun come before those that are not.
            on_progress: receives what a piece reports, from any thread.

        Raises:
            SeatrialError: of the first piece that fails, or because the workers are gone. All that `done` was called with is the
                caller's to keep.
        """
        ...


class LocalWorkers:
    """A thread for each core. Compiled code releases the interpreter, so threads are enough."""

    def __init__(self, count: int | None = None):
        self.cores = count or cores()

    def run(self, work: Work, shared: Any, items: Sequence[Any], done: Done, on_progress: OnProgress = nobody) -> None:
        """See `Workers.run`."""
        waiting, running = deque(enumerate(items)), dict[Future, int]()
        with ThreadPoolExecutor(self.cores) as pool:
            try:
                while waiting or running:
                    # One more than there are threads, so that none waits while a result is being kept.
                    while waiting and len(running) <= self.cores:
                        index, item = waiting.popleft()
                        running[pool.submit(work, shared, item, partial(on_progress, index))] = index
                    for ended in wait(running, return_when=FIRST_COMPLETED).done:
                        index = running.pop(ended)
                        following = done(index, ended.result())
                        if following is not None:
                            waiting.appendleft((index, following))
            except BaseException:
                pool.shutdown(cancel_futures=True, wait=False)
                raise
