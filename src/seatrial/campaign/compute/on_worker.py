"""What a process of the cluster runs: one piece of work, and what it reports sent on."""

import pickle
import time
from dataclasses import dataclass
from typing import Any

from distributed import get_worker

from seatrial.campaign.compute.machine import environment, processor
from seatrial.campaign.compute.workers import Work
from seatrial.core.errors import SeatrialError

EVERY = 0.5
"""Seconds between two reports of one piece."""


@dataclass(frozen=True)
class Failed:
    """An error that is meant for the user: a result, so that no worker tries again."""

    error: SeatrialError


@dataclass(frozen=True)
class Stranger:
    """A worker whose results might not be ours: its address, and versions and settings that differ, theirs and ours."""

    address: str
    differing: dict[str, tuple[str, str]]


def about() -> tuple[dict[str, str], str]:
    """Environment and processor of this process."""
    return environment(), processor()


def differing(ours: dict[str, str], theirs: dict[str, str]) -> dict[str, tuple[str, str]]:
    """Versions and settings that are not the same: theirs and ours."""
    return {name: (theirs.get(name, "missing"), mine) for name, mine in ours.items() if theirs.get(name) != mine}


def load(content: bytes) -> Any:
    """What all pieces share. A task of its own, so that a lost copy is made again from what the scheduler holds."""
    return pickle.loads(content)


def call(work: Work, shared: Any, item: Any, topic: str, index: int, ours: dict[str, str]) -> Any:
    """Do one piece of work; `ours` is checked because workers may join at any time.

    Returns:
        What the work returns, `Failed`, or `Stranger`.
    """
    worker, said = get_worker(), time.monotonic()
    if other := differing(ours, environment()):
        return Stranger(worker.address, other)

    def report(done: int, total: int) -> None:
        nonlocal said
        if time.monotonic() - said >= EVERY:
            said = time.monotonic()
            worker.log_event(topic, (index, int(done), int(total)))

    try:
        return work(shared, item, report)
    except SeatrialError as error:
        return Failed(error)
