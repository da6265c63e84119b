"""What is current, stale or missing, as `seatrial run` would find it, without computing anything."""

import os
import shutil
import time
from dataclasses import replace
from types import SimpleNamespace

import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.data.simulate import record_keys
from seatrial.campaign.design.sweep import design_key
from seatrial.campaign.store.stored_result import Store, write_stamped_json
from seatrial.campaign.workflow.status import standing
from seatrial.campaign.workflow.steps import NotCurrent
from seatrial.core.dataset_file import write_dataset
from seatrial.core.errors import InputError
from seatrial.selection.structures import Structure
from seatrial.selection.verdict import Evidence, select
from tests.campaign.small import LOGGED, write_small

STEPS = ["design", "simulate", "estimate", "select", "predict", "next", "report"]


def states(folder):
    return {step.name: step.state for step in standing(folder)}


def stamped(path, key):
    import xarray as xr

    write_dataset(path, xr.Dataset({"x": ("y", [1.0])}, attrs={"key": key}))


def test_a_new_campaign_has_nothing(tmp_path):
    assert states(write_small(tmp_path)) == dict.fromkeys(STEPS, "missing")


def test_results_are_current_until_what_they_depend_on_changes(tmp_path):
    folder = write_small(tmp_path)
    campaign, store = load_campaign(folder), Store(folder)
    stamped(store.design, design_key(campaign))
    stamped(store.record("trial"), record_keys(campaign)["trial"])
    found = states(folder)
    assert (found["design"], found["simulate"], found["estimate"]) == ("current", "current", "missing")
    write_small(folder, ('upper = "1500 rpm"', 'upper = "1400 rpm"'))
    found = states(folder)
    assert (found["design"], found["simulate"], found["estimate"]) == ("stale", "stale", "missing")


def test_a_damaged_result_is_stale(tmp_path):
    folder = write_small(tmp_path)
    Store(folder).results.mkdir()
    Store(folder).design.write_bytes(b"\x89HDF")
    write_stamped_json(Store(folder).selection, {}, "another key")
    assert states(folder)["design"] == "stale"
    assert states(folder)["select"] == "stale"


def test_a_current_step_that_failed_a_check_says_so(tmp_path, monkeypatch):
    """The alarms of the posteriors and of an evidence on which a probability depends; a step that is not current has none."""
    from seatrial.campaign.workflow import status as module
    from seatrial.dashboard.pages.overview import steps_html

    class Flow:
        def __init__(self, campaign):
            self.campaign = campaign
            self.state = {"estimates": "current", "selection": "current"}.get

        def stored(self, name):
            return [
                SimpleNamespace(path=name, read={"estimates": lambda: posterior, "selection": lambda: evidence}[name])
            ]

        def seen(self, name):
            raise NotCurrent

    label = SimpleNamespace(label="M-0")
    posterior = SimpleNamespace(structure=label, alarms=["the chains disagree about X_u"])
    doubtful = Evidence(10.0, 0.1, "bridge", {}, "nested sampling <differs>")
    evidence = select((Structure("M-0", ("X_u",)), Structure("M-1", ())), (doubtful, replace(doubtful, status="")), [])
    monkeypatch.setattr(module, "Workflow", Flow)
    found = {step.name: step for step in standing(write_small(tmp_path))}
    assert found["estimate"].alarms == ("M-0: the chains disagree about X_u",)
    (alarm,) = found["select"].alarms
    assert alarm.startswith("the evidence of M-0 is not reliable: nested sampling <differs>; ")
    assert found["predict"].alarms == ()
    html = steps_html(tuple(found.values()))
    assert html.count('class="failed"') == 2
    assert "nested sampling &lt;differs&gt;; a verdict" in html


def test_a_log_is_hashed_anew_only_when_it_changes(tmp_path, monkeypatch):
    from seatrial.campaign.workflow import steps as module

    folder = write_small(tmp_path, LOGGED)
    assert states(folder)["import"] == "missing"
    log, hashed = folder / "log_1.csv", []
    log.write_text("t,speed,rpm\n0,1,1\n")
    plain = module.hash_of_log
    monkeypatch.setattr(module, "hash_of_log", lambda path: hashed.append(path) or plain(path))
    states(folder)
    states(folder)
    assert len(hashed) == 1
    time.sleep(0.01)
    log.write_text("t,speed,rpm\n0,1,2\n")
    states(folder)
    assert len(hashed) == 2


def test_records_of_a_copied_campaign_are_current_and_follow_what_the_log_says(tmp_path):
    folder = write_small(tmp_path / "camp", LOGGED)
    rows = [f"{0.1 * i:.1f},{1.5 + 0.01 * (i % 7)},{1200 + 100 * (i // 50 % 2)}" for i in range(300)]
    (folder / "log_1.csv").write_text("\n".join(["t,speed,rpm", *rows]) + "\n")
    get_trials(load_campaign(folder))
    assert states(folder)["import"] == "current"
    copy = tmp_path / "camp2"
    shutil.copytree(folder, copy, copy_function=shutil.copyfile)
    os.utime(copy / "log_1.csv", (2e9, 2e9))
    assert states(copy) == states(folder)
    (copy / "log_1.csv").write_text("\n".join(["t,speed,rpm", *rows, "30.0,1.5,1200"]) + "\n")
    os.utime(copy / "log_1.csv", (1e9, 1e9))
    assert states(copy)["import"] == "stale"


def test_a_file_that_is_no_campaign(tmp_path):
    (tmp_path / "campaign.toml").write_text("[campaign\n")
    with pytest.raises(InputError, match="malformed"):
        standing(tmp_path)
