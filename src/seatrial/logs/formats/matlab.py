"""MATLAB files: vectors of one length below a variable are a table, their dotted paths its columns.

Versions 4 to 7 are loaded by SciPy, whole variables at a time, in a process of bounded memory; 7.3 is HDF5, read in parts. Objects and
functions are passed over.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
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

_HDF5 = b"\x89HDF\r\n\x1a\n"
WORKSPACE = "workspace"  # The table of vectors that are variables of their own


class _Array(NamedTuple):
    """A numeric array of the file: its dotted path, and its shape in MATLAB's order."""

    path: str
    shape: tuple[int, ...]


@dataclass(frozen=True)
class _Column:
    """Where a column lies: an array, the axis of its rows, and the element along the other."""

    path: str
    axis: int
    element: int | None


_RowsOf = Callable[[_Column, int, int], np.ndarray]
"""Gives some rows of a column."""


def _recognises(path: Path, head: bytes) -> bool:
    if head.startswith((b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file")):
        return True
    return path.name.lower().endswith(".mat") and (head.startswith(_HDF5) or _has_version(head))


def _has_version(head: bytes) -> bool:
    """Return whether SciPy finds a version in the first bytes, whatever the first line says."""
    from scipy.io.matlab import MatReadError, matfile_version

    try:
        return len(head) >= 20 and matfile_version(BytesIO(head)) is not None
    except (MatReadError, ValueError, IndexError):
        return False


def _catalogue(log: LogFile) -> tuple[TableInfo, ...]:
    with _opened(log) as (shapes, _):
        tables = _tables(shapes)
    if not tables:
        raise InputError(
            str(log.path),
            found="no numeric vector of two rows or more",
            expected="vectors, or structs of vectors",
            remedy="objects such as timeseries or tables cannot be read: save their parts as plain vectors, "
            "for example s.Time = ts.Time; s.Data = ts.Data",
        )
    table_infos = []
    for name, (rows, columns) in tables.items():
        clocks, infos = clocks_among([ColumnInfo(column) for column in columns])
        table_infos.append(TableInfo(name, infos, clocks, rows))
    return tuple(table_infos)


def _blocks(log: LogFile, wanted: Wanted) -> Iterator[Block]:
    with _opened(log) as (shapes, rows_of):
        tables = {name: table for name, table in _tables(shapes).items() if name in wanted}
        total, read = max(sum(rows for rows, _ in tables.values()), 1), 0
        for name, (rows, columns) in tables.items():
            for start in range(0, rows, BLOCK_ROWS):
                stop = min(start + BLOCK_ROWS, rows)
                read += stop - start
                values = {column: as_column(rows_of(columns[column], start, stop)) for column in wanted[name]}
                yield Block(name, values, read / total)


@contextmanager
def _opened(log: LogFile) -> Iterator[tuple[list[_Array], _RowsOf]]:
    """Return the shapes of the arrays, and what gives rows of a column."""
    with log.path.open("rb") as stream:
        is_hdf5 = stream.read(8).startswith((b"MATLAB 7", _HDF5))
    if not is_hdf5:
        # The real numeric arrays of a file of version 4 to 7, by dotted path.
        from scipy.io import loadmat

        variables = loadmat(log.path, mat_dtype=True)
        loaded = dict(
            array for name, value in variables.items() if not name.startswith("__") for array in _numeric(name, value)
        )
        yield (
            [_Array(path, array.shape) for path, array in loaded.items()],
            lambda column, start, stop: _rows(loaded[column.path], start, stop, column.axis, column.element),
        )
        return
    from seatrial.logs.formats.hdf5 import arrays, opened

    with opened(log.path) as file:
        datasets = {
            path.replace("/", "."): dataset
            for path, dataset in arrays(file)
            if "MATLAB_empty" not in dataset.attrs and dataset.attrs.get("MATLAB_class") not in (b"char", b"cell")
        }
        # MATLAB keeps columns together, HDF5 rows: the axes come in reverse.
        yield (
            [_Array(path, tuple(reversed(dataset.shape))) for path, dataset in datasets.items()],
            lambda column, start, stop: _rows(
                dataset := datasets[column.path], start, stop, dataset.ndim - 1 - column.axis, column.element
            ),
        )


def _rows(array: Any, start: int, stop: int, axis: int, element: int | None) -> np.ndarray:
    """Return some rows of an array of HDF5 or NumPy, of whose axes one or two may be longer than one, and `axis` counts the rows."""
    index: list[Any] = [0] * array.ndim
    index[axis] = slice(start, stop)
    if element is not None:
        other = next(k for k in range(array.ndim) if k != axis and array.shape[k] > 1)
        index[other] = element
    return np.asarray(array[tuple(index)])


def _numeric(path: str, value: Any) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the numeric arrays of a variable, those within single structs by their fields; objects are arrays of kinds of their own."""
    if type(value) is not np.ndarray:
        return
    if value.dtype.names is not None and value.size == 1:
        for field in value.dtype.names:
            yield from _numeric(f"{path}.{field}", value[field].item())
    elif value.dtype.kind in "biuf":
        yield path, value


def _tables(arrays: Sequence[_Array]) -> Mapping[str, tuple[int, dict[str, _Column]]]:
    """Return the rows and columns of each table: arrays of one length below one variable."""
    lengths: dict[str, set[int]] = {}
    for array in arrays:
        long = [size for size in array.shape if size > 1]
        if len(long) == 1:
            lengths.setdefault(array.path.rpartition(".")[0], set()).add(long[0])
    groups: dict[tuple[str, int], dict[str, _Column]] = {}
    for array in arrays:
        parent = array.path.rpartition(".")[0]
        top = array.path.split(".")[0] if "." in array.path else ""
        for name, column, rows in _columns(array, lengths.get(parent, set())):
            groups.setdefault((top, rows), {})[name] = column
    tables: dict[str, tuple[int, dict[str, _Column]]] = {}
    for (top, rows), columns in groups.items():
        prefix = _common([name.rpartition(".")[0] for name in columns]) if top else ""
        name = prefix or top or WORKSPACE
        if name in tables:
            name = f"{name} of {rows}"
        cut = len(prefix) + 1 if prefix else 0
        tables[name] = (rows, {column[cut:]: at for column, at in columns.items()})
    return tables


def _columns(array: _Array, lengths: set[int]) -> Iterator[tuple[str, _Column, int]]:
    """Yield the columns of a vector, or of a matrix whose rows are told by the vectors beside it, else by its longer side."""
    long = [axis for axis, size in enumerate(array.shape) if size > 1]
    if len(long) == 1:
        yield array.path, _Column(array.path, long[0], None), array.shape[long[0]]
    elif len(long) == 2:
        first, second = (array.shape[axis] for axis in long)
        across = (second in lengths and first not in lengths) or (second > first and first not in lengths)
        axis, other = (long[1], long[0]) if across else (long[0], long[1])
        if array.shape[other] <= MAX_ELEMENTS:
            for k in range(array.shape[other]):
                yield f"{array.path}[{k}]", _Column(array.path, axis, k), array.shape[axis]


def _common(paths: Sequence[str]) -> str:
    """Return the longest dotted path that begins all paths."""
    split = [path.split(".") for path in paths]
    shared = []
    for parts in zip(*split, strict=False):
        if len(set(parts)) > 1:
            break
        shared.append(parts[0])
    return ".".join(shared)


FORMAT = LogFormat("a MATLAB file", (".mat",), _recognises, _catalogue, _blocks, memory=2 << 30)
