"""A ROS 1 bag opened by `rosbags` and read chunk by chunk, in the order of recording.

The library's own iteration keeps an index of every message, which takes more memory than a log of short messages takes on
disk. Source: ROS wiki, "Bags/Format/2.0".
"""

import bz2
import struct
from collections.abc import Iterator
from functools import cache
from typing import Any

from seatrial.logs.formats.protocol import LogFile, optional

_MESSAGE = 2
_SIZE = struct.Struct("<I").unpack_from
_TIME = struct.Struct("<II").unpack_from
_MOST_BYTES = 1 << 28
"""Of one chunk, unpacked."""


def open_bag(log: LogFile) -> Any:
    """Reader of a bag that reads its connections and chunks, but not the index of its messages."""
    return _lean(optional("rosbags.rosbag1", "ros", log.path).Reader)(log.path)


def message_counts(reader: Any) -> dict[int, int]:
    """Messages of each connection."""
    counts: dict[int, int] = {}
    for chunk in reader.chunk_infos:
        for connection, number in chunk.connection_counts.items():
            counts[connection] = counts.get(connection, 0) + number
    return counts


def messages(reader: Any, wanted: set[int]) -> Iterator[tuple[int, int, bytes]]:
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
    if data.startswith(b"BZh"):
        unpack, part = bz2.BZ2Decompressor(), b""
        part = unpack.decompress(data, _MOST_BYTES)
    elif data.startswith(b"\x04\x22\x4d\x18"):
        from lz4.frame import LZ4FrameDecompressor

        unpack = LZ4FrameDecompressor()
        part = unpack.decompress(data, _MOST_BYTES)
    else:
        return data
    if not unpack.eof:
        raise ValueError(f"a chunk that is cut off, or larger than {_MOST_BYTES >> 20} MB")
    return part


@cache
def _lean(reader: type) -> type:
    """Reader that passes over the index of messages."""

    def read_index_data(self: Any, pos: int, indexes: Any) -> None:
        for _ in range(2):
            size = self.bio.read(4)
            self.bio.seek(struct.unpack("<I", size)[0], 1)

    return type("LeanReader", (reader,), {"read_index_data": read_index_data})
