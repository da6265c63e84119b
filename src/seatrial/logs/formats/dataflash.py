"""ArduPilot's dataflash logs (.BIN): a table for each message type, and for each instance of a sensor that logs several.

A message is 0xA3 0x95, its type, and numbers packed as the type's FMT message says; FMT describes itself. UNIT, MULT and
FMTU messages tell units, multipliers, and which column counts instances (`#`). Source: ArduPilot, AP_Logger, "Log
Messages" of the developers' pages. Format characters with a multiplier of their own (c, C, e, E, L) are applied.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from seatrial.core.errors import InputError
from seatrial.core.files import kept_per_file
from seatrial.logs.formats.protocol import Block, ColumnInfo, LogFile, LogFormat, TableInfo, Wanted, as_column

_HEAD = b"\xa3\x95"
_FMT, _FMT_LENGTH = 128, 89
_PIECE_BYTES = 1 << 22
# Types by the characters of a format: most are NumPy's own, and some of these with a multiplier
_TYPES = {
    **{character: f"<{character}" for character in "bBhHiIfdqQ"},
    **{"c": "<h", "C": "<H", "e": "<i", "E": "<I", "L": "<i", "M": "B"},
    **{"a": "32<h", "g": "<e", "n": "S4", "N": "S16", "Z": "S64"},
}
_DIVISORS = {"c": 100.0, "C": 100.0, "e": 100.0, "E": 100.0, "L": 1e7}
_PREFIXES = {1e-1: "d", 1e-2: "c", 1e-3: "m", 1e-6: "u", 1e-9: "n"}
_DESCRIBING_MESSAGES = ("UNIT", "MULT", "FMTU")
_CLOCKS = {"TimeUS": "us", "TimeMS": "ms"}


@dataclass(frozen=True)
class _Kind:
    """One message type: its bytes behind the header, and the character of each column."""

    name: str
    length: int
    layout: np.dtype | None
    characters: Mapping[str, str]


@dataclass
class _Scan:
    """What a pass over the log has found so far."""

    kinds: dict[int, _Kind] = field(default_factory=dict)
    skipped: int = 0


@dataclass(frozen=True)
class _Index:
    """Tables of a log: for each its message type, the column and value of its instance, and its rows."""

    tables: tuple[TableInfo, ...]
    where: Mapping[str, tuple[int, str | None, float]]


def _recognises(path: Path, head: bytes) -> bool:
    return head.startswith(_HEAD + bytes([_FMT]))


def _catalogue(log: LogFile) -> tuple[TableInfo, ...]:
    return _index(log.path).tables


def _blocks(log: LogFile, wanted: Wanted) -> Iterator[Block]:
    where = _index(log.path).where
    chosen: dict[int, list[str]] = {}
    for table in wanted:
        chosen.setdefault(where[table][0], []).append(table)
    scan, size, read = _Scan(), max(log.path.stat().st_size, 1), 0
    for piece, places in _pieces(log.path, scan, frozenset(chosen)):
        read += len(piece)
        for kind, starts in places.items():
            rows = _rows(piece, starts, scan.kinds[kind])
            for table in chosen[kind]:
                _, column, value = where[table]
                mine = rows if column is None else rows[rows[column] == value]
                if mine.size:
                    columns = {name: _values(mine, name, scan.kinds[kind]) for name in wanted[table]}
                    yield Block(table, columns, min(read / size, 1.0))


@kept_per_file(4)
def _index(path: Path) -> _Index:
    """Count the messages of each type and instance; kept, since a catalogue is followed by a reading."""
    units: dict[str, str] = {}
    multipliers: dict[str, float] = {}
    described: dict[int, tuple[str, str]] = {}
    counts: dict[int, dict[float, int]] = {}
    scan = _Scan()
    for piece, places in _pieces(path, scan, None):
        for kind, starts in sorted(
            places.items(), key=lambda item: scan.kinds[item[0]].name not in _DESCRIBING_MESSAGES
        ):
            name = scan.kinds[kind].name
            column = _instance(scan.kinds[kind], described.get(kind, ("", ""))[0])
            rows = _rows(piece, starts if column or name in _DESCRIBING_MESSAGES else starts[:0], scan.kinds[kind])
            if name == "UNIT" and _has(rows, "Id", "Label"):
                units |= {chr(int(row["Id"]) & 0xFF): _text(row["Label"]) for row in rows}
            elif name == "MULT" and _has(rows, "Id", "Mult"):
                multipliers |= {chr(int(row["Id"]) & 0xFF): float(f"{row['Mult']:.7g}") for row in rows}
            elif name == "FMTU" and _has(rows, "FmtType", "UnitIds", "MultIds"):
                described |= {int(row["FmtType"]): (_text(row["UnitIds"]), _text(row["MultIds"])) for row in rows}
            values, numbers = np.unique(rows[column], return_counts=True) if column else ([0], [starts.size])
            instances = counts.setdefault(kind, {})
            for value, number in zip(values, numbers, strict=True):
                instances[float(value)] = instances.get(float(value), 0) + int(number)
    notes = (f"{scan.skipped} bytes of the log are no messages and were passed over",) if scan.skipped else ()
    tables, where = [], {}
    for kind, instances in counts.items():
        if scan.kinds[kind].name in ("FMT", *_DESCRIBING_MESSAGES):
            continue
        ids = described.get(kind, ("", ""))
        column = _instance(scan.kinds[kind], ids[0])
        columns = _columns(scan.kinds[kind], ids, units, multipliers)
        if not columns:
            continue
        clocks = tuple(info.name for info in columns if info.name in _CLOCKS)
        for value, number in sorted(instances.items()):
            name = scan.kinds[kind].name + (f"[{value:g}]" if len(instances) > 1 else "")
            if name in where:
                continue
            tables.append(TableInfo(name, columns, clocks, number, notes=notes))
            where[name] = (kind, column if len(instances) > 1 else None, value)
    return _Index(tuple(tables), where)


def _pieces(path: Path, scan: _Scan, kinds: frozenset[int] | None) -> Iterator[tuple[bytes, dict[int, np.ndarray]]]:
    """Divide the log into messages: pieces of it, with the places of the messages of some types in each."""
    lengths = np.zeros(256, np.int64)
    lengths[_FMT] = _FMT_LENGTH
    held, in_step = b"", True
    with path.open("rb") as stream:
        while data := stream.read(_PIECE_BYTES):
            piece = held + data
            places, at, in_step = _divide(piece, lengths, in_step, scan, path)
            held = piece[at:]
            types = np.frombuffer(piece, np.uint8)[places + 2] if places.size else np.empty(0, np.uint8)
            wanted = [kind for kind in np.unique(types).tolist() if kind in scan.kinds and (not kinds or kind in kinds)]
            yield piece, {kind: places[types == kind] for kind in wanted}
    scan.skipped += len(held)


def _divide(piece: bytes, lengths: np.ndarray, in_step: bool, scan: _Scan, path: Path) -> tuple[np.ndarray, int, bool]:
    """Return the places of the messages in a piece, where the first that is not whole begins, and whether that is known.

    Most headers are followed by the next at their message's length, which NumPy finds for all at once; what is left,
    above all new message types, is looked at one by one.
    """
    codes = np.frombuffer(piece, np.uint8)
    heads = np.flatnonzero((codes[:-2] == _HEAD[0]) & (codes[1:-1] == _HEAD[1]))
    ends: np.ndarray | None = None
    parts: list[np.ndarray] = []
    at, end = 0, len(piece)
    while at + 3 <= end:
        length = int(lengths[piece[at + 2]]) if piece.startswith(_HEAD, at) else 0
        if length and not in_step and piece[at + length : at + length + 2] not in (_HEAD, b""):
            # Chance bytes may look like a header; a message is followed by another.
            length = 0
        if not length:
            following = piece.find(_HEAD, at + 1)
            following = following if following >= 0 else end - 1
            scan.skipped += following - at
            at, in_step = following, False
            continue
        if at + length > end:
            break
        in_step = True
        if piece[at + 2] == _FMT:
            _define(piece[at + 3 : at + length], scan, lengths, path)
            ends = None
        elif ends is None:
            # Looked at one by one: types to be learnt, and headers that no header follows in step.
            kinds = codes[heads + 2]
            follows = heads[1:] == heads[:-1] + lengths[kinds[:-1]]
            ends = np.append(np.flatnonzero(~follows | (kinds[:-1] == _FMT)), heads.size - 1)
        first = int(np.searchsorted(heads, at))
        last = int(ends[np.searchsorted(ends, first)]) if ends is not None else first
        parts.append(heads[first : max(last, first + 1)])
        at = int(heads[last]) if last > first else at + length
    return np.concatenate(parts) if parts else np.empty(0, np.int64), at, in_step


def _define(body: bytes, scan: _Scan, lengths: np.ndarray, path: Path) -> None:
    """Learn a message type from its FMT message."""
    kind, length = body[0], body[1]
    name, characters, columns = (_text(part) for part in (body[2:6], body[6:22], body[22:86]))
    names = [part.strip() for part in columns.split(",") if part.strip()]
    layout = None
    if len(names) == len(characters) == len(set(names)) and all(character in _TYPES for character in characters):
        layout = np.dtype([(column, _TYPES[character]) for column, character in zip(names, characters, strict=True)])
        layout = layout if layout.itemsize == length - 3 else None
    definition = _Kind(name, length, layout, dict(zip(names, characters, strict=False)))
    if not re.fullmatch(r"[A-Za-z0-9_]{1,4}", name) or length < 3 or (kind == _FMT and length != _FMT_LENGTH):
        return
    if kind in scan.kinds and scan.kinds[kind] != definition:
        raise InputError(
            f'{path}, table "{name}"',
            found="a message type described twice, differently",
            expected="one log",
            remedy="two logs were joined: divide the file at the start of the second",
        )
    scan.kinds[kind] = definition
    lengths[kind] = length


def _rows(piece: bytes, starts: np.ndarray, kind: _Kind) -> np.ndarray:
    """Return the messages of one type as a structured array, shape (n,)."""
    if kind.layout is None:
        return np.empty(len(starts), np.dtype([]))
    places = starts[:, None] + np.arange(3, kind.length)
    return np.frombuffer(piece, np.uint8)[places].view(kind.layout)[:, 0]


def _values(rows: np.ndarray, column: str, kind: _Kind) -> np.ndarray:
    name, _, element = column.partition("[")
    values = rows[name][:, int(element[:-1])] if element else rows[name]
    values = as_column(np.ascontiguousarray(values))
    divisor = _DIVISORS.get(kind.characters[name])
    return values / divisor if divisor else values


def _columns(
    kind: _Kind, ids: tuple[str, str], units: Mapping[str, str], multipliers: Mapping[str, float]
) -> tuple[ColumnInfo, ...]:
    if kind.layout is None:
        return ()
    columns = []
    for position, (name, character) in enumerate(kind.characters.items()):
        if character in "nNZ":
            continue
        unit = units.get(ids[0][position : position + 1]) or None
        multiplier = multipliers.get(ids[1][position : position + 1], 1.0)
        if unit and character not in _DIVISORS and multiplier in _PREFIXES:
            unit = _PREFIXES[multiplier] + unit
        unit = _CLOCKS.get(name, unit)
        columns += (
            [ColumnInfo(f"{name}[{k}]", unit) for k in range(32)] if character == "a" else [ColumnInfo(name, unit)]
        )
    return tuple(columns)


def _instance(kind: _Kind, unit_ids: str) -> str | None:
    """Return the column that counts instances."""
    names = list(kind.characters)
    position = unit_ids.find("#")
    if kind.layout is None or not 0 <= position < len(names) or kind.characters[names[position]] not in "bBhHiIM":
        return None
    return names[position]


def _has(rows: np.ndarray, *names: str) -> bool:
    return rows.dtype.names is not None and all(name in rows.dtype.names for name in names)


def _text(raw: bytes) -> str:
    return bytes(raw).split(b"\0")[0].decode("latin-1")


FORMAT = LogFormat("an ArduPilot dataflash log", (".bin",), _recognises, _catalogue, _blocks)
