"""What a log is and what it becomes: the file with its channel map going in, the table in SI coming out."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Float

from seatrial.core.errors import InputError, nearest
from seatrial.core.record import Channel, Role
from seatrial.core.signals import RATES, SIGNALS, signal_unit
from seatrial.core.units import to_si

Clock = Literal["as_stamped", "even", "drop_repeated"]
WHITESPACE = "whitespace"
_BY_SUFFIX = {".csv": ",", ".tsv": "\t"}


@dataclass(frozen=True)
class ColumnMap:
    """One channel taken from one column: value = scale * cell + offset, in `unit`; then converted to SI.

    Attributes:
        column: name in the header.
        unit: unit of the cells, for example `rpm`.
        role: whether the channel drives the vehicle or observes it.
        scale: plain factor on the cell, for example -1 to flip the sign.
        offset: added after scaling, in `unit`.
    """

    column: str
    unit: str
    role: Role
    scale: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class LogSource:
    """One log file and how to read it.

    Attributes:
        path: CSV or TSV file, gzip-compressed where the name ends in `.gz`.
        time_column: column of the time stamps: plain numbers, whole or decimal.
        time_unit: their unit, for example `ns`.
        channels: one column map for each seatrial signal (`u`, `udot`, `n`, `tau_X`, …).
        clock: `as_stamped` trusts the stamps; `even` rebuilds an evenly spaced clock from arrival times in bursts;
            `drop_repeated` keeps the first row of every repeated stamp.
        delimiter: one character, or `whitespace`; by default the suffix says (.csv comma, .tsv tab).
        skip_rows: lines above the header, or above the data of a file without one.
        header_rows: rows of the header, of which the first names the columns (2 where a row of units follows).
        names: column names of a file without a header.
        encoding: of the text.
    """

    path: Path
    time_column: str
    time_unit: str
    channels: Mapping[str, ColumnMap]
    clock: Clock = "as_stamped"
    delimiter: str | None = None
    skip_rows: int = 0
    header_rows: int = 1
    names: tuple[str, ...] | None = None
    encoding: str = "utf-8"


@dataclass(frozen=True, eq=False)
class LogTable:
    """The mapped columns of one log, in SI, on the log's own stamps.

    Attributes:
        time: seconds since `epoch`, strictly increasing, shape (n,).
        epoch: exact stamp of the first row, s, on the clock of the file.
        columns: for each channel its samples in SI, NaN where the cell was empty, shape (n,).
        channels: name, unit and role of each.
        source: name of the file.
        sha256: hash of its bytes.
        options: how it was read, as JSON-able values.
        notes: what was found and mended, for the user.
    """

    time: Float[np.ndarray, " n"]
    epoch: Decimal
    columns: Mapping[str, Float[np.ndarray, " n"]]
    channels: tuple[Channel, ...]
    source: str
    sha256: str
    options: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def check_source(source: LogSource) -> None:
    """Check all that can be checked without opening the file.

    Raises:
        InputError: no channels, unknown channel, unit, role or clock, scale that is not a number, or a bad layout.
    """
    where = str(source.path)
    if not source.channels:
        raise InputError(
            f"{where}, channels",
            found="an empty map",
            expected="at least one channel",
            remedy='map one, for example u = {column = "speed", unit = "m/s", role = "measurement"}',
        )
    _one_of(source.clock, get_args(Clock), f"{where}, clock")
    time_scale(source)
    separator(source)
    for key, value, least in (("skip_rows", source.skip_rows, 0), ("header_rows", source.header_rows, 1)):
        if not isinstance(value, int) or value < least:
            raise InputError(
                f"{where}, {key}",
                found=repr(value),
                expected=f"a whole number of at least {least}",
                remedy="count the lines above the first row of numbers",
            )
    for name, column in source.channels.items():
        key = f'{where}, channel "{name}"'
        _one_of(name, (*SIGNALS, *(f"{rate}dot" for rate in RATES)), f"{where}, channels")
        _one_of(column.role, get_args(Role), f"{key}, role")
        if not (math.isfinite(column.scale) and math.isfinite(column.offset) and column.scale != 0):
            raise InputError(
                key,
                found=f"scale {column.scale!r}, offset {column.offset!r}",
                expected="finite numbers and a scale that is not zero",
                remedy="correct the map",
            )
        si_factor(source, name)


def si_factor(source: LogSource, name: str) -> float:
    """What one unit of a channel's column is in SI.

    Raises:
        InputError: unknown unit or one of the wrong dimension.
    """
    return to_si(1.0, source.channels[name].unit, signal_unit(name), f'{source.path}, channel "{name}", unit')


def time_scale(source: LogSource) -> Decimal:
    """Seconds in one unit of the time column, exactly: the shortest decimal of the factor, 1E-9 for `ns`.

    Raises:
        InputError: not a unit of time.
    """
    return Decimal(repr(to_si(1.0, source.time_unit, "s", f"{source.path}, time_unit")))


def separator(source: LogSource) -> str:
    """Return what separates the cells: one ASCII character, or `whitespace`.

    Raises:
        InputError: nothing said where the suffix does not tell, or not a single ASCII character.
    """
    suffix = Path(source.path.name.lower().removesuffix(".gz")).suffix
    found = source.delimiter if source.delimiter is not None else _BY_SUFFIX.get(suffix)
    where = f"{source.path}, delimiter"
    if found is None:
        raise InputError(
            where,
            found=f'suffix "{suffix}" and no delimiter',
            expected=".csv, .tsv, or the delimiter",
            remedy=f'say which: ",", ";", "\\t" or "{WHITESPACE}"',
        )
    if found != WHITESPACE and not (
        len(found) == 1
        and found.isascii()
        and (found.isprintable() or found == "\t")
        and not found.isalnum()
        and found not in '".+-'
    ):
        raise InputError(
            where,
            found=repr(found),
            expected=f'one character that no number contains, or "{WHITESPACE}"',
            remedy='use ",", ";", "\\t" or "whitespace"',
        )
    return found


def source_options(source: LogSource) -> dict[str, Any]:
    """How the file is read, as JSON-able values, without the path of this machine."""
    return {
        "source": source.path.name,
        "time_column": source.time_column,
        "time_unit": source.time_unit,
        "clock": source.clock,
        "delimiter": separator(source),
        "skip_rows": source.skip_rows,
        "header_rows": 0 if source.names else source.header_rows,
        "encoding": source.encoding,
        "names": list(source.names) if source.names else None,
        "channels": {
            name: {
                "column": column.column,
                "unit": column.unit,
                "role": column.role,
                "scale": float(column.scale),
                "offset": float(column.offset),
            }
            for name, column in source.channels.items()
        },
    }


def _one_of(value: str, allowed: tuple[str, ...], where: str) -> None:
    if value not in allowed:
        raise InputError(
            where, found=repr(value), expected="one of " + ", ".join(allowed), remedy=nearest(str(value), allowed)
        )
