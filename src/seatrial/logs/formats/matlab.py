"""MATLAB files: vectors of one length below a variable are a table, their dotted paths its columns.

Versions 4 to 7 are walked by `matlab_arrays`; 7.3 is HDF5. Nothing but numeric arrays is ever built: no objects, no
functions.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from seatrial.core.errors import InputError
from seatrial.logs.formats.matlab_arrays import matlab_arrays, version_4_order
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
    clocks_among,
)

WORKSPACE = "workspace"
"""The table of vectors that are variables of their own."""


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
    is_mat = path.name.lower().endswith(".mat")
    return is_mat and (head.startswith(b"\x89HDF\r\n\x1a\n") or _is_version_4(head) or _is_version_5(head))


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
    found = []
    for name, (rows, columns) in tables.items():
        clocks, infos = clocks_among([ColumnInfo(column) for column in columns])
        found.append(TableInfo(name, infos, clocks, rows))
    return tuple(found)


def _blocks(log: LogFile, wanted: Wanted) -> Iterator[Block]:
    with _opened(log) as (shapes, load):
        tables = {name: table for name, table in _tables(shapes).items() if name in wanted}
        rows_of = load({tables[name][1][column].path for name in tables for column in wanted[name]})
        total, read = max(sum(rows for rows, _ in tables.values()), 1), 0
        for name, (rows, columns) in tables.items():
            for start in range(0, rows, BLOCK_ROWS):
                stop = min(start + BLOCK_ROWS, rows)
                read += stop - start
                found = {column: as_column(rows_of(columns[column], start, stop)) for column in wanted[name]}
                yield Block(name, found, read / total)


@contextmanager
def _opened(log: LogFile) -> Iterator[tuple[list[_Array], Callable[[set[str]], _RowsOf]]]:
    """Shapes of the arrays, and what makes some of them ready to give rows of a column."""
    with log.path.open("rb") as stream:
        is_hdf5 = stream.read(8).startswith((b"MATLAB 7", b"\x89HDF"))
    if not is_hdf5:
        yield (
            [_Array(path, shape) for path, shape, _ in matlab_arrays(log.path)],
            lambda paths: _walked(log.path, paths),
        )
        return

    from seatrial.logs.formats.hdf5 import arrays, opened, rows_of

    with opened(log.path) as file:
        datasets = {
            path.replace("/", "."): dataset
            for path, dataset in arrays(file)
            if "MATLAB_empty" not in dataset.attrs and dataset.attrs.get("MATLAB_class") not in (b"char", b"cell")
        }

        def rows(column: _Column, start: int, stop: int) -> np.ndarray:
            # MATLAB keeps columns together, HDF5 rows: the axes come in reverse.
            dataset = datasets[column.path]
            return rows_of(dataset, start, stop, dataset.ndim - 1 - column.axis, column.element)

        yield [_Array(path, tuple(reversed(dataset.shape))) for path, dataset in datasets.items()], lambda paths: rows


def _walked(path: Path, paths: set[str]) -> _RowsOf:
    """Read arrays of a file of version 4 to 7."""
    kept = {array.path: array.values for array in matlab_arrays(path, frozenset(paths)) if array.values is not None}

    def rows(column: _Column, start: int, stop: int) -> np.ndarray:
        array = kept[column.path]
        index: list[Any] = [0] * array.ndim
        index[column.axis] = slice(start, stop)
        if column.element is not None:
            index[next(k for k in range(array.ndim) if k != column.axis and array.shape[k] > 1)] = column.element
        return array[tuple(index)]

    return rows


def _tables(arrays: Sequence[_Array]) -> Mapping[str, tuple[int, dict[str, _Column]]]:
    """Rows and columns of each table: arrays of one length below one variable."""
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
    """Columns of a vector, or of a matrix whose rows are told by the vectors beside it, else by its longer side."""
    long = [axis for axis, size in enumerate(array.shape) if size > 1]
    if len(long) == 1:
        yield array.path, _Column(array.path, long[0], None), array.shape[long[0]]
    elif len(long) == 2:
        first, second = (array.shape[axis] for axis in long)
        across = (second in lengths and first not in lengths) or (second > first and first not in lengths)
        axis, other = (long[1], long[0]) if across else (long[0], long[1])
        if array.shape[other] <= MOST_ELEMENTS:
            for k in range(array.shape[other]):
                yield f"{array.path}[{k}]", _Column(array.path, axis, k), array.shape[axis]


def _common(paths: Sequence[str]) -> str:
    """Longest dotted path that begins all paths."""
    split = [path.split(".") for path in paths]
    shared = []
    for parts in zip(*split, strict=False):
        if len(set(parts)) > 1:
            break
        shared.append(parts[0])
    return ".".join(shared)


def _is_version_4(head: bytes) -> bool:
    return version_4_order(head) is not None


def _is_version_5(head: bytes) -> bool:
    """Whether it is MATLAB's version 5 in spite of another first line."""
    return head[126:128] in (b"IM", b"MI") and 1 in (head[124], head[125])


FORMAT = LogFormat("a MATLAB file", (".mat",), _recognises, _catalogue, _blocks, is_fragile=True)
