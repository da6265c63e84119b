"""Trials out: the same control at every time in every format, limits repeated, and neutral at the end."""

import csv
import json
import sys

import numpy as np
import pytest
import xarray as xr

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.design.schedule import find_schedules, write_schedule
from seatrial.campaign.design.sweep import design_key
from seatrial.campaign.store.stored_result import Store, write_dataset
from seatrial.core.errors import InputError
from seatrial.export.trials.trial import read_trial, value_at
from seatrial.export.trials.write import FORMATS, STEP, write_trial
from tests.campaign.small import write_small

RPM = 30 / np.pi


@pytest.fixture
def folder(tmp_path):
    campaign = load_campaign(
        write_small(tmp_path / "c", ('upper = "1500 rpm"', 'upper = "1500 rpm"\nrate = "4000 rpm/s"'))
    )
    store = Store(campaign.folder)
    write_schedule(store.schedule(store.design), campaign.family.manoeuvre(20.0, 8.0), 0.1)
    return campaign.folder


def test_the_trial_is_the_schedule_with_its_limits(folder):
    trial = read_trial(folder)
    family = load_campaign(folder).family
    time, control = family.manoeuvre(20.0, 8.0).sample(0.1)
    np.testing.assert_allclose(value_at(trial, time), control, atol=1e-6)
    assert (trial.lower, trial.rate) == (0.0, pytest.approx(4000 / RPM))
    assert trial.lines[1] == "limits of n: lower 0 rpm, upper 1500 rpm, rate 4000 rpm/s"


def test_an_end_below_the_lower_limit_is_said_to_be_intended(folder):
    assert read_trial(folder).lines[2] == "at its end n goes to neutral, 0 rpm"
    path = folder / "campaign.toml"
    path.write_text(path.read_text().replace('lower = "0 rpm"', 'lower = "600 rpm"'))
    said = read_trial(folder).lines[2]
    assert said.startswith("at its end n goes to neutral, 0 rpm: this is below its lower limit, and intended")


def test_the_proposed_trial_comes_first(folder):
    store = Store(folder)
    write_schedule(store.proposed, load_campaign(folder).family.manoeuvre(10.0, 4.0), 0.1)
    assert list(find_schedules(folder)) == ["proposed", "design"]
    assert read_trial(folder).source == "proposed_schedule.csv"
    assert read_trial(folder, "design").source == "design_schedule.csv"
    with pytest.raises(InputError, match='did you mean "design"'):
        read_trial(folder, "desing")


def test_a_trial_that_breaks_limits_of_today_is_refused(folder):
    path = folder / "campaign.toml"
    path.write_text(path.read_text().replace("1500 rpm", "1250 rpm"))
    with pytest.raises(InputError, match="within the campaign's limit of 1250 rpm"):
        read_trial(folder)


def test_a_trial_of_a_design_that_is_stale_says_so_in_every_file(folder):
    """Today's limits of the motion stand at its head; nobody has judged whether it keeps them."""
    campaign = load_campaign(folder)
    write_dataset(Store(folder).design, xr.Dataset(), design_key(campaign))
    assert read_trial(folder).caution == ""
    path = folder / "campaign.toml"
    path.write_text(path.read_text() + '\n[limits.distance]\nupper = "5 m"\n')
    trial = read_trial(folder)
    assert "limit of the motion: distance travelled at most 5 m" in trial.lines
    assert f"caution: {trial.caution}" in trial.lines
    assert "seatrial design" in trial.caution


@pytest.mark.parametrize("damage", [lambda text: text[:30], lambda text: "", lambda text: text.replace("0,", "1,", 1)])
def test_a_schedule_that_people_read_otherwise_than_it_is_exported_is_refused(folder, damage):
    path = Store(folder).schedule(Store(folder).design)
    path.write_text(damage(path.read_text()))
    with pytest.raises(InputError, match="other rows than in design_schedule"):
        read_trial(folder)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{}",
        "[]",
        '{"control": 3, "unit": "rpm", "manoeuvre": "x", "time_s": [0, 1], "value": [1, 1]}',
        '{"control": "n", "unit": "deg", "manoeuvre": "x", "time_s": [0], "value": [1]}',
        '{"control": "n", "unit": "rpm", "manoeuvre": "x", "time_s": [0, 1], "value": [1, NaN]}',
        '{"control": "n", "unit": "rpm", "manoeuvre": "x", "time_s": [0, Infinity], "value": [1, 1]}',
    ],
)
def test_a_damaged_schedule_is_refused(folder, text):
    (folder / "results" / "design_schedule.json").write_text(text)
    with pytest.raises(InputError, match=r"design_schedule\.json"):
        read_trial(folder)


def test_no_schedule_names_the_command_that_makes_one(tmp_path):
    with pytest.raises(InputError, match="seatrial design"):
        read_trial(write_small(tmp_path / "c"))


def test_text_formats_hold_the_same_trial(folder, tmp_path):
    trial = read_trial(folder)
    table, content, script = (path.read_text() for path in write_trial(trial, tmp_path / "out"))
    for text in (table, content, script):
        for line in trial.lines:
            assert line in text
    rows = list(csv.reader(line for line in table.splitlines() if line[0] != "#"))
    assert rows[0] == ["time_s", "n_rpm"]
    designed = np.column_stack([trial.time, trial.value * RPM])
    np.testing.assert_allclose(np.array(rows[1:-1], float), designed, rtol=1e-9)
    np.testing.assert_allclose(json.loads(content)["value_si"], [*trial.value, 0.0])
    assert [float(x) for x in rows[-1]] == [designed[-1, 0], 0.0], "neutral where the trial ends at trim"
    assert json.loads(content)["value"][-1] == 0.0
    assert json.loads(content)["limits_si"]["upper"] == pytest.approx(1500 / RPM)
    with pytest.raises(InputError, match='did you mean "mcap"'):
        write_trial(trial, tmp_path / "out", ("mpac",))
    assert set(FORMATS) == {"csv", "json", "mavlink", "ros2", "mcap"}


@pytest.mark.parametrize("storage", ["mcap", "ros2"])
def test_bags_hold_a_command_every_50_ms(folder, tmp_path, storage):
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import Reader
    from rosbags.typesys import Stores, get_typestore

    trial = read_trial(folder)
    for _ in range(2):
        (path,) = write_trial(trial, tmp_path / "out", (storage,))
    store = get_typestore(Stores.ROS2_HUMBLE)
    with Reader(path) as reader:
        rows = [(c.topic, t, store.deserialize_cdr(data, c.msgtype).data) for c, t, data in reader.messages()]
    about = [json.loads(value) for topic, _, value in rows if topic == "/seatrial/about"]
    times, values = np.array([(t / 1e9, x) for topic, t, x in rows if topic == "/seatrial/command/n"]).T
    assert about[0]["limits_si"]["lower"] == 0.0
    np.testing.assert_allclose(np.diff(times), 0.05, atol=1e-9)
    within = times <= trial.time[-1] + 1e-9
    np.testing.assert_allclose(values[within], value_at(trial, times[within]), atol=1e-9)
    assert values[within][-1] > 100.0
    assert values[~within].tolist() == [0.0] * 20, "a second of neutral"
    assert [one.name for one in (tmp_path / "out").iterdir()] == [path.name], "nothing half-written"


def test_without_the_library_the_extra_is_named(folder, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    with pytest.raises(InputError, match=r"pip install -e .*\[ros\]"):
        write_trial(read_trial(folder), tmp_path / "out", ("mcap",))
    assert STEP == 0.05
    assert not (tmp_path / "out").exists()
