"""What is predicted: a whole run from its start, short stretches from the measured state at the start of each, and single steps.

A stretch is a pair (begin, end) of sample numbers: the samples after `begin` up to `end` are predicted from the controls, and from
the measurements up to `begin`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from seatrial.core.errors import InputError
from seatrial.core.record import Record

MOST_STEPS = 500
"""Single steps of one run that are predicted, evenly spread over it."""
Stretch = tuple[int, int]


@dataclass(frozen=True)
class Task:
    """One task: its name in tables and what it is in words."""

    name: str
    words: str


RUN = Task("run", "open loop over the whole run")
SHORT = Task("short", "open loop over short stretches, each from the measured state")
STEP = Task("step", "one step ahead")
TASKS = (RUN, SHORT, STEP)


def stretches(task: Task, record: Record, channels: Sequence[str], horizon: float) -> list[Stretch]:
    """Return the stretches of a run that a task predicts.

    Args:
        task: one of `TASKS`.
        record: run.
        channels: measured ones that are predicted; each stretch begins where all of them are measured.
        horizon: length of the short stretches, s.

    Raises:
        InputError: fewer than two samples at which all channels are measured.
    """
    there = np.all([np.isfinite(record.channel(channel)) for channel in channels], axis=0)
    rows = np.flatnonzero(there)
    if rows.size < 2:
        raise InputError(
            f'record "{record.label}"',
            found=f"{rows.size} samples at which {', '.join(channels)} are all measured",
            expected="two or more, from which a prediction can start",
            remedy="give [import] a coarser `step`, or leave a channel out",
        )
    last = record.time.size - 1
    if task == RUN:
        return [(int(rows[0]), last)]
    if task == STEP:
        chosen = range(0, rows.size - 1, -(-(rows.size - 1) // MOST_STEPS))
        return [(int(rows[k]), int(rows[k + 1])) for k in chosen]
    begins = np.arange(float(record.time[rows[0]]), float(record.time[rows[-1]]), horizon)
    places = dict.fromkeys(rows[np.searchsorted(record.time[rows], begins - 1e-9 * horizon)].tolist())
    starts = [*places, last]
    return [(begin, end) for begin, end in pairwise(starts) if end > begin]


def leads(piece: Sequence[Stretch], size: int) -> np.ndarray:
    """Return how many samples each one lies behind the start of its stretch; 0 where nothing is predicted, shape (size,)."""
    distances = np.zeros(size, int)
    for begin, end in piece:
        distances[begin + 1 : end + 1] = np.arange(1, end - begin + 1)
    return distances
