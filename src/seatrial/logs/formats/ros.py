"""ROS 1 bags, ROS 2 bags (sqlite3 and MCAP) and bare MCAP: a table for each topic.

`rosbags` opens the container and parses the message definitions that it holds, so that messages of any type are read; `ros_messages`
takes the numbers out of them. What the library unpacks is bounded by the memory of the process in which it reads.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from seatrial.core.errors import InputError
from seatrial.logs.formats.protocol import (
    LOG_TIME,
    Block,
    ColumnInfo,
    LogFile,
    LogFormat,
    TableInfo,
    Wanted,
    begins_with,
    optional,
)
from seatrial.logs.formats.ros_messages import (
    Decoder,
    Definitions,
    Step,
    Undefined,
    columns_of,
    has_sequences,
    lengths_of,
    steps_of,
    words_of,
)

_SQLITE = b"SQLite format 3\0"
_MCAP = b"\x89MCAP0\r\n"
_ROS_1 = b"#ROSBAG V"
_MEMORY = 2 << 30  # A chunk that unpacks to more ends the process that reads it
_HEADER = "std_msgs/Header header\n"
# Definitions of MAVROS below the header
_MAVROS = {
    "RCOut": "uint16[] channels",
    "RCIn": "uint8 rssi\nuint16[] channels",
    "OverrideRCIn": "uint16[18] channels",
    "State": "bool connected\nbool armed\nbool guided\nbool manual_input\nstring mode\nuint8 system_status",
    "VfrHud": "float32 airspeed\nfloat32 groundspeed\nint16 heading\nfloat32 throttle\nfloat32 altitude\nfloat32 climb",
    "Altitude": "\n".join(
        f"float32 {word}" for word in ("monotonic", "amsl", "local", "relative", "terrain", "bottom_clearance")
    ),
}
_LOOKED_AT = 20  # Messages of a topic by which the length of its sequences is told


@dataclass(frozen=True)
class _Topic:
    """One table: connections of one topic and type, and the steps of their messages."""

    name: str
    kind: str
    connections: tuple[Any, ...]
    steps: tuple[Step, ...]
    trouble: str


def _is_folder(path: Path, head: bytes) -> bool:
    return path.is_dir() and (path / "metadata.yaml").is_file()


def _catalogue(log: LogFile) -> tuple[TableInfo, ...]:
    with _opened(log) as reader:
        return tuple(_table(topic, _lengths(topic, reader)) for topic in _topics(reader, log))


def _blocks(log: LogFile, wanted: Wanted) -> Iterator[Block]:
    with _opened(log) as reader:
        topics = [topic for topic in _topics(reader, log) if topic.name in wanted and not topic.trouble]
        connections = [connection for topic in topics for connection in topic.connections]
        if not connections:
            return
        decoders = {}
        for topic in topics:
            decoder = Decoder(topic.name, topic.steps, wanted[topic.name], _is_cdr(reader))
            decoders |= {connection.id: (topic, decoder) for connection in topic.connections}
        total = max(sum(connection.msgcount for connection in connections), 1)
        for read, (connection, time, data) in enumerate(reader.messages(connections=connections), 1):
            topic, decoder = decoders[connection.id]
            if decoder.take(time, data):
                yield _block(log, topic, decoder, min(read / total, 1.0))
        for topic, decoder in {id(decoder): (topic, decoder) for topic, decoder in decoders.values()}.values():
            if decoder.messages:
                yield _block(log, topic, decoder, 1.0)


def _block(log: LogFile, topic: _Topic, decoder: Decoder, done: float) -> Block:
    try:
        return decoder.block(done)
    except struct.error as cause:
        raise InputError(
            f'{log.path}, table "{topic.name}"',
            found=f"a message that does not fit {topic.kind}: {cause}",
            expected="messages by their definition",
            remedy="the log is damaged, or was recorded with another version of the message: record it again",
        ) from cause


def _opened(log: LogFile) -> Any:
    if not log.path.is_dir():
        with log.path.open("rb") as stream:
            is_first = stream.read(len(_ROS_1)) == _ROS_1
        if is_first:
            with optional("ros", log.path):
                from rosbags.rosbag1 import Reader as Reader1
            return Reader1(log.path)
    with optional("ros", log.path):
        from rosbags.rosbag2 import Reader
    return Reader(log.path)


def _is_cdr(reader: Any) -> bool:
    return not hasattr(reader, "chunk_infos")


def _topics(reader: Any, log: LogFile) -> list[_Topic]:
    """Return the connections by topic and type; definitions that many share are parsed once."""
    groups: dict[tuple[str, str, Any], list[Any]] = {}
    for connection in reader.connections:
        groups.setdefault((connection.topic, connection.msgtype, connection.msgdef), []).append(connection)
    names = [topic for topic, _, _ in groups]
    parsed: dict[tuple[str, Any], tuple[tuple[Step, ...], str]] = {}
    topics = []
    for (topic, kind, definition), connections in groups.items():
        if (kind, definition) not in parsed:
            parsed[kind, definition] = _steps(kind, definition, _is_cdr(reader), log)
        steps, trouble = parsed[kind, definition]
        name = topic if names.count(topic) == 1 else f"{topic} ({kind})"
        topics.append(_Topic(name, kind, tuple(connections), steps, trouble))
    return topics


def _steps(kind: str, definition: Any, is_cdr: bool, log: LogFile) -> tuple[tuple[Step, ...], str]:
    """Return the steps of a message type, or why there are none."""
    try:
        return steps_of(kind, _definitions(kind, definition, log), is_cdr), ""
    except Undefined as cause:
        added = (
            ""
            if definition.data
            else ": a bag of ROS 2 Humble or older; record it with MCAP storage, or convert it on a machine with the messages"
        )
        return (), f"{cause}{added}"
    except InputError:
        raise
    except Exception as cause:
        # The parser's own errors differ between releases; one bad definition must not hide the other topics.
        return (), f"a definition of {kind} that cannot be parsed ({type(cause).__name__})"


def _definitions(kind: str, definition: Any, log: LogFile) -> Definitions:
    with optional("ros", log.path):
        import rosbags.typesys as typesys
    if definition.format.name == "MSG":
        return typesys.get_types_from_msg(definition.data, kind)
    if definition.format.name == "IDL":
        separator = "=" * 80 + "\n"
        parts = (
            definition.data.split(separator) if definition.data.startswith(f"{separator}IDL: ") else [definition.data]
        )
        texts = [part.split("\n", 1)[1] if part.startswith("IDL: ") else part for part in parts if part]
        return {name: fields for text in texts for name, fields in typesys.get_types_from_idl(text).items()}
    # Bags from before ROS 2 Iron hold no definitions: those of the standard messages are known, and of what an autopilot's bridge sends.
    known = _MAVROS.get(kind.removeprefix("mavros_msgs/msg/"))
    added = typesys.get_types_from_msg(_HEADER + known, kind) if known else {}
    return {**typesys.get_typestore(typesys.Stores.ROS2_HUMBLE).fielddefs, **added}


def _lengths(topic: _Topic, reader: Any) -> dict[str, int]:
    """Return how long the sequences of a topic are in its first messages."""
    if topic.trouble or not has_sequences(topic.steps):
        return {}
    first = islice(reader.messages(connections=topic.connections), _LOOKED_AT)
    return lengths_of((data for _, _, data in first), topic.steps, _is_cdr(reader))


def _table(topic: _Topic, lengths: dict[str, int]) -> TableInfo:
    columns = (ColumnInfo(LOG_TIME, "ns"), *columns_of(topic.steps, lengths))
    stamps = [column.name for column in columns if column.name in ("header.stamp", "stamp")]
    rows = sum(connection.msgcount for connection in topic.connections)
    clocks, words = (*stamps, LOG_TIME), words_of(topic.steps)
    return TableInfo(topic.name, columns, clocks, rows, topic.kind, topic.trouble, words=words, has_sequences=True)


BAG = LogFormat("a ROS 1 bag", (".bag",), begins_with(_ROS_1), _catalogue, _blocks, memory=_MEMORY)
FOLDER = LogFormat("a ROS 2 bag", (), _is_folder, _catalogue, _blocks, memory=_MEMORY)
MCAP = LogFormat("an MCAP file", (".mcap",), begins_with(_MCAP), _catalogue, _blocks, memory=_MEMORY)
SQLITE = LogFormat("a ROS 2 database", (".db3",), begins_with(_SQLITE), _catalogue, _blocks, memory=_MEMORY)
