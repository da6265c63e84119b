"""Every format against its own writer: the same voyage comes back, with exact stamps, from a catalogue that knows it."""

import sys
from decimal import Decimal

import numpy as np
import pytest

from seatrial.core import processes as apart
from seatrial.core.errors import InputError
from seatrial.logs.formats.protocol import LogFile
from seatrial.logs.formats.registry import catalogue, format_of, read_columns, stream
from seatrial.logs.log_table import read_log_table
from seatrial.logs.source import ColumnMap, LogSource
from tests.logs.log_cases import refusal
from tests.logs.log_writers import RPM, STAMPS, SURGE, TICKS, WRITERS, dataflash, ros_1, ros_2, ros_store, telemetry

CHANNELS = {"u": ("surge", "m/s", "measurement"), "n": ("rpm", "rpm", "control")}


def mapped(written, **changes):
    channels = {name: ColumnMap(getattr(written, key), unit, role) for name, (key, unit, role) in CHANNELS.items()}
    return LogSource(written.path, None, None, channels, table=written.table, **changes)


@pytest.fixture(params=list(WRITERS))
def written(request, tmp_path):
    return WRITERS[request.param](tmp_path)


def test_catalogue_knows_table_columns_and_clock(written):
    tables = {table.name: table for table in catalogue(LogFile(written.path))}
    table = tables[written.table]
    assert {written.surge, written.rpm, written.clock} <= {column.name for column in table.columns}
    assert table.clocks[0] == written.clock
    assert table.unit(written.clock) == written.unit
    assert table.rows in (None, STAMPS.size)


def test_columns_come_back_exactly(written):
    raw = read_columns(LogFile(written.path), written.table, [written.surge, written.clock], [written.clock])
    np.testing.assert_array_equal(raw.columns[written.surge], written.surge_values)
    np.testing.assert_array_equal(raw.columns[written.clock], written.stamps)
    assert raw.columns[written.clock].dtype == written.stamps.dtype
    first = next(iter(stream(LogFile(written.path), {written.table: [written.rpm]})))
    assert first.columns.keys() == {written.rpm}


MODULES = ("matlab", "moos", "netcdf", "npz", "parquet", "protocol", "ros_messages", "ulog")


def test_many_blocks_are_one_table(written, monkeypatch):
    for module in MODULES:
        monkeypatch.setattr(f"seatrial.logs.formats.{module}.BLOCK_ROWS", 7)
    monkeypatch.setattr("seatrial.logs.formats.dataflash._PIECE_BYTES", 100)
    monkeypatch.setattr("seatrial.logs.formats.telemetry._PIECE_BYTES", 100)
    raw = read_columns(LogFile(written.path), written.table, [written.surge, written.clock], [written.clock])
    np.testing.assert_array_equal(raw.columns[written.surge], written.surge_values)
    np.testing.assert_array_equal(raw.columns[written.clock], written.stamps)
    shares = [block.done for block in stream(LogFile(written.path), {written.table: [written.rpm]})]
    assert shares == sorted(shares)
    assert len(shares) > 1 or written.path.suffix == ".csv"


def test_log_in_si(written):
    table = read_log_table(mapped(written))
    np.testing.assert_array_equal(table.columns["u"], written.surge_values)
    turns = table.columns["n"][np.isfinite(table.columns["n"])] * 30 / np.pi
    np.testing.assert_allclose(turns, RPM[np.isfinite(table.columns["n"])], rtol=1e-9)
    scale = {"ns": 1e-9, "us": 1e-6, "s": 1.0}[written.unit]
    np.testing.assert_allclose(table.time, (written.stamps - written.stamps[0]) * scale, rtol=1e-15, atol=1e-15)
    if written.stamps.dtype == np.int64:
        assert table.epoch == Decimal(int(written.stamps[0])) * Decimal(repr(scale))
    assert table.options["time_column"] == written.clock
    assert table.options["time_unit"] == written.unit
    assert any(f"time is the column {written.clock}" in note for note in table.notes)
    again = read_log_table(mapped(written))
    assert again.sha256 == table.sha256


@pytest.mark.parametrize(
    "name", ["ros 1", "mcap", "parquet", "netcdf 4", "netcdf 3", "matlab 5", "matlab 7.3", "dataflash", "alog"]
)
def test_content_tells_the_format_where_the_suffix_does_not(tmp_path, name):
    written = WRITERS[name](tmp_path)
    form = format_of(written.path)
    for other in ("renamed.dat", "renamed.csv", "renamed.parquet"):
        written.path.rename(tmp_path / other)
        assert format_of(tmp_path / other) is form
        (tmp_path / other).rename(written.path)


def test_what_is_wrong_names_file_table_and_column(written):
    source = mapped(written)
    name = written.path.name
    wrong = {"u": ColumnMap("nonsense", "m/s", "measurement")}
    with refusal(name, 'column "nonsense"', "no column"):
        read_log_table(LogSource(written.path, None, None, wrong, table=written.table))
    with refusal(name, "table", "no such thing"):
        read_log_table(LogSource(written.path, None, None, source.channels, table="no such thing"))
    if written.path.suffix != ".csv":
        with refusal(name, "delimiter", "','", "remove it"):
            read_log_table(mapped(written, delimiter=","))
        with refusal(name, "skip_rows", "3", "remove it"):
            read_log_table(mapped(written, skip_rows=3))


def test_table_must_be_named_where_there_are_several(tmp_path):
    written = ros_1(tmp_path)
    with refusal("run.bag, table", "2 tables and none named", "/state", "seatrial inspect"):
        read_log_table(LogSource(written.path, None, None, mapped(written).channels))


@pytest.mark.parametrize("first", [True, False])
def test_ros_numbers_are_those_of_the_library(tmp_path, first):
    """Every listed number of every message, against rosbags' own deserialisation."""
    from rosbags.highlevel import AnyReader

    written = ros_1(tmp_path) if first else ros_2(tmp_path)
    table = next(table for table in catalogue(LogFile(written.path)) if table.name == "/state")
    assert table.kind == "vehicle_msgs/msg/State"
    asked = [column.name for column in table.columns] + ["rpm[2]", "axes[1].value"]
    assert "covariance[35]" in asked
    assert not any(name.startswith("picture") for name in asked)
    raw = read_columns(LogFile(written.path), "/state", asked)
    with AnyReader([written.path]) as reader:
        connections = [connection for connection in reader.connections if connection.topic == "/state"]
        for k, (connection, time, data) in enumerate(reader.messages(connections)):
            message = reader.deserialize(data, connection.msgtype)
            assert raw.columns["log_time"][k] == time
            for name in asked[1:]:
                expected = followed(message, name)
                assert raw.columns[name][k] == expected or (np.isnan(raw.columns[name][k]) and expected is None), name
    assert raw.columns["header.stamp"].dtype == np.int64
    assert raw.columns["small[1]"].dtype == np.int64


def followed(message, name):
    """Value at a dotted path of a message object, None beyond the end of a sequence."""
    for part in name.replace("[", ".[").split("."):
        if part.startswith("["):
            index = int(part[1:-1])
            if index >= len(message):
                return None
            message = message[index]
        else:
            message = getattr(message, part)
    if type(message).__name__.endswith("Time"):
        return message.sec * 10**9 + message.nanosec
    return message


def test_bags_without_definitions_know_the_messages_of_mavros(tmp_path):
    """As ROS 2 Humble writes them: the outputs of an autopilot are read, a message of one's own is named as undefined."""
    import sqlite3

    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import get_types_from_msg

    store, kind = ros_store(False), "mavros_msgs/msg/RCOut"
    store.register(get_types_from_msg("std_msgs/Header header\nuint16[] channels\n", kind))
    stamp, header = store.types["builtin_interfaces/msg/Time"], store.types["std_msgs/msg/Header"]
    with Writer(tmp_path / "bag", version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
        outputs, own = (writer.add_connection(name, name, typestore=store) for name in (kind, "vehicle_msgs/msg/State"))
        for k in range(4):
            message = store.types[kind](header(stamp(k, 0), ""), np.array([1500 + k, 1100], np.uint16))
            writer.write(outputs, k * 10**9, store.serialize_cdr(message, kind))
            writer.write(own, k * 10**9, b"")
    with sqlite3.connect(next((tmp_path / "bag").glob("*.db3"))) as database:
        database.executescript("DROP TABLE message_definitions; UPDATE schema SET schema_version = 3;")
    log = LogFile(tmp_path / "bag")
    known, unknown = catalogue(log)
    assert "ROS 2 Humble" in unknown.trouble
    raw = read_columns(log, known.name, ["channels[0]"])
    np.testing.assert_array_equal(raw.columns["channels[0]"], [1500, 1501, 1502, 1503])


def test_ros_stamp_that_never_moves_gives_way_to_the_time_of_receipt(tmp_path):
    from rosbags.rosbag2 import StoragePlugin, Writer

    store = ros_store(False)
    types, kind = store.types, "geometry_msgs/msg/TwistStamped"
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/twist", kind, typestore=store)
        for k in range(10):
            vector = types["geometry_msgs/msg/Vector3"]
            twist = types["geometry_msgs/msg/Twist"](vector(float(k), 0.0, 0.0), vector(0.0, 0.0, 0.0))
            header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](0, 0), "")
            data = store.serialize_cdr(types[kind](header, twist), kind)
            writer.write(topic, int(STAMPS[k]), data)
    channels = {"u": ColumnMap("twist.linear.x", "m/s", "measurement")}
    table = read_log_table(LogSource(tmp_path / "bag", None, None, channels))
    assert table.epoch == Decimal(int(STAMPS[0])).scaleb(-9)
    assert "time is the column log_time, in ns" in table.notes


def test_matlab_tables_by_length_and_struct(tmp_path):
    written = WRITERS["matlab 5"](tmp_path)
    tables = {table.name: table for table in catalogue(LogFile(written.path))}
    assert {name: table.rows for name, table in tables.items()} == {"nav": 40, "ts": 9, "workspace": 5}
    raw = read_columns(LogFile(written.path), "ts", ["Time", "Data[0]", "Data[1]"])
    np.testing.assert_array_equal(raw.columns["Data[1]"], 10.0 * np.arange(9))
    np.testing.assert_array_equal(raw.columns["Time"], TICKS[:9])
    (matrix,) = read_columns(LogFile(written.path), "nav", ["wrench[1]"]).columns.values()
    np.testing.assert_array_equal(matrix, 2 * SURGE)


def test_netcdf_units_groups_and_elements(tmp_path):
    written = WRITERS["netcdf 4"](tmp_path)
    tables = {table.name: table for table in catalogue(LogFile(written.path))}
    assert tables["slow/time"].rows == 7
    assert tables["time"].unit("speed") == "m/s"
    raw = read_columns(LogFile(written.path), "time", ["wrench[2]"])
    np.testing.assert_array_equal(raw.columns["wrench[2]"], 3 * SURGE)
    channels = {"u": ColumnMap("speed", "kn", "measurement")}
    (told,) = read_log_table(LogSource(written.path, None, None, channels, table="time")).cautions
    assert 'column "speed" is "kn" in the map, and the log states "m/s": set unit = "m/s" there' in told


def test_parquet_gaps_and_nested_columns(tmp_path):
    written = WRITERS["parquet"](tmp_path)
    raw = read_columns(LogFile(written.path), "rows", ["motion.v.w", "wrench[1]", "rpm"])
    np.testing.assert_array_equal(raw.columns["motion.v.w"], -SURGE)
    np.testing.assert_array_equal(raw.columns["wrench[1]"], 2 * RPM)
    assert np.flatnonzero(np.isnan(raw.columns["rpm"])).tolist() == [5]


def test_dataflash_agrees_with_pymavlink(tmp_path):
    from pymavlink.DFReader import DFReader_binary

    written = dataflash(tmp_path)
    tables = {table.name: table for table in catalogue(LogFile(written.path))}
    assert [tables[name].unit(column) for name in ("NAV[0]", "NAV[1]") for column in ("TimeUS", "u", "Roll", "Cm")] == [
        *("us", "m/s", "deg", "cm"),
        *("us", "m/s", "deg", "cm"),
    ]
    theirs = DFReader_binary(str(written.path))
    messages = []
    while (message := theirs.recv_msg()) is not None:
        messages += [message] if message.get_type() == "NAV" else []
    for instance in (0, 1):
        names = ["TimeUS", "u", "rpm", "Roll", "Cm"]
        raw = read_columns(LogFile(written.path), f"NAV[{instance}]", names)
        for name in names:
            expected = [getattr(message, name) for message in messages if instance == message.I]
            np.testing.assert_allclose(raw.columns[name], expected, rtol=1e-15)


def test_dataflash_passes_over_garbage_and_says_so(tmp_path):
    written = dataflash(tmp_path)
    data = written.path.read_bytes()
    at = data.rindex(b"\xa3\x95\x0a")
    noise = b"\x07\xa3\x95\x0a" + bytes(range(20))
    written.path.write_bytes(data[:at] + noise + data[at:] + b"\xff" * 100)
    table = read_log_table(mapped(written))
    np.testing.assert_array_equal(table.columns["u"], written.surge_values)
    assert any("124 bytes of the log are no messages" in note for note in table.notes)


def test_telemetry_agrees_with_pymavlink(tmp_path):
    from pymavlink import mavutil

    written = telemetry(tmp_path)
    tables = {table.name for table in catalogue(LogFile(written.path))}
    assert tables == {"ATTITUDE", "SERVO_OUTPUT_RAW", "HEARTBEAT of 1/1", "HEARTBEAT of 255/190"}
    theirs = mavutil.mavlink_connection(str(written.path), dialect="ardupilotmega")
    for kind, names in (("ATTITUDE", ["pitch", "time_boot_ms"]), ("SERVO_OUTPUT_RAW", ["servo1_raw", "servo8_raw"])):
        raw = read_columns(LogFile(written.path), kind, names)
        theirs.rewind()
        messages = []
        while (message := theirs.recv_match(type=kind)) is not None:
            messages.append(message)
        for name in names:
            assert raw.columns[name].tolist() == [getattr(message, name) for message in messages]


def test_telemetry_passes_over_garbage_and_bad_checksums(tmp_path):
    written = telemetry(tmp_path)
    data = bytearray(written.path.read_bytes())
    data[40] ^= 0xFF
    written.path.write_bytes(b"\x00\x05\xee" + bytes(data))
    written.path.write_bytes(bytes(data[:20]) + bytes(data))
    raw = read_columns(LogFile(written.path), "ATTITUDE", ["roll"])
    assert 38 <= raw.columns["roll"].size <= 40
    assert any("passed over" in table.notes[0] for table in catalogue(LogFile(written.path)))


@pytest.mark.parametrize(
    ("library", "name", "extra"),
    [
        ("rosbags.rosbag1", "ros 1", "ros"),
        ("rosbags.rosbag2", "mcap", "ros"),
        ("pyarrow", "parquet", "parquet"),
        ("pymavlink.dialects.v20.ardupilotmega", "telemetry", "ardupilot"),
        ("pyulog", "ulog", "px4"),
    ],
)
def test_missing_extra_names_the_command(tmp_path, monkeypatch, library, name, extra):
    written = WRITERS[name](tmp_path)
    monkeypatch.setitem(sys.modules, library, None)
    monkeypatch.setattr(apart, "_is_apart", True)  # the process of its own has all libraries
    with refusal(str(written.path), "not installed", f'pip install -e ".[{extra}]"'):
        catalogue(LogFile(written.path))


def test_infinity_is_an_error_and_nan_a_gap(tmp_path):
    import h5netcdf

    path = tmp_path / "run.nc"
    with h5netcdf.File(path, "w") as file:
        file.dimensions = {"time": 6}
        file.create_variable("time", ("time",), float, data=np.arange(6.0))
        file.create_variable("u", ("time",), float, data=[0.0, 1.0, np.nan, 3.0, 4.0, 5.0])
        file.create_variable("v", ("time",), float, data=[0.0, 1.0, np.inf, 3.0, 4.0, 5.0])
    speed = ColumnMap("u", "m/s", "measurement")
    table = read_log_table(LogSource(path, None, None, {"u": speed}))
    assert "u: 1 of 6 cells are empty" in table.notes
    with refusal('run.nc, table "time", column "v", row 3', "inf", "finite"):
        read_log_table(LogSource(path, None, None, {"u": ColumnMap("v", "m/s", "measurement")}))
    with refusal('run.nc, table "time", column "v", row 3', "time inf"):
        read_log_table(LogSource(path, "v", "s", {"u": speed}))


def test_no_log_at_all(tmp_path):
    with refusal("nowhere.bag", "no such file"):
        format_of(tmp_path / "nowhere.bag")
    with refusal("a folder", "metadata.yaml"):
        format_of(tmp_path)
    for name in ("a.bag", "a.mcap", "a.parquet", "a.nc", "a.mat", "a.bin", "a.tlog", "a.db3", "a.alog"):
        path = tmp_path / name
        path.write_bytes(b"")
        with pytest.raises(InputError, match="an empty file"):
            catalogue(LogFile(path))
        path.write_bytes(b"words of no format, though long enough to hold a header of it\n" * 9)
        with pytest.raises(InputError, match="without the first bytes of"):
            catalogue(LogFile(path))


def test_a_numpy_archive_has_a_table_for_its_clock(tmp_path):
    path = WRITERS["npz"](tmp_path).path
    (table,) = catalogue(LogFile(path))
    assert [column.name for column in table.columns] == [
        "timestamps",
        "velocities[0]",
        "velocities[1]",
        "commands",
        "rpm",
    ]
    held = read_columns(LogFile(path), "timestamps", ["commands"]).columns["commands"]
    np.testing.assert_array_equal(held[:-1], RPM[:-1])
    assert np.isnan(held[-1])
    without = tmp_path / "without.npz"
    np.savez_compressed(
        without, a=np.arange(5.0), b=np.arange(12.0).reshape(6, 2, order="F").T.copy().T, c=np.arange(5)
    )
    assert {one.name: [column.name for column in one.columns] for one in catalogue(LogFile(without))} == {
        "5 rows": ["a", "c"],
        "6 rows": ["b[0]", "b[1]"],
    }
    second = read_columns(LogFile(without), "6 rows", ["b[1]"]).columns["b[1]"]
    np.testing.assert_array_equal(second, np.load(without)["b"][:, 1])


def test_a_numpy_archive_of_instants_and_what_is_not_read_of_one(tmp_path):
    path = tmp_path / "instants.npz"
    time = np.datetime64("2025-05-27T11:40:38", "us") + 100_000 * np.arange(5)
    np.savez(path, time=time, u=np.arange(5.0), poses=np.zeros((5, 3, 3)), z=1j * np.arange(5), mass=np.float64(11.2))
    (table,) = catalogue(LogFile(path))
    assert [*map(tuple, table.columns)] == [("time", "us"), ("u", None)]
    assert table.clocks == ("time",)
    (note,) = table.notes
    for name in ("poses (float64, shape (5, 3, 3))", "z (complex128", "mass (float64, shape ())"):
        assert name in note
    np.testing.assert_array_equal(read_columns(LogFile(path), "time", ["time"]).columns["time"], time.astype(np.int64))


def test_a_numpy_archive_of_objects_is_refused_and_never_unpickled(tmp_path):
    path = tmp_path / "objects.npz"
    np.savez(path, things=np.array([{"a": 1}, None, 2.0], dtype=object))
    with refusal("objects.npz", "no array of numbers", "Python objects"):
        catalogue(LogFile(path))
