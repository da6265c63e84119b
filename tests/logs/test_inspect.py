"""A first look: sums of a stream against NumPy on the whole, guesses with their reasons, and a map that works when pasted."""

import sys
import tomllib
from math import pi

import numpy as np
import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import import_trials
from seatrial.cli.main import main
from seatrial.core.errors import InputError
from seatrial.logs import summary
from seatrial.logs.formats.protocol import Block, ColumnInfo, LogFile, TableInfo
from seatrial.logs.formats.registry import read_columns
from seatrial.logs.guess import best, guesses, remarks, unit_by_name
from seatrial.logs.inspect import LogsTogether, inspect_log
from seatrial.logs.log_table import read_log_table
from seatrial.logs.source import ColumnMap, LogSource
from seatrial.logs.summary import Gathered
from tests.campaign.small import LOGGED, write_small
from tests.logs.log_cases import GOOD, refusal, written
from tests.logs.log_writers import RPM, STAMPS, SURGE, WRITERS, ros_store


@pytest.mark.parametrize("name", list(WRITERS))
def test_every_format_is_summed_up(tmp_path, name):
    log = WRITERS[name](tmp_path)
    (table,) = inspect_log(log.path, log.table).tables
    column = next(column for column in table.columns if column.name == log.surge)
    assert (column.count, column.rows, column.missing) == (40, 40, 0.0)
    assert (column.least, column.greatest) == (log.surge_values.min(), log.surge_values.max())
    assert table.clock.name == log.clock
    scale = {"ns": 1e-9, "us": 1e-6, "s": 1.0}[log.unit]
    step = np.diff(log.stamps) * scale
    assert table.clock.rate == pytest.approx(1 / step.mean(), rel=1e-9)
    assert table.clock.jitter == pytest.approx(step.std(), rel=1e-6, abs=1e-12)
    assert table.clock.gap == pytest.approx(step.max(), rel=1e-12)
    assert (table.clock.repeated, table.clock.backward) == (0, 0)
    whole = inspect_log(log.path)
    assert log.table in [table.info.name for table in whole.tables]
    assert any(log.surge in line for line in whole.lines())


def test_blocks_are_summed_as_one(monkeypatch):
    rng = np.random.default_rng(0)
    time = 10**18 + np.cumsum(rng.integers(-2, 5, 1000)) * 1_000_000
    values = np.where(rng.random(1000) < 0.1, np.nan, rng.normal(size=1000))
    values[7] = np.inf
    info = TableInfo("t", (ColumnInfo("time", "ns"), ColumnInfo("u"), ColumnInfo("k")), ("time",))
    gathered = Gathered(info)
    for part in np.array_split(np.arange(1000), 9):
        gathered.take(Block("t", {"time": time[part], "u": values[part], "k": np.full(part.size, 3)}))
    found = gathered.summary()
    step = np.diff(time) * 1e-9
    clock = found.clocks[0]
    assert clock.jitter == pytest.approx(step.std(), rel=1e-9)
    assert (clock.repeated, clock.backward) == ((step == 0).sum(), (step < 0).sum())
    assert clock.duration == pytest.approx((time[-1] - time[0]) * 1e-9)
    speed, constant = found.columns[1:]
    finite = values[np.isfinite(values)]
    assert (speed.count, speed.infinite) == (finite.size, 1)
    assert speed.missing == pytest.approx(np.isnan(values).mean())
    assert (speed.least, speed.greatest) == (finite.min(), finite.max())
    assert (speed.mean, speed.sd) == pytest.approx((finite.mean(), finite.std()), rel=1e-9)
    assert speed.trouble == "1 infinite"
    assert constant.constant
    assert constant.trouble == "constant"
    assert summary.ColumnSummary("u", None, 5, 5, 0, 0.0, 1e-80).trouble.startswith("garbage?")


def test_clock_that_never_moves_or_runs_back_gives_way():
    info = TableInfo(
        "t", (ColumnInfo("header.stamp", "ns"), ColumnInfo("b", "s"), ColumnInfo("c", "s")), ("header.stamp", "b", "c")
    )
    gathered = Gathered(info)
    gathered.take(Block("t", {"header.stamp": np.zeros(4, int), "b": np.array([0.0, 2, 1, 3]), "c": np.arange(4.0)}))
    assert gathered.summary().clock.name == "c"


def ros_log(folder):
    """Odometry, an IMU with a dead gyro, and commands, as a robot records them."""
    from rosbags.rosbag2 import StoragePlugin, Writer

    store = ros_store(False)
    types = store.types
    vector, quaternion = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    nine, many = np.zeros(9), np.zeros(36)

    def header(k):
        seconds, nanoseconds = divmod(int(STAMPS[k]), 10**9)
        return types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](seconds, nanoseconds), "body")

    with Writer(folder / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        kinds = {
            "/odom": "nav_msgs/msg/Odometry",
            "/imu": "sensor_msgs/msg/Imu",
            "/force": "geometry_msgs/msg/WrenchStamped",
        }
        topics = {name: writer.add_connection(name, kind, typestore=store) for name, kind in kinds.items()}
        for k in range(40):
            turn = vector(0.0, 0.02 * SURGE[k], 0.3 * SURGE[k])
            twist = types["geometry_msgs/msg/Twist"](vector(SURGE[k], 0.1 * SURGE[k], 0.0), turn)
            heading = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, np.sin(0.05 * k), np.cos(0.05 * k))
            pose = types["geometry_msgs/msg/Pose"](types["geometry_msgs/msg/Point"](float(k), 0.0, 0.0), heading)
            covered = types["geometry_msgs/msg/PoseWithCovariance"](pose, many)
            moving = types["geometry_msgs/msg/TwistWithCovariance"](twist, many)
            wrench = types["geometry_msgs/msg/Wrench"](vector(RPM[k], 0.0, 0.0), vector(0.0, 0.0, 0.0))
            gyro = vector(1e-80 * k, 0.0, 0.0)
            messages = {
                "/odom": types[kinds["/odom"]](header(k), "base", covered, moving),
                "/imu": types[kinds["/imu"]](header(k), quaternion, nine, gyro, nine, vector(0.0, 0.0, 9.8), nine),
                "/force": types[kinds["/force"]](header(k), wrench),
            }
            for name, message in messages.items():
                writer.write(topics[name], int(STAMPS[k]) + 5, store.serialize_cdr(message, kinds[name]))
    return folder / "bag"


def test_guesses_of_ros_by_type_with_axes_turned(tmp_path):
    found = inspect_log(ros_log(tmp_path))
    chosen = {guess.channel: guess for guess in best(found.guesses)}
    assert chosen.keys() == {"u", "v", "q", "r", "y", "tau_X", "q_w", "q_x", "q_y", "q_z"}
    assert (chosen["u"].column, chosen["u"].axes, chosen["u"].role) == ("twist.twist.linear.x", "ENU", "measurement")
    assert (chosen["r"].column, chosen["r"].axes, chosen["r"].unit) == ("twist.twist.angular.z", "ENU", "rad/s")
    assert (chosen["q_z"].column, chosen["q_z"].table) == ("pose.pose.orientation.z", "/odom")
    assert chosen["y"].column == "pose.pose.position.x"
    assert (chosen["tau_X"].table, chosen["tau_X"].unit, chosen["tau_X"].role) == ("/force", "N", "control")
    assert "REP 103" in chosen["r"].reason
    text = "\n".join(found.lines())
    assert "garbage? (4e-79 at most)" in text
    assert "covariance[…], 36 elements: each 0; constant" in text
    # A quaternion is only there for the angles that are made of it.
    assert [guess.channel for guess in best(found.guesses, ["u", "r"])] == ["u", "r"]
    assert [guess.channel for guess in best(found.guesses, ["psi"])] == ["q_w", "q_x", "q_y", "q_z"]
    assert tomllib.loads(found.as_toml(["r"]))["import"]["files"][0]["axes"] == "ENU"


def test_every_element_of_a_multiarray_is_listed(tmp_path):
    """Eight pulse widths without a header, the first messages empty: none is hidden, those that stand still are named."""
    from rosbags.rosbag2 import StoragePlugin, Writer

    store, kind = ros_store(False), "std_msgs/msg/Int32MultiArray"
    layout = store.types["std_msgs/msg/MultiArrayLayout"]([], 0)
    widths = 1500 + (50 * np.sin(np.outer(np.arange(30), np.r_[0:8, 0, 0]))).astype(np.int32)
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        topic = writer.add_connection("/pwm", kind, typestore=store)
        for k, row in enumerate(widths):
            message = store.types[kind](layout, row if k > 2 else row[:0])
            writer.write(topic, int(STAMPS[k]), store.serialize_cdr(message, kind))
    found = inspect_log(tmp_path / "bag")
    columns = {column.name: column for column in found.tables[0].columns}
    assert [name for name in columns if name.startswith("data")] == [f"data[{k}]" for k in range(10)]
    lines = {line.split()[0]: line for line in found.lines() if line.startswith("  ")}
    assert lines["data[0]"].endswith("1500; constant; 10.0% missing")
    assert columns["data[3]"].sd == pytest.approx(widths[3:, 3].std())
    assert any("data[0]" in remark and "pulse widths" in remark for remark in found.remarks)
    # Thruster 1 stands still; of those behind the last that moves nothing says that they are thrusters.
    (block,) = tomllib.loads(found.as_toml())["import"]["files"]
    assert block["channels"] == {f"f_{k + 1}": {"column": f"data[{k}]", "unit": "command"} for k in range(8)}
    with pytest.raises(InputError) as caught:
        read_log_table(LogSource(found.log.path, None, None, {"f_1": ColumnMap("data[10]", "N", "control")}))
    assert (caught.value.found, caught.value.expected) == ("no such element: data has 10", "data[0] to data[9]")


RAMP = 0.1 * np.arange(9.0)


def summed(name, columns, values=RAMP, **more):
    """Summary of a table whose columns all hold the same values."""
    info = TableInfo(name, (ColumnInfo("time", "s"), *map(ColumnInfo, columns)), ("time",), **more)
    gathered = Gathered(info)
    gathered.take(Block(name, {"time": np.arange(9.0), **dict.fromkeys(columns, values)}))
    return gathered.summary()


AUTOPILOT = {
    "LOCAL_POSITION_NED": (("vx", "vy", "vz"), "ATTITUDE", ("roll", "pitch", "yaw")),
    "XKF1": (("VN", "VE", "VD"), "ATT", ("Roll", "Pitch", "Yaw")),
}


@pytest.mark.parametrize("name", AUTOPILOT)
def test_velocities_over_the_earth_bring_the_attitude_with_them(name):
    velocities, attitude, angles = AUTOPILOT[name]
    found = guesses([summed(name, velocities), summed(attitude, angles)])
    earth, turns = ["v_north", "v_east", "v_down"], ["phi", "theta", "psi"]
    assert {guess.channel for guess in best(found, ["u"])} == {*earth, *turns}
    assert {guess.channel for guess in best(found, ["psi"])} == {"psi"}
    assert {guess.channel for guess in best(found)} == {*earth, *turns}
    # A topic of PX4 with a heading and no other angle: the quaternion beside it gives all three; what is only wanted is no measurement.
    names = ("q[0]", "q[1]", "q[2]", "q[3]")
    tables = {
        "vehicle_local_position": ("vx", "heading"),
        "vehicle_attitude": names,
        "vehicle_rates_setpoint": ("roll",),
    }
    found = guesses([summed(kind, columns) for kind, columns in tables.items()])
    assert [guess.channel for guess in best(found)] == ["v_north", "q_w", "q_x", "q_y", "q_z"]


NAMES = {
    "surge_mps": ("u", "m/s", 1.0),
    "yaw_rate_deg_s": ("r", "deg/s", 1.0),
    "prop_rpm": ("n", "rpm", 1.0),
    "Heading [deg]": ("psi", "deg", 1.0),
    "u [m/s]": ("u", "m/s", 1.0),
    "/dvl/speed (m/s)": ("u", "m/s", 1.0),
    "n [1/min]": ("n", "rpm", 1.0),
    "n [1/s]": ("n", "rev/s", 1.0),
    "rudder_deg": ("delta_r", "deg", 1.0),
    "speed_kn": ("u", "kn", 1.0),
    "field.force.x": ("tau_X", "N", 1.0),
    "thrust_cmd_N": ("tau_X", "N", 1.0),
    "thrust [kgf]": ("tau_X", "kgf", 1.0),
    "commanded_thrust": ("tau_X", "N", 1.0),
    "rudder_rad": ("delta_r", "rad", 1.0),
    "thrust_kgf": ("tau_X", "kgf", 1.0),
    "nav.pitch": ("theta", "rad", 1.0),
    "field.angular_velocity.z": ("r", "rad/s", 1.0),
    "vel_n": ("v_north", "m/s", 1.0),
    "linear_velocity_x": ("u", "m/s", 1.0),
    "twist_linear_y": ("v", "m/s", 1.0),
    "odom_twist_twist_linear_z": ("w", "m/s", 1.0),
    "/odom/twist/twist/linear/x": ("u", "m/s", 1.0),
    "angular_velocity_z": ("r", "rad/s", 1.0),
    "odom.twist.twist.angular.y": ("q", "rad/s", 1.0),
    "pose_pose_position_z": ("z", "m", 1.0),
    "engine_rpm": ("n", "rpm", 1.0),
    "rpm_cmd": ("n", "rpm", 1.0),
    "cmd_rpm": ("n", "rpm", 1.0),
    "rpm_command": ("n", "rpm", 1.0),
    "motor_rpm_commanded": ("n", "rpm", 1.0),
    "command_motor_speed_rps": ("n", "rev/s", 1.0),
    "log_speed": ("u", "m/s", 1.0),
    "dvl_vx": ("u", "m/s", 1.0),
    "dvl_vz_mps": ("w", "m/s", 1.0),
    "heave_cms": ("w", "cm/s", 1.0),
    "sway_mm_s": ("v", "mm/s", 1.0),
    "speed_kt": ("u", "kn", 1.0),
    "roll_cdeg": ("phi", "deg", 0.01),
    "yaw_rate_degps": ("r", "deg/s", 1.0),
    "pitch_rate_mrad_s": ("q", "rad/s", 0.001),
    "depth_cm": ("z", "cm", 1.0),
    "yaw_moment_n_m": ("tau_N", "N*m", 1.0),
    # Autopilots in a text: of all messages in one table, the message before the field, or of one, its name that of the file.
    "vehicle_attitude.q[0]": ("q_w", "1", 1.0),
    "vehicle_attitude_0.q[3]": ("q_z", "1", 1.0),
    "vehicle_attitude/q.01": ("q_x", "1", 1.0),
    "vehicle_angular_velocity.xyz[1]": ("q", "rad/s", 1.0),
    "vehicle_local_position.x": ("x", "m", 1.0),
    "vehicle_local_position.vx": ("v_north", "m/s", 1.0),
    "IMU[0].GyrX": ("p", "rad/s", 1.0),
    "ATT.Roll": ("phi", "deg", 1.0),
    "CTUN.Alt": ("z", "m", -1.0),
    "LOCAL_POSITION_NED.vz": ("v_down", "m/s", 1.0),
    "dvl_speed_mps": ("u", "m/s", 1.0),
    "gyro.z": ("r", "rad/s", 1.0),
}


@pytest.mark.parametrize("name", NAMES)
def test_guesses_by_name_and_unit(tmp_path, name):
    text = f"time,{name},remark\n" + "".join(f"{0.1 * k:.1f},{0.01 * k},ok\n" for k in range(20))
    found = inspect_log(written(tmp_path, text)).guesses
    assert [(guess.channel, guess.unit, guess.scale) for guess in found] == [NAMES[name]]
    assert ("axes are not known" in found[0].reason) == (name.startswith("dvl_v") or "linear" in name)


def test_where_nothing_can_be_guessed_it_is_said_what_was_sought(tmp_path):
    said = inspect_log(written(tmp_path, "time,a,b\n" + "".join(f"{k},{k},{k % 7}\n" for k in range(20)))).lines()
    assert "no column could be guessed, of speeds" in said[-3]
    assert "`--map`" in said[-2]


@pytest.mark.parametrize("name", ["out{}", "RCOUT{}", "nav.output_{}", "servo{}_raw", "thruster_{}_us"])
def test_numbered_columns_of_pulse_widths_are_commands(tmp_path, name):
    """Of eight, numbered from 1; ones that are no pulse widths, and a column that only ends like one, are none."""
    names = ["time", *(name.format(k) for k in range(1, 9)), "timeout1", "out9"]
    rows = [[0.1 * k, *(1500 + 10 * (k - 9) * (-1) ** i for i in range(8)), 1500 + k, k] for k in range(20)]
    path = written(tmp_path, "\n".join([",".join(names), *(",".join(map(str, row)) for row in rows)]) + "\n")
    found = [(one.channel, one.column, one.unit) for one in inspect_log(path).guesses]
    assert found == [(f"f_{k}", name.format(k), "command") for k in range(1, 9)]


@pytest.mark.parametrize(("reach", "unit"), [(350.0, "deg"), (3.0, "rad")])
def test_guesses_of_angles_by_range(tmp_path, reach, unit):
    text = "time,heading\n" + "".join(f"{k},{reach * k / 19}\n" for k in range(20))
    (guess,) = inspect_log(written(tmp_path, text)).guesses
    assert (guess.channel, guess.unit) == ("psi", unit)
    assert "range" in guess.reason


def test_stated_units_decide(tmp_path):
    found = inspect_log(WRITERS["dataflash"](tmp_path).path)
    assert {("phi", "deg"), ("u", "m/s")} <= {(guess.channel, guess.unit) for guess in found.guesses}
    assert not any(guess.column == "Cm" for guess in found.guesses)
    text = 'a remark\ntime;"speed"\n' + "".join(f"{k};{k}\n" for k in range(20))
    from seatrial.logs.formats.protocol import TextLayout

    path = written(tmp_path, text, "semi.csv")
    toml = inspect_log(path, layout=TextLayout(";", 1)).as_toml()
    (block,) = tomllib.loads(toml)["import"]["files"]
    assert (block["delimiter"], block["skip_rows"]) == (";", 1)


def test_autopilot_columns_that_no_factor_maps_are_remarked(tmp_path):
    found = inspect_log(WRITERS["telemetry"](tmp_path).path)
    assert any("SERVO_OUTPUT_RAW" in remark and "pulse" in remark for remark in found.remarks)
    assert {"phi", "theta", "r"} <= {guess.channel for guess in found.guesses if "autopilot" in guess.reason}


def test_pasted_map_imports_a_bag_and_a_csv(tmp_path):
    """What `--map` prints, in a campaign file as it stands, gives the record."""
    bag = ros_log(tmp_path / "logs") if (tmp_path / "logs").mkdir() is None else None
    time = [f"{stamp // 10**9}.{stamp % 10**9:09d}" for stamp in STAMPS.tolist()]
    engine = written(
        tmp_path, "time,prop_rpm\n" + "".join(f"{t},{n}\n" for t, n in zip(time, RPM, strict=True)), "engine.csv"
    )
    maps = inspect_log(bag).as_toml(["u"]) + inspect_log(engine).as_toml(["n"])
    write_small(tmp_path / "campaign", (LOGGED[0], f'[import]\nfit = ["one"]\n{maps}'))
    (record,) = import_trials(load_campaign(tmp_path / "campaign")).fit
    measured = record.channel("u")[np.isfinite(record.channel("u"))]
    assert set(measured) <= set(SURGE)
    assert measured.size >= 39
    np.testing.assert_allclose(record.channel("n"), RPM[: record.time.size] * pi / 30)
    tables = {file["source"]: file["table"] for file in record.provenance.options["files"]}
    assert tables == {"bag": "/odom", "engine.csv": None}


def test_the_map_names_a_log_as_it_was_given(tmp_path, monkeypatch):
    """A relative path stays one, and a comment says of which folder it has to be; an absolute path has no comment."""
    written(tmp_path, "time,prop_rpm\n" + "".join(f"{k},{k}\n" for k in range(20)), "a.csv")
    monkeypatch.chdir(tmp_path)
    assert 'path = "a.csv"  # relative to the folder of the campaign file' in inspect_log("a.csv").as_toml()
    assert f'path = "{tmp_path.as_posix()}/a.csv"\n' in inspect_log(tmp_path / "a.csv").as_toml()


def test_columns_of_the_map_are_those_of_the_log(tmp_path):
    log = WRITERS["parquet"](tmp_path)
    (block,) = tomllib.loads(inspect_log(log.path).as_toml())["import"]["files"]
    assert "table" not in block
    names = [channel["column"] for channel in block["channels"].values()]
    assert read_columns(LogFile(log.path), "rows", names).columns.keys() == set(names)


def run(monkeypatch, capsys, *arguments):
    monkeypatch.setattr(sys, "argv", ["seatrial", "inspect", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        main()
    return ended.value.code, *capsys.readouterr()


def test_command(monkeypatch, capsys, tmp_path):
    log = WRITERS["ros 1"](tmp_path)
    code, out, err = run(monkeypatch, capsys, log.path)
    assert (code, err) == (0, "")
    assert "run.bag: a ROS 1 bag, 2 tables" in out
    code, out, _ = run(monkeypatch, capsys, log.path, "--table", "/other")
    assert "/state" not in out
    code, out, _ = run(monkeypatch, capsys, written(tmp_path, GOOD.replace("t,", "time,", 1)), "--map", "--only", "n,u")
    assert tomllib.loads(out)["import"]["files"][0]["channels"].keys() == {"n", "u"}
    code, out, err = run(monkeypatch, capsys, tmp_path / "nowhere.bag")
    assert (code, out) == (2, "")
    assert "no such file" in err
    with refusal("run.bag, table", '"/nothing"'):
        inspect_log(log.path, "/nothing")


def test_several_logs_are_listed_in_turn_and_mapped_together(monkeypatch, capsys, tmp_path):
    first = written(tmp_path, "time_s,u\n" + "".join(f"{k / 10},{k % 7}\n" for k in range(20)), "dvl.csv")
    second = written(
        tmp_path, "time_ms,u,rpm\n" + "".join(f"{100 * k},{k % 5},{900 + k}\n" for k in range(20)), "esc.csv"
    )
    code, out, _ = run(monkeypatch, capsys, first, second)
    assert code == 0
    assert out.index("dvl.csv: a table of text") < out.index("esc.csv: a table of text")
    _, out, _ = run(monkeypatch, capsys, first, second, "--map")
    files = tomllib.loads(out)["import"]["files"]
    assert [file["channels"].keys() for file in files] == [{"u"}, {"n"}]
    assert [file["time"]["unit"] for file in files] == ["s", "ms"]
    _, out, _ = run(monkeypatch, capsys, first, first, "--map")
    assert len(tomllib.loads(out)["import"]["files"]) == 1
    assert 'such as "log_{run}.csv"' in out
    code, out, err = run(monkeypatch, capsys, first, tmp_path / "nowhere.csv")
    assert (code, out) == (2, "")
    assert "nowhere.csv" in err


def test_two_runs_with_other_columns_are_mapped_each_for_itself(monkeypatch, capsys, tmp_path):
    rows = "".join(f"{k / 10},{k % 7},{900 + k}\n" for k in range(20))
    logs = [
        written(tmp_path, f"{head}\n{rows}", f"{name}.csv")
        for name, head in (
            ("run_a", "time_s,speed,rpm"),
            ("run_b", "t_s,dvl_speed_kn,rpm_cmd"),
            ("run_c", "t_s,dvl_speed_kn,rpm_cmd"),
        )
    ]
    code, out, _ = run(monkeypatch, capsys, *logs[:2], "--map")
    files = tomllib.loads(out)["import"]["files"]
    assert code == 0
    assert [file["runs"] for file in files] == [["run_a"], ["run_b"]]
    assert [file["channels"]["u"]["column"] for file in files] == ["speed", "dvl_speed_kn"]
    assert [file["channels"]["n"]["column"] for file in files] == ["rpm", "rpm_cmd"]
    assert 'Name the runs under [import]: fit = ["run_a", "run_b"].' in out
    assert "{run}" not in out
    _, out, _ = run(monkeypatch, capsys, *logs, "--map")
    assert len(tomllib.loads(out)["import"]["files"]) == 2
    assert "run_c.csv: the logs above have all its channels" in out


def test_a_map_without_a_clock_asks_for_it(tmp_path):
    rows = "".join(f"{k // 2};{k % 3}\n" for k in range(20))
    toml = inspect_log(written(tmp_path, "Zeit;Fahrt\n" + rows, "a.csv")).as_toml()
    (block,) = tomllib.loads(toml)["import"]["files"]
    assert block["time"] == {"column": "", "unit": "s"}
    assert "# time: no column is it by its name, and none rises in every row" in toml


ROV = {
    "sample": lambda k: f"{k}",
    "distance": lambda k: f"{0.01 * k * k:.2f}",
    "CLOCK": lambda k: f"{1_764_010_000 + 0.05 * k:.2f}",
    "dvl_surge_cm_s": lambda k: f"{-20 + 4 * (k % 22)}",
    "dvl_sway": lambda k: f"{3 * (k % 20)}",
    "wz": lambda k: f"{0.1 * (k % 7)}",
    "imu_gx_dps": lambda k: f"{k % 9}",
    "depth_m": lambda k: f"{1 + k % 5}",
    "pwm_port": lambda k: f"{1400 + 50 * (k % 5)}",
    "pwm_stbd": lambda k: f"{1600 - 50 * (k % 5)}",
}
"""Columns of a log at 20 Hz as small vehicles write them, beside a counter of rows and a distance that rises too."""


@pytest.mark.parametrize(
    ("clock", "of", "unit"),
    [
        ("utc_s", lambda k: f"{1_764_010_000 + 0.05 * k:.2f}", "s"),
        ("clock_ms", lambda k: f"{7000 + 50 * k + k % 2}", "ms"),
        ("millis", lambda k: f"{7000 + 50 * k + k % 2}", "ms"),
        ("Zeit", lambda k: f"{7_000_000 + 50_000 * k}", "us"),
    ],
)
def test_a_clock_of_any_name_is_guessed_and_the_columns_beside_it(tmp_path, clock, of, unit):
    columns = {clock if name == "CLOCK" else name: of if name == "CLOCK" else make for name, make in ROV.items()}
    rows = "".join(",".join(make(k) for make in columns.values()) + "\n" for k in range(200))
    found = inspect_log(written(tmp_path, ",".join(columns) + "\n" + rows, "a.csv"))
    (table,) = found.tables
    assert (table.clock.name, table.clock.unit, table.clock.is_named) == (clock, unit, False)
    assert table.clock.rate == pytest.approx(20.0, rel=1e-3)
    lines = "\n".join(found.lines())
    assert "guessed, because it rises in every row, most evenly: check the column, and its unit" in lines
    (block,) = tomllib.loads(found.as_toml())["import"]["files"]
    assert block["time"] == {"column": clock, "unit": unit}
    guessed = {guess.channel: (guess.column, guess.unit) for guess in best(found.guesses)}
    assert guessed == {
        "u": ("dvl_surge_cm_s", "cm/s"),
        "v": ("dvl_sway", "cm/s"),
        "p": ("imu_gx_dps", "deg/s"),
        "r": ("wz", "rad/s"),
        "z": ("depth_m", "m"),
        "f_1": ("pwm_port", "command"),
        "f_2": ("pwm_stbd", "command"),
    }
    reasons = {guess.channel: guess.reason for guess in found.guesses}
    assert reasons["z"].endswith("its unit by the name")
    assert "as 57 m/s is too fast for a vehicle" in reasons["v"]


def test_without_any_clock_the_columns_of_a_single_table_are_guessed(tmp_path):
    found = inspect_log(
        written(tmp_path, "when,u,r\n" + "".join(f"{k // 2},{k % 3},{k % 2}\n" for k in range(40)), "a.csv")
    )
    assert found.tables[0].clock is None
    assert [guess.channel for guess in best(found.guesses)] == ["u", "r"]
    assert any("and none rises in every row" in line for line in found.lines())


def test_a_clock_in_another_unit_than_its_name_says_is_doubted(tmp_path):
    found = inspect_log(written(tmp_path, "t,u\n" + "".join(f"{50 * k},{k % 3}\n" for k in range(40)), "a.csv"))
    doubt = 'a row every 50 s: is its unit "ms", not "s"?'
    assert any(doubt in line for line in found.lines())
    assert f"# time: {doubt}" in found.as_toml()


def test_the_ends_of_a_range_are_told_apart(tmp_path):
    found = inspect_log(
        written(tmp_path, "t,gps\n" + "".join(f"{k},{1_764_010_000 + 0.5 * (k % 180)}\n" for k in range(400)), "a.csv")
    )
    assert any("1764010000 to 1764010089.5; mean" in line for line in found.lines())


def test_decimal_stamps_are_seconds_whatever_the_name(tmp_path):
    """`stamp` is nanoseconds where it is whole."""
    rows = "".join(f"{1_700_000_000 + 0.1 * k:.6f},{0.01 * k:.2f}\n" for k in range(50))
    (table,) = inspect_log(written(tmp_path, "stamp,dvl_u\n" + rows, "decimal.csv")).tables
    assert (table.clock.unit, table.clock.rate) == ("s", pytest.approx(10.0, rel=1e-6))
    whole = "".join(f"{1_700_000_000_000_000_000 + 100_000_000 * k},{0.01 * k:.2f}\n" for k in range(50))
    (table,) = inspect_log(written(tmp_path, "stamp,dvl_u\n" + whole, "whole.csv")).tables
    assert (table.clock.unit, table.clock.rate) == ("ns", pytest.approx(10.0, rel=1e-6))


@pytest.mark.parametrize(
    ("name", "per_second", "unit"),
    [
        ("timestamps", 1e9, "ns"),
        ("time", 1e6, "us"),
        ("t_ms", 1e3, "ms"),
        ("epoch", 1.0, "s"),
        ("uptime_ms", 1e3, "ms"),
    ],
)
def test_unit_of_a_clock_is_one_that_logs_have(tmp_path, name, per_second, unit):
    """Float stamps of an archive are in no stated unit; those of a name that fits keep it."""
    np.savez(tmp_path / "run.npz", **{name: (1.7e9 + 0.2 * np.arange(30)) * per_second, "u": np.linspace(0.0, 1.0, 30)})
    (table,) = inspect_log(tmp_path / "run.npz").tables
    assert (table.clock.unit, table.clock.rate) == (unit, pytest.approx(5.0, rel=1e-3))


def test_map_without_a_guess_has_the_file_and_its_clock(tmp_path):
    np.savez(tmp_path / "run.npz", timestamps=1.7e18 + 2e8 * np.arange(30), state=np.ones((30, 2)), beside=np.ones(7))
    text = inspect_log(tmp_path / "run.npz").as_toml()
    assert 'table = "timestamps"\ntime = { column = "timestamps", unit = "ns" }' in text
    assert "beside" not in text
    assert "No column could be guessed" in text


def test_a_hole_is_no_burst(tmp_path):
    time = np.delete(0.1 * np.arange(3600), slice(1200, 1240))
    rows = "".join(f"{1.7e9 + at:.2f},{1 + at % 7}\n" for at in time.tolist())
    found = inspect_log(written(tmp_path, "stamp,speed\n" + rows))
    clock = found.tables[0].clock
    assert (clock.rate, clock.holes, clock.gap) == (pytest.approx(10.0), 1, pytest.approx(4.1))
    assert (clock.lost, clock.jitter) == (pytest.approx(4.1), pytest.approx(0.0, abs=1e-6))
    assert "10 Hz" in found.lines()[3]
    assert "longest gap 4.1 s; rows are lost in 1 hole, 4.1 s in all" in found.lines()[3]
    assert "even" not in found.as_toml()


def test_a_map_names_the_columns_that_nothing_uses(tmp_path):
    rows = "".join(f"{k / 10},{1 + k % 7},{3 + k % 5},{k % 3},5\n" for k in range(40))
    path = written(tmp_path, "t,speed,thrust_crmd,wind,battery\n" + rows)
    said = inspect_log(path).as_toml()
    assert (
        "# No channel uses these columns; add a line for each that the model needs:\n#   thrust_crmd  3 to 7; mean 5"
        in said
    )
    assert "#   wind         0 to 2;" in said
    assert "battery" not in said, "it never moves"
    assert [*tomllib.loads(said)["import"]["files"][0]["channels"]] == ["u"]
    assert "wind" not in inspect_log(path).as_toml(["u"])


@pytest.mark.parametrize(
    "name", ["vehicle_rates_setpoint.roll", "att.q[1]", "accel.z", "vehicle_local_position.ax", "RCIN.C1"]
)
def test_what_another_message_holds_is_no_guess(tmp_path, name):
    text = f"time,{name},att.q[0],att.q[2]\n" if "[1]" in name else f"time,{name},a,b\n"
    text += "".join(f"{0.1 * k:.1f},{500 + 0.01 * k},{k % 3},{k % 5}\n" for k in range(20))
    assert inspect_log(written(tmp_path, text)).guesses == ()


def test_four_elements_of_a_quaternion_are_guessed_together(tmp_path):
    rows = (f"{0.1 * k:.1f},{np.cos(0.1 * k):.5f},0.0,0.0,{np.sin(0.1 * k):.5f}\n" for k in range(20))
    found = inspect_log(written(tmp_path, "time,nav.q[0],nav.q[1],nav.q[2],nav.q[3]\n" + "".join(rows))).guesses
    assert [guess.channel for guess in found] == ["q_w", "q_x", "q_y", "q_z"]
    assert "check their order" in found[0].reason


def test_the_file_of_one_topic_is_known_by_its_name(tmp_path):
    path = tmp_path / "dive_vehicle_angular_velocity_0.csv"
    path.write_text(
        "timestamp,xyz[0],xyz[1],xyz[2]\n" + "".join(f"{100000 * k},{k % 3},{k % 5},{k % 7}\n" for k in range(20))
    )
    assert [guess.channel for guess in inspect_log(path).guesses] == ["p", "q", "r"]


def test_commands_of_one_message_are_taken_where_a_table_has_several(tmp_path):
    motors, outputs = [f"actuator_motors.control[{i}]" for i in range(2)], [f"RCOU.C{i + 1}" for i in range(3)]
    rows = (f"{0.1 * k:.1f},{k / 20},{-k / 20},{1500 + k},{1500 - k},{1400 + 10 * k}\n" for k in range(20))
    found = inspect_log(written(tmp_path, ",".join(["time", *motors, *outputs]) + "\n" + "".join(rows)))
    assert [guess.column for guess in best(found.guesses)] == outputs


@pytest.mark.parametrize("is_measured", [True, False])
def test_a_smooth_control_is_guessed_to_be_a_line_between_its_samples(tmp_path, is_measured):
    wave = np.sin(0.1 * np.arange(80))
    rpm = 1200 + 200 * (wave if is_measured else np.sign(wave))
    path = written(tmp_path, "time,u,rpm\n" + "".join(f"{0.2 * k:.1f},{wave[k]:.3f},{rpm[k]:.2f}\n" for k in range(80)))
    channels = tomllib.loads(inspect_log(path).as_toml())["import"]["files"][0]["channels"]
    assert channels["n"].get("between") == ("line" if is_measured else None)
    assert "between" not in channels["u"]


def test_a_name_tells_the_unit_of_a_channel_that_has_it():
    assert unit_by_name("ground_mps", "u") == ("m/s", 1.0)
    assert unit_by_name("Lean [cdeg]", "phi") == ("deg", 0.01)
    assert unit_by_name("ground_mps", "r") is None
    assert unit_by_name("ground", "u") is None


def test_clocks_that_do_not_meet_are_told_with_the_shift_where_both_logs_hold_a_quantity(tmp_path):
    """The second log counts from its own start, 1700000004.2 s on the clock of the first."""
    time = 0.1 * np.arange(900)
    turn = np.interp(time, 1.5 * np.arange(61), np.random.default_rng(11).normal(size=61))
    (tmp_path / "a.csv").write_text(
        "time,rpm,yaw_rate,depth\n"
        + "".join(
            f"{1.7e9 + t:.2f},{900 + k % 7},{r:.4f},{2 + k % 3}\n"
            for k, (t, r) in enumerate(zip(time, turn, strict=True))
        )
    )
    rows = [(t - 4.2, r) for t, r in zip(time, turn, strict=True) if t > 4.15]
    (tmp_path / "b.csv").write_text(
        "time_ms,speed,yaw_rate\n" + "".join(f"{1e3 * t:.0f},{t % 3:.2f},{r:.3f}\n" for t, r in rows)
    )
    (tmp_path / "c.csv").write_text("time_ms,speed\n" + "".join(f"{1e3 * t:.0f},{t % 3:.2f}\n" for t, _ in rows))
    a, b, c = (inspect_log(tmp_path / f"{name}.csv") for name in "abc")
    first, second = (tomllib.loads(text)["import"]["files"][0] for text in LogsTogether((a, b)).maps())
    assert "shift" not in first
    assert "z" not in first["channels"]  # which no model has that only surges
    assert float(second["shift"].removesuffix(" s")) == pytest.approx(1.7e9 + 4.2, abs=0.02)
    assert "r is in both logs, correlation 1.000" in LogsTogether((a, b)).maps()[1]
    assert (
        "the clocks do not meet: its first stamp is 1.7e+09 s before that of a.csv"
        in LogsTogether((a, b)).lines()[1][-1]
    )
    assert "no quantity in both logs gives the shift" in LogsTogether((a, c)).lines()[1][-1]
    assert "shift" not in tomllib.loads(LogsTogether((a, c)).maps()[1])["import"]["files"][0]
    assert LogsTogether((a, a)).lines()[1] == a.lines()


def test_a_column_in_a_unit_of_something_else_is_no_clock_however_evenly_it_rises(tmp_path):
    """A dive at a steady rate with a ramp of the propeller; the stamps are less even than both."""
    stamps = np.cumsum(np.random.default_rng(2).uniform(95, 105, 200))
    rows = [f"{stamp:.3f},{0.1 * i:.1f},{900 + i}" for i, stamp in enumerate(stamps)]
    (tmp_path / "dive.csv").write_text("millis,depth_m,rpm\n" + "\n".join(rows) + "\n")
    (table,) = inspect_log(tmp_path / "dive.csv").tables
    assert (table.clock.name, table.clock.unit, table.clock.is_named) == ("millis", "ms", False)


def guessed(folder, head, *columns):
    """Channels by column that are guessed of a text; `columns` are the least and greatest of each column behind the time."""
    rows = (
        ",".join(
            [f"{0.1 * k:.1f}", *(f"{least + (greatest - least) * (k % 9) / 8:.6g}" for least, greatest in columns)]
        )
        for k in range(60)
    )
    found = inspect_log(written(folder, "\n".join([f"time,{head}", *rows]) + "\n", "named.csv"))
    return {one.column: (one.channel, one.unit) for one in best(found.guesses)}, found


COUNTED = {
    "commands": ("thruster_{}", (-0.8, 1.0), "f", "command"),
    "per cent": ("thr{}_cmd", (-100.0, 70.0), "f", "command"),
    "pulse widths": ("pwm_{}", (1600.0, 1900.0), "f", "command"),
    "outputs": ("out{}", (1300.0, 1700.0), "f", "command"),
    "newtons by the unit": ("thruster_{}_newtons", (-30.0, 40.0), "f", "N"),
    "newtons by the name": ("thruster{}.thrust", (-30.0, 40.0), "f", "N"),
    "newtons by the range": ("thruster_{}", (-31.25, 40.5), "f", "N"),
    "thrusts": ("thrust_{}", (-0.5, 0.5), "f", "N"),
    "topics": ("/rov/thruster_{}/cmd_thrust", (-20.0, 20.0), "f", "N"),
    "inputs": ("/rov/thrusters/{}/input", (-0.5, 0.9), "f", "command"),
    "revolutions": ("motor_{}_rpm", (-900.0, 1200.0), "n", "rpm"),
    "speeds": ("motor_{}_speed", (-9.0, 12.0), "n", "rev/s"),
}


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("case", COUNTED)
def test_thrusters_are_counted_from_the_first_number_that_a_log_has(tmp_path, case, first):
    name, ends, channel, unit = COUNTED[case]
    names = [name.format(first + k) for k in range(6)]
    expected = {one: (f"{channel}_{k + 1}", unit) for k, one in enumerate(names)}
    assert guessed(tmp_path, ",".join(names), *[ends] * 6)[0] == expected


@pytest.mark.parametrize(
    "name",
    [
        "channels[{}]",
        "rc_override.channels[{}]",
        "RC_CHANNELS_OVERRIDE.chan{}_raw",
        "RCIN.C{}",
        "rc_override_{}",
        "rc_override_{}, from 0",
        "input_rc.values[{}]",
    ],
)
def test_radio_control_is_of_axes_and_of_no_thruster(tmp_path, name):
    name, _, begins = name.partition(", from ")
    first = 0 if "[" in name or begins else 1
    columns = [name.format(first + k) for k in range(8)]
    ends = [(1400.0, 1600.0)] * 8
    if name == "channels[{}]":  # only the topic tells
        tables = [summed("/mavros/rc/override", columns, 1500 + np.arange(9.0))]
        assert guesses(tables) == ()
        said = remarks((), tables)
    else:
        found, log = guessed(tmp_path, ",".join(columns), *ends)
        assert found == {}
        said = log.remarks
    assert len(said) == 1
    assert f"{columns[0]} pitch, {columns[1]} roll, {columns[2]} up, {columns[3]} yaw, {columns[4]} forward" in said[0]
    assert columns[6] not in said[0]


NOTHING = {
    "thruster_1_deg": [(0.0, 40.0)],
    "path/w": [(0.0, 57.0)],
    "w": [(0.0, 57.0)],  # beyond any speed
    "path_reference.u": [(0.0, 1.0)],
    "pid_gains.p": [(0.0, 1.0)],
    "/cmd_vel/linear.x": [(0.0, 1.0)],
    "thruster_1": [(-40.0, 40.0)],  # whole numbers of no unit
    "motor_0": [(0.5, 2999.5)],  # beyond the force of a thruster
    "orientation.x,orientation.y,orientation.z": [(-0.5, 0.5)] * 3,  # parts of a quaternion
}
PORT_AND_STARBOARD = ("f_1 command", "f_2 command")
BY_RANGE = [
    ("thruster_1", [(-1.0, 1.0)], ("f_1 command",)),
    ("thruster_2_N", [(-30.0, 40.0)], ("f_2 N",)),
    ("thruster_3_rpm", [(-900.0, 1200.0)], ("n_3 rpm",)),
    ("motor_starboard", [(1300.0, 1700.0)], ("f_2 command",)),
    ("port_pwm", [(1300.0, 1700.0)], ("f_1 command",)),
    *((pair, [(1510.0, 1700.0)] * 2, PORT_AND_STARBOARD) for pair in ("PWM_L,PWM_R", "thruster_l,thruster_r")),
    *((pair, [(-100.0, 100.0)] * 2, PORT_AND_STARBOARD) for pair in ("PWM_L,PWM_R", "motor_left,motor_right")),
    (
        "a.orientation.x,a.orientation.y,a.orientation.z",
        [(-0.1, 0.1), (-0.2, 0.1), (-3.0, 3.1)],
        ("phi rad", "theta rad", "psi rad"),
    ),
    (
        "a.orientation.w,a.orientation.x,a.orientation.y,a.orientation.z",
        [(0.5, 1.0), *[(-0.5, 0.5)] * 3],
        ("q_w 1", "q_x 1", "q_y 1", "q_z 1"),
    ),
]
"""Columns, their least and greatest values, and channel and unit of each."""


@pytest.mark.parametrize(
    ("head", "ends", "channels"), [*BY_RANGE, *((head, ends, ()) for head, ends in NOTHING.items())]
)
def test_columns_are_guessed_by_name_and_range_together(tmp_path, head, ends, channels):
    assert [" ".join(one) for one in guessed(tmp_path, head, *ends)[0].values()] == [*channels]


@pytest.mark.parametrize("topic", ["/rov/angle_radian", "/rov/rpy", "/rov/cmd_vel", "/rov/attitude_euler"])
def test_the_type_of_a_velocity_that_holds_something_else_is_no_guess(topic):
    names = ("linear.x", "angular.x", "angular.y", "angular.z")
    for name, expected in ((topic, []), ("/rov/angular_velocity", ["u", "p", "q", "r"])):
        table = summed(name, names, kind="geometry_msgs/msg/Twist")
        assert [one.channel for one in guesses([table])] == expected
