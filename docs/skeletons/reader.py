"""Skeleton of a reader: copy to `src/seatrial/logs/formats/`, add it to `FORMATS`, and a writer to tests/logs/log_writers.py.

This one reads lines such as `t=0.25 surge=1.5 rpm=900`, first of them `#pairs`. A format keeps nothing: its numbers leave in blocks of
a few thousand rows. Whatever it raises on a damaged log becomes an error for the user.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from seatrial.logs.formats.protocol import Block, ColumnInfo, LogFile, LogFormat, TableInfo, Wanted, in_blocks

TABLE, CLOCK = "pairs", "t"
_NAN = float("nan")


def _recognises(path: Path, head: bytes) -> bool:
    """Whether the first bytes can only be of this format."""
    return head.startswith(b"#pairs\n")


def _catalogue(log: LogFile) -> tuple[TableInfo, ...]:
    """Tables, columns with the units that the log states, and which of them may be the time."""
    names = dict.fromkeys(name for pairs in _lines(log) for name in pairs)
    columns = tuple(ColumnInfo(name, "s" if name == CLOCK else None) for name in names)
    return (TableInfo(TABLE, columns, (CLOCK,)),) if CLOCK in names else ()


def _blocks(log: LogFile, wanted: Wanted) -> Iterator[Block]:
    """The wanted columns as a stream; NaN where a value is missing."""

    def block(table: str, rows: list[dict[str, float]], done: float) -> Block:
        return Block(table, {name: np.array([pairs.get(name, _NAN) for pairs in rows]) for name in wanted[table]}, done)

    return in_blocks(((TABLE, pairs, 0.5) for pairs in _lines(log)), block)


def _lines(log: LogFile) -> Iterator[dict[str, float]]:
    with log.path.open(encoding="utf-8") as stream:
        next(stream)
        for line in stream:
            yield {name: float(value) for name, _, value in (pair.partition("=") for pair in line.split())}


FORMAT = LogFormat("a log of pairs", (".pairs",), _recognises, _catalogue, _blocks)
