"""A calibration on Dask workers against threads: how much two workers gain on one, what a task costs beside its work, and where it ends.

`python benchmarks/run.py cluster`, or with other numbers of replicates and workers `python benchmarks/cluster.py 100 1 2`. Workers are
processes on this machine, each held on one core (left alone, one takes more), started and warmed up beforehand. The seconds of n tasks of
t seconds on w workers follow

    T(w) = s + n max(t / w, c)

with s what no worker shares and c what the scheduler and the client spend on a task: beyond w = t / c, workers gain nothing. Tasks that do
nothing tell c, and runs on one and two workers s and t.
"""

import os
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from distributed import Client, LocalCluster
from timing import Ratio, Row, alternate, row

from seatrial.campaign.compute.dask_workers import DaskWorkers
from seatrial.campaign.compute.place import VARIABLE
from seatrial.campaign.compute.shared_work import Study
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.config.templates import init_campaign
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.inference.calibration import calibrate
from seatrial.campaign.store.stored_result import Store

REPLICATES, WORKERS, REPEATS, IDLE = 400, (1, 2, 4), 2, 2000
METHOD = "independence-metropolis"


def scaling(cores: int, replicates: int = REPLICATES, workers: tuple[int, ...] = WORKERS) -> list[Row | Ratio]:
    """Seconds of one calibration on threads and on workers, which must find the same ranks; then the cost of a task."""
    group = f"calibration of {replicates} replicates on Dask"
    with tempfile.TemporaryDirectory() as folder:
        init_campaign(folder, "remus100")
        campaign = load_campaign(folder)
        trials, ranks = get_trials(campaign), []
        path = Store(campaign.folder).calibration(METHOD)

        def calibrated(place: str, count: int = replicates) -> None:
            os.environ[VARIABLE] = place
            path.unlink(missing_ok=True)
            found = calibrate(campaign, trials, count, METHOD).ranks
            if count == replicates:
                ranks.append(found)

        clusters = {
            n: LocalCluster(n_workers=n, threads_per_worker=1, dashboard_address=":0", silence_logs=50) for n in workers
        }
        runs: dict[str, Callable[[], Any]] = {"threads": partial(calibrated, "local")}
        for n, cluster in clusters.items():
            hold(cluster)
            calibrated(cluster.scheduler_address, 20 * n)
            runs[_words(n)] = partial(calibrated, cluster.scheduler_address)
        calibrated("local", 20)
        seconds = alternate(runs, REPEATS, warm_up=False)
        if any(not np.array_equal(found, ranks[0]) for found in ranks):
            raise SystemExit("benchmarks: the ranks differ: the times mean nothing")
        idle = {n: _idle(cluster.scheduler_address, Study(campaign, trials.fit)) for n, cluster in clusters.items()}
        for cluster in clusters.values():
            cluster.close()
    rows: list[Row | Ratio] = [row(group, what, cores, "s", found, 1.0) for what, found in seconds.items()]
    rows += [
        Row(group, f"a task that does nothing, {_words(n)}", cores, "ms", 1e3 * found, 1e3 * found)
        for n, found in idle.items()
    ]
    least = {what: float(found.min()) for what, found in seconds.items()}
    load = os.getloadavg()[0]
    rows.append(Row(group, "load of the machine at the end", cores, "", load, load))
    if not {1, 2} <= set(workers):
        return rows
    one, two = least[_words(1)], least[_words(2)]
    task, shared = 2.0 * (one - two) / replicates, 2.0 * two - one
    cost = min(idle.values())
    rows += [
        Row(group, "fitted: one task, t", cores, "ms", 1e3 * task, 1e3 * task),
        Row(group, "fitted: what no worker shares, s", cores, "s", shared, shared),
        Row(group, "fitted: workers beyond which nothing is gained, t / c", cores, "", task / cost, task / cost),
    ]
    return [
        *rows,
        Ratio(group, "two workers against one", cores, one / two, at_least=1.7),
        Ratio(group, "cost of a task over the task", cores, idle[1] / (one / replicates), at_most=0.05),
        Ratio(group, "two workers against two threads", cores, least["threads"] / two),
        *(Ratio(group, f"{_words(n)} against one", cores, one / least[_words(n)]) for n in workers if n > 2),
    ]


def hold(cluster: LocalCluster) -> None:
    """Hold each worker of a cluster on one core, one after the other; before they import JAX, which asks for their number."""
    usable = sorted(os.sched_getaffinity(0))
    with Client(cluster, set_as_default=False) as client:
        for number, worker in enumerate(client.scheduler_info(n_workers=-1)["workers"]):
            client.run(_stay, usable[number % len(usable)], workers=[worker])


def _stay(core: int) -> None:
    for thread in os.listdir("/proc/self/task"):
        os.sched_setaffinity(int(thread), {core})


def nothing(shared: Any, item: int, report: Any) -> int:
    """A task without work."""
    return item


def _idle(address: str, study: Study) -> float:
    """Seconds that a task takes which does nothing, among many."""
    workers, found = DaskWorkers(address, address), []
    start = time.perf_counter()
    workers.run(nothing, study, range(IDLE), lambda index, result: found.append(result))
    seconds = time.perf_counter() - start
    workers.close()
    if sorted(found) != list(range(IDLE)):
        raise SystemExit("benchmarks: tasks were lost")
    return seconds / IDLE


def _words(n: int) -> str:
    return f"{n} worker{'s' * (n > 1)}"


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parent))
    count, *counts = [int(text) for text in sys.argv[1:]] or [REPLICATES, *WORKERS]
    for found in scaling(len(os.sched_getaffinity(0)), count, tuple(counts) or WORKERS):
        print(*found)
