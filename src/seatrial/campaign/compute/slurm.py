"""Workers that SLURM starts: dask-jobqueue submits a job for each group of processes; the scheduler is a part of this process."""

import shutil
import sys
from typing import Any

from dask_jobqueue.slurm import SLURMCluster

from seatrial.campaign.schema import SlurmTable
from seatrial.core.errors import InputError


def job_options(table: SlurmTable) -> dict[str, Any]:
    """Options of `SLURMCluster`: one process of one thread for each core."""
    return {
        "queue": table.queue,
        "account": table.account,
        "cores": table.cores,
        "processes": table.cores,
        "memory": table.memory,
        "walltime": table.walltime,
        "interface": table.interface,
        "python": sys.executable,
        "job_name": "seatrial",
        "worker_extra_args": ["--no-dashboard"],
    }


def submit_jobs(table: SlurmTable) -> SLURMCluster:
    """Submit the jobs that the table asks for; their workers join as SLURM starts them.

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
    cluster = SLURMCluster(**job_options(table))
    cluster.scale(jobs=table.jobs)
    return cluster
