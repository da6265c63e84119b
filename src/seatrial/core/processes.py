"""Processes that end with the one that started them, also while they compute and also when that one was killed."""

import ctypes
import multiprocessing
import os
import signal
import sys
import threading
from multiprocessing.connection import wait

_PR_SET_PDEATHSIG = 1


def end_with_parent() -> None:
    """End this process as soon as the one that started it has ended; call it before anything else.

    Linux has its kernel do it, which no computation holds up. There the thread that started this process counts as its parent, so
    that thread has to live as long. Elsewhere a thread watches, which sees the end when Python next changes threads.
    """
    parent = multiprocessing.parent_process()
    assert parent is not None, "only of a process that multiprocessing started"
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
        if os.getppid() != parent.pid:  # it ended before that
            os._exit(1)

    def watch() -> None:
        wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
