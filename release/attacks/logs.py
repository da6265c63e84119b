"""Logs of every format, damaged: each is read or refused."""

import gzip
import shutil
import struct
import zlib
from contextlib import suppress
from dataclasses import replace
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

from attacks.damage import damaged, damaged_table
from attacks.outcome import Outcome, Watchman, judged

TEXTS = ("csv", "csv.gz", "alog")


def damaged_log(number: int, random: Random, place: Path, watchman: Watchman) -> Outcome:
    """Damage one log, in the order of the formats, and inspect and read it."""
    from seatrial.core.errors import InputError
    from seatrial.logs.align import align
    from seatrial.logs.inspect import inspect_log
    from seatrial.logs.linear_sum import parse_sum
    from seatrial.logs.log_table import read_log_table
    from seatrial.logs.source import ColumnMap, LogSource

    name = label(number)
    written = original(name, place.parent / "originals")
    path = place / written.path.name
    if written.path.is_dir():
        shutil.copytree(written.path, path)
        victim = random.choice(sorted(file.name for file in path.iterdir()))
        target, source = path / victim, written.path / victim
    else:
        place.mkdir(parents=True)
        target, source = path, written.path
    target.write_bytes(_damaged(name, random, source.read_bytes()))
    text = random.choice(("", f"0.75 '{written.rpm}' + 0.25 * '{written.rpm}'"))
    turns = ColumnMap(text or written.rpm, "rpm", "control", parts=parse_sum(text, "here") if text else ())

    def work() -> None:
        with suppress(InputError):
            inspect_log(path)
        surge = ColumnMap(written.surge, "m/s", "measurement")
        align([read_log_table(LogSource(path, None, None, {"u": surge, "n": turns}, table=written.table))], step=0.02)

    found = judged(work, watchman, place)
    return found._replace(line=f"{name}: {found.line}")


def label(number: int) -> str:
    """Return the format of a case."""
    return names()[number % len(names())]


@cache
def names() -> tuple[str, ...]:
    """Return the formats: those of the tests, compressed text, and messages that are nothing but an array."""
    from tests.logs.log_writers import WRITERS

    return (*WRITERS, "csv.gz", "ros 2, multiarray")


@cache
def original(name: str, folder: Path) -> Any:
    """Return a log as its own library writes it."""
    from tests.logs.log_writers import WRITERS

    place = folder / name.replace(" ", "-").replace(",", "")
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    if name == "ros 2, multiarray":
        return _multiarray(place)
    if name != "csv.gz":
        return WRITERS[name](place)
    plain = WRITERS["csv"](place)
    path = plain.path.with_name("run.csv.gz")
    path.write_bytes(gzip.compress(plain.path.read_bytes()))
    return replace(plain, path=path)


def _multiarray(place: Path) -> Any:
    """Return a bag of arrays without a header, whose elements are surge speed and propeller speed."""
    import numpy as np
    from rosbags.rosbag2 import StoragePlugin, Writer

    from tests.logs import log_writers

    store, kind, path = log_writers.ros_store(False), "std_msgs/msg/Float64MultiArray", place / "bag"
    dimension = store.types["std_msgs/msg/MultiArrayDimension"]("speeds", 3, 3)
    layout = store.types["std_msgs/msg/MultiArrayLayout"]([dimension], 0)
    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        topic = writer.add_connection("/speeds", kind, typestore=store)
        for k, stamp in enumerate(log_writers.STAMPS):
            row = np.array([log_writers.SURGE[k], log_writers.RPM[k], 0.0])
            writer.write(topic, int(stamp), store.serialize_cdr(store.types[kind](layout, row), kind))
    return log_writers.Written(path, "/speeds", "data[0]", "data[1]", "log_time", "ns", log_writers.STAMPS)


def _damaged(name: str, random: Random, data: bytes) -> bytes:
    """Damage to the bytes, or to what they hold where that is text or compressed."""
    inside = random.random() < 0.6
    if name == "csv.gz" and inside:
        return gzip.compress(damaged_table(random, gzip.decompress(data).decode()).encode())
    if name in TEXTS and inside:
        return damaged_table(random, data.decode()).encode()
    if name == "matlab 7" and inside:
        return _inside_matlab(random, data)
    return damaged(random, data)


def _inside_matlab(random: Random, data: bytes) -> bytes:
    """A compressed variable, damaged before it was compressed."""
    head, at, parts = data[:128], 128, []
    while at + 8 <= len(data):
        kind, size = struct.unpack_from("<2I", data, at)
        parts.append((kind, data[at + 8 : at + 8 + size]))
        at += 8 + size
    chosen = random.randrange(len(parts))
    body = b""
    for k, (kind, part) in enumerate(parts):
        part = zlib.compress(damaged(random, zlib.decompress(part))) if k == chosen and kind == 15 else part
        body += struct.pack("<2I", kind, len(part)) + part
    return head + body
