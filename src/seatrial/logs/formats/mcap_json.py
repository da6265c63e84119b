"""MCAP files whose messages are JSON, as BlueOS records them: a table for each topic, a column for each number of its messages.

A file is records of one byte of kind and eight of length: channels, messages, and chunks of both, compressed by zstd or lz4. It is read
from the front, so that a recording whose power was cut is read to its last whole record. BlueOS writes MAVLink as
`{"header": {...}, "message": {"type": "ATTITUDE", "roll": 0.01, ...}}` on topics such as `mavlink/1/1/ATTITUDE`.
Sources: MCAP format specification (mcap.dev/spec); bluerobotics/blueos-recorder, src/channel_descriptor.rs;
bluerobotics/mavlink-server, src/lib/drivers/zenoh/json.rs.
"""

import json
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from seatrial.core.errors import InputError
from seatrial.logs.formats.protocol import (
    LOG_TIME,
    MAX_ELEMENTS,
    Block,
    ColumnInfo,
    LogFile,
    LogFormat,
    TableInfo,
    Wanted,
    as_column,
    clocks_among,
    in_blocks,
    optional,
)

_MAGIC = b"\x89MCAP0\r\n"
_HEADER = 0x01
_MAX_RECORD_BYTES = 1 << 30  # Bytes of a record, or of a chunk unpacked; more is damage
_SAMPLE_MESSAGES = 20  # Messages of a topic whose numbers and words are listed
_MAX_DEPTH = 8
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
    notes: list[str] = []
    for message in _messages(log, notes):
        topic_content = seen.setdefault(message.channel.topic, _Seen(message.channel.encoding))
        topic_content.rows += 1
        if topic_content.encoding == "json" and topic_content.rows <= _SAMPLE_MESSAGES:
            for name, value in _flat(_content(log, message)):
                (topic_content.words if isinstance(value, str) else topic_content.numbers)[name] = None
    return tuple(_table(topic, topic_content, tuple(notes)) for topic, topic_content in sorted(seen.items()))


def _table(topic: str, seen: _Seen, notes: tuple[str, ...]) -> TableInfo:
    # MAVLink's clocks, of which clocks_among knows no unit by the name.
    units = {"time_boot_ms": "ms", "time_usec": "us", "time_unix_usec": "us"}
    clocks, columns = clocks_among([ColumnInfo(name, units.get(name.rpartition(".")[2])) for name in seen.numbers])
    trouble = "" if seen.encoding == "json" else f'messages in the encoding "{seen.encoding}"; only JSON is read'
    first = (ColumnInfo(LOG_TIME, "ns"), *columns)
    return TableInfo(topic, first, (LOG_TIME, *clocks), seen.rows, "", trouble, notes, tuple(seen.words), True)


def _blocks(log: LogFile, wanted: Wanted) -> Iterator[Block]:
    def block(topic: str, messages: list[_Message], done: float) -> Block:
        rows = [dict(_flat(_content(log, message))) for message in messages]
        columns = {name: _column([row.get(name) for row in rows]) for name in wanted[topic] if name != LOG_TIME}
        if LOG_TIME in wanted[topic]:
            columns[LOG_TIME] = np.array([message.time for message in messages], np.int64)
        return Block(topic, columns, done)

    messages = (one for one in _messages(log, []) if one.channel.encoding == "json")
    return in_blocks(((one.channel.topic, one, one.done) for one in messages if one.channel.topic in wanted), block)


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
            expected="JSON, as the channel states",
            remedy="the log is damaged: copy it again, or map another table",
        ) from cause


def _flat(value: Any, name: str = "", depth: int = 0) -> Iterator[tuple[str, float | int | str]]:
    """Yield the numbers and words of a message, by dotted path and index."""
    if isinstance(value, Mapping):
        if depth < _MAX_DEPTH:
            for key, item in value.items():
                yield from _flat(item, f"{name}.{key}" if name else str(key), depth + 1)
    elif isinstance(value, list):
        if depth < _MAX_DEPTH:
            for i, item in enumerate(value[:MAX_ELEMENTS]):
                yield from _flat(item, f"{name}[{i}]", depth + 1)
    elif isinstance(value, bool):
        yield name, int(value)
    elif isinstance(value, int | float | str):
        yield name, value


def _messages(log: LogFile, notes: list[str]) -> Iterator[_Message]:
    """Yield the messages of a file in its order, to its last whole record, and add a note where one follows that is not whole.

    Raises:
        InputError: the library is missing.
        ValueError: damage.
    """
    with optional("ros", log.path):
        import mcap.exceptions as errors
        import mcap.stream_reader as mcap
        from mcap.records import Channel, Message
    channels: dict[int, _Channel] = {}
    size = max(log.path.stat().st_size, 1)
    with log.path.open("rb") as stream:
        records = mcap.StreamReader(stream, emit_chunks=True, record_size_limit=_MAX_RECORD_BYTES).records
        try:
            for record in records:
                done = min(stream.tell() / size, 1.0)
                for one in _contents(record, mcap, errors):
                    if isinstance(one, Channel):
                        channels[one.id] = _Channel(one.topic, one.message_encoding)
                    elif isinstance(one, Message) and one.channel_id in channels and one.log_time < 2**63:
                        yield _Message(channels[one.channel_id], one.log_time, one.data, done)
        except (errors.McapError, struct.error) as damage:
            # A file that ends inside a record was cut off while it was written.
            if stream.read(1) or not isinstance(damage, errors.EndOfFile | struct.error):
                raise ValueError(str(damage)) from damage
            notes.append("the recording was cut off: it is read to its last whole message")


def _contents(record: Any, mcap: Any, errors: Any) -> Sequence[Any]:
    """Return the records inside a chunk; of another record itself.

    Raises:
        ValueError: a chunk that is larger unpacked than memory allows, or that does not hold what it states.
    """
    if not isinstance(record, mcap.Chunk):
        return (record,)
    if record.uncompressed_size > _MAX_RECORD_BYTES:
        raise ValueError(f"a chunk of {record.uncompressed_size} bytes")
    if record.compression not in ("", "zstd", "lz4"):
        raise ValueError(f'chunks compressed by "{record.compression}"')
    try:
        return mcap.breakup_chunk(record, validate_crc=True)
    except errors.EndOfFile as damage:
        raise ValueError("a record that is longer than its chunk") from damage
    except RuntimeError as damage:  # of both libraries of compression
        raise ValueError(f"a chunk that cannot be unpacked: {damage}") from damage


FORMAT = LogFormat("an MCAP file of JSON messages", (".mcap",), _recognises, _catalogue, _blocks, memory=_MEMORY)
