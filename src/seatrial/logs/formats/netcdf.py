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
    MAX_ELEMENTS,
    TIME_UNITS,
    Block,
    ColumnInfo,
    LogFile,
    LogFormat,
    TableInfo,
    Wanted,
    as_column,
    blocks_of,
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
    rows: int
    elements: int | None
    data: Any
    attributes: dict[str, Any]


def _recognises(path: Path, head: bytes) -> bool:
    if head[:4] in _CLASSIC:
        return True
    return head.startswith(b"\x89HDF\r\n\x1a\n") and not path.name.lower().endswith(".mat")


def _catalogue(log: LogFile) -> tuple[TableInfo, ...]:
    with _opened(log) as variables:
        return tuple(_table(name, members) for name, members in _tables(variables).items())


def _blocks(log: LogFile, wanted: Wanted) -> Iterator[Block]:
    with _opened(log) as variables:
        tables = {
            name: {one.name: one for one in members} for name, members in _tables(variables).items() if name in wanted
        }
        rows = {name: next(iter(members.values())).rows for name, members in tables.items()}
        yield from blocks_of(rows, wanted, lambda table, column, *ends: _values(tables[table], column, *ends))


@contextmanager
def _opened(log: LogFile) -> Iterator[list[_Variable]]:
    with log.path.open("rb") as stream:
        classic = stream.read(4) in _CLASSIC
    if classic:
        from scipy.io import netcdf_file

        file = netcdf_file(log.path, "r", mmap=True, maskandscale=False)
        try:
            variables = [_classic(name, variable) for name, variable in file.variables.items()]
            yield [variable for variable in variables if variable is not None]
        finally:
            with warnings.catch_warnings():
                # It stays mapped while a view of it lives, which it says; the views go with this function.
                warnings.simplefilter("ignore", RuntimeWarning)
                file.close()
    else:
        from seatrial.logs.formats.hdf5 import arrays, opened

        with opened(log.path) as file:
            variables = [_modern(path, dataset) for path, dataset in arrays(file)]
            yield [variable for variable in variables if variable is not None]


def _classic(name: str, variable: Any) -> _Variable | None:
    shape, dimensions = variable.data.shape, variable.dimensions
    if (
        variable.data.dtype.kind not in "iuf"
        or len(shape) not in (1, 2)
        or (len(shape) == 2 and shape[1] > MAX_ELEMENTS)
    ):
        return None
    attributes = dict(variable._attributes)
    return _Variable(name, dimensions[0], shape[0], shape[1] if len(shape) == 2 else None, variable.data, attributes)


def _modern(path: str, dataset: Any) -> _Variable | None:
    shape = dataset.shape
    if len(shape) not in (1, 2) or (len(shape) == 2 and shape[1] > MAX_ELEMENTS):
        return None
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
    own = name if is_scale else f"{shape[0]} rows"
    dimension = Path(scales[0].name).name if len(scales) and not is_scale else own
    dimension = f"{group}/{dimension}" if group else dimension
    return _Variable(name, dimension, shape[0], shape[1] if len(shape) == 2 else None, dataset, attributes)


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
        names = (
            [variable.name]
            if variable.elements is None
            else [f"{variable.name}[{k}]" for k in range(variable.elements)]
        )
        columns += [ColumnInfo(column, unit) for column in names]
        clocks += [(variable.name != name.rpartition("/")[2], variable.name)] if is_clock else []
    return TableInfo(name, tuple(columns), tuple(clock for _, clock in sorted(clocks)), variables[0].rows)


def _unit(variable: _Variable) -> tuple[str | None, bool]:
    """Return the unit as the file states it, and whether the variable may be time; "seconds since …" is a unit of time."""
    stated = _text(variable.attributes.get("units"))
    since = _SINCE.fullmatch(stated) if stated else None
    unit = since[1] if since else stated
    unit = _SPELLING.get(unit or "", unit)
    if variable.elements is None and since and unit in TIME_UNITS:
        return unit, True
    clock = clock_unit(variable.name, unit) if variable.elements is None else None
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
