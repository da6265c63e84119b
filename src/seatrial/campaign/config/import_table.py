"""Reads `[import]`: runs, and how their logs become records; everything is checked that can be without opening a log."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from math import inf
from posixpath import normpath

from seatrial.campaign.config.file_keys import FileKeys
from seatrial.campaign.config.schema import ColumnTable, FileTable, ImportTable, KeepTable
from seatrial.campaign.config.settings import Imports, KeepRule, LogColumn, LogFile
from seatrial.core.errors import InputError, nearest
from seatrial.core.signals import is_thruster, signal_unit
from seatrial.core.units import to_si
from seatrial.logs.body_frame import SOURCES
from seatrial.logs.linear_sum import parse_sum
from seatrial.logs.run_conditions import parse_condition
from seatrial.vehicles.thrusters import ThrustLaw

COMMAND = "command"
"""Unit of a column that a law of thrust is for."""
LONGEST = 80
"""Characters of a run's name."""
LAYOUT = ("delimiter", "encoding", "header_rows", "names", "skip_rows")
"""Keys of `[[import.files]]` for text alone."""


def read_imports(table: ImportTable, keys: FileKeys, known: Sequence[str], laws: Mapping[str, ThrustLaw]) -> Imports:
    """Read what is imported.

    Args:
        table: as written.
        keys: of the file.
        known: signals that a record may hold.
        laws: of thrust, by control.

    Raises:
        InputError: a channel or unit that is none, a scale of zero, times that are not positive, or a key without effect.
    """
    step, split = (
        None if text is None else _positive(text, keys, f"import.{key}")
        for key, text in (("step", table.step), ("split", table.split))
    )
    runs = (*table.fit, *table.predict)
    if len(set(runs)) < len(runs):
        raise InputError(
            keys.where("import.predict" if table.predict else "import.fit"),
            found="a run named twice in fit and predict",
            expected="each run once",
            remedy="a run that was fitted cannot also be a test of prediction",
        )
    for run in runs:
        if not (0 < len(run) <= LONGEST and run.isprintable()) or set(run) & set("/\\") or run.startswith("."):
            raise InputError(
                keys.where("import.fit" if run in table.fit else "import.predict"),
                found=f"run {run[: 2 * LONGEST]!r}",
                expected=f"a plain name of at most {LONGEST} characters",
                remedy="it becomes a file name: use letters and digits",
            )
    ends = {run: _ends(table, keys, run) for run in runs}
    files = tuple(_file(file, keys, f"import.files[{index}]", known, laws) for index, file in enumerate(table.files))
    named = [(run, f"import.trim.{run}") for run in table.trim]
    named += [(run, f"import.files[{index}].runs") for index, file in enumerate(files) for run in file.runs]
    for run, key in named:
        if run not in runs:
            raise InputError(
                keys.where(key),
                found=f'run "{run}"',
                expected="one of " + ", ".join(runs),
                remedy=nearest(run, runs),
            )
    keep = tuple(_keep(one, keys, f"import.keep[{index}]") for index, one in enumerate(table.keep))
    found = Imports(
        tuple(table.fit), tuple(table.predict), files, step, split, ends, tuple(table.trim), table.schedule, keep
    )
    for run in runs if files else ():
        if not found.of(run):
            raise InputError(
                keys.where("import.files"),
                found=f'no log of run "{run}": `runs` of each names others',
                expected="one [[import.files]] or more for each run",
                remedy=f'add "{run}" to `runs` of its logs, or leave `runs` out of logs that every run has',
            )
    if files:
        _check_counted_once(found, keys)
    return found


def _check_counted_once(imports: Imports, keys: FileKeys) -> None:
    """Check that no two runs are the same part of the same logs, which would count one trial twice.

    Raises:
        InputError: two runs with the same columns of the same files, over times that overlap.
    """
    read = {run: _what_is_read(imports, run) for run in imports.runs}
    for one, other in combinations(imports.runs, 2):
        (start, end), (other_start, other_end) = (
            (imports.ends[run].get("start", 0.0), imports.ends[run].get("end", inf)) for run in (one, other)
        )
        if read[one] == read[other] and start < other_end and other_start < end:
            paths = dict.fromkeys(file.path for file in imports.of(one).values())
            raise InputError(
                keys.where(f"import.files[{next(iter(imports.of(other)))}].path"),
                found=f'runs "{one}" and "{other}", which both read {", ".join(paths)} over the same time: one trial counted twice',
                expected="a log, or a part of a log, for each run",
                remedy="write {run} in the path where the names of the logs differ by it; or an [[import.files]] for each log, with "
                f'runs = ["{one}"] and runs = ["{other}"]; or give each run its own part, by start and end under [import.trim.{other}]',
            )


def _what_is_read(imports: Imports, run: str) -> frozenset[object]:
    """Return what makes the record of a run beside its start and end: its columns, and the files that cut it."""
    cut_by = [imports.schedule or "", *(rule.path for rule in imports.keep)]
    return frozenset(
        [
            *(("cut", normpath(path.replace("{run}", run))) for path in cut_by if path),
            *(
                (normpath(file.path.replace("{run}", run)), file.table, name, column.column)
                for file in imports.of(run).values()
                for name, column in file.channels.items()
            ),
        ]
    )


def _keep(one: KeepTable, keys: FileKeys, key: str) -> KeepRule:
    unit = None if one.time is None else one.time.unit
    if unit is not None:
        to_si(1.0, unit, "s", keys.where(f"{key}.time.unit"))
    condition = parse_condition(one.when, keys.where(f"{key}.when"))
    return KeepRule(
        one.path, one.when, condition, one.table, None if one.time is None else one.time.column, unit, one.delimiter
    )


def _positive(text: str | float, keys: FileKeys, key: str) -> float:
    value = keys.si(text, "s", key)
    if not value > 0:
        raise InputError(
            keys.where(key), found=f"{text}", expected="more than 0 s", remedy="correct it, or leave the key out"
        )
    return value


def _ends(table: ImportTable, keys: FileKeys, run: str) -> dict[str, float]:
    """Where a run begins and ends, s, as far as anything is said of it.

    Raises:
        InputError: before the beginning of the record, or an end that is not after the start.
    """
    found: dict[str, float] = {}
    for name in ("start", "end"):
        own = getattr(table.trim.get(run), name, None)
        text, key = (getattr(table, name), f"import.{name}") if own is None else (own, f"import.trim.{run}.{name}")
        if text is not None:
            found[name] = keys.si(text, "s", key)
            if found[name] < 0 or (name == "end" and found[name] <= found.get("start", 0.0)):
                raise InputError(
                    keys.where(key),
                    found=text
                    + (f", with a start at {found['start']:g} s" if name == "end" and "start" in found else ""),
                    expected="0 s or more, and an end after the start",
                    remedy="count from the beginning of the record",
                )
    return found


def _file(file: FileTable, keys: FileKeys, key: str, known: Sequence[str], laws: Mapping[str, ThrustLaw]) -> LogFile:
    if file.time is not None and file.time.unit is not None:
        to_si(1.0, file.time.unit, "s", keys.where(f"{key}.time.unit"))
    if file.names is not None and "header_rows" in file.model_fields_set:
        raise InputError(
            keys.where(f"{key}.header_rows"),
            found="a key without effect: `names` says that the file has no header",
            expected="one of the two",
            remedy="remove it, or remove names",
        )
    return LogFile(
        file.path,
        {name: _column(name, one, keys, f"{key}.channels.{name}", known, laws) for name, one in file.channels.items()},
        file.table,
        None if file.time is None else file.time.column,
        None if file.time is None else file.time.unit,
        file.clock,
        0.0 if file.shift is None else keys.si(file.shift, "s", f"{key}.shift"),
        file.axes,
        file.delimiter,
        file.encoding,
        file.skip_rows,
        file.header_rows,
        None if file.names is None else tuple(file.names),
        tuple(name for name in LAYOUT if name in file.model_fields_set),
        tuple(file.runs or ()),
    )


def _column(
    name: str, column: ColumnTable, keys: FileKeys, key: str, known: Sequence[str], laws: Mapping[str, ThrustLaw]
) -> LogColumn:
    if name not in (*known, *SOURCES):
        raise InputError(
            keys.where(key),
            found=f'channel "{name}"',
            expected=f"one of {', '.join(known)}, or a part of the attitude or of a velocity over the earth",
            remedy=f"leave it out where no term needs it; else {nearest(name, known)}",
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
            found=f"a curve of each column of {name}, whose columns are added up",
            expected="one command of a thruster, of which a curve or a law makes its thrust",
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
            found="a curve beside the thruster's law of thrust",
            expected="one of them",
            remedy="remove it here, or the law under [vehicle]",
        )
