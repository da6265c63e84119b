"""A trial as it is commanded: controls over time, each value held from sample to sample, and the table in which people read and write it.

The table has a row where a control bends. Between two rows it is a straight line, of which every sample takes its value; two rows of one
time are a jump. The header names each column and its unit: `time_s,n_rpm,delta_r_deg`. Lines that begin with # are remarks.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from seatrial.core.argument_checks import check_array, check_mapping
from seatrial.core.display_units import shown_unit
from seatrial.core.errors import InputError, nearest
from seatrial.core.files import depend_on
from seatrial.core.result_table import text_html
from seatrial.core.signals import signal_unit
from seatrial.core.units import to_si
from seatrial.manoeuvres.manoeuvre import Limits, Manoeuvre

MAX_SAMPLES = 200_000  # Samples of one trial
MAX_BYTES = 1 << 26
# In place of a unit: the command of a thruster by its law of thrust, which is written for the operator and not read
# back.
COMMAND = "command"
_BEND = 1e-9  # Change of slope, as a share of the largest value, below which a line is straight
_JUMP = 1e-9  # Time that a jump takes, s
_ROUNDING_SHARE = 1e-6  # Share of a limit by which the digits of a table may lie beyond it


@dataclass(frozen=True, eq=False)
class Schedule:
    """Controls over time.

    Attributes:
        time: sample times, s, rising from 0, shape (n,).
        controls: by name, constant from each sample to the next, SI, each of shape (n,).

    Raises:
        InputError: fewer than two samples, times that do not rise from 0, or a control of another length or with gaps.
    """

    time: Float[np.ndarray, " n"]
    controls: Mapping[str, Float[np.ndarray, " n"]]

    def __post_init__(self) -> None:
        """Refuse what cannot be commanded, and take lists for arrays."""
        time = check_array(self.time, "schedule, time")
        if time.size < 2 or time[0] != 0 or (np.diff(time) <= 0).any():
            raise InputError(
                "schedule, time",
                found=f"{time.size} sample{'s' * (time.size != 1)} from {time[0]:g} s to {time[-1]:g} s"
                + ", not rising throughout" * bool((np.diff(time) <= 0).any()),
                expected="two or more times that rise from 0 s",
                remedy="count the time from the beginning of the trial, and sort the samples",
            )
        given = check_mapping(self.controls, "schedule, controls", 'write for example {"n": speeds}')
        checked = {name: check_array(x, f"schedule, control {name}", size=time.size) for name, x in given.items()}
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "controls", checked)

    def __repr__(self) -> str:
        """Print its length, and between which values each control lies."""
        lines = [f"Schedule: {self.time.size} samples over {self.time[-1]:.6g} s"]
        for name, values in self.controls.items():
            factor, unit = shown_unit(name)
            lines.append(f"{name} from {values.min() * factor:.4g} to {values.max() * factor:.4g} {unit}")
        return "; ".join(lines)

    _repr_html_ = text_html

    def columns(self, trim: Sequence[tuple[str, float]]) -> dict[str, Float[np.ndarray, " n"]]:
        """Return every control of a vehicle, SI, in its order; those outside the schedule stay at trim."""
        return {name: self.controls.get(name, np.full(self.time.size, value)) for name, value in trim}

    def bends(self) -> "ScheduleRows":
        """Return the rows between which every control is a straight line through its samples."""
        bent = np.zeros(max(self.time.size - 2, 0), bool)
        for values in self.controls.values():
            bent |= np.abs(np.diff(values, n=2)) > _BEND * max(1.0, float(np.abs(values).max()))
        at = np.flatnonzero(np.concatenate([[True], bent, [True]]))
        return ScheduleRows("", tuple(map(int, at)), self.time[at], {name: x[at] for name, x in self.controls.items()})


class ScheduleRows(NamedTuple):
    """A schedule as its table has it.

    Attributes:
        source: name of the file, for errors.
        line: of each row in it, from 1.
        time: s, shape (r,).
        controls: SI, each of shape (r,).
    """

    source: str
    line: tuple[int, ...]
    time: Float[np.ndarray, " r"]
    controls: Mapping[str, Float[np.ndarray, " r"]]

    def schedule(self, sample_time: float) -> Schedule:
        """Return the controls at every sample from the first row to the last.

        Raises:
            InputError: fewer than three samples, or too many.
        """
        last = float(self.time[-1])
        if not 2 <= last / sample_time + 1e-6 < MAX_SAMPLES:
            raise InputError(
                f"{self.source}:{self.line[-1]}",
                found=f"a schedule that ends after {last:g} s",
                expected=f"3 to {MAX_SAMPLES} samples of {sample_time:g} s",
                remedy="correct the times, or `sample_time` of [design]",
            )
        time = np.arange(int(last / sample_time + 1e-6) + 1) * sample_time
        # The second of two rows of one time holds from that time on.
        knots = np.where(np.append(np.diff(self.time) == 0, False), self.time - _JUMP, self.time)
        knots[1:] -= 0.5 * _JUMP * (np.diff(self.time) == 0)
        return Schedule(time, {name: np.interp(time, knots, x) for name, x in self.controls.items()})

    def skipped(self, schedule: Schedule) -> tuple[int, ...]:
        """Return the lines of the rows that lie between the samples of a schedule and are not what these make of them."""
        jumps = np.diff(self.time) == 0
        beside = np.append(jumps, False) | np.append(False, jumps)
        lost = np.zeros(self.time.size, bool)
        for name, values in self.controls.items():
            taken = np.interp(self.time, schedule.time, schedule.controls[name])
            lost |= np.abs(taken - values) > 1e-6 * max(1.0, float(np.abs(values).max()))
        return tuple(line for line, out in zip(self.line, lost & ~beside, strict=True) if out)

    def _jumps(self, after: float, until: float) -> Float[np.ndarray, " j"]:
        """Return the times of two rows at once, behind one time and up to another, s."""
        twice = self.time[1:][np.diff(self.time) == 0]
        return twice[(twice > after + 1e-9) & (twice <= until + 1e-9)]

    def check_limits(self, control: str, limits: Limits, schedule: Schedule) -> None:
        """Check one control of a schedule of these rows against its limits, at every sample.

        Args:
            control: name; one that is not in the table keeps its limits.
            limits: of it.
            schedule: that the rows make.

        Raises:
            InputError: the first row that leads beyond one.
        """
        if control not in self.controls:
            return
        values, step = schedule.controls[control], float(schedule.time[1])
        factor, unit = shown_unit(control)
        # Decimals of a file are rounded: that alone breaks no limit.
        lower, upper, rate = limits.lower, limits.upper, limits.rate
        broken = Limits(
            None if lower is None else lower - _ROUNDING_SHARE * max(1.0, abs(lower)),
            None if upper is None else upper + _ROUNDING_SHARE * max(1.0, abs(upper)),
            None if rate is None else rate * (1.0 + _ROUNDING_SHARE),
        ).excess(values, step)
        for name, course, ends in (
            ("lower", values, unit),
            ("upper", values, unit),
            ("rate", np.abs(np.diff(values)) / step, f"{unit}/s"),
        ):
            if name not in broken:
                continue
            reached, bound = broken[name][0], getattr(limits, name)
            at = int(np.argmax(np.isclose(course, reached, rtol=1e-9, atol=0.0)))
            time = float(schedule.time[at])
            if name == "rate" and (jumps := self._jumps(time, time + step)).size:
                time = float(jumps[0])
            row = int(np.searchsorted(self.time, time + 1e-9, side="right")) - 1
            raise InputError(
                f"{self.source}:{self.line[row]}",
                found=f"{control} that reaches {reached * factor:.6g} {ends} at {time:.6g} s",
                expected=f"within the {name} limit of {bound * factor:.6g} {ends}, [limits.{control}]",
                remedy="correct the schedule, or widen the limit if the vehicle allows it"
                if name != "rate"
                else "reach the next value in more time, or widen the limit if the vehicle allows it",
            )


def schedule_of(manoeuvre: Manoeuvre, sample_time: float) -> Schedule:
    """Return the schedule of a manoeuvre: the control that it drives, and those that move with it."""
    time, control = manoeuvre.sample(sample_time)
    return Schedule(time, {manoeuvre.control: control, **{name: x(time) for name, x in manoeuvre.others.items()}})


def table_text(
    time: Sequence[float],
    controls: Mapping[str, Sequence[float]],
    commands: Mapping[str, Sequence[float]] = {},
) -> str:
    """Return a table by its rows, in the units in which people read them.

    Args:
        time: s.
        controls: by name, SI.
        commands: of the thrusters among them, in the unit of their laws of thrust, NaN if no command makes a thrust: such a control
            has no column of them, and a remark at the end says why.
    """
    shown = [(name, *shown_unit(name), values) for name, values in controls.items()]
    short = {name: np.flatnonzero(np.isnan(values)) for name, values in commands.items()}
    shown += [(name, 1.0, COMMAND, values) for name, values in commands.items() if not short[name].size]
    head = ",".join(["time_s", *(f"{name}_{unit}" for name, _, unit, _ in shown)])
    rows = (
        ",".join([f"{t:.10g}", *(f"{values[i] * factor:.10g}" for _, factor, _, values in shown)])
        for i, t in enumerate(time)
    )
    remarks = (
        f"# {name}: no {COMMAND} column, because no command makes {controls[name][at[0]]:.4g} N by its law of thrust"
        for name, at in short.items()
        if at.size
    )
    return "\n".join([head, *rows, *remarks]) + "\n"


def read_rows(path: Path, controls: Sequence[str]) -> ScheduleRows:
    """Read a table.

    Args:
        path: CSV file.
        controls: those of the vehicle; the table has one of them at least.

    Raises:
        InputError: no such file, a header without the time or a control, a unit of another kind, a row without a number in each column,
            or times that do not rise from 0.
    """
    lines = [(i, text.strip()) for i, text in enumerate(_text(path).splitlines(), 1)]
    lines = [(i, text) for i, text in lines if text and not text.startswith("#")]
    if len(lines) < 3:
        raise InputError(
            str(path),
            found=f"{max(len(lines) - 1, 0)} row{'s' * (len(lines) != 2)} below a header",
            expected="a header and two rows at least",
            remedy=f"begin with {_example(controls)}, then a row for each time at which a control bends",
        )
    columns = _header(f"{path}:{lines[0][0]}", [cell.strip() for cell in lines[0][1].split(",")], controls)
    cells = np.array([_row(f"{path}:{i}", text.split(","), len(columns)) for i, text in lines[1:]])
    values = {
        name: cells[:, at] * factor
        for at, (name, factor) in enumerate(columns.items())
        if not name.endswith(f"_{COMMAND}")
    }
    rows = ScheduleRows(str(path), tuple(i for i, _ in lines[1:]), values.pop("time"), values)
    _check_times(rows)
    return rows


def _text(path: Path) -> str:
    depend_on(path)
    if not path.is_file():
        raise InputError(
            str(path),
            found="a folder" if path.is_dir() else "no such file",
            expected="a schedule as CSV",
            remedy="check the path",
        )
    if (size := path.stat().st_size) > MAX_BYTES:
        raise InputError(
            str(path),
            found=f"{size / 2**20:.0f} MB",
            expected=f"a schedule of at most {MAX_BYTES >> 20} MB",
            remedy="check the path: a row is needed only if a control bends",
        )
    content = path.read_bytes()
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as cause:
        raise InputError(
            f"{path}:{content[: cause.start].count(10) + 1}",
            found=f"the byte 0x{content[cause.start]:02x}, which is not UTF-8",
            expected="text",
            remedy="save the schedule as CSV in UTF-8",
        ) from cause


def _example(controls: Sequence[str]) -> str:
    return ",".join(["time_s", *(f"{name}_{shown_unit(name)[1]}" for name in controls)])


def _header(where: str, cells: Sequence[str], controls: Sequence[str]) -> dict[str, float]:
    """Name of each column, and the factor of its unit to SI."""
    if len(cells) == 1 and set(cells[0]) & set(";\t"):
        raise InputError(
            where,
            found=f'"{cells[0][:80]}"',
            expected=_example(controls),
            remedy="separate the columns by commas, and give decimals a point",
        )
    factors: dict[str, float] = {}
    known = {"time": "s"} | {name: signal_unit(name) for name in controls}
    for cell in cells:
        # Of tau_X_N and n_1_rpm the longest name that is known is meant.
        name = max((one for one in known if cell == one or cell.startswith(f"{one}_")), key=len, default="")
        if not name or (name if cell != f"{name}_{COMMAND}" else cell) in factors:
            meant = nearest(cell.rpartition("_")[0] or cell, known)
            raise InputError(
                where,
                found=f'column "{cell[:80]}"' + (f", a second one of {name}" if name else ""),
                expected=f"the time and controls of the vehicle, each with its unit: {_example(controls)}",
                remedy="leave the second one out" if name else f"rename it, or leave it out: {meant}",
            )
        if cell == f"{name}_{COMMAND}":
            factors[cell] = 1.0
            continue
        if not (unit := cell[len(name) + 1 :]):
            raise InputError(
                where,
                found=f'column "{cell}" without a unit',
                expected=f"for example {name}_{'s' if name == 'time' else shown_unit(name)[1]}",
                remedy="write the unit behind the name",
            )
        factors[name] = to_si(1.0, unit, known[name], f'{where}, column "{cell}"')
    if "time" not in factors or not set(factors) & set(controls):
        raise InputError(
            where,
            found="no time" if "time" not in factors else "no control",
            expected=_example(controls),
            remedy="name the columns in the first line" if "time" not in factors else "add a control of the vehicle",
        )
    return factors


def _row(where: str, cells: Sequence[str], columns: int) -> list[float]:
    if len(cells) != columns:
        raise InputError(
            where,
            found=f"{len(cells)} cell{'s' * (len(cells) != 1)}",
            expected=f"{columns}, one for each column of the header",
            remedy="give every control in every row",
        )
    values = []
    for cell in cells:
        try:
            value = float(cell)
        except ValueError:
            value = float("nan")
        if not isfinite(value):
            raise InputError(
                where,
                found=f'"{cell.strip()[:80]}"',
                expected="a finite number in every cell",
                remedy="give every control in every row, with a decimal point",
            )
        values.append(value)
    return values


def _check_times(rows: ScheduleRows) -> None:
    time, steps = rows.time, np.diff(rows.time)
    late = np.flatnonzero((steps < 0) | (np.append(1.0, steps[:-1]) == 0) & (steps == 0))
    if time[0] != 0 or late.size:
        at = int(late[0]) + 1 if time[0] == 0 else 0
        raise InputError(
            f"{rows.source}:{rows.line[at]}",
            found=f"the time {time[at]:.10g} s" + (f" after {time[at - 1]:.10g} s" if at else " in the first row"),
            expected="times that rise; two may be equal if a control jumps" if at else "a first row at 0 s",
            remedy="sort the rows, and delete repeated ones"
            if at
            else "count the times from the beginning of the trial",
        )
