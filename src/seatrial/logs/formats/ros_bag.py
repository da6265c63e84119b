"""Bags opened by `rosbags`, what they unpack held within bounds; a ROS 1 bag is read chunk by chunk, in the order of recording.

The library's own iteration of a ROS 1 bag keeps an index of every message, which takes more memory than a log of short messages takes
on disk. Source: ROS wiki, "Bags/Format/2.0".
"""

import bz2
import struct
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO

from seatrial.logs.formats.protocol import LogFile, optional

_MESSAGE = 2
_SIZE = struct.Struct("<I").unpack_from
_TIME = struct.Struct("<II").unpack_from
_MOST_BYTES = 1 << 28
"""Of one chunk, unpacked."""
_SMALL_BYTES, _MOST_TIMES_LARGER = 1 << 23, 1000
"""Of a chunk that may be all zeros, and how many times larger than packed a larger one may be; numbers of sensors reach some tens."""
_SMALL_FILE = 1 << 30
"""The same of a whole database that was packed."""


def open_rosbag2(path: Path) -> Any:
    """Return the library's reader of a ROS 2 bag or an MCAP file, which then unpacks no more than a recorder would have packed."""
    library = optional("rosbags.rosbag2", "ros", path)
    library.reader.zstd = _BoundedZstd
    library.storage_mcap.DECOMPRESSORS.update({"lz4": _unpacked_chunk, "zstd": _unpacked_chunk})
    return library.Reader(path)


def open_bag(log: LogFile) -> Any:
    """Reader of a ROS 1 bag that reads its connections and chunks, but not the index of its messages."""
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
