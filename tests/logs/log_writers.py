"""One short voyage written in every format, each by the format's own writer library."""

import json
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

ROWS = 40
START = 1_669_909_203_330_211_715
STAMPS = START + 20_000_000 * np.arange(ROWS) + np.random.default_rng(3).integers(0, 1_000_000, ROWS)
RECEIVED = STAMPS + 1_000_003
SURGE = 1.0 + 0.25 * np.sin(0.3 * np.arange(ROWS))
TICKS = np.round(0.5 + 0.02 * np.arange(ROWS), 2)
RPM = 600.0 + np.arange(ROWS) % 7

STATE = """std_msgs/Header header
string mode
float64[3] wrench
float32[] rpm
Axis[] axes
uint8[] picture
bool armed
geometry_msgs/Vector3 velocity
uint64 count
int8[2] small
float64[36] covariance
================================================================================
MSG: vehicle_msgs/Axis
string name
float64 value
"""
"""A message of our own: strings and sequences in front of what is wanted, so that nothing lies at a fixed place."""


@dataclass(frozen=True)
class Written:
    """A log, the table and columns that hold surge speed and propeller speed, and its clock."""

    path: Path
    table: str
    surge: str
    rpm: str
    clock: str
    unit: str
    stamps: np.ndarray
    surge_values: np.ndarray = field(default_factory=lambda: SURGE)


def ros_store(first: bool) -> Any:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if first else Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(STATE, "vehicle_msgs/msg/State"))
    return store


def state(store: Any, k: int, first: bool = False) -> Any:
    """Message k; the number of its elements changes from message to message."""
    types = store.types
    seconds, nanoseconds = divmod(int(STAMPS[k]), 10**9)
    stamp = types["builtin_interfaces/msg/Time"](seconds, nanoseconds)
    frame = {"seq": k} if first else {}
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="body"[: k % 5], **frame)
    axis = types["vehicle_msgs/msg/Axis"]
    return types["vehicle_msgs/msg/State"](
        header=header,
        mode="m" * (k % 4),
        wrench=np.array([k, -k, 0.5 * k]),
        rpm=np.array([RPM[k]] * (1 + k % 3), np.float32),
        axes=[axis("a" * (j + k % 3), 10.0 * k + j) for j in range(k % 3)],
        picture=np.arange(k % 6, dtype=np.uint8),
        armed=bool(k % 2),
        velocity=types["geometry_msgs/msg/Vector3"](SURGE[k], -SURGE[k], 0.0),
        count=2**53 + k,
        small=np.array([-k, k], np.int8),
        covariance=np.arange(36.0) + k,
    )


def ros_1(folder: Path, rows: int = ROWS, compression: str = "NONE") -> Written:
    from rosbags.rosbag1 import Writer

    store, path = ros_store(True), folder / "run.bag"
    writer = Writer(path)
    if compression != "NONE":
        writer.set_compression(getattr(Writer.CompressionFormat, compression))
    with writer:
        topic = writer.add_connection("/state", "vehicle_msgs/msg/State", typestore=store)
        other = writer.add_connection("/other", "std_msgs/msg/Float64", typestore=store)
        for k in range(rows):
            message = state(store, k % ROWS, True)
            writer.write(topic, int(RECEIVED[k % ROWS]), store.serialize_ros1(message, "vehicle_msgs/msg/State"))
            number = store.types["std_msgs/msg/Float64"](float(k))
            writer.write(other, int(RECEIVED[k % ROWS]) + 7, store.serialize_ros1(number, "std_msgs/msg/Float64"))
    return Written(path, "/state", "velocity.x", "rpm[0]", "header.stamp", "ns", STAMPS)


def ros_2(folder: Path, storage: str = "SQLITE3", rows: int = ROWS, little_endian: bool = True) -> Written:
    from rosbags.rosbag2 import StoragePlugin, Writer

    store, path = ros_store(False), folder / f"run_{storage.lower()}"
    with Writer(path, version=9, storage_plugin=getattr(StoragePlugin, storage)) as writer:
        topic = writer.add_connection("/state", "vehicle_msgs/msg/State", typestore=store)
        other = writer.add_connection("/other", "std_msgs/msg/Float64", typestore=store)
        for k in range(rows):
            data = store.serialize_cdr(state(store, k % ROWS), "vehicle_msgs/msg/State", little_endian=little_endian)
            writer.write(topic, int(RECEIVED[k % ROWS]), data)
            number = store.types["std_msgs/msg/Float64"](float(k))
            writer.write(other, int(RECEIVED[k % ROWS]) + 7, store.serialize_cdr(number, "std_msgs/msg/Float64"))
    return Written(path, "/state", "velocity.x", "rpm[0]", "header.stamp", "ns", STAMPS)


def mcap(folder: Path) -> Written:
    written = ros_2(folder, "MCAP")
    (path,) = written.path.glob("*.mcap")
    return Written(path, "/state", "velocity.x", "rpm[0]", "header.stamp", "ns", STAMPS)


def json_mcap(path: Path, messages: list[tuple[str, int, Any]], compression: str = "zstd", chunk: int = 16) -> Path:
    """Write messages (topic, ns, content) as the recorder of BlueOS does: JSON on channels of a JSON schema, in compressed chunks."""

    def record(kind: int, body: bytes) -> bytes:
        return struct.pack("<BQ", kind, len(body)) + body

    def text(words: str) -> bytes:
        return struct.pack("<I", len(words.encode())) + words.encode()

    def packed(data: bytes) -> bytes:
        if compression == "zstd":
            from backports import zstd

            return zstd.compress(data)
        if compression == "lz4":
            import lz4.frame

            return lz4.frame.compress(data)
        return data

    topics = list(dict.fromkeys(topic for topic, _, _ in messages))
    out = [b"\x89MCAP0\r\n", record(1, text("") + text("mcap-rs-0.23"))]
    for start in range(0, len(messages), chunk):
        inner = b""
        for number, topic in enumerate(topics, 1):
            schema = json.dumps({"type": "object"}).encode()
            inner += record(
                3,
                struct.pack("<H", number)
                + text(topic.replace("/", "."))
                + text("jsonschema")
                + struct.pack("<I", len(schema))
                + schema,
            )
            inner += record(4, struct.pack("<HH", number, number) + text(topic) + text("json") + struct.pack("<I", 0))
        for topic, time, content in messages[start : start + chunk]:
            data = json.dumps(content).encode()
            inner += record(5, struct.pack("<HIQQ", topics.index(topic) + 1, start, time, time) + data)
        data = packed(inner)
        head = struct.pack("<QQQI", messages[start][1], messages[start][1], len(inner), 0) + text(compression)
        out.append(record(6, head + struct.pack("<Q", len(data)) + data))
    out += [record(15, b"\0\0\0\0"), record(2, b"\0" * 20), b"\x89MCAP0\r\n"]
    path.write_bytes(b"".join(out))
    return path


def mavlink_json(kind: str, **fields: Any) -> dict[str, Any]:
    """Return a MAVLink message as BlueOS writes it."""
    header = {"system_id": 1, "component_id": 1, "sequence": 0}
    return {"header": header, "message": {"type": kind, **fields}}


def blueos(folder: Path) -> Written:
    topic = "mavlink/1/1/NAMED"
    rows = [(topic, int(STAMPS[k]), mavlink_json("NAMED", vx=float(SURGE[k]), rpm=[RPM[k], 0.0])) for k in range(ROWS)]
    other = [("mavlink/1/1/OTHER", int(STAMPS[k]) + 5, mavlink_json("OTHER", a=k)) for k in range(ROWS)]
    path = json_mcap(folder / "recorder.mcap", [one for pair in zip(rows, other, strict=True) for one in pair])
    return Written(path, topic, "message.vx", "message.rpm[0]", "log_time", "ns", STAMPS)


def parquet(folder: Path) -> Written:
    import pyarrow as arrow
    import pyarrow.parquet as store

    table = arrow.table(
        {
            "when": arrow.array(STAMPS, arrow.timestamp("ns")),
            "motion": arrow.array([{"u": value, "v.w": -value} for value in SURGE.tolist()]),
            "rpm": arrow.array([None if k == 5 else value for k, value in enumerate(RPM.tolist())]),
            "remark": arrow.array(["ok"] * ROWS),
            "wrench": arrow.array([[value, 2 * value] for value in RPM.tolist()], arrow.list_(arrow.float64(), 2)),
        }
    )
    path = folder / "run.parquet"
    store.write_table(table, path, row_group_size=17)
    return Written(path, "rows", "motion.u", "rpm", "when", "ns", STAMPS)


def netcdf_4(folder: Path) -> Written:
    import h5netcdf

    path = folder / "run.nc"
    with h5netcdf.File(path, "w") as file:
        file.dimensions = {"time": ROWS, "axis": 3}
        clock = file.create_variable("time", ("time",), np.int64, data=STAMPS)
        clock.attrs["units"] = "nanoseconds since 1970-01-01"
        speed = file.create_variable("speed", ("time",), float, data=SURGE)
        speed.attrs["units"] = "m/s"
        turns = file.create_variable("rpm", ("time",), np.int16, data=(RPM * 10).astype(np.int16), fillvalue=-1)
        turns.attrs["scale_factor"] = 0.1
        turns.attrs["units"] = "rpm"
        file.create_variable("wrench", ("time", "axis"), float, data=np.outer(SURGE, [1.0, 2.0, 3.0]))
        group = file.create_group("slow")
        group.dimensions = {"time": 7}
        group.create_variable("depth", ("time",), float, data=np.arange(7.0))
    return Written(path, "time", "speed", "rpm", "time", "ns", STAMPS)


def netcdf_3(folder: Path) -> Written:
    from scipy.io import netcdf_file

    path = folder / "classic.nc"
    with netcdf_file(path, "w") as file:
        file.createDimension("time", ROWS)
        for name, unit, values in (
            ("time", b"seconds since launch", TICKS),
            ("speed", b"m/s", SURGE),
            ("rpm", b"rpm", RPM),
        ):
            variable = file.createVariable(name, "d", ("time",))
            variable[:] = values
            variable.units = unit
    return Written(path, "time", "speed", "rpm", "time", "s", TICKS)


def matlab_5(folder: Path, **options: Any) -> Written:
    from scipy.io import savemat

    path = folder / "run.mat"
    nav = {"time": TICKS, "u": SURGE, "wrench": np.outer(SURGE, [1.0, 2.0]), "label": "pool", "gain": 2.0}
    series = {"Time": TICKS[:9, None], "Data": np.outer(np.arange(9.0), [1.0, 10.0])}
    cells = np.array([np.arange(3), "x"], object)
    content = {"nav": nav | {"engine": {"rpm": RPM}}, "ts": series, "loose": np.arange(5), "odd": cells}
    savemat(path, content, **options)
    return Written(path, "nav", "u", "engine.rpm", "time", "s", TICKS)


def matlab_4(folder: Path) -> Written:
    from scipy.io import savemat

    path = folder / "old.mat"
    savemat(path, {"t": TICKS, "u": SURGE, "rpm": RPM}, format="4")
    return Written(path, "workspace", "u", "rpm", "t", "s", TICKS)


def matlab_73(folder: Path) -> Written:
    """As MATLAB writes it: HDF5 behind 512 bytes of text, vectors as rows, structs as groups."""
    import h5py

    path = folder / "new.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        nav = file.create_group("nav")
        nav.attrs["MATLAB_class"] = np.bytes_("struct")
        for name, values in (("time", TICKS), ("u", SURGE), ("wrench", np.outer(SURGE, [1.0, 2.0]).T)):
            made = nav.create_dataset(name, data=np.atleast_2d(values), chunks=True, compression="gzip")
            made.attrs["MATLAB_class"] = np.bytes_("double")
        engine = nav.create_group("engine")
        engine.create_dataset("rpm", data=RPM[:, None])
        text = nav.create_dataset("label", data=np.array([[112], [111]], np.uint16))
        text.attrs["MATLAB_class"] = np.bytes_("char")
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    return Written(path, "nav", "u", "engine.rpm", "time", "s", TICKS)


def packed(kind: int, layout: str, *values: Any) -> bytes:
    return b"\xa3\x95" + bytes([kind]) + struct.pack("<" + layout, *values)


def described(kind: int, name: str, characters: str, layout: str, columns: str) -> bytes:
    """FMT message of a type."""
    length = 3 + struct.calcsize("<" + layout)
    return packed(128, "BB4s16s64s", kind, length, name.encode(), characters.encode(), columns.encode())


DATAFLASH_HEAD = (
    described(128, "FMT", "BBnNZ", "BB4s16s64s", "Type,Length,Name,Format,Columns")
    + described(1, "UNIT", "QbZ", "Qb64s", "TimeUS,Id,Label")
    + described(2, "MULT", "Qbd", "Qbd", "TimeUS,Id,Mult")
    + described(3, "FMTU", "QBNN", "QB16s16s", "TimeUS,FmtType,UnitIds,MultIds")
    + described(10, "NAV", "QBffcH", "QBffhH", "TimeUS,I,u,rpm,Roll,Cm")
    + described(11, "MSG", "QZ", "Q64s", "TimeUS,Message")
    + packed(1, "Qb64s", 1000, ord("s"), b"s")
    + packed(1, "Qb64s", 1000, ord("n"), b"m/s")
    + packed(1, "Qb64s", 1000, ord("d"), b"deg")
    + packed(1, "Qb64s", 1000, ord("m"), b"m")
    + packed(2, "Qbd", 1000, ord("F"), 1e-6)
    + packed(2, "Qbd", 1000, ord("B"), 1e-2)
    + packed(2, "Qbd", 1000, ord("0"), 1.0)
    + packed(3, "QB16s16s", 1000, 10, b"s#n-dm", b"F-00BB")
)


def dataflash(folder: Path, rows: int = ROWS) -> Written:
    path = folder / "run.BIN"
    micro = (STAMPS - START) // 1000 + 50_000_000
    body = b"".join(
        packed(10, "QBffhH", int(micro[k]), instance, SURGE[k] + instance, RPM[k], 100 * k, k)
        + packed(11, "Q64s", int(micro[k]), b"hello")
        for k in range(min(rows, ROWS))
        for instance in (0, 1)
    )
    path.write_bytes(DATAFLASH_HEAD + body)
    single = SURGE.astype(np.float32).astype(float)
    return Written(path, "NAV[0]", "u", "rpm", "TimeUS", "us", micro, single)


def telemetry(folder: Path) -> Written:
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    path = folder / "run.tlog"
    link = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    ground = dialect.MAVLink(None, srcSystem=255, srcComponent=190)
    records = b""
    for k in range(ROWS):
        time = struct.pack(">Q", int(STAMPS[k]) // 1000)
        attitude = link.attitude_encode(20 * k, SURGE[k], -SURGE[k], 0.0, 0.0, 0.0, RPM[k])
        outputs = link.servo_output_raw_encode(20_000 * k, 0, *(1500 + (k * j) % 90 for j in range(8)))
        for sender, message in ((link, attitude), (ground, link.heartbeat_encode(6, 8, 0, 0, 4)), (link, outputs)):
            records += time + message.pack(sender, force_mavlink1=k % 2 == 1)
        records += time + link.heartbeat_encode(2, 3, 0, 0, 4).pack(link)
    path.write_bytes(records)
    single = SURGE.astype(np.float32).astype(float)
    return Written(path, "ATTITUDE", "roll", "yawspeed", "log_time", "us", STAMPS // 1000, single)


def ulog_message(kind: bytes, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), kind[0]) + body


def ulog(folder: Path) -> Written:
    """Two instances of a topic that holds another, rows without the padding at their end, a text and a dropout in between."""
    path, micro = folder / "run.ulg", (STAMPS - START) // 1000 + 50_000_000
    body = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", int(micro[0])) + ulog_message(b"B", bytes(40))
    for text in (
        b"nav:uint64_t timestamp;speed_s[1] speed;bool[3] ok;double rpm;uint8_t[4] _padding0;",
        b"speed_s:float x;float[2] yz;",
    ):
        body += ulog_message(b"F", text)
    for instance, number in ((0, 3), (1, 260)):
        body += ulog_message(b"A", struct.pack("<BH", instance, number) + b"nav")
    for k in range(ROWS):
        row = struct.pack("<Q3f3Bd", int(micro[k]), SURGE[k], -SURGE[k], 0.0, 1, 0, k % 2, RPM[k])
        body += ulog_message(b"D", struct.pack("<H", 3) + row + bytes(4) * (k % 2))
        body += ulog_message(b"L", b"6" + struct.pack("<Q", k) + b"going") + ulog_message(b"O", b"\1\0")
        body += ulog_message(b"D", struct.pack("<H", 260) + struct.pack("<Q3f3Bd", k, 0, 0, 0, 0, 0, 0, 0.5 * k))
    path.write_bytes(body)
    single = SURGE.astype(np.float32).astype(float)
    return Written(path, "nav[0]", "speed[0].x", "rpm", "timestamp", "us", micro, single)


def alog(folder: Path) -> Written:
    path = folder / "run.alog"
    lines = ["%" * 40, "%% LOG FILE:       ./run.alog", "%% LOGSTART           1669909203.33", "%" * 40]
    for k in range(ROWS):
        time = f"{TICKS[k]:.5f}"
        lines.append(f"{time:15} NAV_SPEED           uSim      {float(SURGE[k])!r}")
        lines.append(
            f"{time:15} NODE_REPORT_LOCAL   pNode     NAME=alpha,TYPE=UUV,SPD={float(SURGE[k])!r}, RPM={RPM[k]}"
        )
        lines.append(f"{time:15} MODE                pHelm     MODE@ACTIVE:LOITERING")
    path.write_text("\n".join(lines) + "\n")
    return Written(path, "NODE_REPORT_LOCAL", "SPD", "RPM", "log_time", "s", TICKS)


def csv(folder: Path) -> Written:
    path = folder / "run.csv"
    rows = zip(STAMPS.tolist(), SURGE.tolist(), RPM.tolist(), strict=True)
    path.write_text("%time,u,rpm,remark\n" + "".join(f"{t},{u!r},{n},ok\n" for t, u, n in rows))
    return Written(path, "rows", "u", "rpm", "%time", "ns", STAMPS)


def npz(folder: Path) -> Written:
    path = folder / "run.npz"
    np.savez(
        path,
        timestamps=TICKS,
        velocities=np.column_stack([SURGE, -SURGE]),
        commands=RPM[:-1],
        rpm=RPM,
        remark=np.array(["ok"] * ROWS),
    )
    return Written(path, "timestamps", "velocities[0]", "rpm", "timestamps", "s", TICKS)


WRITERS = {
    "csv": csv,
    "ros 1": ros_1,
    "ros 1, bz2": lambda folder: ros_1(folder, compression="BZ2"),
    "ros 1, lz4": lambda folder: ros_1(folder, compression="LZ4"),
    "ros 2, sqlite": ros_2,
    "ros 2, mcap": lambda folder: ros_2(folder, "MCAP"),
    "ros 2, big-endian": lambda folder: ros_2(folder, little_endian=False),
    "mcap": mcap,
    "blueos mcap": blueos,
    "parquet": parquet,
    "netcdf 4": netcdf_4,
    "netcdf 3": netcdf_3,
    "matlab 5": matlab_5,
    "matlab 7": lambda folder: matlab_5(folder, do_compression=True),
    "matlab 4": matlab_4,
    "matlab 7.3": matlab_73,
    "dataflash": dataflash,
    "telemetry": telemetry,
    "ulog": ulog,
    "alog": alog,
    "npz": npz,
}
