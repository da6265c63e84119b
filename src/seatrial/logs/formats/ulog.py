"""PX4's logs (.ulg): a table for each topic, and for each instance of one that several publish.

A message is its length, its type and its bytes. `F` messages name the fields of a topic, `A` messages say which number stands for which
topic, `D` messages are its rows. Source: PX4, "ULog File Format" of the developers' guide.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from seatrial.core.errors import InputError
from seatrial.logs.formats.protocol import (
    BLOCK_ROWS,
    MOST_ELEMENTS,
    Block,
    ColumnInfo,
    LogFile,
    LogFormat,
    TableInfo,
    Wanted,
    as_column,
)

_MAGIC = b"ULog\x01\x12\x35"
_HEAD = 16
_PIECE = 1 << 22
_CLOCKS = {"timestamp_sample": "us", "timestamp": "us"}
_NUMBERS = {
    "int8_t": "i1",
    "uint8_t": "u1",
    "int16_t": "<i2",
    "uint16_t": "<u2",
    "int32_t": "<i4",
    "uint32_t": "<u4",
    "int64_t": "<i8",
    "uint64_t": "<u8",
    "float": "<f4",
    "double": "<f8",
    "bool": "u1",
    "char": "S1",
}
_FIELD = re.compile(r"([\w/]+)(?:\[(\d{1,5})\])? (\w+)")
_DEEPEST = 8
_LARGEST = 1 << 16
_KNOWN = b"FIMPQADRLCSOB"
"""Types of messages; another is passed over."""


class _Topic(NamedTuple):
    """What a number of `D` messages stands for."""

    kind: str
    instance: int


@dataclass
class _Scan:
    """What a pass over the log has found so far."""

    formats: dict[str, str] = field(default_factory=dict)
    topics: dict[int, _Topic] = field(default_factory=dict)
    skipped: int = 0


@dataclass(frozen=True)
class _Index:
    """Tables of a log: for each its topic and the layout of its rows."""

    tables: tuple[TableInfo, ...]
    where: Mapping[str, tuple[_Topic, np.dtype]]


def _recognises(path: Path, head: bytes) -> bool:
    return head.startswith(_MAGIC)


def _catalogue(log: LogFile) -> tuple[TableInfo, ...]:
    return _index_of(log).tables


def _blocks(log: LogFile, wanted: Wanted) -> Iterator[Block]:
    where = _index_of(log).where
    tables = {where[table][0]: table for table in wanted}
    waiting: dict[str, list[bytes]] = {table: [] for table in wanted}
    scan, size = _Scan(), max(log.path.stat().st_size, 1)
    for number, row, done in _rows(log.path, scan):
        table = tables.get(scan.topics[number])
        if table is not None:
            rows, least = waiting[table], where[table][1].itemsize
            if len(row) >= least:
                rows.append(row[:least])
            if len(rows) >= BLOCK_ROWS:
                yield _block(table, wanted[table], rows, where[table][1], done / size)
                rows.clear()
    for table, rows in waiting.items():
        if rows:
            yield _block(table, wanted[table], rows, where[table][1], 1.0)


def _block(table: str, names: Sequence[str], rows: list[bytes], layout: np.dtype, done: float) -> Block:
    values = np.frombuffer(b"".join(rows), layout)
    return Block(
        table, {name: as_column(np.ascontiguousarray(_column(values, name))) for name in names}, min(done, 1.0)
    )


def _column(values: np.ndarray, name: str) -> np.ndarray:
    """Return a field of the rows, or an element of one that is an array."""
    if name in (values.dtype.names or ()):
        return values[name]
    base, _, element = name.rpartition("[")
    return values[base][:, int(element[:-1])]


def _index_of(log: LogFile) -> _Index:
    stat = log.path.stat()
    return _index(log.path, stat.st_size, stat.st_mtime_ns)


@lru_cache(maxsize=4)
def _index(path: Path, size: int, changed: int) -> _Index:
    """Count the rows of each topic; kept, since a catalogue is followed by a reading."""
    scan, counts = _Scan(), dict[_Topic, int]()
    for number, _, _ in _rows(path, scan):
        topic = scan.topics[number]
        counts[topic] = counts.get(topic, 0) + 1
    notes = (f"{scan.skipped} bytes of the log are no messages and were passed over",) if scan.skipped else ()
    kinds = [topic.kind for topic in counts]
    tables, where = [], {}
    for topic, number in counts.items():
        name = topic.kind + (f"[{topic.instance}]" if kinds.count(topic.kind) > 1 else "")
        layout = np.dtype(_fields(topic.kind, scan.formats, path))
        columns = tuple(_columns(layout))
        clocks = tuple(column.name for column in columns if column.name in _CLOCKS)
        tables.append(TableInfo(name, columns, clocks, number, notes=notes))
        where[name] = (topic, layout)
    return _Index(tuple(tables), where)


def _columns(layout: np.dtype) -> Iterator[ColumnInfo]:
    for name in layout.names or ():
        kind = layout[name]
        if kind.base.kind == "S" or name.rpartition(".")[2].startswith("_padding"):
            continue
        if kind.shape:
            yield from (ColumnInfo(f"{name}[{k}]") for k in range(min(kind.shape[0], MOST_ELEMENTS)))
        else:
            yield ColumnInfo(name, _CLOCKS.get(name))


def _fields(kind: str, formats: Mapping[str, str], path: Path, prefix: str = "", depth: int = 0) -> list[tuple]:
    """Return the fields of a topic as NumPy has them, without the padding at the end, which no row holds.

    Raises:
        InputError: a topic, or a part of one, that the log does not define.
    """
    text = formats.get(kind)
    parts = [part.strip() for part in (text or "").split(";") if part.strip()]
    found: list[tuple] = []
    for part in parts if depth < _DEEPEST else [""]:
        match = _FIELD.fullmatch(part)
        if match is None or len(found) > _LARGEST:
            parts = []
            break
        base, count, name = match[1], int(match[2] or 0), prefix + match[3]
        if base in _NUMBERS:
            found.append((name, _NUMBERS[base], (count,)) if count else (name, _NUMBERS[base]))
        else:
            names = [f"{name}[{k}]" for k in range(count)] if count else [name]
            found += [one for each in names for one in _fields(base, formats, path, f"{each}.", depth + 1)]
    if not parts:
        raise InputError(
            f'{path}, table "{kind}"',
            found="no definition of it" if text is None else f"the definition {text[:80]!r}",
            expected="the fields of the topic",
            remedy="the log is damaged: copy it again from the vehicle",
        )
    while not prefix and len(found) > 1 and found[-1][0].startswith("_padding"):
        found.pop()
    return found


def _rows(path: Path, scan: _Scan) -> Iterator[tuple[int, bytes, int]]:
    """Yield the number and bytes of every row, and how far the log is read; what says what they are goes into `scan`."""
    with path.open("rb") as stream:
        stream.seek(_HEAD)
        parts = _appended(stream.read(3 + 40))
        for start, end in pairwise((_HEAD, *sorted(parts), path.stat().st_size)):
            stream.seek(start)
            yield from _part(stream, start, end, scan)


def _appended(first: bytes) -> list[int]:
    """Return where the log goes on after a crash, by its first message."""
    if len(first) < 43 or first[2:3] != b"B":
        return []
    return [place for place in np.frombuffer(first, "<u8", 3, 3 + 16).tolist() if place]


def _part(stream: BinaryIO, start: int, end: int, scan: _Scan) -> Iterator[tuple[int, bytes, int]]:
    """Yield the rows between two places, between which messages follow each other."""
    held, base = b"", start
    while base + len(held) < end:
        piece, at = held + stream.read(min(_PIECE, end - base - len(held))), 0
        while at + 3 <= len(piece):
            length, kind = piece[at] | piece[at + 1] << 8, piece[at + 2]
            stop = at + 3 + length
            if kind not in _KNOWN:
                scan.skipped += 1
                at += 1
                continue
            if stop > len(piece):
                break
            if kind == 68:  # D
                number = piece[at + 3] | piece[at + 4] << 8
                if number in scan.topics and length > 2:
                    yield number, piece[at + 5 : stop], base + at
            elif kind in b"FA":
                _define(kind, piece[at + 3 : stop], scan)
            at = stop
        if not piece[len(held) :]:
            break
        held, base = piece[at:], base + at
    scan.skipped += len(held)


def _define(kind: int, body: bytes, scan: _Scan) -> None:
    """Learn the fields of a topic, or which number stands for it."""
    if kind in b"F":
        name, _, fields = body.decode("latin-1").partition(":")
        scan.formats[name] = fields
    elif len(body) > 3:
        scan.topics[body[1] | body[2] << 8] = _Topic(body[3:].decode("latin-1"), body[0])


FORMAT = LogFormat("a PX4 log", (".ulg",), _recognises, _catalogue, _blocks)
