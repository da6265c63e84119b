"""The interface to whatever does a campaign's work: one conformance test over all kinds, and what is said where one is not there."""

import os
import pickle
import signal
import sys
import threading
import time
from dataclasses import replace
from importlib.metadata import version

import numpy as np
import pytest
from dask_jobqueue.slurm import SLURMCluster
from distributed import LocalCluster

from seatrial.campaign.compute import dask_workers, place
from seatrial.campaign.compute.dask_workers import DaskWorkers
from seatrial.campaign.compute.place import job_options, submit_jobs
from seatrial.campaign.compute.shared_work import Study
from seatrial.campaign.compute.workers import LocalWorkers
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.config.schema import ComputeTable, SlurmTable
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.design.sweep import design_key
from seatrial.campaign.inference.calibration import estimate_key
from seatrial.campaign.rehearsal.run import rehearsal_key
from seatrial.campaign.selection.evidence import evidence_key
from seatrial.campaign.selection.screening import stored_screening
from seatrial.core.errors import InputError, NumericalError
from seatrial.core.record import Channel, Provenance, make_record
from tests.campaign.small import write_small
from tests.campaign.tiny_work import mute, power, slowly

WITH = "[estimation]\nchains = 16"
GOAL = '[goal]\nsd = { X_u = "10 %" }\n'


class Heard:
    """A watch that keeps what is said."""

    def __init__(self):
        self.lines = []

    def say(self, text):
        self.lines.append(text)

    def progress(self, title):
        return lambda done, total: None


@pytest.fixture(scope="module")
def cluster():
    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50
    ) as started:
        yield started


@pytest.fixture(scope="module")
def joined(cluster):
    joined = DaskWorkers(cluster.scheduler_address, "the test's")
    yield joined
    joined.close()


@pytest.fixture(params=["local", "dask"])
def workers(request):
    return LocalWorkers(2) if request.param == "local" else request.getfixturevalue("joined")


def test_every_result_comes_once_and_pieces_go_on(workers):
    """Each item is raised by one until it reaches 6; what is done and what follows is the caller's to say."""
    found, threads = {}, set()

    def done(index, result):
        threads.add(threading.get_ident())
        found.setdefault(index, []).append(result)
        exponent = len(found[index]) + index
        return exponent if exponent <= 6 else None

    workers.run(power, 2.0, list(range(7)), done)
    assert found == {i: [2.0**e for e in range(i, 7)] for i in range(7)}
    assert threads == {threading.get_ident()}


def test_no_items_no_work(workers):
    workers.run(power, 2.0, [], lambda index, result: pytest.fail("nothing was asked for"))


def test_arrays_are_the_same_to_the_last_bit(workers):
    shared, found = np.random.default_rng(0).normal(size=1000), {}
    workers.run(power, shared, [3, 5], found.__setitem__)
    assert {i: value.tobytes() for i, value in found.items()} == {0: (shared**3).tobytes(), 1: (shared**5).tobytes()}


def test_reports_arrive(workers):
    told = []
    workers.run(slowly, 1.2, ["a", "b"], lambda index, result: None, lambda *report: told.append(report))
    assert {index for index, _, _ in told} == {0, 1}
    assert all(0 <= done < total == 6 for _, done, total in told)


@pytest.mark.parametrize(
    ("item", "error", "words"),
    [(-1, InputError, "expected: 0 or more"), (-2, NumericalError, "it diverges"), (-3, ZeroDivisionError, "of ours")],
)
def test_errors_arrive_whole_and_what_was_done_is_kept(workers, item, error, words):
    found = {}
    with pytest.raises(error, match=words) as caught:
        workers.run(power, 2.0, [*range(30), item], found.__setitem__)
    assert found
    assert found == {i: 2.0**i for i in found}
    assert item != -1 or (caught.value.where, caught.value.remedy) == ("here", "another")


def test_an_interrupt_cancels_what_is_left(cluster, joined):
    def interrupted(index, result):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        joined.run(slowly, 0.05, list(range(50)), interrupted)
    deadline = time.monotonic() + 20
    while any("slowly" in str(key) for key in cluster.scheduler.tasks):
        assert time.monotonic() < deadline
        time.sleep(0.05)


def test_a_killed_worker_costs_its_task_only(joined):
    found, victims = {}, list(joined.client.run(os.getpid).values())

    def done(index, result):
        found[index] = result
        if len(found) == 3:
            os.kill(victims[0], signal.SIGKILL)

    joined.run(slowly, 0.1, list(range(20)), done)
    assert found == {i: i for i in range(20)}
    joined.client.wait_for_workers(2, timeout=60)
    assert victims[0] not in joined.client.run(os.getpid).values()


def test_how_many_and_how_much_memory_is_said(joined, monkeypatch):
    monkeypatch.setattr(dask_workers, "LOOK", 0.05)
    monkeypatch.setattr(dask_workers, "SAY", 0.1)
    heard = Heard()
    monkeypatch.setattr(joined, "reporter", heard)
    joined.greet()
    joined.run(slowly, 0.6, [1, 2], lambda index, result: None)
    assert heard.lines[0].startswith("2 workers at the test's")
    assert any("of 2 tasks; 2 workers, memory of each" in line for line in heard.lines[1:])


def test_another_version_is_refused_at_once_and_also_from_one_that_joins_late(joined, monkeypatch):
    monkeypatch.setattr(joined, "ours", {**joined.ours, "jax": "9.9"})
    for attempt in (lambda: joined.greet(), lambda: joined.run(power, 2.0, [1], lambda *_: None)):
        with pytest.raises(InputError) as caught:
            attempt()
        assert caught.value.where.startswith("the worker tcp://")
        assert (caught.value.found, caught.value.expected) == (f"jax {version('jax')}", "jax 9.9, as here")


def test_another_version_of_ours_at_the_scheduler_is_refused(joined, monkeypatch):
    monkeypatch.setattr(joined, "ours", {**joined.ours, "seatrial": "9.9"})
    with pytest.raises(InputError, match=r"expected: seatrial 9\.9, as here") as caught:
        joined.greet()
    assert caught.value.where == "the scheduler at the test's"


def test_a_process_that_cannot_import_us_is_named(joined, monkeypatch):
    monkeypatch.setattr(dask_workers, "about", mute)
    with pytest.raises(InputError, match="No module named 'seatrial'") as caught:
        joined.greet()
    assert caught.value.where == "the scheduler at the test's"


def test_another_dask_is_refused(cluster, joined, monkeypatch):
    monkeypatch.setattr(dask_workers, "environment", lambda: {**joined.ours, "distributed": "1999.1"})
    with pytest.raises(InputError, match=r"expected: distributed 1999\.1, as here"):
        DaskWorkers(cluster.scheduler_address, "the test's")


def test_a_scheduler_that_is_not_there(monkeypatch):
    monkeypatch.setattr(dask_workers, "CONNECT", 0.5)
    with pytest.raises(InputError, match=r"no answer of a scheduler within 0\.5 s"):
        DaskWorkers("tcp://127.0.0.1:1", "tcp://127.0.0.1:1")


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    return load_campaign(write_small(tmp_path_factory.mktemp("workers") / "small", (WITH, GOAL + WITH)))


def with_compute(campaign, **settings):
    return replace(campaign, compute=ComputeTable(**settings))


def test_where_is_one_setting_and_the_environment_overrides_it(small, monkeypatch):
    monkeypatch.delenv(place.VARIABLE, raising=False)
    assert isinstance(place.workers_of(small), LocalWorkers)
    monkeypatch.setenv(place.VARIABLE, "local")
    assert isinstance(place.workers_of(with_compute(small, workers="slurm")), LocalWorkers)


@pytest.mark.parametrize(
    ("written", "asked", "where", "words"),
    [
        ("everywhere", "", "key compute.workers", 'found:    "everywhere"'),
        ("local", "host:8786", f"environment variable {place.VARIABLE}", "tcp://host:8786"),
        ("local", "tcp://host", f"environment variable {place.VARIABLE}", "tcp://host:8786"),
        ("tcp://host:8786", "", "key compute.workers", f"export {place.VARIABLE}=tcp://host:8786"),
        ("slurm", "", "key compute.slurm", "walltime"),
    ],
)
def test_impossible_workers_are_refused_with_their_setting(small, monkeypatch, written, asked, where, words):
    monkeypatch.setenv(place.VARIABLE, asked)
    with pytest.raises(InputError, match=words) as caught:
        place.workers_of(with_compute(small, workers=written))
    assert where in caught.value.where


def test_without_dask_the_extra_is_named(small, monkeypatch):
    monkeypatch.setenv(place.VARIABLE, "tcp://127.0.0.1:1")
    monkeypatch.delitem(sys.modules, "seatrial.campaign.compute.dask_workers")
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r'pip install -e "\.\[cluster\]"'):
        place.workers_of(small)


def record(n=60):
    random = np.random.default_rng(1)
    channels = (Channel("n", "rad/s", "control"), Channel("u", "m/s", "measurement"))
    columns = {"n": 125.0 + random.normal(size=n), "u": 1.5 + 0.1 * random.normal(size=n)}
    return make_record(0.1 * np.arange(n), columns, channels, Provenance("made up", ""), "trial")


def test_no_key_of_a_result_knows_where_it_was_computed(small):
    elsewhere, trials = with_compute(small, workers="slurm"), Trials((record(),), (), "the trials'")
    for key in (design_key, rehearsal_key, lambda one: stored_screening(one, trials).key):
        assert key(small) == key(elsewhere)
    for structure in small.structures:
        for key in (estimate_key, evidence_key):
            assert key(small, structure, trials) == key(elsewhere, structure, trials)


def test_a_study_travels_as_data_and_is_built_where_it_arrives(small):
    study = Study(small, [record()], "by a method")
    here = study.posterior(small.full)
    sent = pickle.dumps(study)
    there = pickle.loads(sent)
    assert there.extra == "by a method"
    assert there.posterior(there.campaign.full).names == here.names
    assert there.posterior(there.campaign.full) is there.posterior(there.campaign.full)
    assert len(sent) < 20_000
    assert len(pickle.dumps(there)) < 20_000


def test_what_has_been_built_is_built_once(small):
    study, made = Study(small), []
    workers = [threading.Thread(target=lambda: study.once("it", lambda: made.append(time.sleep(0.05)))) for _ in "1234"]
    for one in workers:
        one.start()
    for one in workers:
        one.join()
    assert len(made) == 1


SLURM = SlurmTable(memory="16GB", walltime="04:00:00", cores=8, jobs=5, queue="short", account="hydro", interface="lo")


@pytest.mark.filterwarnings("ignore:Port 8787:UserWarning")
def test_the_job_that_slurm_is_given():
    with SLURMCluster(**job_options(SLURM)) as cluster:
        script = cluster.job_script()
    for line in ("-p short", "-A hydro", "-n 1", "--cpus-per-task=8", "--mem=15G", "-t 04:00:00", "-J seatrial"):
        assert f"#SBATCH {line}\n" in script
    assert f"{sys.executable} -m distributed.cli.dask_worker tcp://127.0.0.1:" in script
    for option in ("--nthreads 1 ", "--nworkers 8 ", "--memory-limit 1.86GiB ", "--interface lo"):
        assert option in script


def test_missing_sbatch_is_reported(monkeypatch):
    monkeypatch.setenv("PATH", "")
    with pytest.raises(InputError, match="no command sbatch"):
        submit_jobs(SLURM)


@pytest.mark.parametrize(
    "table",
    ['queue = "a\\nrm -rf ~"', 'queue = "a; rm"', 'account = "$(id)"', 'interface = "a b"', 'memory = "1GB; id"'],
)
def test_nothing_in_a_campaign_becomes_a_command_of_a_job(tmp_path, table):
    needed = "" if "memory" in table else 'memory = "1GB"\n'
    written = f'[compute]\nworkers = "slurm"\n[compute.slurm]\nwalltime = "1:00"\n{needed}{table}\n'
    with pytest.raises(InputError, match=r"compute\.slurm"):
        load_campaign(write_small(tmp_path / "small", (WITH, written + WITH)))
