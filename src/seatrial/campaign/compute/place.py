"""Where a campaign's work is done: `[compute] workers`, or the environment variable SEATRIAL_WORKERS in its place.

What is computed does not depend on it, so no key of a result does.
"""

import atexit
import os
import re
import shutil
import sys
from collections.abc import Callable
from typing import Any

from seatrial.campaign.compute.workers import LocalWorkers, Workers
from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.schema import ComputeTable, SlurmTable
from seatrial.core.errors import InputError, install_extra
from seatrial.core.reporter import SILENT, Reporter

# Workers that SLURM starts: dask-jobqueue submits a job for each group of processes; the scheduler is a part of this
# process.


def job_options(asked: SlurmTable) -> dict[str, Any]:
    """Options of `SLURMCluster`: one process of one thread for each core."""
    return {
        "queue": asked.queue,
        "account": asked.account,
        "cores": asked.cores,
        "processes": asked.cores,
        "memory": asked.memory,
        "walltime": asked.walltime,
        "interface": asked.interface,
        "python": sys.executable,
        "job_name": "seatrial",
        "worker_extra_args": ["--no-dashboard"],
    }


def submit_jobs(asked: SlurmTable) -> Any:
    """Submit the jobs that are asked for; their workers join as SLURM starts them.

    Raises:
        InputError: there is no SLURM here.
    """
    if shutil.which("sbatch") is None:
        raise InputError(
            "workers slurm",
            found="no command sbatch",
            expected="a machine from which jobs are submitted to SLURM",
            remedy='run on the cluster\'s login node, give the address of a scheduler, or set SEATRIAL_WORKERS="local"',
        )
    from dask_jobqueue.slurm import SLURMCluster

    cluster = SLURMCluster(**job_options(asked))
    cluster.scale(jobs=asked.jobs)
    return cluster


VARIABLE = "SEATRIAL_WORKERS"
# Of a scheduler; with `tls` the certificates are those of Dask's own configuration
ADDRESS = re.compile(r"(tcp|tls)://\S+:\d+")


def workers_of(campaign: Campaign, reporter: Reporter = SILENT) -> Workers:
    """Whatever is to do the work of a campaign. A cluster is joined once in a process, and left at its end.

    Raises:
        InputError: a setting that is none, an address that only a file vouches for, a cluster that is not there or not ours, or
            Dask missing.
    """
    place, where = _place(campaign.compute, campaign.where)
    if place == "local":
        return LocalWorkers()
    if place == "slurm":
        asked = campaign.compute.slurm
        if asked is None:
            raise InputError(
                campaign.where("compute.slurm"),
                found="nothing",
                expected="the resources of the SLURM jobs",
                remedy='add [compute.slurm] with memory = "8GB", walltime = "02:00:00", cores and jobs',
            )
        return _joined("slurm", asked, reporter)
    if ADDRESS.fullmatch(place):
        return _joined(place, None, reporter)
    raise InputError(
        where,
        found=f'"{place}"',
        expected='"local", "slurm", or the address of a Dask scheduler, tcp://host:8786',
        remedy="correct it, or leave it out to compute on this machine",
    )


def _place(compute: ComputeTable, where: Callable[[str], str]) -> tuple[str, str]:
    """The setting, and where it stands."""
    asked = os.environ.get(VARIABLE, "").strip()
    if asked:
        return asked, f"environment variable {VARIABLE}"
    written, place = compute.workers, where("compute.workers")
    if "://" in written:
        raise InputError(
            place,
            found=f'"{written}"',
            expected="an address that you trust: the program there can run code here, and this file may come from others",
            remedy=f"if you trust it: export {VARIABLE}={written}",
        )
    return written, place


def has_joined() -> bool:
    """Return whether this process has joined a cluster, which it leaves at its end."""
    return bool(_JOINED)


_JOINED: dict[tuple[str, SlurmTable | None], Any] = {}  # Clusters that this process has joined


def _joined(place: str, asked: SlurmTable | None, reporter: Reporter) -> Any:
    try:
        import dask_jobqueue  # noqa: F401  (needed where jobs are submitted)

        from seatrial.campaign.compute.dask_workers import DaskWorkers
    except ImportError as cause:
        raise InputError(
            f"workers {place}",
            found=f"no package {cause.name}",
            expected="Dask, to reach other machines",
            remedy=install_extra("cluster"),
        ) from cause
    workers = _JOINED.get((place, asked))
    if workers is None or not workers.is_there:
        workers = DaskWorkers(place if asked is None else submit_jobs(asked), place, reporter)
        atexit.register(workers.close)
        workers.greet()
        _JOINED[place, asked] = workers
    workers.reporter = reporter
    return workers
