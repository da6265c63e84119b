"""MOOS logs (.alog): a table for each variable, its numbers as `value`, those of KEY=VALUE strings as columns.

A line is `time variable source value`, the time in seconds since LOGSTART; lines that begin with % are remarks. Source:
MOOS-IvP, "pLogger" and "The ALog Toolbox".
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from seatrial.logs.formats.protocol import (
    BLOCK_ROWS,
    LOG_TIME,
    Block,
    ColumnInfo,
    Columns,
    LogFile,
    LogFormat,
    TableInfo,
    Wanted,
    kept_index,
)

VALUE = "value"
_MAX_LINE_BYTES = 1 << 20
_MAX_KEYS = 256
_MAX_VARIABLES = 20_000
_NUMBER = re.compile(rb"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,4})?|[-+]?(?:nan|inf)", re.IGNORECASE)
_PAIR = re.compile(rb"\s*([A-Za-z_]\w{0,63})\s*=\s*([^,]*?)\s*(?:,|$)")
_NAN = float("nan")


@dataclass
class _Skipped:
    """Lines that could not be used."""

    odd: int = 0
    cut: int = 0


def _recognises(path: Path, head: bytes) -> bool:
    return head.startswith(b"%%") and (
        b"LOG FILE" in head or b"LOGSTART" in head or path.name.lower().endswith(".alog")
    )


def _catalogue(log: LogFile) -> tuple[TableInfo, ...]:
    return _index(log)


def _blocks(log: LogFile, wanted: Wanted) -> Iterator[Block]:
    tables = {name.encode("latin-1"): Columns(name, dict.fromkeys(columns, "d")) for name, columns in wanted.items()}
    keys = {
        name.encode("latin-1"): [(column, column.encode()) for column in columns] for name, columns in wanted.items()
    }
    size = max(log.path.stat().st_size, 1)
    for time, name, value, done in _lines(log.path, _Skipped()):
        table = tables.get(name)
        if table is None:
            continue
        numbers = _numbers(value)
        if not numbers:
            continue
        for column, key in keys[name]:
            table.buffers[column].append(time if column == LOG_TIME else numbers.get(key, _NAN))
        if table.rows >= BLOCK_ROWS:
            yield table.block(min(done / size, 1.0))
    for table in tables.values():
        if table.rows:
            yield table.block(1.0)


@kept_index
def _index(path: Path) -> tuple[TableInfo, ...]:
    """List the variables."""
    rows: dict[bytes, int] = {}
    keys: dict[bytes, dict[bytes, None]] = {}
    skipped = _Skipped()
    for _, name, value, _ in _lines(path, skipped):
        numbers = _numbers(value)
        if not numbers or (name not in rows and len(rows) >= _MAX_VARIABLES):
            continue
        rows[name] = rows.get(name, 0) + 1
        seen = keys.setdefault(name, {})
        if len(seen) < _MAX_KEYS:
            seen.update(dict.fromkeys(numbers))
    notes = (f"{skipped.odd} lines are no `time variable source value` and were passed over",) if skipped.odd else ()
    notes += ("the last line is cut off and was left out",) if skipped.cut else ()
    return tuple(
        TableInfo(
            name.decode("latin-1"),
            (ColumnInfo(LOG_TIME, "s"), *(ColumnInfo(key.decode()) for key in keys[name])),
            (LOG_TIME,),
            count,
            notes=notes,
        )
        for name, count in rows.items()
    )


def _lines(path: Path, skipped: _Skipped) -> Iterator[tuple[float, bytes, bytes, int]]:
    """Yield the time, variable, value and place of each line."""
    with path.open("rb") as stream:
        for line in _whole_lines(stream, skipped):
            if line.startswith(b"%") or line.isspace():
                continue
            parts = line.split(None, 3)
            if len(parts) < 4 or not _NUMBER.fullmatch(parts[0]):
                skipped.odd += 1
                continue
            yield float(parts[0]), parts[1], parts[3].strip(), stream.tell()


def _whole_lines(stream: BinaryIO, skipped: _Skipped) -> Iterator[bytes]:
    """Yield the lines, but those that do not end or go on for a megabyte."""
    while line := stream.readline(_MAX_LINE_BYTES):
        if line.endswith(b"\n"):
            yield line
            continue
        rest = line
        while rest and not rest.endswith(b"\n"):
            rest = stream.readline(_MAX_LINE_BYTES)
        if rest:
            skipped.odd += 1
        else:
            skipped.cut = 1


def _numbers(value: bytes) -> Mapping[bytes, float]:
    """Return the numbers of a value: itself, or those of its KEY=VALUE pairs."""
    if _NUMBER.fullmatch(value):
        return {VALUE.encode(): float(value)}
    if b"=" not in value:
        return {}
    return {key: float(text) for key, text in _PAIR.findall(value) if _NUMBER.fullmatch(text)}


FORMAT = LogFormat("a MOOS log", (".alog",), _recognises, _catalogue, _blocks)
