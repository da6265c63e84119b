"""A campaign file of a published vehicle: the columns of its log are mapped, the file can be used, and a run is cut by conditions."""

import tomllib

import numpy as np
import pytest

from seatrial.campaign.config.load import check_text, load_campaign
from seatrial.campaign.config.vehicle_campaign import vehicle_campaign_text
from seatrial.campaign.data.import_logs import import_trials
from seatrial.campaign.data.unmapped import unmapped
from seatrial.core.errors import InputError
from seatrial.vehicles.catalogue import vehicle_names
from tests.campaign.small import write_small
from tests.cases import RPM
from tests.logs.log_writers import json_mcap, mavlink_json, ros_store

COLUMNS = {
    "u": "mps",
    "v": "mps",
    "w": "mps",
    "p": "dps",
    "q": "dps",
    "r": "dps",
    "roll": "deg",
    "pitch": "deg",
    "yaw": "deg",
}
ROWS = 40


def log_of(folder, moving=8, count=10):
    """A table of outputs, of which the first move, armed from 1 s on and at a voltage that falls."""
    rng = np.random.default_rng(2)
    outputs = np.column_stack([rng.integers(1400, 1600, (ROWS, moving)), np.full((ROWS, count - moving), 1500)])
    names = [
        "t",
        *(f"{name}_{unit}" for name, unit in COLUMNS.items()),
        *(f"pwm[{k}]" for k in range(count)),
        "armed",
        "volts",
    ]
    time = 0.1 * np.arange(ROWS)
    rows = np.column_stack([time, rng.normal(size=(ROWS, len(COLUMNS))), outputs, time > 0.95, 16 - time])
    path = folder / "dive.csv"
    path.write_text("\n".join([",".join(names), *(",".join(f"{value:.6g}" for value in row) for row in rows)]))
    return path


def test_a_log_makes_a_campaign(tmp_path):
    path = log_of(tmp_path)
    campaign = check_text(tmp_path, vehicle_campaign_text(tmp_path, "bluerov2_heavy", path))
    (file,) = campaign.imports.files
    assert set(file.channels) == {*"uvwpqr", "phi", "theta", "psi", *(f"f_{k}" for k in range(1, 9))}
    assert (file.channels["f_8"].column, file.channels["r"].unit, campaign.imports.step) == ("pwm[7]", "deg/s", 0.1)
    assert file.path == "dive.csv"
    assert {"X_u", "gain_f", "lag_f", "net_weight", "z_b"} <= set(campaign.priors)
    beside = tmp_path / "rov"
    assert (
        check_text(beside, vehicle_campaign_text(beside, "bluerov2_heavy", path)).imports.files[0].path == "../dive.csv"
    )


@pytest.mark.parametrize("vehicle", [name for name in vehicle_names() if name != "remus100_fossen"])
def test_each_published_vehicle_makes_a_campaign_before_there_is_a_log(tmp_path, vehicle):
    campaign = check_text(tmp_path, vehicle_campaign_text(tmp_path, vehicle))
    assert campaign.full.terms
    assert not campaign.has_records


def test_what_is_needed_and_not_mapped_is_known(tmp_path):
    """A quaternion is made of three angles, velocities along the body are made of those over the earth; a thruster is made of nothing."""
    text = vehicle_campaign_text(tmp_path, "bluerov2_heavy", log_of(tmp_path))

    def missing(*gone, more=""):
        kept = [line for line in text.splitlines() if not line.startswith(tuple(f"channels.{name} " for name in gone))]
        return [*unmapped(check_text(tmp_path, "\n".join([*kept, more]) + "\n"))]

    assert missing() == []
    assert missing("f_3", "psi") == ["f_3", "q_w", "q_x", "q_y", "q_z"]
    assert missing("phi", "theta", "psi", more=lines_of("q_w", "q_x", "q_y", "q_z", unit="1")) == []
    assert missing("u", "v", "w", more=lines_of("v_north", "v_east")) == ["w"]
    assert missing("u", "v", "w", more=lines_of("v_north", "v_east", "v_down")) == []


def lines_of(*names, unit="m/s"):
    return "\n".join(f'channels.{name} = {{ column = "{name}", unit = "{unit}" }}' for name in names)


def test_a_log_without_the_vehicles_controls_is_refused(tmp_path):
    """Outputs that stand still are thrusters of a vehicle that has as many; with fewer it is said how many there are."""
    few = log_of(tmp_path, moving=4, count=4)
    with pytest.raises(
        InputError, match=r"4 outputs to thrusters: pwm\[0\] \(f_1\)[^$]*8, one for each[^$]*vehicle.thrusters"
    ):
        vehicle_campaign_text(tmp_path, "bluerov2_heavy", few)
    still = check_text(tmp_path, vehicle_campaign_text(tmp_path, "bluerov2_heavy", log_of(tmp_path, moving=5)))
    assert still.imports.files[0].channels["f_8"].column == "pwm[7]"
    path = log_of(tmp_path)
    with pytest.raises(InputError, match="no column that may be a control"):
        vehicle_campaign_text(tmp_path, "remus100_prestero", path)
    with pytest.raises(InputError, match="surge only"):
        vehicle_campaign_text(tmp_path, "remus100_surge", path)


def test_a_run_is_kept_while_its_conditions_hold(tmp_path):
    """Armed from 1.0 s to the end, above 14.05 V until 1.9 s, the last stamp at which it is still held being that of the next row."""
    text = vehicle_campaign_text(tmp_path, "bluerov2_heavy", log_of(tmp_path))
    when = '[[import.keep]]\npath = "dive.csv"\nwhen = "armed == 1 and volts > 14.05"\n\n[[import.files]]'
    campaign_file = tmp_path / "campaign.toml"
    campaign_file.write_text(text.replace("[[import.files]]", when, 1))
    campaign = load_campaign(tmp_path)
    (record,) = import_trials(campaign).fit
    assert record.provenance.options["start"] == pytest.approx(1.0)
    assert record.time[-1] == pytest.approx(1.0)
    campaign_file.write_text(campaign_file.read_text().replace("14.05", "17"))
    with pytest.raises(InputError, match=r"armed == 1 and volts > 17 never holds"):
        import_trials(load_campaign(tmp_path))
    campaign_file.write_text(campaign_file.read_text().replace("armed == 1 and", "armed or"))
    with pytest.raises(InputError, match="comparisons of a column with a number"):
        load_campaign(tmp_path)


def test_two_bags_of_one_run_are_on_one_clock_and_cut_by_the_name_of_a_mode(tmp_path):
    """The computer's bag has the speed, the autopilot's recording the propeller and the mode, 0.35 s later and at other times."""
    pytest.importorskip("rosbags.rosbag2")
    from rosbags.rosbag2 import StoragePlugin, Writer

    start, rate, store = 1_700_000_000_000_000_000, 20, ros_store(False)
    types, times = store.types, np.arange(400) / rate
    with Writer(tmp_path / "computer", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        topic = writer.add_connection("/dvl", "geometry_msgs/msg/TwistStamped", typestore=store)
        for t in times:
            stamp = start + int(t * 1e9)
            header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](*divmod(stamp, 10**9)), "body")
            zero = types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
            speed = types["geometry_msgs/msg/Vector3"](1.0 + 0.1 * t, 0.0, 0.0)
            message = types["geometry_msgs/msg/TwistStamped"](header, types["geometry_msgs/msg/Twist"](speed, zero))
            writer.write(topic, stamp + 40_000_000, store.serialize_cdr(message, "geometry_msgs/msg/TwistStamped"))
    rows = []
    for t in times:
        stamp = start + int((t + 0.35) * 1e9)
        rows += [
            ("mavlink/1/1/RPM", stamp, mavlink_json("RPM", rpm1=1000 + 10 * (t + 0.35))),
            ("mavlink/1/1/HEARTBEAT", stamp + 5, mavlink_json("HEARTBEAT", custom_mode=19 if 4 <= t < 12 else 2)),
        ]
    json_mcap(tmp_path / "autopilot.mcap", rows)
    write_small(tmp_path / "c")
    text = (tmp_path / "c" / "campaign.toml").read_text()
    head, tail = text.split("[truth]")
    imports = """
[import]
fit = ["computer"]
step = "0.05 s"

[[import.files]]
path = "../{run}"
table = "/dvl"
channels.u = { column = "twist.linear.x", unit = "m/s" }

[[import.files]]
path = "../autopilot.mcap"
table = "mavlink/1/1/RPM"
channels.n = { column = "message.rpm1", unit = "rpm" }

[[import.keep]]
path = "../autopilot.mcap"
table = "mavlink/1/1/HEARTBEAT"
when = 'message.custom_mode == "MANUAL"'
"""
    (tmp_path / "c" / "campaign.toml").write_text(
        head + tail[tail.index("[estimation]") :].replace("chains", 'initial = "measured"\nchains') + imports
    )
    (record,) = import_trials(load_campaign(tmp_path / "c")).fit
    assert record.time[-1] == pytest.approx(8.0, abs=0.11)
    seconds = record.time + 4.35  # the mode is said from here on, on the clock of both
    np.testing.assert_allclose(record.channel("u"), 1.0 + 0.1 * seconds, atol=0.006)
    np.testing.assert_allclose(record.channel("n") / RPM, 1000 + 10 * seconds, atol=0.6)


@pytest.mark.parametrize(("column", "control", "upper"), [("rpm", "n", "1400 rpm"), ("tau_x [N]", "tau_X", "1400 N")])
def test_the_log_of_a_vehicle_of_ones_own_fills_in_the_template(tmp_path, column, control, upper):
    rows = [f"{0.1 * i:.1f},{1.5 + 0.2 * (i // 50 % 2):.1f},{1200 + 200 * (i // 50 % 2)}" for i in range(300)]
    log = tmp_path / "dive.csv"
    log.write_text(f"time_s,speed,{column}\n" + "\n".join(rows) + "\n")
    text = vehicle_campaign_text(tmp_path / "boat", log=log, named="logs/dive.csv")
    content = tomllib.loads(text)
    assert content["limits"] == {control: {"lower": upper.replace("14", "12"), "upper": upper}}
    assert content["vehicle"]["trim"] == {"u": "1.6 m/s", control: upper.replace("14", "13")}
    campaign = check_text(tmp_path / "boat", text)
    (file,) = campaign.imports.files
    assert (file.path, set(file.channels)) == ("logs/dive.csv", {"u", control})
    assert campaign.family.control == control
    assert campaign.example_vehicle  # the mass is still that of the template
