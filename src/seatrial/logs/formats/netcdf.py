"""NetCDF, 4 and classic: a table for each group and dimension, with its variables, units, scale and missing values."""

import re
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from seatrial.core.processes import MEMORY
from seatrial.logs.formats.protocol import (
    BLOCK_ROWS,
    MAX_ELEMENTS,
    TIME_UNITS,
    Block,
    ColumnInfo,
    LogFile,
    LogFormat,
    TableInfo,
    Wanted,
    as_column,
    clock_unit,
)

_CLASSIC = (b"CDF\x01", b"CDF\x02")
_SINCE = re.compile(r"\s*(\w+)\s+since\s+.*", re.S)
_SPELLING = {
    "nanoseconds": "ns",
    "microseconds": "us",
    "milliseconds": "ms",
    "seconds": "s",
    "second": "s",
    "sec": "s",
    "minutes": "min",
    "hours": "h",
}


@dataclass(frozen=True)
class _Variable:
    """One variable: `data[rows]` or `data[rows, elements]`."""

    name: str
    dimension: str
    data: Any
    attributes: dict[str, Any]

    @property
    def rows(self) -> int:
        return self.data.shape[0]

    @property
    def columns(self) -> list[str]:
        if len(self.data.shape) == 1:
            return [self.name]
        return [f"{self.name}[{k}]" for k in range(self.data.shape[1])]


def _recognises(path: Path, head: bytes) -> bool:
    if head[:4] in _CLASSIC:
        return True
    return head.startswith(b"\x89HDF\r\n\x1a\n") and not path.name.lower().endswith(".mat")


def _catalogue(log: LogFile) -> tuple[TableInfo, ...]:
    with _opened(log) as variables:
        return tuple(_table(name, members) for name, members in _tables(variables).items())


def _blocks(log: LogFile, wanted: Wanted) -> Iterator[Block]:
    with _opened(log) as variables:
        tables = {name: members for name, members in _tables(variables).items() if name in wanted}
        total, read = max(sum(members[0].rows for members in tables.values()), 1), 0
        for name, members in tables.items():
            rows = members[0].rows
            by_name = {variable.name: variable for variable in members}
            for start in range(0, rows, BLOCK_ROWS):
                stop = min(start + BLOCK_ROWS, rows)
                read += stop - start
                columns = {column: _values(by_name, column, start, stop) for column in wanted[name]}
                yield Block(name, columns, read / total)


@contextmanager
def _opened(log: LogFile) -> Iterator[list[_Variable]]:
    with log.path.open("rb") as stream:
        classic = stream.read(4) in _CLASSIC
    if classic:
        from scipy.io import netcdf_file

        file = netcdf_file(log.path, "r", mmap=True, maskandscale=False)
        try:
            yield [
                _Variable(name, variable.dimensions[0], variable.data, dict(variable._attributes))
                for name, variable in file.variables.items()
                if variable.data.dtype.kind in "iuf" and _is_listed(variable.data.shape)
            ]
        finally:
            with warnings.catch_warnings():
                # It stays mapped while a view of it lives, which it says; the views go with this function.
                warnings.simplefilter("ignore", RuntimeWarning)
                file.close()
    else:
        from seatrial.logs.formats.hdf5 import arrays, opened

        with opened(log.path) as file:
            variables = [_modern(path, dataset) for path, dataset in arrays(file) if _is_listed(dataset.shape)]
            yield [variable for variable in variables if variable is not None]


def _is_listed(shape: tuple[int, ...]) -> bool:
    return len(shape) == 1 or (len(shape) == 2 and shape[1] <= MAX_ELEMENTS)


def _modern(path: str, dataset: Any) -> _Variable | None:
    group, _, name = path.rpartition("/")
    attributes = {
        key: dataset.attrs[key]
        for key in ("units", "scale_factor", "add_offset", "_FillValue", "missing_value", "NAME", "CLASS")
        if key in dataset.attrs
    }
    if str(_text(attributes.get("NAME"))).startswith("This is a netCDF dimension but not a netCDF variable"):
        return None
    scales = dataset.dims[0]
    is_scale = attributes.get("CLASS") == b"DIMENSION_SCALE"
    own = name if is_scale else f"{dataset.shape[0]} rows"
    dimension = Path(scales[0].name).name if len(scales) and not is_scale else own
    dimension = f"{group}/{dimension}" if group else dimension
    return _Variable(name, dimension, dataset, attributes)


def _tables(variables: Sequence[_Variable]) -> dict[str, list[_Variable]]:
    """Return the variables by their first dimension; of one length each, since a damaged file may say otherwise."""
    tables: dict[str, list[_Variable]] = {}
    for variable in variables:
        tables.setdefault(variable.dimension, []).append(variable)
    return {
        name: [variable for variable in members if variable.rows == members[0].rows]
        for name, members in tables.items()
        if members[0].rows > 1
    }


def _table(name: str, variables: Sequence[_Variable]) -> TableInfo:
    columns, clocks = [], []
    for variable in variables:
        unit, is_clock = _unit(variable)
        columns += [ColumnInfo(column, unit) for column in variable.columns]
        clocks += [(variable.name != name.rpartition("/")[2], variable.name)] if is_clock else []
    return TableInfo(name, tuple(columns), tuple(clock for _, clock in sorted(clocks)), variables[0].rows)


def _unit(variable: _Variable) -> tuple[str | None, bool]:
    """Return the unit as the file states it, and whether the variable may be time; "seconds since …" is a unit of time."""
    stated = _text(variable.attributes.get("units"))
    since = _SINCE.fullmatch(stated) if stated else None
    unit = since[1] if since else stated
    unit = _SPELLING.get(unit or "", unit)
    if variable.columns != [variable.name]:
        return unit, False
    if since and unit in TIME_UNITS:
        return unit, True
    clock = clock_unit(variable.name, unit)
    return unit or clock, clock is not None


def _values(variables: dict[str, _Variable], column: str, start: int, stop: int) -> np.ndarray:
    name, _, element = column.partition("[")
    variable = variables[column] if column in variables else variables[name]
    data = variable.data[start:stop] if column in variables else variable.data[start:stop, int(element[:-1])]
    raw = np.asarray(data)
    values = as_column(raw)
    missing = np.zeros(values.shape, bool)
    for key in ("_FillValue", "missing_value"):
        if key in variable.attributes:
            missing |= raw == np.ravel(variable.attributes[key])[0]
    if missing.any():
        values = np.where(missing, np.nan, values)
    scale, offset = (
        float(np.ravel(variable.attributes.get(key, default))[0])
        for key, default in (("scale_factor", 1.0), ("add_offset", 0.0))
    )
    return values if (scale, offset) == (1.0, 0.0) else scale * values + offset


def _text(value: Any) -> str | None:
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.ravel()[0]
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace").strip("\0 ")
    return value.strip() if isinstance(value, str) else None


FORMAT = LogFormat("a NetCDF file", (".nc", ".nc4", ".cdf", ".netcdf"), _recognises, _catalogue, _blocks, memory=MEMORY)
