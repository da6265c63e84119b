"""The processes of a Dask cluster as workers: tasks that are lost with their process are done again elsewhere, by the scheduler.

Functions and data travel as pickles between processes of one user's own: whoever is at the scheduler's address can run code here, and so
can whoever reaches the scheduler there. Nothing that a file holds is ever unpickled. See docs/decisions/0016.
"""

import logging
import os
import pickle
import platform
import queue
import time
import uuid
import warnings
from collections.abc import Iterator, Mapping, Sequence, Sized
from contextlib import contextmanager, suppress
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from distributed import Client, Future, KilledWorker, get_worker
from distributed.comm.core import CommClosedError

from seatrial import __version__
from seatrial.campaign.compute.workers import Done, OnProgress, Work, nobody
from seatrial.compiled import engine
from seatrial.compiled.batching import backend
from seatrial.core.errors import InputError, NumericalError, install_extra
from seatrial.core.reporter import SILENT, Reporter

# What a process of the cluster runs: one piece of work, and what it reports sent on.

REPORT_SECONDS = 0.5  # Seconds between two reports of one piece


def about() -> tuple[dict[str, str], str]:
    """Environment and processor of this process."""
    return environment(), processor()


def load(content: bytes) -> Any:
    """What all pieces share. A task of its own, so that a lost copy is made again from what the scheduler holds."""
    return pickle.loads(content)


def call(work: Work, shared: Any, item: Any, topic: str, index: int, ours: dict[str, str]) -> Any:
    """Do one piece of work and return its result; `ours` is checked because workers may join at any time.

    Raises:
        InputError: results of this worker might not be ours.
    """
    engine.configure()
    worker, said = get_worker(), time.monotonic()
    _check_same(f"the worker {worker.address}", environment(), ours)

    def report(done: int, total: int) -> None:
        nonlocal said
        if time.monotonic() - said >= REPORT_SECONDS:
            said = time.monotonic()
            worker.log_event(topic, (index, int(done), int(total)))

    return work(shared, item, report)


CONNECT = 5.0  # Seconds in which a scheduler answers, if there is one
LOOK = 1.0  # Seconds between two looks at whether the scheduler is still there
PAUSE_SECONDS = 0.2  # Seconds before a result is asked for again
SAY = 30.0  # Seconds between two lines about the workers
NEEDED_VERSIONS = ("seatrial", "distributed", "Python")  # What a scheduler has to have as here; it computes nothing
LOST_ERRORS = (OSError, CommClosedError, TimeoutError)  # How a call ends whose scheduler is gone


class DaskWorkers:
    """`Workers` that are processes at a scheduler's address.

    Args:
        address: of the scheduler, or a cluster object of Dask that has one.
        name: as messages call it.
        reporter: is told how the workers are.

    Raises:
        InputError: nothing answers there, or it is another version of Dask.
    """

    def __init__(self, address: Any, name: str, reporter: Reporter = SILENT):
        self.name, self.reporter, self.ours = name, reporter, environment()
        _quieten()
        try:
            self.client: Any = Client(address, timeout=CONNECT, set_as_default=False, name="seatrial")
            theirs = self.client.get_versions(check=False)["scheduler"]["packages"]
        except (*LOST_ERRORS, ValueError, TypeError, KeyError, RuntimeError) as cause:
            raise InputError(
                f"workers {name}",
                found=f"no answer of a scheduler within {CONNECT:g} s ({type(cause).__name__}: {cause})",
                expected="the address of a Dask scheduler of the same version, as `dask scheduler` prints it",
                remedy='start one with `dask scheduler`, correct the address, or set SEATRIAL_WORKERS="local"',
            ) from cause
        try:
            _check_same(f"the scheduler at {name}", theirs, {"distributed": self.ours["distributed"]})
        except InputError:
            self.client.close()
            raise

    @property
    def is_there(self) -> bool:
        """Whether the scheduler still is, as far as is known."""
        return self.client.status == "running"

    def state(self, workers: Mapping[str, Any]) -> str:
        """Return how the workers are, of which the scheduler says this: their number and memory, or what will start one."""
        if workers:
            used = sorted(one["metrics"]["memory"] / 2**20 for one in workers.values())
            return f"{_counted(workers)}, memory of each {used[0]:.0f} to {used[-1]:.0f} MiB"
        start = f"start one with: dask worker {self.name} --nworkers auto --nthreads 1"
        return (
            f"no worker at {self.name}: waiting ({'SLURM has not started them yet' if self.name == 'slurm' else start})"
        )

    def greet(self) -> None:
        """Check the scheduler, which reads what the tasks are made of, and the workers that are there; say where they are.

        Raises:
            InputError: one whose results might not be ours.
        """
        try:
            answers = self.client.run(about, on_error="return")
            at_the_scheduler = self.client.run_on_scheduler(about)
        except LOST_ERRORS as cause:
            raise self.gone(0, 0) from cause
        except Exception as cause:  # whatever keeps seatrial from being imported there
            raise self._mute(f"the scheduler at {self.name}", cause) from cause
        needed = {name: self.ours[name] for name in NEEDED_VERSIONS}
        _check_same(f"the scheduler at {self.name}", at_the_scheduler[0], needed)
        for address, answer in answers.items():
            if isinstance(answer, Exception):
                raise self._mute(f"the worker {address}", answer)
            _check_same(f"the worker {address}", answer[0], self.ours)
        here = f"{_counted(answers)} at {self.name}" if answers else self.state({})
        link = self.client.dashboard_link
        self.reporter.say(here + (f"; the scheduler's page is {link}" if link else ""))
        if others := {answer[1] for answer in answers.values()} - {processor()}:
            self.reporter.say(
                f"caution: workers compute on {', '.join(sorted(others))}, this machine is {processor()}: results of two kinds of "
                "processor may differ in their last bits"
            )

    def close(self) -> None:
        """Let go of the scheduler, and end the jobs of one that is a part of this process."""
        with suppress(*LOST_ERRORS):
            self.client.close(timeout=2)
            if self.client.cluster is not None:
                self.client.cluster.close(timeout=2)

    def run(self, work: Work, shared: Any, items: Sequence[Any], done: Done, on_progress: OnProgress = nobody) -> None:
        """See `Workers.run`."""
        _Run(self, work, items, on_progress).until_done(shared, done)

    def _mute(self, who: str, answer: Exception) -> InputError:
        return InputError(
            who,
            found=f"no answer but {answer}",
            expected=f"a process in which seatrial {self.ours['seatrial']} can be imported",
            remedy=f"install the same versions there: {install_extra('cluster')}",
        )

    def gone(self, kept: int, total: int) -> InputError:
        """Return the error of a scheduler that is no longer there."""
        return InputError(
            f"workers {self.name}",
            found=f"the scheduler is gone; {kept} of {total} tasks are kept" if total else "the scheduler is gone",
            expected="one that stays until the work is done",
            remedy='start it and run the same command again, which continues; to use this machine set SEATRIAL_WORKERS="local"',
        )


class _Run:
    """Pieces of one call of `run`."""

    def __init__(self, cluster: DaskWorkers, work: Work, items: Sequence[Any], on_progress: OnProgress):
        self.cluster, self.client, self.work, self.items = cluster, cluster.client, work, items
        self.on_progress = on_progress
        self.name, self.total = f"{work.__name__.strip('_')}-{uuid.uuid4().hex[:12]}", len(items)
        self.ended = queue.SimpleQueue[Future]()
        self.running: dict[str, tuple[int, Future]] = {}
        self.sent = self.kept = 0
        self.alone = False
        self.looked, self.said = 0.0, time.monotonic()

    def until_done(self, shared: Any, done: Done) -> None:
        """Send pieces and hand over results until there are none left."""
        with self._listening():
            loaded = self._sent(load, pickle.dumps(shared, protocol=5), key=f"{self.name}-shared")
            self._look()
            for index, item in enumerate(self.items):
                self._send(loaded, index, item, begun=False)
            while self.running:
                if time.monotonic() - self.looked > LOOK:
                    self._look()
                try:
                    future = self.ended.get(timeout=LOOK)
                except queue.Empty:
                    continue
                index, _ = self.running.pop(future.key)
                following = done(index, self._result(future))
                self.kept += 1
                if following is not None:
                    self.total += 1
                    self._send(loaded, index, following, begun=True)

    def _send(self, loaded: Future, index: int, item: Any, begun: bool) -> None:
        self.sent += 1
        arguments = (self.work, loaded, item, self.name, index, self.cluster.ours)
        future = self._sent(call, *arguments, key=f"{self.name}-{self.sent}", priority=int(begun))
        self.running[future.key] = (index, future)
        future.add_done_callback(self.ended.put)

    def _sent(self, function: Any, *arguments: Any, **options: Any) -> Future:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Sending large graph")
            try:
                return self.client.submit(function, *arguments, pure=False, **options)
            except (*LOST_ERRORS, RuntimeError) as cause:
                raise self._lost() from cause

    def _result(self, future: Future) -> Any:
        if future.status in ("cancelled", "lost"):
            raise self._lost()
        try:
            return self._fetched(future)
        except KilledWorker as cause:
            raise NumericalError(
                f"every worker that ran one of the tasks has stopped, {cause.allowed_failures + 1} of them: probably for lack of memory. "
                f"Give each more, and look at the log of {getattr(cause.last_worker, 'address', 'the last one')}"
            ) from cause
        except Exception as cause:
            if "cancelled" in type(cause).__name__.lower():
                raise self._lost() from cause
            raise

    def _fetched(self, future: Future) -> Any:
        """The result; where its worker ended before it was fetched, it is made again, which takes as long as it takes."""
        while True:
            try:
                return future.result(timeout=CONNECT)
            except LOST_ERRORS:
                if future.status == "error":  # of the work itself
                    raise
                self._look()
                time.sleep(PAUSE_SECONDS)

    def _look(self) -> None:
        """See whether the scheduler is there, and how many workers."""
        self.looked = time.monotonic()
        if self.client.status != "running":
            raise self._lost()
        try:
            workers = self.client.scheduler_info(n_workers=-1)["workers"]
        except (*LOST_ERRORS, RuntimeError) as cause:
            raise self._lost() from cause
        joined, self.alone = self.alone and bool(workers), not workers
        if joined or self.looked - self.said > SAY:
            self.said = self.looked
            self.cluster.reporter.say(f"{self.kept} of {self.total} tasks; {self.cluster.state(workers)}")

    def _lost(self) -> InputError:
        return self.cluster.gone(self.kept, self.total)

    @contextmanager
    def _listening(self) -> Iterator[None]:
        """Receive reports while the block runs; at its end, also by an error or Ctrl-C, what still runs is cancelled."""
        self.client.subscribe_topic(self.name, lambda event: self.on_progress(*event[1]))
        try:
            yield
        finally:
            if self.client.status == "running":
                with suppress(*LOST_ERRORS, RuntimeError):
                    self.client.cancel([future for _, future in self.running.values()], force=True)
                    self.client.unsubscribe_topic(self.name)
            self.running.clear()


def _counted(workers: Sized) -> str:
    return f"{len(workers)} worker{'s' * (len(workers) != 1)}"


def _check_same(who: str, theirs: Mapping[str, str], ours: Mapping[str, str]) -> None:
    """Check that a process has our versions and settings, without which its results might not be ours.

    Raises:
        InputError: those that differ.
    """
    other = {name: theirs.get(name, "missing") for name, mine in ours.items() if theirs.get(name) != mine}
    if other:
        raise InputError(
            who,
            found=", ".join(f"{name} {value or 'not set'}" for name, value in other.items()),
            expected=", ".join(f"{name} {ours[name] or 'not set'}" for name in other) + ", as here",
            remedy="let it import nothing before seatrial, set the same JAX_PLATFORMS, and install the same versions there: "
            + install_extra("cluster"),
        )


def _quieten() -> None:
    """Dask's own log says in many lines what our errors say in one."""
    for name in ("distributed.client", "distributed.core", "distributed.comm.tcp", "distributed.batched"):
        logging.getLogger(name).setLevel(logging.CRITICAL)


# What decides the bits of a computation besides its input: versions, compiler settings and the processor.

PACKAGES = ("jax", "jaxlib", "jax-cuda12-plugin", "numpy", "scipy", "blackjax", "distributed")


def environment() -> dict[str, str]:
    """Versions, compiler settings and the kind of device; where they differ, results may."""
    versions = {"seatrial": __version__, "Python": ".".join(platform.python_version_tuple()[:2])}
    versions |= {name: _version(name) for name in PACKAGES}
    return (
        versions | {name: os.environ.get(name, "") for name in ("XLA_FLAGS", "JAX_ENABLE_X64")} | {"device": backend()}
    )


def processor() -> str:
    """Name of this machine's processor; sums may differ in their last bits between two kinds."""
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


@lru_cache
def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "missing"
