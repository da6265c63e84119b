"""NumPy archives: a table for each clock, of the arrays with as many rows, or one fewer, which then hold between two samples.

Arrays of one or two axes are read, by their name, or name and element such as `velocities[2]`, and instants (`datetime64`) in their unit;
nothing in the file is ever run: arrays of Python objects are passed over. Without a clock the arrays of one number of rows are a table.
"""

import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from seatrial.core.errors import InputError
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
    clocks_among,
)

_NPY = ".npy"
_MAX_HEADER = 10_000
_MAX_ARRAYS = 10_000
_MAX_ARRAY_BYTES = 1 << 29  # Of one array
_MAX_NAMES = 8  # Arrays that are not read, of which the names are told
# Units of `datetime64`
_UNITS = {
    (name, 1): unit for name, unit in {"ns": "ns", "us": "us", "ms": "ms", "s": "s", "m": "min", "h": "h"}.items()
}
_READERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}


class _Array(NamedTuple):
    """An array of the archive that is read: its name, rows, elements of each, and unit of instants."""

    name: str
    rows: int
    elements: int | None
    unit: str | None

    def columns(self) -> list[ColumnInfo]:
        """Its columns."""
        names = [self.name] if self.elements is None else [f"{self.name}[{k}]" for k in range(self.elements)]
        return [ColumnInfo(name, self.unit) for name in names]


def _recognises(path: Path, head: bytes) -> bool:
    return head[:4] == b"PK\x03\x04" and path.name.lower().endswith(".npz")


def _catalogue(log: LogFile) -> tuple[TableInfo, ...]:
    with zipfile.ZipFile(log.path) as archive:
        arrays, notes = _arrays(archive, log)
        tables = _tables(arrays)
    table_infos = []
    for name, arrays in tables.items():
        clocks, infos = clocks_among([column for array in arrays for column in array.columns()])
        first = (name,) if name in clocks else ()
        clocks = first + tuple(clock for clock in clocks if clock != name)
        table_infos.append(TableInfo(name, infos, clocks, max(array.rows for array in arrays), notes=notes))
    return tuple(table_infos)


def _blocks(log: LogFile, wanted: Wanted) -> Iterator[Block]:
    with zipfile.ZipFile(log.path) as archive:
        tables = _tables(_arrays(archive, log)[0])
        for name, columns in wanted.items():
            rows = max(array.rows for array in tables[name])
            loaded = {column: _column(archive, log, column, rows) for column in columns}
            for start in range(0, rows, BLOCK_ROWS):
                stop = min(start + BLOCK_ROWS, rows)
                yield Block(name, {column: values[start:stop] for column, values in loaded.items()}, stop / rows)


def _arrays(archive: zipfile.ZipFile, log: LogFile) -> tuple[list[_Array], tuple[str, ...]]:
    """Arrays of numbers and instants, of one or two axes and two rows or more; and which others there are, for the user."""
    names = [info.filename for info in archive.infolist() if info.filename.endswith(_NPY)]
    readable, others = [], []
    for name in names[:_MAX_ARRAYS]:
        with archive.open(name) as stream:
            shape, kind, _ = _header(stream)
        unit = _UNITS.get(np.datetime_data(kind)) if kind.kind == "M" else None
        elements = None if len(shape) == 1 else shape[-1] if len(shape) == 2 else MAX_ELEMENTS + 1
        if (kind.kind in "biuf" or unit) and shape and shape[0] >= 2 and (elements or 0) <= MAX_ELEMENTS:
            readable.append(_Array(name.removesuffix(_NPY), shape[0], elements, unit))
        else:
            others.append(f"{name.removesuffix(_NPY)} ({kind}, shape {shape})")
    if not readable:
        raise InputError(
            str(log.path),
            found="no array of numbers with two rows or more",
            expected="arrays of one or two axes, of which each row is a sample",
            remedy="save them by np.savez; arrays of Python objects are not read",
        )
    left = f" and {len(others) - _MAX_NAMES} more" if len(others) > _MAX_NAMES else ""
    return readable, (f"arrays that are not read: {', '.join(others[:_MAX_NAMES])}{left}",) if others else ()


def _tables(arrays: list[_Array]) -> dict[str, list[_Array]]:
    """Arrays by the clock they go with; those without one by their number of rows."""
    singles = [array for array in arrays if array.elements is None]
    clocks, _ = clocks_among([column for array in singles for column in array.columns()])
    tables: dict[str, list[_Array]] = {}
    for name in clocks:
        rows = next(array.rows for array in singles if array.name == name)
        tables[name] = [array for array in arrays if array.rows in (rows, rows - 1)]
    used = {array.name for some in tables.values() for array in some}
    for array in arrays:
        if array.name not in used:
            tables.setdefault(f"{array.rows} rows", []).append(array)
    return tables


def _column(archive: zipfile.ZipFile, log: LogFile, column: str, rows: int) -> np.ndarray:
    """One column, NaN in the last row of one that is a row shorter."""
    name, _, element = column.removesuffix("]").partition("[") if column.endswith("]") else (column, "", "")
    info = archive.getinfo(name + _NPY)
    with archive.open(info) as stream:
        shape, kind, by_columns = _header(stream)
        size = int(np.prod(shape, dtype=float)) * kind.itemsize
        if size > min(info.file_size, _MAX_ARRAY_BYTES):
            raise InputError(
                f'{log.path}, array "{name}"',
                found=f"shape {shape}, {size} bytes, of which the file holds {info.file_size}",
                expected=f"an array that the file holds, of at most {_MAX_ARRAY_BYTES >> 20} MB",
                remedy="the file is damaged, or the log is to be cut",
            )
        values = np.frombuffer(stream.read(size), kind).reshape(shape, order="F" if by_columns else "C")
        stream.read()  # to the end, where the checksum is looked at
    values = as_column(values if values.ndim == 1 else values[:, int(element)])
    return values if values.size == rows else np.append(values.astype(float), np.nan)


def _header(stream: Any) -> tuple[tuple[int, ...], np.dtype, bool]:
    """Shape and type of an array, and whether it is kept by columns.

    Raises:
        ValueError: no header of NumPy's format in version 1 or 2.
    """
    version = np.lib.format.read_magic(stream)
    if version not in _READERS:
        raise ValueError(f"version {version} of NumPy's format")
    shape, by_columns, kind = _READERS[version](stream, max_header_size=_MAX_HEADER)
    return shape, kind, by_columns


FORMAT = LogFormat("a NumPy archive", (".npz",), _recognises, _catalogue, _blocks)
