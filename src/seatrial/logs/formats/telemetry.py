"""MAVLink telemetry logs (.tlog): a table for each message type, and for each sender where several send it.

A record is the time of receipt in microseconds since 1970 (eight bytes, big-endian) and a MAVLink packet of version 1 or 2.
`pymavlink` knows the messages: their fields, units and check bytes. Source: MAVLink developer guide, "Serialization".
"""

import re
import struct
from collections import Counter
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from seatrial.core.files import kept_per_file
from seatrial.logs.formats.protocol import (
    LOG_TIME,
    Block,
    ColumnInfo,
    LogFile,
    LogFormat,
    TableInfo,
    Wanted,
    as_column,
    in_blocks,
    optional,
)

_PIECE_BYTES = 1 << 22
_VERSION_1, _VERSION_2 = 0xFE, 0xFD
_MAX_PACKET_BYTES = 8 + 10 + 255 + 2 + 13
_CLOCKS = {"time_boot_ms": "ms", "time_usec": "us", "time_unix_usec": "us"}


@dataclass(frozen=True)
class _Index:
    """Tables of a log, and for each its message type and sender."""

    tables: tuple[TableInfo, ...]
    where: Mapping[str, tuple[int, tuple[int, int]]]


class Packet(NamedTuple):
    """One message as it came over a link.

    Attributes:
        table: type of the message.
        sender: system and component.
        columns: its numbers by the names that a log of it has, and the time of receipt, us.
        record: the bytes that a telemetry log holds of it.
    """

    table: str
    sender: tuple[int, int]
    columns: dict[str, float]
    record: bytes


def packets(data: bytes, time: int, wanted: Container[str]) -> list[Packet]:
    """Return the messages in a datagram whose check bytes are right; of types that are not wanted only the bytes.

    Args:
        data: as received.
        time: of receipt, us since 1970.
        wanted: types of messages.

    Raises:
        InputError: without pymavlink.
    """
    dialect = mavlink(Path("MAVLink over UDP"))
    stamp, at, received = struct.pack(">Q", time), 0, []
    while at < len(data):
        piece = stamp + data[at:]
        packet = _packet(piece, 0, dialect.mavlink_map, dialect.x25crc)
        if packet is None:
            at += 1
            continue
        kind, sender, payload, length = packet
        message = dialect.mavlink_map.get(kind)
        name, columns = ("", {}) if message is None else (message.msgname, {})
        if name in wanted:
            layout = _layout(message)
            rows = np.frombuffer(payload.ljust(layout.itemsize, b"\0"), layout)
            columns |= {column.name: float(_column(rows, column.name)[0]) for column in _columns(message)}
            columns[LOG_TIME] = float(time)
        received.append(Packet(name, sender, columns, piece[:length]))
        at += length - len(stamp)
    return received


def _recognises(path: Path, head: bytes) -> bool:
    """Recognise a plausible time, 1990 to 2100, before the first byte of a packet."""
    if not path.name.lower().endswith(".tlog") or len(head) < 9:
        return False
    seconds = int.from_bytes(head[:8], "big") / 1e6
    return head[8] in (_VERSION_1, _VERSION_2) and 6.3e8 < seconds < 4.1e9


def _catalogue(log: LogFile) -> tuple[TableInfo, ...]:
    return _index(log.path).tables


def mavlink(path: Path) -> Any:
    """Return the messages of ArduPilot as pymavlink has them.

    Args:
        path: of the log, for the error.

    Raises:
        InputError: without pymavlink.
    """
    with optional("ardupilot", path):
        import pymavlink.dialects.v20.ardupilotmega as dialect
    return dialect


def _blocks(log: LogFile, wanted: Wanted) -> Iterator[Block]:
    messages, where = mavlink(log.path).mavlink_map, _index(log.path).where
    tables = {where[table]: table for table in wanted}
    size = max(log.path.stat().st_size, 1)

    def rows() -> Iterator[tuple[str, tuple[int, bytes], float]]:
        for time, kind, sender, payload, done in _records(log.path, messages, Counter()):
            if table := tables.get((kind, sender)):
                yield table, (time, payload.ljust(_layout(messages[kind]).itemsize, b"\0")), done / size

    def block(table: str, rows: list[tuple[int, bytes]], done: float) -> Block:
        cells = np.frombuffer(b"".join(payload for _, payload in rows), _layout(messages[where[table][0]]))
        columns = {name: _column(cells, name) for name in wanted[table] if name != LOG_TIME}
        if LOG_TIME in wanted[table]:
            columns[LOG_TIME] = np.array([time for time, _ in rows], np.int64)
        return Block(table, columns, done)

    return in_blocks(rows(), block)


def _column(rows: np.ndarray, name: str) -> np.ndarray:
    """Return a field of messages, or an element of one that is an array."""
    field, _, element = name.partition("[")
    return as_column(np.ascontiguousarray(rows[field][:, int(element[:-1])] if element else rows[field]))


@kept_per_file(4)
def _index(path: Path) -> _Index:
    """Count the messages of each type and sender; kept, since a catalogue is followed by a reading."""
    messages = mavlink(path).mavlink_map
    skipped: Counter[str] = Counter()
    counts = Counter((kind, sender) for _, kind, sender, _, _ in _records(path, messages, skipped))
    senders = Counter(kind for kind, _ in counts)
    notes = (f"{skipped['bytes']} bytes of the log are no messages and were passed over",) if skipped else ()
    tables, where = [], {}
    for (kind, sender), number in sorted(counts.items()):
        columns = (ColumnInfo(LOG_TIME, "us"), *_columns(messages[kind]))
        clocks = (LOG_TIME, *(column.name for column in columns if column.name in _CLOCKS))
        name = messages[kind].msgname + (f" of {sender[0]}/{sender[1]}" if senders[kind] > 1 else "")
        tables.append(TableInfo(name, columns, clocks, number, notes=notes))
        where[name] = (kind, sender)
    return _Index(tuple(tables), where)


def _records(
    path: Path, messages: Mapping[int, Any], skipped: Counter[str]
) -> Iterator[tuple[int, int, tuple[int, int], bytes, int]]:
    """Yield the time, type, sender and payload of every message whose check bytes are right, and how far the log is read."""
    checksum = mavlink(path).x25crc
    held, base = b"", 0
    with path.open("rb") as stream:
        while True:
            data = stream.read(_PIECE_BYTES)
            piece, at = held + data, 0
            end = len(piece) if not data else len(piece) - _MAX_PACKET_BYTES
            while at < end:
                packet = _packet(piece, at, messages, checksum)
                if packet is None:
                    at += 1
                    skipped["bytes"] += 1
                    continue
                kind, sender, payload, length = packet
                if kind in messages:
                    yield struct.unpack_from(">Q", piece, at)[0], kind, sender, payload, base + at
                at += length
            at = min(at, len(piece))
            held, base = piece[at:], base + at
            if not data:
                return


def _packet(
    piece: bytes, at: int, messages: Mapping[int, Any], checksum: Any
) -> tuple[int, tuple[int, int], bytes, int] | None:
    """Return the type, sender, payload and length of the record at a place, None if there is none."""
    if len(piece) < at + 16:
        return None
    start, length = piece[at + 8], piece[at + 9]
    if start == _VERSION_1:
        sender, kind, body, tail = (piece[at + 11], piece[at + 12]), piece[at + 13], at + 14, 2
    elif start == _VERSION_2 and len(piece) >= at + 20:
        sender, kind = (piece[at + 13], piece[at + 14]), int.from_bytes(piece[at + 15 : at + 18], "little")
        body, tail = at + 18, 15 if piece[at + 10] & 1 else 2
    else:
        return None
    stop = body + length
    if stop + tail > len(piece):
        return None
    if kind in messages:
        crc = checksum(piece[at + 9 : stop])
        crc.accumulate(bytes([messages[kind].crc_extra]))
        if crc.crc != int.from_bytes(piece[stop : stop + 2], "little"):
            return None
        if start == _VERSION_1 and length > messages[kind].unpacker.size:
            return None
    elif stop + tail + 8 < len(piece) and piece[stop + tail + 8] not in (_VERSION_1, _VERSION_2):
        # A message of another dialect: all that tells it from chance is the packet that follows.
        return None
    return (
        kind,
        sender,
        piece[body:stop][: messages[kind].unpacker.size if kind in messages else None],
        stop + tail - at,
    )


@lru_cache(maxsize=256)
def _layout(message: Any) -> np.dtype:
    """Return the numbers of a payload, in their order on the wire."""
    tokens = re.findall(r"(\d*)([a-zA-Z])", message.unpacker.format.lstrip("<"))
    fields = []
    for name, (count, code) in zip(message.ordered_fieldnames, tokens, strict=True):
        if code in "sc":
            fields.append((name, f"S{count or 1}"))
        else:
            fields.append((name, f"{count}<{code}"))  # NumPy calls these types as struct does
    return np.dtype(fields)


def _columns(message: Any) -> Iterator[ColumnInfo]:
    layout = _layout(message)
    for name in message.fieldnames:
        kind = layout[name]
        unit = message.fieldunits_by_name.get(name) or _CLOCKS.get(name)
        if kind.shape:
            yield from (ColumnInfo(f"{name}[{k}]", unit) for k in range(kind.shape[0]))
        elif kind.kind != "S":
            yield ColumnInfo(name, unit)


FORMAT = LogFormat("a MAVLink telemetry log", (".tlog",), _recognises, _catalogue, _blocks)
