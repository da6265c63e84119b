"""Reads `[import]`: runs, and how their logs become records; everything is checked that can be without opening a log."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import inf
from posixpath import normpath
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from seatrial.campaign.config.quantities import (
    Seconds,
    Several,
    Table,
    Unit,
    refused,
    refusing,
    without_effect,
)
from seatrial.campaign.config.toml import FileKeys
from seatrial.core.errors import InputError, nearest, not_among
from seatrial.core.record import CONFIGURATION
from seatrial.core.signals import is_thruster, signal_unit
from seatrial.core.units import to_si
from seatrial.logs.body_frame import SOURCES
from seatrial.logs.linear_sum import parse_sum
from seatrial.logs.run_conditions import parse_condition
from seatrial.logs.source import Between
from seatrial.vehicles.thrusters import ThrustLaw

Length = Annotated[float, Unit("s", above=0.0, expected="more than 0 s", remedy="correct it, or leave the key out")]


class TimeTable(Table):
    """`[import.files.time]`: the column that holds time, and its unit."""

    column: str = Field(description="name of the column of time")
    unit: str | None = Field(default=None, description="its unit; not needed if the log states it")

    @model_validator(mode="after")
    def _check_unit(self) -> Self:
        with refusing("unit"):
            to_si(1.0, self.unit or "s", "s", "")
        return self


class ColumnTable(Table):
    """`[import.files.channels.CHANNEL]`: the column of a channel, its unit, and the conversion of its numbers.

    `curve` is a CSV with a header and two columns: a logged number, and its meaning in `unit`, interpolated between rows.
    Use it for the maker's table of thrust over PWM width.

    In a `sum`, put names with characters other than letters, digits and . _ / [ ] in single quotes. The curve is
    applied to each column. Forces of thrusters may be in the unit "command": `[vehicle.thrust_laws]` converts the
    column, or the sum, to thrust. `offset` is then in units of the command and is added before the law, and `scale`
    multiplies the thrust.

    `between = "line"` is for a measured control, such as the speed of a propeller. Over each step it is the mean of the
    straight line between its samples. By default a control is constant from sample to sample, and a caution names one
    that changes at nearly every sample. With `between = "held"` there is no caution.
    """

    column: str | None = Field(default=None, description="name of the column of the channel")
    sum: str | None = Field(
        default=None, description="instead of a column: columns with factors, such as `0.12 data[0] - 0.12 data[1]`"
    )
    unit: str = Field(description="unit of the column")
    scale: float = Field(default=1.0, description="factor on the column; -1 reverses an axis")
    offset: float = Field(default=0.0, description="constant added after scaling")
    curve: str | None = Field(
        default=None,
        description="CSV with the meaning of each logged number, such as the thrust of a PWM width; it must cover the rows "
        "that are kept",
    )
    between: Literal["held", "line"] | None = Field(
        default=None,
        description="of a control: `held` from sample to sample, or a straight `line`",
    )


class FileTable(Table):
    """`[[import.files]]`: one log of a trial; `{run}` in the path stands for the run's label.

    `time` is not needed if the format has a clock. Channels `v_north`, `v_east` and `v_down` become velocities along the body,
    and `q_w`, `q_x`, `q_y`, `q_z` become angles. `delimiter`, `encoding`, `skip_rows`, `header_rows` and `names` are for CSV and TSV.
    """

    path: str = Field(
        description="path of the log; `{run}` means the label of a run, `${NAME}` an environment variable"
    )
    table: str | None = Field(
        default=None, description="topic, type of message, struct or variable, if the log has several"
    )
    time: TimeTable | None = Field(default=None, description="column of time, `[import.files.time]`")
    channels: dict[str, ColumnTable] = Field(description="columns of the channels, `[import.files.channels.CHANNEL]`")
    runs: Several[str] | None = Field(
        default=None,
        min_length=1,
        description="runs with this log; all if not given",
    )
    configuration: str | None = Field(
        default=None,
        pattern=CONFIGURATION,
        description="configuration of the vehicle in these runs, such as `loaded`, of at most 40 letters, digits, spaces and `_ . + -`; "
        "`estimation.by_configuration` names the differences",
    )
    clock: Literal["as_stamped", "even", "drop_repeated"] = Field(
        default="as_stamped", description="keep the stamps, spread them evenly, or drop rows with a repeated stamp"
    )
    shift: Seconds | None = Field(
        default=None,
        description="added to the stamps of this log, if its clock differs; not for `seatrial live`",
    )
    axes: Literal["NED", "ENU"] = Field(
        default="NED",
        description="axes of the log: `NED` with body axes forward, right, down, or `ENU` with forward, left, up",
    )
    delimiter: str | None = Field(
        default=None, description="character between the cells of a text file, or `whitespace`"
    )
    encoding: str = Field(default="utf-8", description="encoding of a text file")
    skip_rows: int = Field(default=0, ge=0, le=1_000_000, description="lines above the header of a text file")
    header_rows: int = Field(
        default=1, ge=1, le=1000, description="rows of the header of a text file; the first names the columns"
    )
    names: Several[str] | None = Field(
        default=None,
        min_length=1,
        description="names of all columns, for a text file without a header; if not given, `column_1`, `column_2`, …",
    )

    @model_validator(mode="after")
    def _check_header(self) -> Self:
        if self.names is not None and "header_rows" in self.model_fields_set:
            raise without_effect(
                "header_rows", "`names` means that the file has no header", "remove it, or remove names"
            )
        return self


class KeepTable(Table):
    """`[[import.keep]]`: conditions on a log of the trial that a run must meet: `when = "armed == 1 and voltage > 14.5"`.

    Each run is cut to the longest stretch in which every condition holds, between its start and end. Comparisons of columns with numbers
    (`==`, `!=`, `<`, `<=`, `>`, `>=`) are joined by `and`; a number holds from its stamp to the next.
    """

    path: str = Field(description="path of a log of the trial; `{run}` means the label of a run")
    when: str = Field(
        description="comparisons of columns with numbers, joined by `and`, such as `armed == 1 and voltage > 14.5`"
    )
    table: str | None = Field(default=None, description="topic or type of message, if the log has several")
    time: TimeTable | None = Field(
        default=None,
        description="column of time, `[import.keep.time]`; not needed if the format has a clock",
    )
    delimiter: str | None = Field(
        default=None, description="character between the cells of a text file, or `whitespace`"
    )

    @model_validator(mode="after")
    def _check_condition(self) -> Self:
        with refusing("when"):
            parse_condition(self.when, "")
        return self


class TrimTable(Table):
    """`[import.trim.RUN]`: start and end of one run, instead of those of `[import]`."""

    start: Seconds | None = Field(
        default=None, description="start of the run, counted from the beginning of the record"
    )
    end: Seconds | None = Field(default=None, description="end of the run, counted in the same way")


class ImportTable(Table):
    """`[import]`: runs that are fitted jointly, runs that are only predicted, and how their files become records.

    Every run is cut to `start` and `end`, counted from the first time that all its files have. `split` divides it into
    pieces, each a trial with a separate start: for long records, and for vehicles that leave their course slowly. `schedule` is the
    commanded table; `{run}` stands for the run's label. A run without `start` and `end` is cut to this table, and
    `import` prints how well the vehicle followed it.
    """

    fit: Several[str] = Field(min_length=1, description="labels of the runs that are fitted jointly")
    predict: Several[str] = Field(default=(), description="labels of the runs that are only predicted")
    step: Length | None = Field(
        default=None,
        description="grid on which samples are averaged; if not given, every stamp is kept",
    )
    start: Seconds | None = Field(default=None, description="beginning of the part that is kept")
    end: Seconds | None = Field(default=None, description="end of the part that is kept")
    trim: dict[str, TrimTable] = Field(
        default={}, description="`[import.trim.RUN]`, for a run with a different start and end"
    )
    split: Length | None = Field(default=None, description="length of the pieces into which a long record is cut")
    schedule: str | None = Field(
        default=None,
        description="CSV of the commands, with `{run}` for the label of a run; the record is cut to it",
    )
    keep: Several[KeepTable] = Field(
        default=(),
        description="conditions of a run, `[[import.keep]]`; it is cut to the longest stretch that meets them",
    )
    files: Several[FileTable] = Field(min_length=1, description="the logs, `[[import.files]]`, one or more")

    @property
    def runs(self) -> tuple[str, ...]:
        """All runs, those that are fitted first."""
        return (*self.fit, *self.predict)

    def of(self, run: str) -> dict[int, Any]:
        """Return the logs of one run, by their places in `files`."""
        return {index: file for index, file in enumerate(self.files) if not file.runs or run in file.runs}

    def configuration(self, run: str) -> str:
        """Return the configuration of the vehicle in a run; empty if none is named."""
        return next((file.configuration for file in self.of(run).values() if file.configuration), "")

    @property
    def configurations(self) -> tuple[str, ...]:
        """Configurations of the fitted runs, each once, in their order; none if none is named."""
        return tuple(dict.fromkeys(filter(None, map(self.configuration, self.fit))))

    def ends(self, run: str) -> dict[str, float]:
        """Return where a run starts and ends, s from where its logs overlap, as far as anything is said."""
        own = self.trim.get(run, TrimTable())
        ends = {"start": (own.start, self.start), "end": (own.end, self.end)}
        return {name: value for name, pair in ends.items() for value in [one for one in pair if one is not None][:1]}

    @model_validator(mode="after")
    def _check_runs(self) -> Self:
        if len(set(self.runs)) < len(self.runs):
            raise refused(
                "a run named twice in fit and predict",
                "each run once",
                "each run either fitted or predicted",
                key="predict" if self.predict else "fit",
            )
        for run in self.runs:
            if not (0 < len(run) <= LONGEST and run.isprintable()) or set(run) & set("/\\") or run.startswith("."):
                raise refused(
                    f"run {run[: 2 * LONGEST]!r}",
                    f"a plain name of at most {LONGEST} characters",
                    "it becomes a file name: use letters and digits",
                    key="fit" if run in self.fit else "predict",
                )
        named = [(run, f"trim.{run}") for run in self.trim]
        named += [(run, f"files[{index}].runs") for index, file in enumerate(self.files) for run in file.runs or ()]
        for run, key in named:
            with refusing(key):
                if run not in self.runs:
                    raise not_among("", run, self.runs, found=f'run "{run}"')
        for run in self.runs:
            if not self.of(run):
                raise refused(
                    f'no log of run "{run}": `runs` of each log lists other runs',
                    "one [[import.files]] or more for each run",
                    f'add "{run}" to `runs` of its logs, or leave `runs` out of logs that every run has',
                    key="files",
                )
        return self

    @model_validator(mode="after")
    def _check_configurations(self) -> Self:
        known = self.configurations
        for run in self.runs:
            logs = self.of(run)
            named = list(dict.fromkeys(file.configuration for file in logs.values() if file.configuration))
            if len(named) > 1 or ((known or named) and not set(named) & set(known)):
                raise refused(
                    f'run "{run}"'
                    + (f" of the configuration {' and '.join(named)}" if named else " without a configuration"),
                    "for each run one configuration, which a fitted run has"
                    + (f": {', '.join(known)}" if known else ""),
                    "correct `configuration` of its logs; a log for each configuration needs `runs`",
                    key=f"files[{next((i for i, file in logs.items() if file.configuration), min(logs))}].configuration",
                )
        return self

    @model_validator(mode="after")
    def _check_ends(self) -> Self:
        for run in self.runs:
            ends, own = self.ends(run), self.trim.get(run, TrimTable())
            for name, value in ends.items():
                if value < 0 or (name == "end" and value <= ends.get("start", 0.0)):
                    after = f", with a start at {ends['start']:g} s" if name == "end" and "start" in ends else ""
                    raise refused(
                        f"{value:g} s{after}",
                        "0 s or more, and an end after the start",
                        "count from the beginning of the record",
                        key=name if getattr(own, name) is None else f"trim.{run}.{name}",
                    )
        return self

    @model_validator(mode="after")
    def _check_counted_once(self) -> Self:
        """Check that no two runs are the same part of the same logs, which would count one trial twice."""
        read = {run: self._what_is_read(run) for run in self.runs}
        for one, other in combinations(self.runs, 2):
            (start, end), (other_start, other_end) = (
                (ends.get("start", 0.0), ends.get("end", inf)) for ends in (self.ends(one), self.ends(other))
            )
            if read[one] == read[other] and start < other_end and other_start < end:
                paths = dict.fromkeys(file.path for file in self.of(one).values())
                raise refused(
                    f'runs "{one}" and "{other}", which both read {", ".join(paths)} over the same time: one trial counted twice',
                    "a log, or a part of a log, for each run",
                    "write {run} in the path if the names of the logs differ by it. Otherwise write an [[import.files]] for each log, with "
                    f'runs = ["{one}"] and runs = ["{other}"]; or give each run its own part, by start and end under [import.trim.{other}]',
                    key=f"files[{next(iter(self.of(other)))}].path",
                )
        return self

    def _what_is_read(self, run: str) -> frozenset[object]:
        """Return what makes the record of a run beside its start and end: its columns, and the files that cut it."""
        cut_by = [self.schedule or "", *(rule.path for rule in self.keep)]
        columns = [
            (normpath(file.path.replace("{run}", run)), file.table, name, column.sum or column.column)
            for file in self.of(run).values()
            for name, column in file.channels.items()
        ]
        return frozenset([*(("cut", normpath(path.replace("{run}", run))) for path in cut_by if path), *columns])


@dataclass(frozen=True)
class LogColumn:
    """Column that holds a channel, in a unit; multiplied by `scale`, then `offset` is added; `curve` names a table to read it off.

    Of a sum of columns, `column` is the sum as it was written, and `parts` are its factors and columns. `law` is that of a thruster, whose
    command the column or the sum is, after `offset` is added; `scale` then multiplies the thrust. `between` says what a control does
    between its samples; None if that is not said.
    """

    column: str
    unit: str
    scale: float = 1.0
    offset: float = 0.0
    curve: str | None = None
    parts: tuple[tuple[float, str], ...] = ()
    law: ThrustLaw | None = None
    between: Between | None = None


class LogFile(FileTable):
    """One log of a trial: its table, in whose channels a command has the law that makes thrust of it."""

    channels: dict[str, LogColumn]  # pyright: ignore[reportIncompatibleVariableOverride]

    @property
    def layout(self) -> tuple[str, ...]:
        """Keys that say how text is laid out, as far as they are stated; a log that is no text must not have them."""
        return tuple(name for name in LAYOUT if name in self.model_fields_set)


COMMAND = "command"  # Unit of a column that a law of thrust is for
LONGEST = 80  # Characters of a run's name
LAYOUT = ("delimiter", "encoding", "header_rows", "names", "skip_rows")  # Keys of `[[import.files]]` for text alone


def read_imports(
    table: ImportTable, keys: FileKeys, known: Sequence[str], laws: Mapping[str, ThrustLaw]
) -> ImportTable:
    """Return what is imported, with logs whose commands have the laws that make thrust of them.

    Args:
        table: as written.
        keys: of the file.
        known: signals that a record may hold.
        laws: of thrust, by control.

    Raises:
        InputError: a channel or unit that is none, a scale of zero, or a command without a law.
    """
    files = []
    for index, file in enumerate(table.files):
        columns = {
            name: _column(name, one, keys, f"import.files[{index}].channels.{name}", known, laws)
            for name, one in file.channels.items()
        }
        files.append(LogFile.model_construct(file.model_fields_set, **{**dict(file), "channels": columns}))
    return table.model_copy(update={"files": tuple(files)})


def _column(
    name: str, column: ColumnTable, keys: FileKeys, key: str, known: Sequence[str], laws: Mapping[str, ThrustLaw]
) -> LogColumn:
    if name not in (*known, *SOURCES):
        raise InputError(
            keys.where(key),
            found=f'channel "{name}"',
            expected=f"one of {', '.join(known)}, or a part of the attitude or of a velocity over the earth",
            remedy=f"leave it out if no term needs it; else {nearest(name, known)}",
        )
    law = laws.get(name)
    if column.unit == COMMAND or law is not None:
        _check_command(column, law, keys, key)
    unit = "N" if column.unit == COMMAND else column.unit
    to_si(1.0, unit, signal_unit(name), keys.where(f"{key}.unit"))
    if column.scale == 0:
        raise InputError(keys.where(f"{key}.scale"), found="0", expected="a number other than 0", remedy="correct it")
    if (column.column is None) == (column.sum is None):
        raise InputError(
            keys.where(key),
            found="both column and sum" if column.sum else "neither column nor sum",
            expected="one of them",
            remedy='write column = "data[0]", or sum = "0.12 data[0] - 0.12 data[1]"',
        )
    parts = () if column.sum is None else parse_sum(column.sum, keys.where(f"{key}.sum"))
    if len(parts) > 1 and column.curve is not None and is_thruster(name) and name[0] == "f":
        raise InputError(
            keys.where(f"{key}.curve"),
            found=f"a curve of each column of {name}, with the sum of the columns",
            expected="one command of a thruster, which a curve or a law converts to thrust",
            remedy=f'give the thrusters a law, [vehicle.thrust_laws.NAME] with curve = "{column.curve}", and their channels '
            f'unit = "{COMMAND}" without a curve: a law acts on the sum',
        )
    written = column.sum or column.column or ""
    curve = column.curve if law is None else law.table or None
    return LogColumn(written, unit, column.scale, column.offset, curve, parts, law, column.between)


def _check_command(column: ColumnTable, law: ThrustLaw | None, keys: FileKeys, key: str) -> None:
    """Check that a command has a law of thrust, and a law a command."""
    if column.unit != COMMAND or law is None:
        raise InputError(
            keys.where(f"{key}.unit"),
            found=f'"{column.unit}"' + (", of a channel without a law of thrust" if law is None else ""),
            expected="a unit, or a thruster with a law"
            if law is None
            else f'"{COMMAND}": [vehicle.thrust_laws] makes thrust of it',
            remedy="give [vehicle.thrust_laws.NAME], or the unit" if law is None else "correct it, or remove the law",
        )
    if column.curve is not None:
        raise InputError(
            keys.where(f"{key}.curve"),
            found="a curve and the law of thrust of the thruster",
            expected="one of them",
            remedy="remove it here, or the law under [vehicle]",
        )
