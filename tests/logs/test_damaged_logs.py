"""Damaged, cut off and hostile logs of every format: read or refused with an InputError, never more, never gigabytes."""

import random
import shutil
import struct
import tracemalloc
import zlib
from contextlib import suppress
from dataclasses import replace
from functools import cache
from itertools import count, islice
from pathlib import Path
from tempfile import TemporaryDirectory

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seatrial.core import processes
from seatrial.core.errors import InputError
from seatrial.logs.formats import registry
from seatrial.logs.formats.hdf5 import arrays, opened
from seatrial.logs.formats.protocol import LogFile
from seatrial.logs.formats.registry import catalogue, read_columns, stream
from seatrial.logs.formats.ros_messages import Decoder, Undefined, steps_of
from seatrial.logs.inspect import inspect_log
from seatrial.logs.log_table import read_log_table
from tests.logs.log_cases import refusal
from tests.logs.log_writers import DATAFLASH_HEAD, RECEIVED, WRITERS, described, ros_store
from tests.logs.test_formats import mapped

EDITS = st.lists(
    st.tuples(
        st.floats(0, 1, exclude_max=True),
        st.sampled_from([b"\0", b"\xff", b"\xff" * 4, b"\x7f" * 4, b"\0" * 8, b"\xff\xff\xff\x7f", b"\xff" * 8]),
        st.booleans(),
    ),
    min_size=1,
    max_size=3,
)
FRESH = count()


FOLDER = TemporaryDirectory(prefix="seatrial-logs-")


@cache
def original(name):
    place = Path(FOLDER.name) / name.replace(" ", "-")
    place.mkdir()
    return WRITERS[name](place)


def damaged(folder, name, change):
    """Copy a log under a new name, the largest of its files changed."""
    written = original(name)
    place = folder / str(next(FRESH)) / written.path.name
    if written.path.is_dir():
        shutil.copytree(written.path, place)
        victim = max(place.iterdir(), key=lambda file: file.stat().st_size)
    else:
        place.parent.mkdir()
        victim = place
    victim.write_bytes(change((written.path / victim.name if written.path.is_dir() else written.path).read_bytes()))
    return replace(written, path=place)


def read_or_refuse(written):
    with suppress(InputError):
        inspect_log(written.path)
    with suppress(InputError):
        read_log_table(mapped(written))


def edit(edits):
    def change(data):
        data = bytearray(data)
        for share, junk, insert in edits:
            at = int(share * len(data))
            data[at : at if insert else at + len(junk)] = junk
        return bytes(data)

    return change


SAFE = [name for name in WRITERS if name not in ("matlab 4", "matlab 5", "matlab 7")]
"""Formats that no bytes can bring to end this process; SciPy's reader of MATLAB files has one of its own below."""


@pytest.mark.parametrize("name", SAFE)
def test_bytes_changed(tmp_path_factory, name):
    @given(EDITS)
    @settings(max_examples=8)
    def check(edits):
        read_or_refuse(damaged(tmp_path_factory.getbasetemp(), name, edit(edits)))

    check()


def cut(share):
    return lambda data: data[: int(share * len(data))]


@pytest.mark.parametrize("name", SAFE)
def test_cut_off_anywhere(tmp_path, name):
    for share in (0.0, 0.1, 0.6, 0.999):
        read_or_refuse(damaged(tmp_path, name, cut(share)))


def each_read_or_refused(logs):
    for written in logs:
        yield read_or_refuse(written)


@pytest.fixture
def read_apart(in_others):
    """Read or refuse logs, one after another, in a process that is begun anew behind a log that ends it; returns how many did."""

    def read(logs):
        todo, ended = list(logs), 0
        while todo:
            try:
                for _ in processes.apart("logs", each_read_or_refused, tuple(todo), memory=2 << 30, seconds=60.0):
                    todo.pop(0)
            except InputError:
                todo.pop(0)
                ended += 1
        return ended

    return read


def test_damaged_matlab_files(tmp_path, read_apart):
    """Some of these bytes lead SciPy's reader astray."""
    draw, logs = random.Random(1), []
    for name in ("matlab 4", "matlab 5", "matlab 7"):
        logs += [damaged(tmp_path, name, cut(share)) for share in (0.0, 0.1, 0.6, 0.999)]
        for _ in range(60):
            junk = draw.choice([b"\0", b"\xff", b"\xff" * 4, b"\x7f" * 4, b"\0" * 8, b"\xff\xff\xff\x7f"])
            logs.append(damaged(tmp_path, name, edit([(draw.random(), junk, draw.random() < 0.5)])))
    assert read_apart(logs) < len(logs) / 10


@pytest.mark.parametrize(
    "name", ["ros 1", "mcap", "parquet", "matlab 7", "matlab 5", "matlab 4", "netcdf 4", "netcdf 3"]
)
def test_a_log_cut_in_half_is_refused_by_name(tmp_path, name):
    written = damaged(tmp_path, name, lambda data: data[: len(data) // 2])
    with refusal(written.path.name, "remedy", "again"):
        read_log_table(mapped(written))


def peak(work):
    """Most bytes that were in use while some work ran, and what it returned."""
    tracemalloc.start()
    try:
        result = work()
        return tracemalloc.get_traced_memory()[1], result
    finally:
        tracemalloc.stop()


def matlab_5(*body):
    return b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + b"".join(body)


def element(kind, data):
    return struct.pack("<2I", kind, len(data)) + data + b"\0" * (-len(data) % 8)


def matrix(kind, shape, rest=b""):
    """A variable `x` of a class and shape, whatever it holds."""
    flags, extent = struct.pack("<2I", kind, 0), struct.pack(f"<{len(shape)}i", *shape)
    return element(14, element(6, flags) + element(5, extent) + element(1, b"x") + rest)


def nested(depth):
    inner = b""
    for _ in range(depth):
        names = element(5, struct.pack("<i", 2)) + element(1, b"a\0")
        extent = element(5, struct.pack("<2i", 1, 1))
        inner = element(14, element(6, struct.pack("<2I", 2, 0)) + extent + element(1, b"") + names + inner)
    return inner


HOSTILE = {
    "numbers that are not there": ("a.mat", matlab_5(matrix(6, (1 << 15, 1 << 15)))),
    "cells that are not there": ("a.mat", matlab_5(matrix(1, (1 << 15, 1 << 15)))),
    "structs that are not there": (
        "a.mat",
        matlab_5(matrix(2, (1 << 15, 1 << 15), element(5, struct.pack("<i", 2)) + element(1, b"a\0b\0"))),
    ),
    "negative shape": ("a.mat", matlab_5(matrix(6, (-5, -5)))),
    "structs without end": ("a.mat", matlab_5(nested(300))),
    "a bomb of zeros": (
        "a.mat",
        matlab_5(
            element(
                15,
                zlib.compress(struct.pack("<2I", 14, 1 << 30) + matrix(6, (1 << 13, 1 << 13))[8:] + bytes(40_000_000)),
            )
        ),
    ),
    "version 4, huge": ("a.mat", struct.pack("<5i", 0, 1 << 30, 1 << 30, 0, 2) + b"x\0"),
    "version 4, backwards": (
        "a.mat",
        struct.pack("<5i", 0, 1, 1, 0, 2) + b"x\0" + bytes(8) + struct.pack("<5i", 0, -5, 5, 0, 2),
    ),
    "types that overlap": ("a.bin", DATAFLASH_HEAD + described(128, "FMT", "B", "B", "Type") + b"\xa3\x95\x80" * 50),
    "type of no length": ("a.bin", DATAFLASH_HEAD + b"\xa3\x95\x80\x0c\x00NUL\0" + bytes(80) + b"\xa3\x95\x0c" * 50),
    "nothing but headers": ("a.bin", b"\xa3\x95\x80" * 5000),
    "an endless line": ("a.alog", b"%% LOGSTART 1\n" + b"1 NAV " + b"x" * 3_000_000),
    "thousands of keys": (
        "a.alog",
        b"%% LOGSTART 1\n" + b"".join(b"%d V s K%d=1,L%d=2\n" % (k, k, k) for k in range(3000)),
    ),
    "classic, huge": ("a.nc", b"CDF\x01" + struct.pack(">I", 0) + struct.pack(">2I", 10, 1 << 30) + b"\xff" * 64),
    "no packet at all": ("a.tlog", struct.pack(">Q", 1_669_909_203_000_000) + b"\xfe" + b"\xff" * 5000),
}


def test_hostile_matlab_files(tmp_path, read_apart):
    written = original("matlab 5")
    logs = []
    for case, (name, content) in HOSTILE.items():
        if name.endswith(".mat"):
            path = tmp_path / f"{len(logs)} {case}.mat"
            path.write_bytes(content)
            logs.append(replace(written, path=path))
    read_apart(logs)


@pytest.mark.parametrize("case", [case for case, (name, _) in HOSTILE.items() if not name.endswith(".mat")])
def test_hostile_files_are_refused_in_little_memory(tmp_path, case):
    name, content = HOSTILE[case]
    path = tmp_path / name
    path.write_bytes(content)

    def work():
        with suppress(InputError):
            inspect_log(path)

    assert peak(work)[0] < 30_000_000


def test_hdf5_that_claims_more_than_it_holds(tmp_path):
    import h5py

    path = tmp_path / "a.nc"
    with h5py.File(path, "w") as file:
        file.create_dataset("time", (1 << 40,), float, chunks=(1 << 16,))
    with refusal("a.nc", "time", "shape (1099511627776,)", "damaged"):
        catalogue(LogFile(path))
    with h5py.File(path, "w") as file:
        group = file.create_group("loop")
        group["again"] = group
        file["outside"] = h5py.ExternalLink("/etc/passwd", "/")
        file.create_dataset("loop/u", data=np.arange(5.0))
    assert [table.name for table in catalogue(LogFile(path))] == ["loop/5 rows"]


def test_ros_definitions_cannot_grow_without_end():
    two = {f"a/msg/T{k}": ([], [("x", (2, f"a/msg/T{k + 1}")), ("y", (2, f"a/msg/T{k + 1}"))]) for k in range(60)}
    with pytest.raises(Undefined, match=r"itself|too many"):
        steps_of("a/msg/T0", two, True)
    with pytest.raises(Undefined, match="itself"):
        steps_of("a/msg/T", {"a/msg/T": ([], [("x", (2, "a/msg/T"))])}, True)
    with pytest.raises(Undefined, match="does not define b/msg/T"):
        steps_of("a/msg/T", {"a/msg/T": ([], [("x", (2, "b/msg/T"))])}, False)


@pytest.mark.parametrize("is_cdr", [True, False])
@pytest.mark.parametrize("number", [2**32 - 1, 2**31, 10**6])
def test_ros_sequences_that_claim_more_than_the_message(is_cdr, number):
    fields = {
        "a/msg/Nothing": ([], []),
        "a/msg/T": ([], [("many", (4, ((1, ("float64", 0)), 0))), ("none", (4, ((2, "a/msg/Nothing"), 0)))]),
    }
    decoder = Decoder("t", steps_of("a/msg/T", fields, is_cdr), ["many[0]"], is_cdr)
    header = b"\0\1\0\0" if is_cdr else b""
    decoder.take(0, header + struct.pack("<I", number) + bytes(16))
    with pytest.raises(struct.error):
        decoder.block(1.0)
    # Elements of ROS 1 may have no bytes at all: any number of them is passed over at once.
    empty = Decoder("t", steps_of("a/msg/T", fields, is_cdr), ["many[0]"], is_cdr)
    empty.take(0, header + struct.pack("<2I", 0, number))
    if is_cdr:
        with pytest.raises(struct.error):
            empty.block(1.0)
    else:
        assert np.isnan(empty.block(1.0).columns["many[0]"])


def test_ros_fixed_array_of_a_billion_costs_nothing():
    fields = {"a/msg/T": ([], [("x", (3, ((1, ("float64", 0)), 10**9))), ("y", (1, ("float64", 0)))])}

    def work():
        decoder = Decoder("t", steps_of("a/msg/T", fields, False), ["y"], False)
        decoder.take(0, bytes(64))
        with pytest.raises(struct.error):
            decoder.block(1.0)

    assert peak(work)[0] < 1_000_000


@pytest.mark.parametrize("version", [1, 2])
def test_memory_follows_the_wanted_columns_not_the_messages(tmp_path, version):
    """Three thousand messages with pictures of 8 kB: 24 MB of log for 48 kB of numbers."""
    from rosbags import rosbag1, rosbag2

    store, kind, rows, path = ros_store(version == 1), "sensor_msgs/msg/Image", 3000, tmp_path / "run.bag"
    image, frame = store.types[kind], {"seq": 0} if version == 1 else {}
    header = store.types["std_msgs/msg/Header"](
        stamp=store.types["builtin_interfaces/msg/Time"](1, 2), frame_id="camera", **frame
    )
    picture = np.zeros(8192, np.uint8)
    if version == 2:
        path = tmp_path / "bag"
        writer = rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin.MCAP)
    else:
        writer = rosbag1.Writer(path)
    with writer:
        topic = writer.add_connection("/camera", kind, typestore=store)
        for k in range(rows):
            message = image(header, k, 64, "mono8", 0, 64, picture)
            data = (store.serialize_ros1 if version == 1 else store.serialize_cdr)(message, kind)
            writer.write(topic, int(RECEIVED[0]) + 1000 * k, data)

    used, raw = peak(lambda: read_columns(LogFile(path), "/camera", ["height", "log_time"]))
    np.testing.assert_array_equal(raw.columns["height"], np.arange(rows))
    assert used < 8_000_000
    used, blocks = peak(lambda: sum(1 for _ in stream(LogFile(path), {"/camera": ["height"]})))
    assert blocks >= 1
    assert used < 8_000_000


def test_text_is_read_in_pieces(tmp_path, monkeypatch):
    """Pieces of a few rows give the numbers, the line of an error and the notes that one piece gives."""
    from seatrial.logs.source import LogSource
    from tests.logs.log_cases import GOOD, PROPELLER, SPEED, written

    channels = {"n": PROPELLER, "u": SPEED}
    texts = {
        "plain.csv": GOOD,
        "returns.csv": GOOD.replace("\n", "\r\n"),
        "quotes.csv": GOOD.replace("ok", '"all ""well"",\nso far"'),
        "blank.csv": GOOD.replace("\n", "\n\n"),
        "empty.csv": GOOD + ",,,\n" * 60,
        "mixed.csv": GOOD.replace("0.0,", "0,", 1).replace("1.0,", "1,", 1),
    }
    for name, text in texts.items():
        source = LogSource(written(tmp_path, text, name), "t", "s", channels)
        whole = read_log_table(source)
        for rows in (1, 3):
            monkeypatch.setattr("seatrial.logs.formats.text._PIECE_ROWS", rows)
            pieces = read_log_table(source)
            monkeypatch.undo()
            np.testing.assert_array_equal(pieces.time, whole.time)
            np.testing.assert_array_equal(pieces.columns["u"], whole.columns["u"])
            assert pieces.notes == whole.notes
    repeated = GOOD.replace("1.4,614", "1.3,614")
    source = LogSource(written(tmp_path, repeated.replace("\n", "\n\n")), "t", "s", channels)
    monkeypatch.setattr("seatrial.logs.formats.text._PIECE_ROWS", 3)
    with refusal('column "t", row 31', "same time stamp"):
        read_log_table(source)
    source = LogSource(written(tmp_path, GOOD.replace("1.14", "fast")), "t", "s", channels)
    with refusal('row 16, column "speed"', "'fast'"):
        read_log_table(source)


def mcap_of(compression, size, packed):
    """An MCAP file of one chunk that says what size it has."""
    text = compression.encode()
    chunk = struct.pack("<QQQII", 0, 1, size, 0, len(text)) + text + struct.pack("<Q", len(packed)) + packed
    header = struct.pack("<I", 4) + b"ros2" + struct.pack("<I", 0)
    records = [(1, header), (6, chunk), (15, bytes(4)), (2, bytes(20))]
    magic = b"\x89MCAP0\r\n"
    return magic + b"".join(bytes([kind]) + struct.pack("<Q", len(body)) + body for kind, body in records) + magic


@pytest.fixture
def little_memory(in_others, monkeypatch):
    """Read in processes of their own, of less than a gigabyte."""
    monkeypatch.setattr(registry, "FORMATS", tuple(replace(form, memory=700 << 20) for form in registry.FORMATS))


@pytest.mark.parametrize("compression", ["lz4", "zstd"])
@pytest.mark.parametrize("declared", [1 << 30, 1000])
def test_a_chunk_that_unpacks_to_gigabytes_is_refused_in_little_memory(tmp_path, little_memory, compression, declared):
    lz4, zstd = pytest.importorskip("lz4.frame"), pytest.importorskip("backports.zstd")
    packed = (lz4.compress if compression == "lz4" else zstd.compress)(bytes(1 << 30))
    path = tmp_path / "run.mcap"
    path.write_bytes(mcap_of(compression, declared, packed))
    with refusal("run.mcap", "memory allowed", "too large to be read"):
        inspect_log(path)


@pytest.mark.proof
def test_a_packed_database_that_grows_without_end_is_refused(tmp_path, little_memory):
    zstd = pytest.importorskip("backports.zstd")
    written = WRITERS["ros 2, sqlite"](tmp_path)
    (database,) = written.path.glob("*.db3")
    packed, content = database.with_name(database.name + ".zstd"), database.read_bytes()
    database.unlink()
    information = written.path / "metadata.yaml"
    text = information.read_text().replace(database.name, packed.name)
    text = text.replace("compression_format: ''", "compression_format: zstd")
    information.write_text(text.replace("compression_mode: ''", "compression_mode: FILE"))
    packed.write_bytes(zstd.compress(content))
    assert read_log_table(mapped(written)).time.size > 1, "one of an honest size is read"
    packed.write_bytes(zstd.compress(content + bytes(1 << 30)))
    with refusal("run_sqlite3", "File too large"):
        read_log_table(mapped(written))


def test_a_large_piece_of_an_array_is_unpacked_once_and_not_for_every_block(tmp_path):
    """Blocks of 8192 rows of a piece of 4 million: what was unpacked stays."""
    path, rows = tmp_path / "run.nc", 1 << 22
    with h5py.File(path, "w") as file:
        made = file.create_dataset("u", (rows,), "f8", chunks=(rows,), compression="gzip")
        made.id.write_direct_chunk((0,), zlib.compress(bytes(8 * rows)))
    with opened(path) as file:
        size = file["u"].chunks[0] * file["u"].dtype.itemsize
        assert file["u"].id.get_access_plist().get_chunk_cache()[1] >= size


@pytest.mark.parametrize(("version", "at"), [(0, 48), (1, 52)])
def test_the_address_of_a_driver_is_refused_before_the_library_follows_it(tmp_path, version, at):
    """The library took the four gigabytes that stood there."""
    written = WRITERS["netcdf 4"](tmp_path)
    data = bytearray(written.path.read_bytes())
    assert data[8] == 0
    assert data[48:56] == b"\xff" * 8
    data[8] = version
    data[at : at + 8] = struct.pack("<Q", 96)
    written.path.write_bytes(data)
    with refusal("run.nc", "the address of a driver", "copy or save it again"):
        inspect_log(written.path)


def test_a_table_of_more_rows_than_memory_holds_is_refused(tmp_path, monkeypatch):
    """Equal numbers are packed so well that a kilobyte may hold a billion of them."""
    written = WRITERS["parquet"](tmp_path)
    assert read_log_table(mapped(written)).time.size > 1, "one of an honest size is read"
    monkeypatch.setattr("seatrial.logs.formats.parquet._MOST_ROWS", 3)
    with refusal(".parquet", "rows", "at most 3", "cut the log"):
        read_log_table(mapped(written))


@pytest.mark.parametrize("suffix", ["nc", "mat"])
def test_groups_that_share_others_are_listed_once(tmp_path, suffix):
    """Of 40 groups, each with the next under two names, there are 2^40 paths."""
    path = tmp_path / f"a.{suffix}"
    with h5py.File(path, "w") as file:
        file["t"], file["u"], file["of nothing"] = np.arange(9.0), np.arange(9.0), h5py.Empty("f8")
        group = file.create_group("a")
        for number in range(30):
            below = file.create_group(f"below{number}")
            group["left"] = group["right"] = below
            group = below
        group["v"] = np.arange(9.0)
        group["loop"] = file
    with opened(path) as file:
        found = list(islice(arrays(file), 100))
    assert sorted(name.rpartition("/")[2] for name, _ in found) == ["t", "u", "v"]
    assert {column.name for table in catalogue(LogFile(path)) for column in table.columns} >= {"t", "u"}
