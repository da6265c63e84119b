"""MOOS logs (.alog): a table for each variable, its numbers as `value`, those of KEY=VALUE strings as columns.

A line is `time variable source value`, the time in seconds since LOGSTART; lines that begin with % are remarks. Source:
MOOS-IvP, "pLogger" and "The ALog Toolbox".
"""

import re
from array import array
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import BinaryIO

import numpy as np

from seatrial.core.files import kept_per_file
from seatrial.logs.formats.protocol import (
    BLOCK_ROWS,
    LOG_TIME,
    Block,
    ColumnInfo,
    LogFile,
    LogFormat,
    TableInfo,
    Wanted,
)

VALUE = "value"
_MAX_LINE_BYTES = 1 << 20
_MAX_KEYS = 256
_MAX_VARIABLES = 20_000
_NUMBER = re.compile(rb"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,4})?|[-+]?(?:nan|inf)", re.IGNORECASE)
_PAIR = re.compile(rb"\s*([A-Za-z_]\w{0,63})\s*=\s*([^,]*?)\s*(?:,|$)")
_NAN = float("nan")


def _recognises(path: Path, head: bytes) -> bool:
    return head.startswith(b"%%") and (
        b"LOG FILE" in head or b"LOGSTART" in head or path.name.lower().endswith(".alog")
    )


def _catalogue(log: LogFile) -> tuple[TableInfo, ...]:
    return _index(log.path)


def _blocks(log: LogFile, wanted: Wanted) -> Iterator[Block]:
    waiting = {table: {column: array("d") for column in columns} for table, columns in wanted.items() if columns}
    size = max(log.path.stat().st_size, 1)
    for time, table, value, done in _lines(log.path, Counter()):
        numbers = _numbers(value) if table in waiting else {}
        if not numbers:
            continue
        for column, cells in waiting[table].items():
            cells.append(time if column == LOG_TIME else numbers.get(column, _NAN))
        if len(waiting[table][wanted[table][0]]) == BLOCK_ROWS:
            yield _block(table, waiting[table], min(done / size, 1.0))
    yield from (_block(table, columns, 1.0) for table, columns in waiting.items() if any(columns.values()))


def _block(table: str, columns: Mapping[str, array], done: float) -> Block:
    """Hand on what has come together, and empty it."""
    block = Block(table, {name: np.array(cells) for name, cells in columns.items()}, done)
    for cells in columns.values():
        del cells[:]
    return block


@kept_per_file(4)
def _index(path: Path) -> tuple[TableInfo, ...]:
    """List the variables; kept, since a catalogue is followed by a reading."""
    rows: Counter[str] = Counter()
    keys: dict[str, dict[str, None]] = {}
    skipped: Counter[str] = Counter()
    for _, name, value, _ in _lines(path, skipped):
        numbers = _numbers(value)
        if not numbers or (name not in rows and len(rows) >= _MAX_VARIABLES):
            continue
        rows[name] += 1
        seen = keys.setdefault(name, {})
        if len(seen) < _MAX_KEYS:
            seen.update(dict.fromkeys(numbers))
    notes = (
        (f"{skipped['odd']} lines are no `time variable source value` and were passed over",) if skipped["odd"] else ()
    )
    notes += ("the last line is cut off and was left out",) if skipped["cut"] else ()
    columns = {name: (ColumnInfo(LOG_TIME, "s"), *map(ColumnInfo, keys[name])) for name in rows}
    return tuple(TableInfo(name, columns[name], (LOG_TIME,), count, notes=notes) for name, count in rows.items())


def _lines(path: Path, skipped: Counter[str]) -> Iterator[tuple[float, str, bytes, int]]:
    """Yield the time, variable, value and place of each line, and count those that cannot be used."""
    with path.open("rb") as stream:
        for line in _whole_lines(stream, skipped):
            if line.startswith(b"%") or line.isspace():
                continue
            parts = line.split(None, 3)
            if len(parts) < 4 or not _NUMBER.fullmatch(parts[0]):
                skipped["odd"] += 1
                continue
            yield float(parts[0]), parts[1].decode("latin-1"), parts[3].strip(), stream.tell()


def _whole_lines(stream: BinaryIO, skipped: Counter[str]) -> Iterator[bytes]:
    """Yield the lines, but those that do not end or go on for a megabyte."""
    while line := stream.readline(_MAX_LINE_BYTES):
        if line.endswith(b"\n"):
            yield line
            continue
        rest = line
        while rest and not rest.endswith(b"\n"):
            rest = stream.readline(_MAX_LINE_BYTES)
        skipped["odd" if rest else "cut"] += 1


def _numbers(value: bytes) -> Mapping[str, float]:
    """Return the numbers of a value: itself, or those of its KEY=VALUE pairs."""
    if _NUMBER.fullmatch(value):
        return {VALUE: float(value)}
    if b"=" not in value:
        return {}
    return {key.decode(): float(text) for key, text in _PAIR.findall(value) if _NUMBER.fullmatch(text)}


FORMAT = LogFormat("a MOOS log", (".alog",), _recognises, _catalogue, _blocks)
