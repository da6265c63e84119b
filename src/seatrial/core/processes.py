"""Processes that end with the one that started them, also while they compute and also when that one was killed."""

import ctypes
import multiprocessing
import os
import signal
import sys
import threading
import time
from multiprocessing.connection import wait

_PR_SET_PDEATHSIG = 1


def end_with_parent(parent: int | None = None) -> None:
    """End this process as soon as the one that started it has ended; call it before anything else.

    Linux has its kernel do it, which no computation holds up. There the thread that started this process counts as its parent, so
    that thread has to live as long. Elsewhere a thread watches, which sees the end when Python next changes threads.

    Args:
        parent: number of the process that started this one; not needed where multiprocessing did.
    """
    starter = multiprocessing.parent_process()
    number = parent if starter is None else starter.pid
    assert number is not None, "only of a process that multiprocessing started, or with the number of the one that did"
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
        if os.getppid() != number:  # it ended before that
            os._exit(1)

    def watch() -> None:
        if starter is not None:
            wait([starter.sentinel])
        while starter is None and os.getppid() == number:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
