"""MCAP files whose messages are JSON, as BlueOS records them: a table for each topic, a column for each number of its messages.

A file is records of one byte of kind and eight of length: channels, messages, and chunks of both, compressed by zstd or lz4. It is read
from the front, so that a recording whose power was cut is read to its last whole record. BlueOS writes MAVLink as
`{"header": {...}, "message": {"type": "ATTITUDE", "roll": 0.01, ...}}` on topics such as `mavlink/1/1/ATTITUDE`.
Sources: MCAP format specification (mcap.dev/spec); bluerobotics/blueos-recorder, src/channel_descriptor.rs;
bluerobotics/mavlink-server, src/lib/drivers/zenoh/json.rs.
"""

import json
import struct
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from seatrial.core.errors import InputError
from seatrial.logs.formats.protocol import (
    BLOCK_ROWS,
    LOG_TIME,
    MOST_ELEMENTS,
    Block,
    ColumnInfo,
    LogFile,
    LogFormat,
    TableInfo,
    Wanted,
    as_column,
    clocks_among,
    optional,
)

_MAGIC = b"\x89MCAP0\r\n"
_HEADER, _FOOTER, _CHANNEL, _MESSAGE, _CHUNK = 0x01, 0x02, 0x04, 0x05, 0x06
_LONGEST = 1 << 30
"""Bytes of a record, or of a chunk unpacked; more is damage."""
_LOOKED_AT = 20
"""Messages of a topic whose numbers and words are listed."""
_DEEPEST = 8
_MEMORY = 2 << 30


class _Channel(NamedTuple):
    """A topic and the encoding of its messages."""

    topic: str
    encoding: str


class _Message(NamedTuple):
    """A message: when it was recorded, ns, its bytes, and the share of the file that is read."""

    channel: _Channel
    time: int
    data: bytes
    done: float


@dataclass
class _End:
    """How a file ends."""

    is_whole: bool = False


@dataclass
class _Seen:
    """What the catalogue keeps of a topic."""

    encoding: str
    rows: int = 0
    numbers: dict[str, None] = field(default_factory=dict)
    words: dict[str, None] = field(default_factory=dict)


def _recognises(path: Path, head: bytes) -> bool:
    """Recognise MCAP that no ROS 2 recorder wrote: its header names another profile."""
    if not head.startswith(_MAGIC) or len(head) < 21 or head[8] != _HEADER:
        return False
    (length,) = struct.unpack_from("<I", head, 17)
    return head[21 : 21 + length] != b"ros2"


def _catalogue(log: LogFile) -> tuple[TableInfo, ...]:
    seen: dict[str, _Seen] = {}
    end = _End()
    for message in _messages(log, end):
        one = seen.setdefault(message.channel.topic, _Seen(message.channel.encoding))
        one.rows += 1
        if one.encoding == "json" and one.rows <= _LOOKED_AT:
            for name, value in _flat(_content(log, message)):
                (one.words if isinstance(value, str) else one.numbers)[name] = None
    notes = () if end.is_whole else ("the recording was cut off: it is read to its last whole message",)
    return tuple(_table(topic, one, notes) for topic, one in sorted(seen.items()))


def _table(topic: str, seen: _Seen, notes: tuple[str, ...]) -> TableInfo:
    clocks, columns = clocks_among([ColumnInfo(name, _clock_unit(name)) for name in seen.numbers])
    trouble = "" if seen.encoding == "json" else f'messages in the encoding "{seen.encoding}", where JSON is read'
    first = (ColumnInfo(LOG_TIME, "ns"), *columns)
    return TableInfo(topic, first, (LOG_TIME, *clocks), seen.rows, "", trouble, notes, tuple(seen.words), True)


def _clock_unit(name: str) -> str | None:
    return {"time_boot_ms": "ms", "time_usec": "us", "time_unix_usec": "us"}.get(name.rpartition(".")[2])


def _blocks(log: LogFile, wanted: Wanted) -> Iterator[Block]:
    waiting: dict[str, list[_Message]] = {}
    for message in _messages(log, _End()):
        topic = message.channel.topic
        if topic in wanted and message.channel.encoding == "json":
            rows = waiting.setdefault(topic, [])
            rows.append(message)
            if len(rows) == BLOCK_ROWS:
                yield _block(log, waiting.pop(topic), wanted)
    for rows in waiting.values():
        yield _block(log, rows, wanted)


def _block(log: LogFile, messages: list[_Message], wanted: Wanted) -> Block:
    topic = messages[0].channel.topic
    rows = [dict(_flat(_content(log, message))) for message in messages]
    columns = {name: _column([row.get(name) for row in rows]) for name in wanted[topic] if name != LOG_TIME}
    if LOG_TIME in wanted[topic]:
        columns[LOG_TIME] = np.array([message.time for message in messages], np.int64)
    return Block(topic, columns, messages[-1].done)


def _column(values: list[Any]) -> np.ndarray:
    """Return words as text, whole numbers as int64 where none is missing, else floats, NaN for what is no number."""
    if any(isinstance(value, str) for value in values):
        return np.array([value if isinstance(value, str) else "" for value in values], object)
    if all(isinstance(value, int) and abs(value) < 2**62 for value in values):
        return as_column(np.array(values, np.int64))
    return np.array([np.nan if value is None else float(value) for value in values])


def _content(log: LogFile, message: _Message) -> Any:
    try:
        return json.loads(message.data)
    except (ValueError, RecursionError) as cause:
        raise InputError(
            f'{log.path}, table "{message.channel.topic}"',
            found=f"a message that is no JSON: {message.data[:40]!r}",
            expected="JSON, as the channel says",
            remedy="the log is damaged: copy it again, or map another table",
        ) from cause


def _flat(value: Any, name: str = "", depth: int = 0) -> Iterator[tuple[str, float | int | str]]:
    """Yield the numbers and words of a message, by dotted path and index."""
    if isinstance(value, Mapping):
        if depth < _DEEPEST:
            for key, one in value.items():
                yield from _flat(one, f"{name}.{key}" if name else str(key), depth + 1)
    elif isinstance(value, list):
        if depth < _DEEPEST:
            for i, one in enumerate(value[:MOST_ELEMENTS]):
                yield from _flat(one, f"{name}[{i}]", depth + 1)
    elif isinstance(value, bool):
        yield name, int(value)
    elif isinstance(value, int | float | str):
        yield name, value


def _messages(log: LogFile, end: _End) -> Iterator[_Message]:
    """Yield the messages of a file in its order.

    Raises:
        InputError: a compression that is not known, or a library that is missing.
        ValueError: damage.
    """
    channels: dict[int, _Channel] = {}
    size = max(log.path.stat().st_size, 1)
    with log.path.open("rb") as stream:
        stream.seek(len(_MAGIC))
        for kind, record in _records(stream):
            if kind == _FOOTER:
                end.is_whole = True
                return
            done = min(stream.tell() / size, 1.0)
            if kind == _CHUNK:
                for inner, content in _inside(_unpacked(record, log)):
                    yield from _message(inner, content, channels, done)
            else:
                yield from _message(kind, record, channels, done)


def _message(kind: int, record: bytes, channels: dict[int, _Channel], done: float) -> Iterator[_Message]:
    if kind == _CHANNEL:
        number, _ = struct.unpack_from("<HH", record)
        topic, at = _string(record, 4)
        channels[number] = _Channel(topic, _string(record, at)[0])
    elif kind == _MESSAGE:
        number, _, time, _ = struct.unpack_from("<HIQQ", record)
        if number in channels and time < 2**63:
            yield _Message(channels[number], time, record[22:], done)


def _records(stream: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """Yield whole records; a last one that is cut off ends them."""
    while len(head := stream.read(9)) == 9:
        kind, length = struct.unpack("<BQ", head)
        if length > _LONGEST:
            raise ValueError(f"a record of {length} bytes")
        record = stream.read(length)
        if len(record) < length:
            return
        yield kind, record


def _inside(data: bytes) -> Iterator[tuple[int, bytes]]:
    at = 0
    while at + 9 <= len(data):
        kind, length = struct.unpack_from("<BQ", data, at)
        at += 9
        if at + length > len(data):
            raise ValueError("a record that is longer than its chunk")
        yield kind, data[at : at + length]
        at += length


def _unpacked(record: bytes, log: LogFile) -> bytes:
    _, _, size, _ = struct.unpack_from("<QQQI", record)
    compression, at = _string(record, 28)
    (length,) = struct.unpack_from("<Q", record, at)
    data = record[at + 8 : at + 8 + length]
    if size > _LONGEST:
        raise ValueError(f"a chunk of {size} bytes")
    if not compression:
        return data
    if compression == "zstd":
        zstd = optional("compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd", "ros", log.path)
        unpacked = zstd.decompress(data)
    elif compression == "lz4":
        unpacked = optional("lz4.frame", "ros", log.path).decompress(data)
    else:
        raise ValueError(f'chunks compressed by "{compression}"')
    if len(unpacked) != size:
        raise ValueError(f"a chunk of {len(unpacked)} bytes where {size} are stated")
    return unpacked


def _string(record: bytes, at: int) -> tuple[str, int]:
    (length,) = struct.unpack_from("<I", record, at)
    return record[at + 4 : at + 4 + length].decode(), at + 4 + length


FORMAT = LogFormat("an MCAP file of JSON messages", (".mcap",), _recognises, _catalogue, _blocks, memory=_MEMORY)
