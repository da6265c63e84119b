"""Processes that end with the one that started them, also while they compute and also when that one was killed."""

import ctypes
import multiprocessing
import os
import signal
import sys
import threading
import time
from multiprocessing.connection import wait

EVERY = 1.0
"""Seconds between two looks at whether the parent is there, where nothing tells."""
_PR_SET_PDEATHSIG = 1


def end_with_parent(parent: int | None = None) -> None:
    """End this process as soon as the one that started it has ended; call it before anything else.

    Linux has its kernel do it, which no computation holds up. There the thread that started this process counts as its parent, so
    that thread has to live as long. Elsewhere a thread watches, which sees the end when Python next changes threads.

    Args:
        parent: number of the process that started this one, if it is known and may have ended by now.
    """
    starter = multiprocessing.parent_process()
    number = (parent or os.getppid()) if starter is None else starter.pid
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
        if os.getppid() != number:  # it ended before that
            os._exit(1)

    def watch() -> None:
        if starter is not None:
            wait([starter.sentinel])
        while starter is None and os.getppid() == number:
            time.sleep(EVERY)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
