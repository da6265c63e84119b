"""What pages say of results: where to go on, what colours mean, what a column is."""

import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from markupsafe import Markup

from seatrial.apps.dashboard.jobs import Jobs, log_of
from seatrial.apps.dashboard.page_layout import VIEWS
from seatrial.apps.dashboard.pages.design import legend_html
from seatrial.apps.dashboard.pages.record_chart import RecordChart
from seatrial.apps.dashboard.pages.results import estimated, next_html
from seatrial.apps.dashboard.view_models import beside
from seatrial.campaign.store.stored_result import Store
from seatrial.core.errors import InputError


def test_after_stop_no_link_leads_to_the_next_trial(tmp_path):
    store = Store(tmp_path)
    schedule = store.schedule(store.next_design)
    schedule.parent.mkdir(parents=True)
    schedule.write_text("time_s,n_rpm\n")
    run = next_html(Markup("run a doublet"), False, "boat", store)
    assert run.count("href=") == 2
    stop = next_html(Markup("stop: the goal is met"), True, "boat", store)
    assert stop == "<p>stop: the goal is met</p>"


def test_grey_is_explained_where_a_design_breaks_a_limit():
    assert "breaks a limit" in legend_html(np.array([[1.0, np.nan]]))
    assert "grey" not in legend_html(np.array([[1.0, 2.0]]))


@pytest.mark.parametrize(("imported", "label"), [(True, "logged"), (False, "commanded")])
def test_a_control_of_a_log_is_not_called_commanded(tmp_path, imported, label):
    chart = RecordChart(SimpleNamespace(), tmp_path, SimpleNamespace(imported=imported), [])  # pyright: ignore[reportArgumentType]
    assert chart._panel("n", "rpm", "control").curves[0].label == label
    assert chart._panel("u", "m/s", "measurement").curves[0].label == "measured"


def test_the_last_check_is_seen_whatever_was_started_since(tmp_path):
    jobs = Jobs(prepares=False)
    for age, (command, output) in enumerate([("check", "record 1: pass"), ("prior", "steady speed")]):
        log = log_of(tmp_path, command)
        log.parent.mkdir(exist_ok=True)
        log.write_text(f"$ seatrial {command} boat\n{output}\n")
        os.utime(log, (age, age))
    assert (jobs.look(tmp_path).word, jobs.look(tmp_path).output) == ("prior", "steady speed\n")
    assert (jobs.last_check(tmp_path).word, jobs.last_check(tmp_path).output) == ("check", "record 1: pass\n")


def test_an_error_beside_its_field_names_no_line_of_the_file():
    error = InputError(
        "campaign.toml:31, key a.b", found='unit "kg"', expected='a unit like "m/s"', remedy="correct it"
    )
    assert beside(error) == 'unit "kg": expected a unit like "m/s"; correct it'


def test_estimates_stand_by_structure_before_a_model_is_chosen(tmp_path):
    store = Store(tmp_path)
    store.coefficients.parent.mkdir(parents=True)
    head = "structure,name,unit,mean,sd,model_error_sd,model_error_cause\n"
    rows = "M-0,X_u,kg/s,-1.25,0.23,,\nM-0,sigma_u,m/s,0.05,0.002,,\nM-1,X_uabsu,kg/m,-3.92,0.13,0.478,a force X_u\n"
    store.coefficients.write_text(head + rows)
    first, second = estimated(store).split("<caption>")[1:]
    assert first.startswith("Parameters of M-0: X_u<")
    assert "−1.25 ± 0.23" in first
    assert "with model error" not in first
    assert '<th scope="col">with model error' in second
    assert "± 0.478 <small>a force X_u</small>" in second
    assert '<th scope="col">mean ± sd, within the model' in second
    assert '<td data-head="with model error">± 0.478' in second  # on a narrow screen, where the head is above each cell


def test_every_view_stands_in_its_documentation():
    text = (Path(__file__).parents[3] / "docs" / "dashboard.md").read_text()
    assert [name for name in VIEWS.values() if f"\n| {name} |" not in text] == []
