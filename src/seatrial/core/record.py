"""A record: one cleaned trial, with named channels in SI, gaps as NaN and the account of where it came from."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Float

from seatrial.core.argument_checks import check_array, check_each_of, check_kind, check_mapping, check_text, shown
from seatrial.core.errors import InputError, nearest, too_few
from seatrial.core.result_table import text_html
from seatrial.core.signals import FORCE, MOMENT, POSITIONS, QUATERNION, SIGNALS, TRACKS, is_signal, signal_unit
from seatrial.core.units import to_si

Role = Literal["control", "measurement"]
_SI = {str(FORCE): "N", str(MOMENT): "N m"}
MAX_MAGNITUDE = 1e9  # SI, from which a number is no measurement of a vehicle


@dataclass(frozen=True)
class Channel:
    """One column of a record.

    Attributes:
        name: of the signal: `u`, `udot`, `n`, …
        unit: that of the signal in SI: m/s, rad/s for `n`, `r` and their like, rad, N, …
        role: `control` if it drives the vehicle, `measurement` if it observes it.
    """

    name: str
    unit: str
    role: Role


CONFIGURATION = r"^\w[\w .+-]{0,39}$"  # Name of a configuration of the vehicle
SIMULATED = "simulated"  # Source of a record that no log holds


@dataclass(frozen=True)
class Provenance:
    """Where a record came from.

    Attributes:
        source: names of the files, or another word for it.
        sha256: of the bytes of each file; empty if there is none.
        options: of the import, JSON-able.
    """

    source: str
    sha256: str
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Record:
    """One cleaned trial. Build it with `make_record`, which checks it.

    Attributes:
        time: seconds, strictly increasing, shape (n,).
        control: constant from each sample to the next, SI, shape (n, n_controls), no gaps.
        measurement: of the sensors, SI, NaN without a measurement, shape (n, n_measured).
        channels: the controls, then the measurements, in column order.
        provenance: source, hash and options.
        label: short name, for messages and tables.
        configuration: of the vehicle in this trial, such as `loaded`, see `in_configuration`; empty if there is only one.
    """

    time: Float[np.ndarray, " n"]
    control: Float[np.ndarray, "n n_controls"]
    measurement: Float[np.ndarray, "n n_measured"]
    channels: tuple[Channel, ...]
    provenance: Provenance
    label: str = "trial"
    configuration: str = ""

    def __repr__(self):
        lines = [f'Record "{self.label}": {self.time.size} samples over {self.time[-1] - self.time[0]:.6g} s']
        lines += [f'configuration "{self.configuration}"'] if self.configuration else []
        for word, role in (("controls", "control"), ("measured", "measurement")):
            named = [f"{one.name} [{_SI.get(one.unit, one.unit)}]" for one in self.channels if one.role == role]
            lines += [f"{word} {', '.join(named)}"] if named else []
        if count := len(self.cautions):
            lines.append(f"{count} caution{'s' if count > 1 else ''}: read record.cautions")
        return "; ".join(lines)

    _repr_html_ = text_html

    @property
    def cautions(self) -> tuple[str, ...]:
        """Cautions about its numbers: gaps, clocks and units of its log."""
        return tuple(self.provenance.options.get("cautions", ()))

    @property
    def controls(self) -> tuple[str, ...]:
        """Names of the control channels."""
        return tuple(channel.name for channel in self.channels if channel.role == "control")

    @property
    def measured(self) -> tuple[str, ...]:
        """Names of the measurement channels."""
        return tuple(channel.name for channel in self.channels if channel.role == "measurement")

    @property
    def step(self) -> Float[np.ndarray, " n"]:
        """Time from each sample to the next, s; the last is a repetition of the one before."""
        step = np.diff(self.time)
        return np.append(step, step[-1])

    def in_configuration(self, name: str) -> "Record":
        """Return the record as one of a configuration of the vehicle, such as `loaded`; all records with this name have its values.

        Raises:
            InputError: a name with other characters than letters, digits, spaces and `_ . + -`.
        """
        if not isinstance(name, str) or not re.fullmatch(CONFIGURATION, name):
            where, expected = f'record "{self.label}", configuration', "at most 40 letters, digits, spaces and _ . + -"
            raise InputError(where, found=shown(name), expected=expected, remedy='write for example "loaded"')
        return replace(self, configuration=name)

    def channel(self, name: str) -> Float[np.ndarray, " n"]:
        """Return the samples of one channel, SI, shape (n,), NaN without a measurement.

        Args:
            name: of a control or a measured channel.

        Raises:
            InputError: no channel of that name.
        """
        check_kind(name, str, f'record "{self.label}"', 'ask for a channel by its name, for example "u"')
        if name in self.controls:
            return self.control[:, self.controls.index(name)]
        if name in self.measured:
            return self.measurement[:, self.measured.index(name)]
        raise InputError(
            f'record "{self.label}"',
            found=f'no channel "{name}"',
            expected="one of " + ", ".join(self.controls + self.measured),
            remedy="map the channel when importing, or drop the terms that need it",
        )


def make_record(
    time: np.ndarray,
    columns: Mapping[str, np.ndarray],
    channels: tuple[Channel, ...],
    provenance: Provenance,
    label: str = "trial",
) -> Record:
    """Build a record from columns and check it; each control is held from its sample to the next, see `seatrial.make_record` for others.

    Args:
        time: seconds, shape (n,).
        columns: one array of shape (n,) for each channel.
        channels: description of the channels; controls and measurements in any order.
        provenance: source, hash and options.
        label: short name.

    Returns:
        the record, in SI as the columns are: of n samples, the controls and the measurements each in a table of a column a channel.

    Raises:
        InputError: fewer than three samples, time not strictly increasing, no channel, a name that is no signal, a unit that is not the
            signal's own in SI, a gap in a control, a channel without data, or an infinite value.
    """
    check_kind(provenance, Provenance, "provenance", 'write for example Provenance("own numbers", "")')
    check_text(label, "label", "give a short name")
    where = f"{provenance.source}, record {label!r}"
    time = check_array(time, f"{where}, time", least=0, is_finite=False)
    channels = check_each_of(channels, Channel, f"{where}, channels", 'write Channel("u", "m/s", "measurement")')
    check_mapping(columns, f"{where}, columns", 'write for example {"u": speeds}')
    check_time(time, where)
    controls = tuple(channel for channel in channels if channel.role == "control")
    measured = tuple(channel for channel in channels if channel.role == "measurement")
    _check_map(channels, columns, where)
    arrays = {
        name: check_array(columns[name], f'{where}, channel "{name}"', is_finite=False)
        for name in (channel.name for channel in channels)
    }
    for channel in channels:
        _check_column(arrays[channel.name], channel, time, where)

    def stack(group: tuple[Channel, ...]) -> np.ndarray:
        return np.column_stack([arrays[channel.name] for channel in group]) if group else np.empty((time.size, 0))

    return Record(time, stack(controls), stack(measured), controls + measured, provenance, label)


def check_time(time: np.ndarray, where: str, first_row: int = 1) -> None:
    """Check that time is finite and strictly increasing.

    Args:
        time: stamps, s.
        where: file or record, for the error.
        first_row: row number of the first stamp as the user counts them.

    Raises:
        InputError: naming the first offending row and how many there are.
    """
    if time.size < 3:
        raise too_few(where, f"{time.size} samples", 3, "check the file, the time range and the channel map")
    if not np.isfinite(time).all():
        row = int(np.argmin(np.isfinite(time)))
        raise InputError(
            f"{where}, row {first_row + row}",
            found=f"time {time[row]}",
            expected="a finite number of seconds",
            remedy="remove the row or correct the clock",
        )
    step = np.diff(time)
    if (step <= 0).any():
        row = int(np.argmax(step <= 0))
        kind = "the same time stamp as the row before" if step[row] == 0 else "time running backwards"
        raise InputError(
            f"{where}, row {first_row + row + 1}",
            found=f"{kind} ({float(time[row])!r} s, then {float(time[row + 1])!r} s); {int((step <= 0).sum())} such rows",
            expected="strictly increasing time",
            remedy='if stamps only repeat, clock = "even" or "drop_repeated" corrects them. If time runs back, split the run there, sort '
            "its rows, or use another time column",
        )


def _check_map(channels: tuple[Channel, ...], columns: Mapping[str, np.ndarray], where: str) -> None:
    if not channels:
        raise InputError(
            f"{where}, channels",
            found="none",
            expected="one channel at least",
            remedy='write (Channel("u", "m/s", "measurement"),)',
        )
    names = [channel.name for channel in channels]
    for channel in channels:
        here = f'{where}, channel "{channel.name}"'
        _check_signal(channel, here)
        if channel.name not in columns:
            raise InputError(
                here, found="no such column", expected="one of " + ", ".join(columns), remedy="correct the channel map"
            )
        if names.count(channel.name) > 1:
            raise InputError(
                here, found="the name twice", expected="each channel once", remedy="drop or rename one of them"
            )
        if channel.role not in get_args(Role):
            raise InputError(
                here, found=f"role {channel.role!r}", expected=" or ".join(get_args(Role)), remedy="correct the role"
            )


def _check_signal(channel: Channel, where: str) -> None:
    """Refuse a name that is no signal, and a unit in which its numbers would not be those of SI."""
    name, known = channel.name, (*SIGNALS, *POSITIONS, *TRACKS)
    if not isinstance(name, str) or not is_signal(name):
        description = f"the name {shown(name)}"
        raise InputError(where, found=description, expected="the name of a signal", remedy=nearest(name, known))
    unit = _SI.get(signal_unit(name), signal_unit(name))
    place = f"{where}, unit"
    factor = to_si(1.0, check_text(channel.unit, place, f'write "{unit}"'), unit, place)
    if factor != 1.0:
        raise InputError(
            place,
            found=f'"{channel.unit}"',
            expected=f'"{unit}", its unit in SI',
            remedy=f'multiply the column by {factor:.7g}, and write "{unit}"',
        )


def _check_column(values: np.ndarray, channel: Channel, time: np.ndarray, where: str) -> None:
    where = f'{where}, channel "{channel.name}"'
    if values.shape != time.shape:
        raise InputError(
            where,
            found=f"shape {values.shape}",
            expected=f"shape {time.shape}, one value per time stamp",
            remedy="align the channel with the time axis",
        )
    if np.isinf(values).any():
        row = int(np.argmax(np.isinf(values)))
        raise InputError(
            f"{where}, sample {row + 1}",
            found=f"{values[row]} at t = {time[row]:g} s",
            expected="a finite number, or NaN without a measurement",
            remedy="correct the value, or replace it by NaN",
        )
    finite = np.isfinite(values)
    if not finite.any():
        raise InputError(
            where, found="no finite value", expected="measurements", remedy="map another column, or drop the channel"
        )
    if channel.role == "control" and not finite.all():
        row = int(np.argmin(finite))
        raise InputError(
            f"{where}, sample {row + 1}",
            found=f"a gap at t = {time[row]:g} s",
            expected="a control at every sample",
            remedy="cut the record to the stretch with this control",
        )
    _check_garbage(values[finite], channel, where)


def _check_garbage(values: np.ndarray, channel: Channel, where: str) -> None:
    """Refuse a measurement that never moves, or whose values no instrument of SI units gives (1e-155 m/s)."""
    if channel.name in QUATERNION:
        return  # of a body that turns about one axis two parts are 0
    if channel.role == "measurement" and values.size > 1 and np.ptp(values) == 0:
        raise InputError(
            where,
            found=f"{float(values[0])!r} in every sample",
            expected="a measurement that varies",
            remedy="map another column, or drop the channel",
        )
    size = np.max(np.abs(values))
    if size > 0 and not 1e-6 < size < MAX_MAGNITUDE and channel.role == "measurement":
        raise InputError(
            where,
            found=f"values of at most {size:.1e} {channel.unit}",
            expected="magnitudes a vehicle can have",
            remedy="the column has invalid values or the unit is wrong: map another column or correct the unit",
        )
