"""The whole loop on a small campaign: what it leaves on disk and what it recomputes."""

import json
import os
import shutil
import subprocess

import jax
import numpy as np
import pytest
import xarray as xr

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.design.sweep import design_first
from seatrial.campaign.store.stored_result import Store, stamp_of
from seatrial.campaign.workflow.loop import run_loop
from seatrial.campaign.workflow.status import standing
from seatrial.cli.answer import Exit
from seatrial.cli.main import main
from seatrial.core.errors import InputError
from seatrial.core.files import watching_files
from seatrial.core.reporter import SilentReporter
from seatrial.report.page import write_report
from tests.campaign.small import SMALL, hearing_of_files


def test_truth_is_inside_the_stated_uncertainty(finished):
    _, outcome = finished
    truth = outcome.campaign.truth
    for row in outcome.summary.coefficients:
        if row.name in truth:
            assert abs(row.mean - truth[row.name]) < 4 * row.sd


def test_probabilities_and_words_are_complete(finished):
    _, outcome = finished
    summary = outcome.summary
    assert sum(item.probability for item in summary.structures) == pytest.approx(1.0)
    assert len(summary.structures) == 2
    assert any("X_u" in verdict for verdict in summary.verdicts)
    assert summary.next_trial.best.gain_nat > 0
    assert summary.alarms == ()


def test_results_are_plain_files_others_can_read(finished):
    folder, _ = finished
    store = Store(folder)
    record = xr.load_dataset(store.record("trial"), engine="h5netcdf")
    assert record["u"].attrs["units"] == "m/s"
    assert json.loads(store.summary.read_text())["name"] == "small"
    schedule = np.loadtxt(store.schedule(store.design), delimiter=",", skiprows=1)
    assert (np.diff(schedule[:, 0]) > 0).all()
    assert not list(folder.rglob("*.part"))
    assert not list(store.checkpoint("x").parent.glob("*.npz"))


def test_the_schedule_holds_every_edge_of_the_trial(finished):
    folder, outcome = finished
    store = Store(folder)
    schedule = np.loadtxt(store.schedule(store.design), delimiter=",", skiprows=1)
    time_, control = outcome.first.best.best_manoeuvre().sample(outcome.campaign.family.sample_time)
    np.testing.assert_allclose(np.interp(time_, *schedule.T), control * 30 / np.pi, rtol=1e-9)
    assert store.schedule(store.design).read_text().startswith("time_s,n_rpm\n")


def test_a_second_run_computes_nothing(finished):
    folder, _ = finished
    before = {path: path.stat().st_mtime_ns for path in (folder / "results").rglob("*.*")}
    run_loop(load_campaign(folder), SilentReporter())
    assert before == {path: path.stat().st_mtime_ns for path in (folder / "results").rglob("*.*")}


def test_a_copy_is_as_current_as_its_original_whenever_its_files_were_written(finished, tmp_path):
    """A copy gets its files in any order; a page belongs to the summary that it was drawn from, and a summary to all it was made from."""
    folder, outcome = finished
    write_report(outcome)
    copy = tmp_path / "copy"
    subprocess.run(["cp", "-r", str(folder), str(copy)], check=True)

    def states():
        return {step.name: step.state for step in standing(copy)}

    assert set(states().values()) == {"current"}
    for path in copy.rglob("*.*"):
        os.utime(path, (2e9, 2e9) if path.suffix == ".json" else (1e9, 1e9))
    assert set(states().values()) == {"current"}
    text = (copy / "campaign.toml").read_text()
    (copy / "campaign.toml").write_text(text + "# a comment\n")
    assert states()["report"] == "current"
    for old, new in (('name = "small"', 'name = "another"'), ("points = 3 }", "points = 2 }")):
        (copy / "campaign.toml").write_text(text.replace(old, new))
        assert states()["report"] == "stale", new
    assert states()["next"] == "stale"
    (copy / "campaign.toml").write_text(text)
    (copy / "report.html").write_text("<html>of an earlier version</html>")
    assert states()["report"] == "stale"


def test_what_is_said_rests_on_every_file_that_was_opened(finished):
    folder, _ = finished
    with watching_files() as seen, hearing_of_files(folder) as opened:
        write_report(run_loop(load_campaign(folder), SilentReporter()))
    assert {"campaign.toml", "M-0.nc", "selection.json", "trial.nc", "next_schedule.csv"} <= {
        path.name for path in opened
    }
    assert opened <= set(seen)


def test_the_next_trial_needs_few_programs(finished, tmp_path, programs):
    """Of the chosen structure the filter, the fits and the sweep; of two contenders their motions, and what tells them apart."""
    folder, _ = finished
    copy = tmp_path / "copy"
    subprocess.run(["cp", "-r", str(folder), str(copy)], check=True)
    for name in ("filter.nc", "predictions.nc", "next.nc", "contenders.json"):
        (copy / "results" / name).unlink(missing_ok=True)
    campaign = load_campaign(copy)
    jax.clear_caches()
    assert programs(run_loop, campaign, SilentReporter()) <= 6


def test_an_edited_key_recomputes_what_depends_on_it(finished, tmp_path):
    folder, _ = finished
    copy = tmp_path / "copy"
    subprocess.run(["cp", "-r", str(folder), str(copy)], check=True)
    stamps = {
        name: stamp_of(copy / "results" / name)
        for name in ("design.nc", "records/trial.nc", "posterior/M-0.nc", "selection.json")
    }
    text = (copy / "campaign.toml").read_text().replace("repeats = 2", "repeats = 3")
    (copy / "campaign.toml").write_text(text)
    run_loop(load_campaign(copy), SilentReporter())
    changed = {name for name, stamp in stamps.items() if stamp_of(copy / "results" / name) != stamp}
    assert changed == {"selection.json"}


def log_campaign(folder, record):
    """Write a campaign on the log of a record; its programs, to which the name of the run belongs, are those of the simulated one."""
    text = SMALL[: SMALL.index("[truth]")] + SMALL[SMALL.index("[estimation]") :]
    rows = [
        f"{t},{n},{u}" for t, n, u in zip(record["time"].values, record["n"].values, record["u"].values, strict=True)
    ]
    (folder / "log.csv").write_text("\n".join(["t,n,u", *rows]) + "\n")
    channels = 'channels = { n = { column = "n", unit = "rad/s" }, u = { column = "u", unit = "m/s" } }'
    text += f'[import]\nfit = ["trial"]\n[[import.files]]\npath = "log.csv"\ntime = {{ column = "t", unit = "s" }}\n{channels}\n'
    (folder / "campaign.toml").write_text(text)
    return load_campaign(folder)


@pytest.fixture(scope="module")
def logged(finished, tmp_path_factory):
    """A campaign on a log, after its whole loop."""
    record = xr.load_dataset(Store(finished[0]).record("trial"), engine="h5netcdf")
    return run_loop(log_campaign(tmp_path_factory.mktemp("logged"), record), SilentReporter())


@pytest.fixture
def log_folder(logged, tmp_path):
    """A copy of it, whose posterior stays current whatever is designed."""
    shutil.copytree(logged.campaign.folder, tmp_path, dirs_exist_ok=True)
    return tmp_path


def test_a_log_for_which_nothing_was_designed_is_fitted_and_the_next_trial_designed(logged):
    folder = logged.campaign.folder
    assert logged.first is logged.promised is None
    assert logged.summary.next_trial.best.gain_nat > 0
    write_report(logged)
    assert {step.name: step.state for step in standing(folder)}["report"] == "current"
    design_first(logged.campaign)
    assert {step.name: step.state for step in standing(folder)}["report"] == "stale"
    Store(folder).design.unlink()


@pytest.mark.proof
def test_what_was_found_is_kept_where_no_next_trial_is_allowed(log_folder, monkeypatch, capsys):
    """No trial of 30 s stays within a metre: an alarm for who asks which trial is next, unless the goal is met without one."""
    with (log_folder / "campaign.toml").open("a") as file:
        file.write('[limits.distance]\nupper = "1 m"\n')
    outcome = run_loop(load_campaign(log_folder), SilentReporter())
    assert outcome.next is None
    words = outcome.summary.next_trial.words
    assert words.startswith("no trial is proposed: ")
    assert "distance travelled at most 1 m" in words
    assert outcome.summary.alarms == ()
    assert "distance travelled at most 1 m" in write_report(outcome).read_text()
    assert _next_of(log_folder, monkeypatch) == Exit.ALARMS
    assert "distance travelled at most 1 m" in capsys.readouterr().out
    with (log_folder / "campaign.toml").open("a") as file:
        file.write('[goal]\nsd = { X_uabsu = "90 %" }\n')
    assert _next_of(log_folder, monkeypatch) == Exit.OK


def _next_of(folder, monkeypatch):
    """Exit code of `seatrial next`."""
    monkeypatch.setattr("sys.argv", ["seatrial", "next", str(folder), "--quiet"])
    with pytest.raises(SystemExit) as ended:
        main()
    return ended.value.code


def test_a_log_is_fitted_and_reported_without_a_design(log_folder):
    """What designs a trial is refused with the key to add; a campaign without logs needs it."""
    path = log_folder / "campaign.toml"
    text = path.read_text()
    text = text[: text.index("[design]")] + text[text.index("[estimation]") :]
    path.write_text(text)
    campaign = load_campaign(log_folder)
    outcome = run_loop(campaign, SilentReporter())
    assert outcome.summary.next_trial.best is None
    assert "add [design] to the campaign" in outcome.summary.next_trial.words
    assert "The next trial" not in write_report(outcome).read_text()
    with pytest.raises(InputError, match=r"key design\n"):
        design_first(campaign)
    path.write_text(text[: text.index("[import]")])
    with pytest.raises(InputError, match='control = "n"'):
        load_campaign(log_folder)
