"""Parquet: one table, streamed by row groups; nested columns by dotted path, stamps as whole numbers in their unit."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from seatrial.core.errors import InputError
from seatrial.core.processes import MEMORY
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
    clocks_among,
    optional,
)

TABLE = "rows"
_MOST_BYTES = 1 << 29  # Of one row group's wanted columns: more would not fit in memory when it is opened
# Two weeks at 100 Hz; equal numbers are packed so well that a small file may hold more than memory does
_MOST_ROWS = 1 << 27


def _catalogue(log: LogFile) -> tuple[TableInfo, ...]:
    with _opened(log) as file:
        import pyarrow as arrow

        columns = [ColumnInfo(name, unit) for field in file.schema_arrow for name, unit in _leaves(arrow, field)]
        stamps = tuple(column.name for column in columns if column.unit)
        clocks, columns = clocks_among(columns)
        return (TableInfo(TABLE, columns, tuple(dict.fromkeys((*stamps, *clocks))), file.metadata.num_rows),)


def _blocks(log: LogFile, wanted: Wanted) -> Iterator[Block]:
    names = wanted.get(TABLE, ())
    with _opened(log) as file:
        tops = sorted({_top(name, file.schema_arrow.names) for name in names})
        _check_size(file.metadata, tops, log)
        total, read = max(file.metadata.num_rows, 1), 0
        for batch in file.iter_batches(batch_size=BLOCK_ROWS, columns=tops, use_threads=False):
            read += batch.num_rows
            yield Block(TABLE, {name: _values(batch, name) for name in names}, read / total)


def _opened(log: LogFile) -> Any:
    with optional("parquet", log.path):
        import pyarrow.parquet
    return pyarrow.parquet.ParquetFile(log.path, memory_map=True)


def _leaves(arrow: Any, field: Any, prefix: str = "") -> Iterator[tuple[str, str | None]]:
    """Numeric leaves of a field, with the unit of stamps."""
    kind, name = field.type, prefix + field.name
    if arrow.types.is_struct(kind):
        for position in range(kind.num_fields):
            yield from _leaves(arrow, kind.field(position), f"{name}.")
    elif arrow.types.is_timestamp(kind) or arrow.types.is_duration(kind):
        yield name, kind.unit
    elif arrow.types.is_fixed_size_list(kind) and _is_number(arrow, kind.value_type):
        yield from ((f"{name}[{k}]", None) for k in range(min(kind.list_size, MAX_ELEMENTS)))
    elif _is_number(arrow, kind):
        yield name, None


def _is_number(arrow: Any, kind: Any) -> bool:
    types = arrow.types
    return types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind) or types.is_decimal(kind)


def _top(name: str, tops: list[str]) -> str:
    """Return the column of the file that holds a leaf; its own name may have dots."""
    return max((top for top in tops if name == top or name.startswith((f"{top}.", f"{top}["))), key=len)


def _values(batch: Any, name: str) -> np.ndarray:
    import pyarrow as arrow
    from pyarrow import compute

    top = _top(name, batch.schema.names)
    column, rest = batch.column(batch.schema.names.index(top)), name.removeprefix(top)
    while rest:
        if rest.startswith("["):
            index, _, rest = rest[1:].partition("]")
            column = compute.list_element(column, int(index))
        else:
            part = _top(rest[1:], [field.name for field in column.type])
            column, rest = compute.struct_field(column, column.type.get_field_index(part)), rest[1 + len(part) :]
    missing = column.is_null().to_numpy(zero_copy_only=False)
    if arrow.types.is_timestamp(column.type) or arrow.types.is_duration(column.type):
        column = column.cast(arrow.int64())
    elif arrow.types.is_decimal(column.type) or arrow.types.is_boolean(column.type):
        column = column.cast(arrow.float64())
    values = as_column(column.fill_null(0).to_numpy(zero_copy_only=False))
    return np.where(missing, np.nan, values) if missing.any() else values


def _check_size(metadata: Any, tops: list[str], log: LogFile) -> None:
    """Refuse a table or row groups whose wanted columns would not fit in memory."""
    if metadata.num_rows > _MOST_ROWS:
        raise InputError(
            str(log.path),
            found=f"{metadata.num_rows} rows",
            expected=f"at most {_MOST_ROWS}",
            remedy="cut the log, or write it at a lower rate",
        )
    for group in range(metadata.num_row_groups):
        row_group = metadata.row_group(group)
        chunks = [row_group.column(k) for k in range(row_group.num_columns)]
        size = sum(chunk.total_uncompressed_size for chunk in chunks if chunk.path_in_schema.split(".")[0] in tops)
        if size > _MOST_BYTES:
            raise InputError(
                str(log.path),
                found=f"a row group of {size >> 20} MB",
                expected=f"at most {_MOST_BYTES >> 20} MB of wanted columns in each",
                remedy="write the file with smaller row groups",
            )


FORMAT = LogFormat("a Parquet file", (".parquet", ".pq"), begins_with(b"PAR1"), _catalogue, _blocks, memory=MEMORY)
