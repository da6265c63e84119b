"""A campaign on two workers of a cluster gives the bits it gives here, also when a worker or the scheduler is killed in the middle."""

import os
import re
import shutil
import signal
import subprocess
import sys
import threading

import pytest
import xarray as xr
from distributed import LocalCluster

from seatrial.campaign.compute import place
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.design.sweep import design_first
from seatrial.campaign.inference.calibration import calibrate
from seatrial.campaign.inference.estimate import estimate_all
from seatrial.campaign.selection.evidence import select_structure
from seatrial.campaign.store.stored_result import Store
from seatrial.core.errors import InputError
from tests.campaign.small import NO_X_U, write_small

pytestmark = [pytest.mark.proof, pytest.mark.timeout(600)]
METHOD, REPLICATES = "independence-metropolis", 16
GRID = ('period = { from = "2 s", to = "20 s", points = 4 }', 'period = { from = "2 s", to = "20 s", points = 40 }')
"""Of more designs than one block holds."""


class At:
    """A watch that does something once, at a progress that is told in this thread: as a result is there, and not by a report."""

    def __init__(self, when, act):
        self.when, self.act = when, act

    def say(self, text):
        """Nothing."""

    def progress(self, title):
        def told(done, total):
            here = threading.current_thread() is threading.main_thread()
            if here and self.act is not None and self.when(title, done):
                act, self.act = self.act, None
                act()

        return told


@pytest.fixture(scope="module")
def here(tmp_path_factory):
    """The campaign as computed on this machine."""
    campaign = load_campaign(write_small(tmp_path_factory.mktemp("bits") / "here", *NO_X_U, GRID))
    trials = get_trials(campaign)
    estimate_all(campaign, trials)
    select_structure(campaign, trials)
    calibrate(campaign, trials, REPLICATES, METHOD)
    return campaign


@pytest.fixture
def there(here, tmp_path):
    """The same campaign with nothing computed but its trial."""
    campaign = load_campaign(write_small(tmp_path / "there", *NO_X_U, GRID))
    shutil.copytree(Store(here.folder).results / "records", Store(campaign.folder).results / "records")
    return campaign


def assert_same(here, there, path):
    paths = [path(Store(campaign.folder)) for campaign in (here, there)]
    xr.testing.assert_identical(*(xr.load_dataset(one, engine="h5netcdf") for one in paths))


def test_a_campaign_with_a_worker_killed_in_every_part(here, there, monkeypatch):
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0", silence_logs=50) as cluster:
        monkeypatch.setenv(place.VARIABLE, cluster.scheduler_address)
        killed = []

        def kill_one():
            pids = place.workers_of(there).client.run(os.getpid, on_error="return").values()
            killed.append(max(pid for pid in pids if isinstance(pid, int)))
            os.kill(killed[-1], signal.SIGKILL)

        design_first(there)
        trials = get_trials(there)
        calibrate(there, trials, REPLICATES, METHOD, At(lambda title, done: done == 3, kill_one))
        estimate_all(there, trials, At(lambda title, done: done >= 500, kill_one))
        selection = select_structure(there, trials, At(lambda title, done: done > 0, kill_one))
        assert len(set(killed)) == len(killed) == 3
    assert_same(here, there, lambda store: store.design)
    assert_same(here, there, lambda store: store.calibration(METHOD))
    assert_same(here, there, lambda store: store.posterior("M-0"))
    assert selection.rows == select_structure(here, trials).rows
    assert not list(there.folder.rglob("*.npz"))


@pytest.fixture
def scheduler():
    """A scheduler and a worker in processes of their own: its address, and its process."""
    command = [sys.executable, "-m", "distributed.cli.dask_scheduler"]
    options = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard"]
    with subprocess.Popen([*command, *options], stderr=subprocess.PIPE, text=True) as started:
        address = next(found[0] for line in started.stderr if (found := re.search(r"tcp://127.0.0.1:\d+", line)))
        worker = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-dashboard"]
        with subprocess.Popen([*worker, "--no-nanny"], stderr=subprocess.DEVNULL) as helper:
            yield address, started
            helper.kill()
        started.kill()
        started.stderr.close()


def test_a_scheduler_that_is_killed_loses_nothing_finished(here, there, scheduler, monkeypatch):
    address, process = scheduler
    monkeypatch.setenv(place.VARIABLE, address)
    trials = get_trials(there)
    with pytest.raises(InputError, match=r"the scheduler is gone; ([0-9]+) of 16 tasks are kept") as caught:
        calibrate(there, trials, REPLICATES, METHOD, At(lambda title, done: done == 5, process.kill))
    kept = int(re.search(r"([0-9]+) of 16", str(caught.value))[1])
    assert 5 <= kept < 16
    monkeypatch.setenv(place.VARIABLE, "local")
    told = []
    calibrate(there, trials, REPLICATES, METHOD, At(lambda title, done: told.append(done), lambda: None))
    assert told[0] == kept
    assert_same(here, there, lambda store: store.calibration(METHOD))
