"""PX4's logs (.ulg), read by pyulog: a table for each topic, and for each instance of one that several publish.

Arrays and nested topics are columns such as `speed[0].x`. Source: PX4, "ULog File Format" of the developers' guide.
"""

import io
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import redirect_stdout
from typing import Any

from seatrial.logs.formats.protocol import (
    BLOCK_ROWS,
    MAX_ELEMENTS,
    Block,
    ColumnInfo,
    LogFile,
    LogFormat,
    TableInfo,
    Wanted,
    as_column,
    begins_with,
    optional,
)

_MAGIC = b"ULog\x01\x12\x35"
_MEMORY = 2 << 30
_MESSAGE_HEAD, _MAX_ROW_BYTES = 3, 1 << 16
_CLOCKS = {"timestamp_sample": "us", "timestamp": "us"}


class _Stream(io.BufferedReader):
    """A log that knows whether its reader came to the end: pyulog stops silently at a message that is shorter than its fields."""

    is_whole = False

    def read(self, size: int | None = -1, /) -> bytes:
        """Read bytes; a whole log ends where the head of a message would begin."""
        data = super().read(size)
        self.is_whole = size == _MESSAGE_HEAD and not data
        return data


def _catalogue(log: LogFile) -> tuple[TableInfo, ...]:
    tables, is_whole = _read(log)
    notes = () if is_whole else ("the log is damaged or was cut off: unreadable messages were passed over",)
    infos = []
    for name, parts in sorted(tables.items()):
        columns = tuple(
            ColumnInfo(one.field_name, _CLOCKS.get(one.field_name))
            for one in parts[0].field_data
            if one.type_str != "char" and _is_listed(one.field_name)
        )
        clocks = tuple(column.name for column in columns if column.unit)
        infos.append(TableInfo(name, columns, clocks, sum(map(_rows, parts)), notes=notes))
    return tuple(infos)


def _blocks(log: LogFile, wanted: Wanted) -> Iterator[Block]:
    tables, _ = _read(log, [table.partition("[")[0] for table in wanted])
    total, done = sum(_rows(part) for table in wanted for part in tables[table]), 0
    for table, columns in wanted.items():
        for part in tables[table]:
            for start in range(0, _rows(part), BLOCK_ROWS):
                rows = slice(start, min(start + BLOCK_ROWS, _rows(part)))
                done += rows.stop - start
                yield Block(table, {name: as_column(part.data[name][rows]) for name in columns}, done / total)


def _read(log: LogFile, topics: Sequence[str] | None = None) -> tuple[dict[str, list[Any]], bool]:
    """Return the data of each table in the order of the log, and whether all of the log was read.

    Args:
        log: where.
        topics: names of those to read; all of them if there are none.
    """
    with optional("px4", log.path):
        import pyulog

    class Topic(pyulog.ULog._MessageAddLogged):
        def __init__(self, *announcement: Any):
            super().__init__(*announcement)
            # Rows may hold the padding at their end, but pyulog 1.3 does not count it and would pass these rows over.
            self.max_data_size = _MAX_ROW_BYTES

        def _parse_nested_type(self, prefix_str: str, type_name: str, message_formats: Any) -> None:
            # Arrays of arrays in a damaged definition would be listed for minutes; pyulog takes this error for damage.
            if len(self.field_data) > _MAX_ROW_BYTES:
                raise ValueError("a topic of too many fields")
            super()._parse_nested_type(prefix_str, type_name, message_formats)

    class Reader(pyulog.ULog):
        _MessageAddLogged = Topic

    stream = _Stream(io.FileIO(log.path))
    # pyulog prints its warnings, which would stand among the answer of a command.
    with stream, redirect_stdout(io.StringIO()):
        content = Reader(stream, topics)
    # A topic that is announced twice has two parts, and pyulog lists the later one first.
    parts = content.data_list[::-1]
    instances = Counter(name for name, _ in {(part.name, part.multi_id) for part in parts})
    tables: dict[str, list[Any]] = {}
    for part in parts:
        name = f"{part.name}[{part.multi_id}]" if instances[part.name] > 1 else part.name
        tables.setdefault(name, []).append(part)
    return tables, stream.is_whole and not content.file_corruption


def _rows(part: Any) -> int:
    return len(part.data[part.field_data[0].field_name])


def _is_listed(name: str) -> bool:
    """Return whether a catalogue lists a field: no padding, and no element far along an array."""
    last = name.rpartition(".")[2]
    element = last.rpartition("[")[2].rstrip("]") if last.endswith("]") else "0"
    return not last.startswith("_padding") and int(element) < MAX_ELEMENTS


FORMAT = LogFormat("a PX4 log", (".ulg",), begins_with(_MAGIC), _catalogue, _blocks, memory=_MEMORY)
