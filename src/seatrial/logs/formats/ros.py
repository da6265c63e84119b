"""ROS 1 bags, ROS 2 bags (sqlite3 and MCAP) and bare MCAP: a table for each topic.

`rosbags` opens the container and parses the message definitions that it holds, so that messages of any type are read; `ros_messages`
takes the numbers out of them. What the library unpacks is held within bounds, and a ROS 1 bag is read chunk by chunk, in the order of
recording: its own iteration keeps an index of every message, which takes more memory than a log of short messages takes on disk. Source:
ROS wiki, "Bags/Format/2.0".
"""

import bz2
import struct
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO

from seatrial.core.errors import InputError
from seatrial.logs.formats.protocol import (
    LOG_TIME,
    Block,
    ColumnInfo,
    LogFile,
    LogFormat,
    TableInfo,
    Wanted,
    optional,
)
from seatrial.logs.formats.ros_messages import Decoder, Definitions, Step, Undefined, columns_of, steps_of

_SQLITE = b"SQLite format 3\0"
_MCAP = b"\x89MCAP0\r\n"
_ROS_1 = b"#ROSBAG V"

_MESSAGE = 2
_SIZE = struct.Struct("<I").unpack_from
_TIME = struct.Struct("<II").unpack_from
_MOST_BYTES = 1 << 28
"""Of one chunk, unpacked."""
_SMALL_BYTES, _MOST_TIMES_LARGER = 1 << 23, 1000
"""Of a chunk that may be all zeros, and how many times larger than packed a larger one may be; numbers of sensors reach some tens."""
_SMALL_FILE = 1 << 30
"""The same of a whole database that was packed."""


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
        counts = _counts(reader)
        return tuple(_table(topic, counts) for topic in _topics(reader, log))


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
        counts = _counts(reader)
        total = max(sum(counts.get(connection.id, 0) for connection in connections), 1)
        for read, (connection, time, data) in enumerate(_messages(reader, connections), 1):
            topic, decoder = decoders[connection]
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
            expected="messages as their definition says",
            remedy="the log is damaged, or was recorded with another version of the message: record it again",
        ) from cause


def _opened(log: LogFile) -> Any:
    if not log.path.is_dir():
        with log.path.open("rb") as stream:
            is_first = stream.read(len(_ROS_1)) == _ROS_1
        if is_first:
            return _open_bag(log)
    return _open_rosbag2(log.path)


def _is_cdr(reader: Any) -> bool:
    return not hasattr(reader, "chunk_infos")


def _counts(reader: Any) -> dict[int, int]:
    """Messages of each connection."""
    if _is_cdr(reader):
        return {connection.id: connection.msgcount for connection in reader.connections}
    counts: dict[int, int] = {}
    for chunk in reader.chunk_infos:
        for connection, number in chunk.connection_counts.items():
            counts[connection] = counts.get(connection, 0) + number
    return counts


def _messages(reader: Any, connections: Sequence[Any]) -> Iterator[tuple[int, int, bytes]]:
    """Connection, time of receipt in ns and bytes of each message."""
    if _is_cdr(reader):
        yield from ((found.id, time, data) for found, time, data in reader.messages(connections=connections))
    else:
        yield from _bag_messages(reader, {connection.id for connection in connections})


def _topics(reader: Any, log: LogFile) -> list[_Topic]:
    """Connections by topic and type; definitions that many share are parsed once."""
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
    """Steps of a message type, or why there are none."""
    try:
        return steps_of(kind, _definitions(kind, definition, log), is_cdr), ""
    except Undefined as cause:
        return (), str(cause)
    except InputError:
        raise
    except Exception as cause:
        # The parser's own errors differ between releases; one bad definition must not hide the other topics.
        return (), f"a definition of {kind} that cannot be parsed ({type(cause).__name__})"


def _definitions(kind: str, definition: Any, log: LogFile) -> Definitions:
    typesys = optional("rosbags.typesys", "ros", log.path)
    if definition.format.name == "MSG":
        return typesys.get_types_from_msg(definition.data, kind)
    if definition.format.name == "IDL":
        separator = "=" * 80 + "\n"
        parts = (
            definition.data.split(separator) if definition.data.startswith(f"{separator}IDL: ") else [definition.data]
        )
        texts = [part.split("\n", 1)[1] if part.startswith("IDL: ") else part for part in parts if part]
        return {name: fields for text in texts for name, fields in typesys.get_types_from_idl(text).items()}
    # Bags from before ROS 2 Iron hold no definitions: those of the standard messages are known.
    return typesys.get_typestore(typesys.Stores.ROS2_HUMBLE).fielddefs


def _table(topic: _Topic, counts: Mapping[int, int]) -> TableInfo:
    columns = (ColumnInfo(LOG_TIME, "ns"), *columns_of(topic.steps))
    stamps = [column.name for column in columns if column.name in ("header.stamp", "stamp")]
    rows = sum(counts.get(connection.id, 0) for connection in topic.connections)
    return TableInfo(topic.name, columns, (*stamps, LOG_TIME), rows, topic.kind, topic.trouble)


def _open_rosbag2(path: Path) -> Any:
    """Return the library's reader of a ROS 2 bag or an MCAP file, which then unpacks no more than a recorder would have packed."""
    library = optional("rosbags.rosbag2", "ros", path)
    library.reader.zstd = _BoundedZstd
    library.storage_mcap.DECOMPRESSORS.update({"lz4": _unpacked_chunk, "zstd": _unpacked_chunk})
    return library.Reader(path)


def _open_bag(log: LogFile) -> Any:
    """Reader of a ROS 1 bag that reads its connections and chunks, but not the index of its messages."""
    return _lean(optional("rosbags.rosbag1", "ros", log.path).Reader)(log.path)


def _bag_messages(reader: Any, wanted: set[int]) -> Iterator[tuple[int, int, bytes]]:
    """Connection, time of receipt in ns and bytes of each message of some connections.

    Raises:
        ValueError: a chunk that is no series of records, or that unpacks to more than any recorder writes.
    """
    for info in reader.chunk_infos:
        if wanted.isdisjoint(info.connection_counts):
            continue
        chunk = reader.chunks[info.pos]
        reader.bio.seek(chunk.datapos)
        data = _unpacked(reader.bio.read(chunk.datasize))
        at, places = 0, None
        while at < len(data):
            length = _SIZE(data, at)[0]
            header = data[at + 4 : at + 4 + length]
            start = at + 8 + length
            at = start + _SIZE(data, start - 4)[0]
            if at > len(data):
                raise ValueError("a record that is longer than its chunk")
            if places is None or not _is_alike(header, places):
                places = _places(header)
                if places is None:
                    continue
            connection = _SIZE(header, places["conn"])[0]
            if connection in wanted:
                seconds, nanoseconds = _TIME(header, places["time"])
                yield connection, seconds * 10**9 + nanoseconds, data[start:at]


def _is_alike(header: bytes, places: dict[str, int]) -> bool:
    """Whether a header is laid out as the one before: recorders write all alike."""
    return (
        len(header) == places["length"]
        and header[places["op"]] == _MESSAGE
        and header[places["op"] - 3 : places["op"]] == b"op="
        and header[places["conn"] - 5 : places["conn"]] == b"conn="
        and header[places["time"] - 5 : places["time"]] == b"time="
    )


def _places(header: bytes) -> dict[str, int] | None:
    """Where the fields of a message's header begin; None for the header of another record."""
    places, at = {"length": len(header)}, 0
    while at < len(header):
        length = _SIZE(header, at)[0]
        name, mark, _ = header[at + 4 : at + 4 + length].partition(b"=")
        if mark:
            places[name.decode("latin-1")] = at + 4 + len(name) + 1
        at += 4 + length
    if not {"op", "conn", "time"} <= places.keys() or header[places["op"]] != _MESSAGE:
        return None
    return places


def _unpacked(data: bytes) -> bytes:
    """Unpack a chunk by what it begins with.

    Raises:
        ValueError: it is cut off, or larger than a recorder makes it.
    """
    if data.startswith(b"BZh"):
        unpack: Any = bz2.BZ2Decompressor()
    elif data.startswith(b"\x04\x22\x4d\x18"):
        from lz4.frame import LZ4FrameDecompressor

        unpack = LZ4FrameDecompressor()
    elif data.startswith(b"\x28\xb5\x2f\xfd"):
        unpack = _zstd().ZstdDecompressor()
    else:
        return data
    most = min(_MOST_BYTES, _SMALL_BYTES + _MOST_TIMES_LARGER * len(data))
    part = unpack.decompress(data, most)
    if not unpack.eof:
        raise ValueError(f"a chunk that is cut off, or larger than {most >> 20} MB")
    return part


def _unpacked_chunk(data: bytes, _: int) -> bytes:
    return _unpacked(data)


def _zstd() -> Any:
    """The module that `rosbags` itself unpacks with."""
    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd
    return zstd


class _BoundedZstd:
    """What `rosbags` uses of zstd, within bounds: single messages and whole databases."""

    decompress = staticmethod(_unpacked)

    @staticmethod
    def open(packed: BinaryIO, mode: str) -> "_BoundedFile":
        """Open a packed database."""
        return _BoundedFile(packed, mode)


class _BoundedFile:
    """A packed file that is read no farther than a recorder would have written it."""

    def __init__(self, packed: BinaryIO, mode: str) -> None:
        """Open it."""
        self.left = _SMALL_FILE + _MOST_TIMES_LARGER * packed.seek(0, 2)
        packed.seek(0)
        self.file = _zstd().open(packed, mode)

    def __enter__(self) -> "_BoundedFile":
        """Begin."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self.file.close()

    def read(self, size: int = -1) -> bytes:
        """Read on.

        Raises:
            ValueError: it is larger than it can be.
        """
        data = self.file.read(size)
        self.left -= len(data)
        if self.left < 0:
            raise ValueError("a packed database that is larger than any recorder packs")
        return data


@cache
def _lean(reader: type) -> type:
    """Reader that passes over the index of messages."""

    def read_index_data(self: Any, pos: int, indexes: Any) -> None:
        for _ in range(2):
            size = self.bio.read(4)
            self.bio.seek(struct.unpack("<I", size)[0], 1)

    return type("LeanReader", (reader,), {"read_index_data": read_index_data})


def _recognises(magic: bytes) -> Any:
    return lambda path, head: head.startswith(magic)


BAG = LogFormat("a ROS 1 bag", (".bag",), _recognises(_ROS_1), _catalogue, _blocks)
FOLDER = LogFormat("a ROS 2 bag", (), _is_folder, _catalogue, _blocks)
MCAP = LogFormat("an MCAP file", (".mcap",), _recognises(_MCAP), _catalogue, _blocks)
SQLITE = LogFormat("a ROS 2 database", (".db3",), _recognises(_SQLITE), _catalogue, _blocks)
