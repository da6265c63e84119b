"""Trials out: the same control at every time in every format, limits repeated, and a script that comes back to neutral."""

import csv
import json
import signal
import subprocess
import sys

import numpy as np
import pytest

from seatrial.campaign.load import load_campaign
from seatrial.campaign.schedules import write_schedule
from seatrial.campaign.store import Store
from seatrial.core.errors import InputError
from seatrial.export.trials import bag
from seatrial.export.trials.trial import read_trial, schedules, value_at
from seatrial.export.trials.write import FORMATS, write_trial
from tests.campaign.small import write_small

RPM = 30 / np.pi
FAKE = '''
"""Stands for pymavlink: it writes what is sent, and its heartbeat stops after a while."""
import json, os, sys, time

class Mav:
    def manual_control_send(self, *values):
        print(json.dumps(["manual", *values]), flush=True)
    def command_long_send(self, *values):
        print(json.dumps(["command", *[v if v == v else None for v in values]]), flush=True)

class Beat:
    def __init__(self, system):
        self.system = system
    def get_srcSystem(self):
        return self.system

class Link:
    target_system = target_component = 1
    mav = Mav()
    start = time.monotonic()
    def wait_heartbeat(self, timeout):
        return True
    def recv_match(self, **_):
        """The vehicle's while it lives, then that of a ground station."""
        return Beat(1 if time.monotonic() - self.start < float(os.environ["ALIVE"]) else 255)

def mavlink_connection(address):
    return Link()
'''


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


def test_the_proposed_trial_comes_first(folder):
    store = Store(folder)
    write_schedule(store.proposed, load_campaign(folder).family.manoeuvre(10.0, 4.0), 0.1)
    assert list(schedules(folder)) == ["proposed", "design"]
    assert read_trial(folder).source == "proposed_schedule.csv"
    assert read_trial(folder, "design").source == "design_schedule.csv"
    with pytest.raises(InputError, match='did you mean "design"'):
        read_trial(folder, "desing")


def test_a_trial_that_breaks_limits_of_today_is_refused(folder):
    path = folder / "campaign.toml"
    path.write_text(path.read_text().replace("1500 rpm", "1250 rpm"))
    with pytest.raises(InputError, match="within the campaign's limit of 1250 rpm"):
        read_trial(folder)


@pytest.mark.parametrize(
    "text", ["", "{}", '{"control": "n", "unit": "deg", "manoeuvre": "x", "time_s": [0], "value": [1]}']
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
    np.testing.assert_allclose(np.array(rows[1:], float), np.column_stack([trial.time, trial.value * RPM]), rtol=1e-9)
    np.testing.assert_allclose(json.loads(content)["value_si"], trial.value)
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
    np.testing.assert_allclose(values, value_at(trial, times), atol=1e-9)
    assert [one.name for one in (tmp_path / "out").iterdir()] == [path.name], "nothing half-written"


def test_without_the_library_the_extra_is_named(folder, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    with pytest.raises(InputError, match=r"seatrial\[ros\]"):
        write_trial(read_trial(folder), tmp_path / "out", ("mcap",))
    assert bag.STEP == 0.05
    assert not (tmp_path / "out").exists()


def script(folder, tmp_path, rows, *arguments, alive=60.0):
    """The script with another table, on a stand-in of pymavlink."""
    (path,) = write_trial(read_trial(folder), tmp_path / "out", ("mavlink",))
    head, tail = path.read_text().split("ROWS = [\n")
    head = head.replace("HEARTBEAT = 3.0", "HEARTBEAT = 0.5")
    path.write_text(head + f"ROWS = {rows}\n" + tail.split("]\n", 1)[1])
    (tmp_path / "pymavlink").mkdir(exist_ok=True)
    (tmp_path / "pymavlink" / "__init__.py").write_text("")
    (tmp_path / "pymavlink" / "mavutil.py").write_text(FAKE)
    environment = {"PYTHONPATH": str(tmp_path), "ALIVE": str(alive), "PATH": ""}
    return subprocess.Popen(
        [sys.executable, str(path), *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=environment,
    )


def sent(output):
    return [json.loads(line) for line in output.splitlines() if line.startswith("[")]


ROWS = [(0.0, 600.0), (0.3, 600.0), (0.3, 2000.0), (0.8, 2000.0)]
"""A step beyond the upper limit, in rpm."""


def test_the_script_prints_and_sends_nothing_by_default(folder, tmp_path):
    output, _ = script(folder, tmp_path, ROWS).communicate(timeout=60)
    assert "nothing is sent" in output
    assert sent(output) == []
    assert "n = 1500 rpm  +1.0000 of full" in output, "clipped at the upper limit"
    assert output.splitlines()[-1].endswith("neutral")


def test_a_trial_beyond_full_stick_is_refused(folder, tmp_path):
    process = script(folder, tmp_path, ROWS, "--full", "1000")
    output, _ = process.communicate(timeout=60)
    assert process.returncode == 2
    assert "goes to 1500 rpm, beyond --full 1000" in output


def test_the_script_sends_clips_and_ends_at_neutral(folder, tmp_path):
    process = script(folder, tmp_path, ROWS, "--send", "x")
    output, _ = process.communicate(timeout=60)
    messages = sent(output)
    assert process.returncode == 0
    shares = [message[2] for message in messages]
    assert max(shares) == 1000
    assert shares[0] == 400
    assert max(np.diff(shares)) <= 4000 * 0.05 / 1500 * 1000 + 1, "no faster than the rate"
    assert messages[-20:] == [["manual", 1, 0, 0, 500, 0, 0]] * 20
    assert "finished; neutral was sent" in output


@pytest.mark.parametrize("mode", ["manual", "actuator"])
def test_a_lost_heartbeat_ends_at_neutral(folder, tmp_path, mode):
    process = script(folder, tmp_path, [(0.0, 600.0), (60.0, 600.0)], "--send", "x", "--mode", mode, alive=0.2)
    output, _ = process.communicate(timeout=60)
    assert process.returncode == 1
    assert "heartbeat lost" in output
    quiet = ["manual", 1, 0, 0, 500, 0, 0] if mode == "manual" else ["command", 1, 1, 187, 0, 0.0, *[None] * 5, 0]
    assert sent(output)[-20:] == [quiet] * 20
    assert sent(output)[0] != quiet


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_abort_ends_at_neutral(folder, tmp_path, number):
    process = script(folder, tmp_path, [(0.0, 600.0), (60.0, 600.0)], "--send", "x")
    assert process.stdout is not None
    lines = [process.stdout.readline() for _ in range(4)]
    process.send_signal(number)
    output, _ = process.communicate(timeout=60)
    assert process.returncode == 1
    assert "aborted; neutral was sent" in output
    assert sent("".join(lines) + output)[-1] == ["manual", 1, 0, 0, 500, 0, 0]
