"""A log read into a record in one call: which column is which signal, and which of them drive the vehicle."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import inf, isclose
from pathlib import Path
from typing import Any, get_args

import numpy as np

from seatrial.core.argument_checks import (
    check_array,
    check_choice,
    check_known,
    check_mapping,
    check_names,
    check_number,
    check_path,
    check_text,
    shown,
)
from seatrial.core.errors import InputError, nearest, not_among
from seatrial.core.record import Channel, Provenance, Record, Role, make_record
from seatrial.core.signals import ANGLES, OVER_EARTH, QUATERNION, RATES, SIGNALS, is_signal, signal_unit
from seatrial.core.units import to_si
from seatrial.logs.axes import Axes
from seatrial.logs.formats.text_layout import nanoseconds
from seatrial.logs.guess import unit_by_name
from seatrial.logs.log_table import SAME_UNIT, read_log_table
from seatrial.logs.measured_control import half_a_step_matters, looks_measured, mean_to_next, taken_as_measured
from seatrial.logs.source import Between, Clock, ColumnMap, LogSource

# What may be said of a log's layout, see `LogSource`
_LAYOUT = ("clock", "delimiter", "skip_rows", "header_rows", "names", "encoding", "table", "axes")


def read_log(
    path: Path | str,
    channels: Mapping[str, tuple[str, str]],
    controls: Sequence[str],
    *,
    time: tuple[str, str] | None = None,
    step: float | None = None,
    start: float | None = None,
    end: float | None = None,
    label: str | None = None,
    between: Mapping[str, Between] | None = None,
    **layout: Any,
) -> Record:
    """Read a log into a record.

    Args:
        path: CSV or TSV, Parquet, NetCDF, MATLAB, NumPy archive, ROS 1 or 2 bag, MCAP, dataflash `.BIN`, MAVLink `.tlog`, PX4 `.ulg` or
            MOOS `.alog`.
        channels: signal to (column, unit), for example `{"u": ("speed", "m/s"), "n": ("prop", "rpm")}`.
        controls: those of the signals that drive the vehicle.
        time: column of the time stamps and their unit; by default the log's own clock.
        step: of a uniform grid, s; by default the union of all stamps.
        start: where to begin, s from the first sample.
        end: where to end, s likewise.
        label: short name; by default the file's.
        between: of controls, "line" for one that was measured while it changed, "held" for a command; see `ColumnMap`. One that is not
            named is taken as measured if it changes at nearly every sample, with a warning, else as a command.
        layout: `clock` ("as_stamped", "even" or "drop_repeated"), `axes` ("NED" or "ENU"), `table` of a log that has several; of text
            `delimiter`, `skip_rows`, `header_rows`, `names` and `encoding`.

    Returns:
        a record in SI whose time starts at 0. Holes, and doubts of clocks and units, are among its `cautions`.

    Raises:
        InputError: a file, column or unit that cannot be used, or a control that is no channel.
    """
    path = check_path(path, "log, path")
    asked = _columns(path, channels, time)
    check_names(controls, f"{path}, controls", "n")
    check_known(layout, _LAYOUT, f"{path}, arguments")
    for name, choices in {"clock": get_args(Clock), "axes": get_args(Axes)}.items():
        check_choice(layout.get(name, choices[0]), choices, f"{path}, {name}")
    for name in ("delimiter", "table", "encoding"):
        if layout.get(name) is not None:
            check_text(layout[name], f"{path}, {name}", "give it as text, or leave it out")
    for name, value in (("start", start), ("end", end), ("step", step)):
        if value is not None:
            check_number(value, name, above=0.0 if name == "step" else -inf, remedy="give it in s")
    check_text(path.stem if label is None else label, "label", "give a short name")
    if unmapped := [name for name in controls if name not in channels]:
        raise InputError(
            f"{path}, controls",
            found=", ".join(unmapped),
            expected="among " + ", ".join(channels),
            remedy="map the control to a column",
        )
    lines = _checked(between, tuple(controls), f"{path}, between")
    roles: dict[str, Role] = {name: "control" if name in controls else "measurement" for name in channels}
    maps = {
        name: ColumnMap(column, unit, roles[name], between=lines.get(name)) for name, (column, unit) in asked.items()
    }
    source = LogSource(path, *(time or (None, None)), maps, **layout)
    made: dict[str, Role] = dict.fromkeys(
        (*RATES, *ANGLES), "measurement"
    )  # of quaternions, and of velocities over the earth
    table, cautions = read_log_table(source), []
    for name in controls:
        column = table.columns[name]
        if name not in lines and half_a_step_matters(column) and looks_measured(table.time, column):
            maps[name] = replace(maps[name], between="line")
            cautions.append(f"{table.place}, {taken_as_measured(name, 'read_log')}")
            warnings.warn(cautions[-1], stacklevel=2)
    if cautions:
        table = read_log_table(replace(source, channels=maps))
        table = replace(table, cautions=(*table.cautions, *cautions))
    from seatrial.logs.join_logs import body_tables, join_logs  # with JAX, which a record from memory does not need

    kept = made | {name: roles[name] for name in channels if name not in (*OVER_EARTH, *QUATERNION)}
    tables = body_tables([table], kept)
    return join_logs(tables, step=step, start=start, end=end, label=path.stem if label is None else label)


def _columns(path: Path, channels: Any, time: Any) -> Mapping[str, tuple[str, str]]:
    """Return the channels, each checked to be a column and its unit, as the time is."""
    example = 'write for example {"u": ("speed", "m/s")}'
    asked = check_mapping(channels, f"{path}, channels", example)
    if not asked:
        raise InputError(f"{path}, channels", found="none", expected="one channel at least", remedy=example)
    for name, pair in asked.items():
        _check_pair(pair, f'{path}, channel "{name}"', example)
    if time is not None:
        _check_pair(time, f"{path}, time", 'write time=("t", "s")')
    return asked


def _checked(between: Mapping[str, Between] | None, controls: Sequence[str], where: str) -> Mapping[str, Between]:
    """Return what is said of controls between their samples."""
    stated = {} if between is None else check_mapping(between, where, 'write for example {"n": "line"}')
    check_known(stated, controls, where)
    for name, choice in stated.items():
        check_choice(choice, get_args(Between), f"{where}, {name}")
    return stated


def _check_pair(pair: Any, where: str, remedy: str) -> None:
    if not (isinstance(pair, tuple | list) and len(pair) == 2 and all(isinstance(part, str) for part in pair)):
        raise InputError(where, found=shown(pair), expected="a column and its unit", remedy=remedy)


# Columns of one's own made into a record: what a control does between its samples is stated, or judged by how it
# changes.


def record_of_columns(
    time: np.ndarray,
    columns: Mapping[str, np.ndarray],
    channels: tuple[Channel, ...],
    provenance: Provenance,
    label: str = "trial",
    *,
    between: Mapping[str, Between] | None = None,
) -> Record:
    """Build a record from columns and check it.

    Args:
        time: seconds, shape (n,).
        columns: one array of shape (n,) for each channel.
        channels: description of the channels; controls and measurements in any order.
        provenance: source, hash and options.
        label: short name.
        between: of controls, "held" for a command, which acts from its sample to the next, or "line" for one that was measured while it
            changed, such as the speed of a propeller: over each step it is the mean of the straight line between its samples. One that is
            not named is taken as measured if it changes at nearly every sample, with a warning, else as a command.

    Returns:
        the record, in SI as the columns are: of n samples, the controls and the measurements each in a table of a column a channel. Its
        provenance has `between` of each control.

    Raises:
        InputError: fewer than three samples, time not strictly increasing, no channel, a name that is no signal, a unit that is not the
            signal's own in SI, a gap in a control, a channel without data, an infinite value, or `between` of no control.
    """
    return _judged(make_record(time, columns, channels, provenance, label), between, "make_record")


def _judged(record: Record, between: Mapping[str, Between] | None, called: str) -> Record:
    """Return a record whose controls do between their samples what is stated, or what their changes show; `called` is for the warning."""
    where = f"{record.provenance.source}, record {record.label!r}"
    stated = _checked(between, record.controls, f"{where}, between")
    chosen, cautions, control = {}, [], record.control.copy()
    for at, name in enumerate(record.controls):
        measured = looks_measured(record.time, control[:, at])
        chosen[name] = stated.get(name) or ("line" if measured else "held")
        if name not in stated and measured and half_a_step_matters(control[:, at]):
            cautions.append(taken_as_measured(name, called))
            warnings.warn(f"{where}, {cautions[-1]}", stacklevel=3)
        if chosen[name] == "line":
            control[:, at] = mean_to_next(control[:, at])
    options = dict(record.provenance.options)
    options |= {"between": chosen} if chosen else {}
    options |= {"cautions": [*options.get("cautions", ()), *cautions]} if cautions else {}
    return replace(record, control=control, provenance=replace(record.provenance, options=options))


def record_of_table(
    table: Any,
    time: str | tuple[str, str] = "t",
    *,
    commanded: Sequence[str] = (),
    between: Mapping[str, Between] | None = None,
    label: str = "trial",
    **channels: tuple[str, str],
) -> Record:
    """Make a record of a table in memory, for example `record(df, time="t", u=("SOG_kn", "kn"), n=("rpm", "rpm"), commanded=["n"])`.

    Args:
        table: data frame of pandas or polars, or arrays by name; a column is an array of shape (n,), with NaN or None if nothing was
            measured.
        time: column of the stamps: dates, ISO 8601 texts, or seconds; (column, unit) for numbers in another unit.
        commanded: those of the signals that drive the vehicle; all others are measured.
        between: of these, "held" for a command, "line" for one that was measured while it changed, as in `make_record`.
        label: short name.
        channels: each signal as (column, unit).

    Returns:
        a record in SI whose time starts at 0.

    Raises:
        InputError: a column that is missing or holds no numbers, a unit of another dimension, a time that does not increase, or as
            `make_record`.
    """
    check_text(label, "label", "give a short name")
    where, names = f"record {label!r}", [str(name) for name in getattr(table, "columns", table)]
    example = 'write for example u=("speed", "m/s")'
    stamps = (time, "s") if isinstance(time, str) else time
    for place, pair in {"time": stamps, **{f'channel "{name}"': pair for name, pair in channels.items()}}.items():
        _check_pair(pair, f"{where}, {place}", 'write time="t", or time=("t", "ms")' if place == "time" else example)
        if pair[0] not in names:
            raise not_among(f"{where}, {place}", pair[0], names, found=f'no column "{pair[0]}"')
    check_known(check_names(commanded, f"{where}, commanded", "n"), tuple(channels), f"{where}, commanded")
    columns, described, cautions = {}, [], []
    for name, (column, unit) in channels.items():
        place = f'{where}, channel "{name}"'
        if not is_signal(name):
            remedy = nearest(name, SIGNALS)
            raise InputError(place, found=f"the name {shown(name)}", expected="the name of a signal", remedy=remedy)
        si = signal_unit(name)
        factor = to_si(1.0, unit, si, f"{place}, unit")
        columns[name] = factor * check_array(table[column], f'{place}, column "{column}"', is_finite=False)
        described.append(Channel(name, si, "control" if name in commanded else "measurement"))
        by_name = unit_by_name(column, name)
        if by_name and not isclose(by_name[1] * to_si(1.0, by_name[0], si, place), factor, rel_tol=SAME_UNIT):
            cautions.append(f'channel "{name}": column "{column}" is given in "{unit}", but by its name "{by_name[0]}"')
            warnings.warn(f"{where}, {cautions[-1]}", stacklevel=2)
    options = {"columns": {name: list(pair) for name, pair in channels.items()}} | (
        {"cautions": cautions} if cautions else {}
    )
    seconds = _seconds(table[stamps[0]], stamps[1], f'{where}, time, column "{stamps[0]}"')
    made = make_record(seconds, columns, tuple(described), Provenance("a table", "", options), label)
    return _judged(made, between, "record")


def _seconds(column: Any, unit: str, where: str) -> np.ndarray:
    """Return the time since the first stamp, s, of dates, of ISO 8601 texts, or of numbers in a unit."""
    cells = np.asarray(column)
    if cells.dtype.kind not in "MOUST":
        stamps = check_array(cells, where, is_finite=False)
        return (stamps - stamps[:1]) * to_si(1.0, unit, "s", f"{where}, unit")
    instants, missing = nanoseconds([str(cell).rstrip() for cell in cells.astype(str).ravel()])
    if missing.any():
        at = int(np.argmax(missing))
        raise InputError(
            f"{where}, row {at + 1}",
            found=shown(str(cells.ravel()[at])),
            expected="a date and time of one zone, such as 2026-05-01T10:00:00.5Z",
            remedy="correct it, or drop the row",
        )
    return (instants - instants[0]) / 1e9
