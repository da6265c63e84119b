"""Getting the trial's records: simulated from the campaign's truth, or imported from real logs."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.import_table import ImportTable, LogColumn, LogFile
from seatrial.campaign.config.named_files import find
from seatrial.campaign.data.no_record import no_record
from seatrial.campaign.data.rebuilt_controls import with_rebuilt_controls
from seatrial.campaign.data.simulate import check_simulated, simulated_records
from seatrial.campaign.data.unmapped import check_mapped
from seatrial.campaign.store.stored_result import Store, StoredResult, key_of
from seatrial.core.argument_checks import check_kind
from seatrial.core.errors import InputError, located
from seatrial.core.record import Record, Role
from seatrial.core.reporter import SILENT, Reporter
from seatrial.core.result_table import text_html
from seatrial.core.signals import BATTERY
from seatrial.logs.align import align
from seatrial.logs.curve import CellCurve, Curve, check_within, read_curve
from seatrial.logs.cut_record import cut, is_beyond
from seatrial.logs.formats.protocol import NoColumn
from seatrial.logs.formats.registry import format_of, hash_of_log
from seatrial.logs.join_logs import Commanded, Condition, body_tables, join_logs, unchecked
from seatrial.logs.log_table import read_log_table
from seatrial.logs.measured_control import mean_to_next
from seatrial.logs.source import ColumnMap, LogSource, LogTable
from seatrial.manoeuvres.schedule import read_rows
from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.thrusters import ThrustLaw, crossings

_TRIED_COMMANDS = 401  # Commands at which a polynomial of thrust is looked at


@dataclass(frozen=True, eq=False)
class Trials:
    """Records that are fitted, records that are only predicted, and the key of them all."""

    fit: tuple[Record, ...]
    predict: tuple[Record, ...]
    key: str

    def __repr__(self) -> str:
        """Print a line for each record."""
        parts = ("fitted", self.fit), ("only predicted", self.predict)
        return "\n".join(f"{words}: {record}" for words, records in parts for record in records) or "no records"

    _repr_html_ = text_html


def get_trials(campaign: Campaign, reporter: Reporter = SILENT) -> Trials:
    """Simulate the trials of a campaign, or import their logs.

    Args:
        campaign: of `load_campaign`.
        reporter: receives the progress.

    Returns:
        the fitted records and the held-back ones, SI.

    Raises:
        InputError: it says neither, a true vehicle that runs away, or files that cannot be used.
    """
    check_kind(campaign, Campaign, "campaign", "read it with `load_campaign`")
    return simulate_trials(campaign, reporter) if campaign.imports is None else import_trials(campaign, reporter)


def simulate_trials(campaign: Campaign, reporter: Reporter = SILENT) -> Trials:
    """Run the best design on the simulated truth, and every trial decided since, and store the records.

    Raises:
        InputError: as `check_simulated`, or a true vehicle that runs away.
    """
    check_simulated(campaign)
    records, key = simulated_records(campaign, reporter)
    return Trials(records, (), key)


def import_trials(campaign: Campaign, reporter: Reporter = SILENT) -> Trials:
    """Read every run's files and store the records; runs whose files and options have not changed are kept.

    Raises:
        InputError: a campaign that simulates instead or says nothing of its trials, a channel that is needed and not mapped, or files that
            cannot be used.
    """
    imports = campaign.imports
    if not campaign.has_records:
        raise no_record(campaign)
    if imports is None:
        raise InputError(
            str(campaign.path), found="[truth]", expected="[import], to read logs", remedy="use `seatrial simulate`"
        )
    check_mapped(campaign)
    pieces, keys = {}, []
    for run in imports.runs:
        record, key = _import_run(campaign, imports, run)
        pieces[run] = (record,) if imports.split is None else cut(record, imports.split)
        in_pieces = f", in {len(pieces[run])} pieces" if len(pieces[run]) > 1 else ""
        reporter.say(f"run {run}: {record.time.size} samples, {record.time[-1]:.1f} s{in_pieces}")
        keys.append(key)
    fit, predict = (tuple(one for run in some for one in pieces[run]) for some in (imports.fit, imports.predict))
    return Trials(fit, predict, trials_key(imports, keys))


def trials_key(imports: ImportTable, records: list[str]) -> str:
    """Key of all imported trials from those of their records."""
    return key_of("import", records, imports.fit, imports.split)


def read_untrimmed(campaign: Campaign, run: str) -> Record:
    """The record of one run with all that its files hold between start and end of their overlap; nothing is stored.

    Raises:
        InputError: files that cannot be used, or a campaign without any.
    """
    imports = campaign.imports
    if imports is None:
        raise no_record(campaign)
    return align(unchecked(read_tables(campaign, run)), step=imports.step, label=run)


def read_tables(campaign: Campaign, run: str) -> list[LogTable]:
    """The logs of one run as they are before they are put on one axis, velocities along the body.

    Raises:
        InputError: files that cannot be used, or a campaign without any.
    """
    if campaign.imports is None:
        raise no_record(campaign)
    return _tables(campaign, campaign.imports, run)


def stored_record(
    campaign: Campaign, imports: ImportTable, run: str, hash_of: Callable[[Path], str] = hash_of_log
) -> StoredResult[Record]:
    """Return where the record of one run is kept, and what it depends on; of its files no more is read than `hash_of` does.

    Raises:
        InputError: a name that cannot be a file's, or files that are missing.
    """
    key = _key(campaign, imports, run, hash_of)
    return StoredResult(Store(campaign.folder).record(run), key, Record)


def _import_run(campaign: Campaign, imports: ImportTable, run: str) -> tuple[Record, str]:
    kept = stored_record(campaign, imports, run)

    def read_files() -> Record:
        with located(campaign.where("import")):
            record = _with_late_end(imports, run, _joined(campaign, imports, run))
        record = with_rebuilt_controls(campaign, record)
        configuration = imports.configuration(run)
        return record.in_configuration(configuration) if configuration else record

    return kept.read_or_make(read_files), kept.key


def _joined(campaign: Campaign, imports: ImportTable, run: str) -> Record:
    """Read the files of a run, and put them on one axis."""
    tables, where = _tables(campaign, imports, run), campaign.where
    conditions = []
    for index, (rule, path) in enumerate(
        zip(imports.keep, _keep_paths(campaign.folder, where, imports, run), strict=True)
    ):
        column, unit = (None, None) if rule.time is None else (rule.time.column, rule.time.unit)
        source = LogSource(path, column, unit, {}, delimiter=rule.delimiter, table=rule.table)
        conditions.append(Condition(source, rule.when, where(f"import.keep[{index}].when")))
    commanded = None
    if imports.schedule is not None:
        path, place = _commanded(campaign.folder, where, imports, run), where("import.schedule")
        with located(place):
            commands = [name for name, _ in campaign.control_trim(campaign.model(campaign.full))]
            sent = read_rows(path, commands).schedule(campaign.family.sample_time)
        commanded = Commanded(path.name, sent.time, sent.controls, place)
    ends = imports.ends(run)
    return join_logs(tables, step=imports.step, **ends, label=run, conditions=conditions, commanded=commanded)


def available_of(trials: Trials) -> dict[str, float]:
    """Return how long the files of each run overlap, s; a run in pieces stands once."""
    available: dict[str, float] = {}
    for record in (*trials.fit, *trials.predict):
        options = record.provenance.options
        available.setdefault(
            record.label.rpartition(".")[0] if "piece" in options else record.label, options["available"]
        )
    return available


def _with_late_end(imports: ImportTable, run: str, record: Record) -> Record:
    """Return a record with a caution where the end that is stated for this run lies after its files end."""
    options, end = record.provenance.options, imports.ends(run).get("end", 0.0)
    if run not in imports.trim or imports.keep or not is_beyond(end, options["available"]):
        return record
    caution = (
        f'its files end at {options["available"]:.6g} s, before its end = "{end:g} s", so it ends there; '
        f"correct end in [import.trim.{run}]"
    )
    updated = {**options, "cautions": [*options["cautions"], caution]}
    return replace(record, provenance=replace(record.provenance, options=updated))


def _keep_paths(folder: Path, where: Callable[[str], str], imports: ImportTable, run: str) -> list[Path]:
    return [
        find(folder, rule.path, where(f"import.keep[{index}].path"), run) for index, rule in enumerate(imports.keep)
    ]


def _commanded(folder: Path, where: Callable[[str], str], imports: ImportTable, run: str) -> Path:
    """Schedule of a run that names one."""
    return find(folder, imports.schedule or "", where("import.schedule"), run)


def _tables(campaign: Campaign, imports: ImportTable, run: str) -> list[LogTable]:
    """Read the files of a run, with velocities along the body."""
    logs, roles = [], signal_roles(campaign.model(campaign.full), campaign.autopilot.trim)
    for (index, file), path in zip(
        imports.of(run).items(), _located(campaign.folder, campaign.where, imports, run), strict=True
    ):
        _check_layout(campaign.where, file, path, index)
        source = log_source(campaign, file, path, index, roles)
        with located(campaign.where(f"import.files[{index}]")), _of_several_runs(imports, file, run):
            logs.append((file, read_log_table(source)))
    return body_tables(
        _at_voltage(logs, BATTERY in roles, campaign.where("import.files"), run), roles, campaign.channels
    )


def _at_voltage(logs: Sequence[tuple[LogFile, LogTable]], is_control: bool, where: str, run: str) -> list[LogTable]:
    """Return logs in which each thrust whose law knows the battery voltage is that at the voltage logged last.

    Args:
        logs: of a run, with their maps; the thrusts are those at the voltage at which their laws are stated.
        is_control: whether the vehicle feels the voltage too; if not, it is left out of the logs.
        where: key of the files, for errors.
        run: its label.

    Raises:
        InputError: no voltage, or one that is not above 0.
    """
    laws = [one.curve for _, log in logs for cells in log.curved.values() for one in cells]
    if not any(isinstance(one, _Thrust) and one.law.voltage for one in laws):
        return [log for _, log in logs]
    battery = next((log for _, log in logs if BATTERY in log.columns), None)
    volts = np.full(1, np.nan) if battery is None else battery.columns[BATTERY]
    known = np.isfinite(volts)
    if battery is None or not known.any():
        raise InputError(
            where,
            found=f"run {run}: no channel V" if battery is None else f"run {run}: a channel V without a number",
            expected="the battery voltage, because [vehicle.thrust_laws] has a voltage",
            remedy='map it, for example channels.V = { column = "battery", unit = "V" }; a log of another message is a separate '
            "[[import.files]]",
        )
    least = int(np.nanargmin(volts))
    if volts[least] <= 0:
        raise InputError(
            where,
            found=f"run {run}: V = {volts[least]:g} V at {battery.time[least]:.6g} s of its log",
            expected="a voltage above 0 V, by which [vehicle.thrust_laws] gives the thrust",
            remedy="correct the column or the unit of channels.V, or remove the rows without a battery from the log",
        )
    result = []
    for file, log in logs:
        columns = dict(log.columns)
        for name, (one, *_) in log.curved.items():
            if isinstance(one.curve, _Thrust) and one.curve.law.voltage:
                last = np.searchsorted(battery.time[known] + float(battery.epoch - log.epoch), log.time, side="right")
                thrust = file.channels[name].scale * one.curve(one.cells, volts[known][np.maximum(last - 1, 0)])
                thrust = np.where(np.isnan(thrust), columns[name], thrust)  # a gap, or a command that `align` refuses
                columns[name] = mean_to_next(thrust) if file.channels[name].between == "line" else thrust
        gone = () if is_control else (BATTERY,)
        kept = tuple(channel for channel in log.channels if channel.name not in gone)
        result.append(replace(log, channels=kept, columns={one.name: columns[one.name] for one in kept}))
    return result


@contextmanager
def _of_several_runs(imports: ImportTable, file: LogFile, run: str) -> Iterator[None]:
    """Where a column is missing, say that the map is that of other runs too, before somebody corrects it for one run alone."""
    try:
        yield
    except NoColumn as error:
        others = [one for one in file.runs or imports.runs if one != run]
        if not others:
            raise
        remedy = (
            f"{error.remedy} Run {', '.join(others)} has this map too: if only run {run} has other columns, write "
            f"runs = {_written(others)} here, and runs = {_written([run])} under a separate [[import.files]]"
        )
        raise InputError(error.where, found=error.found, expected=error.expected, remedy=remedy) from error.__cause__


def _written(runs: Sequence[str]) -> str:
    return "[" + ", ".join(f'"{run}"' for run in runs) + "]"


def _located(folder: Path, where: Callable[[str], str], imports: ImportTable, run: str) -> list[Path]:
    return [
        find(folder, file.path, where(f"import.files[{index}].path"), run) for index, file in imports.of(run).items()
    ]


def _key(campaign: Campaign, imports: ImportTable, run: str, hash_of: Callable[[Path], str]) -> str:
    files = imports.of(run)
    curves = [
        _curve(campaign.folder, campaign.where, index, name, column.curve)
        for index, file in files.items()
        for name, column in file.channels.items()
        if column.curve
    ]
    hashes = [hash_of(path) for path in (*_located(campaign.folder, campaign.where, imports, run), *curves)]
    sent = (
        ()
        if imports.schedule is None
        else (hash_of(_commanded(campaign.folder, campaign.where, imports, run)), campaign.family.sample_time)
    )
    keep = [hash_of(path) for path in _keep_paths(campaign.folder, campaign.where, imports, run)]
    kept = (keep, imports.keep) if keep else ()
    kept += (campaign.pilot(campaign.model(campaign.full).controls),) if campaign.autopilot.loops else ()
    return key_of("record", run, hashes, imports.step, [*files.values()], imports.ends(run), *sent, *kept)


def _curve(folder: Path, where: Callable[[str], str], index: int, name: str, written: str) -> Path:
    """Curve of a channel of a file, which has one."""
    return find(folder, written, where(f"import.files[{index}].channels.{name}.curve"))


def signal_roles(model: VehicleModel, set_points: Collection[str] = ()) -> dict[str, Role]:
    """Return every signal that a record may hold, and whether it drives the vehicle, as `set_points` do, or observes it."""
    driving = (*model.controls, *set_points)
    return {name: "control" if name in driving else "measurement" for name in (*driving, *model.channel_units())}


def _check_layout(where: Callable[[str], str], file: LogFile, path: Path, index: int) -> None:
    """Refuse the layout of a text where the log is none."""
    if file.layout and not format_of(path).is_text:
        raise InputError(
            where(f"import.files[{index}].{file.layout[0]}"),
            found=f"a key without effect: {path.name} is {format_of(path).name}",
            expected="keys that have an effect",
            remedy=f"remove {', '.join(file.layout)}, which describes the layout of text",
        )


def log_source(campaign: Campaign, file: LogFile, path: Path, index: int, roles: Mapping[str, Role]) -> LogSource:
    """Return how one log is read.

    Args:
        campaign: whose folder holds curves.
        file: of its [import] table.
        path: of the log, or what stands for it.
        index: of the file in the table, for errors.
        roles: of `signal_roles`.

    Raises:
        InputError: a curve that cannot be read, or a straight line between measurements.
    """
    for name, column in file.channels.items():
        if column.between == "line" and roles.get(name) != "control":
            raise InputError(
                campaign.where(f"import.files[{index}].channels.{name}.between"),
                found=f'"line", of {name}, which is a measurement',
                expected="a control: measurements are used at their stamps",
                remedy="remove it",
            )
    channels = {
        name: ColumnMap(
            column.column,
            column.unit,
            roles.get(name, "measurement"),
            scale=column.scale,
            offset=column.offset,
            curve=None if column.law else _cell_curve(campaign, index, name, column),
            parts=column.parts,
            between=column.between,
            law=_law(campaign, index, name, column, column.law) if column.law else None,
        )
        for name, column in file.channels.items()
    }
    return LogSource(
        path,
        None if file.time is None else file.time.column,
        None if file.time is None else file.time.unit,
        channels,
        clock=file.clock,
        shift=file.shift or 0.0,
        delimiter=file.delimiter,
        encoding=file.encoding,
        skip_rows=file.skip_rows,
        header_rows=file.header_rows,
        names=file.names,
        table=file.table,
        axes=file.axes,
    )


def _cell_curve(campaign: Campaign, index: int, name: str, column: LogColumn) -> Curve | None:
    """Return the curve of a channel, or the table of its law.

    Raises:
        InputError: a curve that cannot be read.
    """
    where = campaign.where(f"import.files[{index}].channels.{name}.{'unit' if column.law else 'curve'}")
    return (
        read_curve(_curve(campaign.folder, campaign.where, index, name, column.curve), where) if column.curve else None
    )


def _law(campaign: Campaign, index: int, name: str, column: LogColumn, law: ThrustLaw) -> CellCurve:
    """Return the force of a channel's command by the law of its thruster.

    Raises:
        InputError: a table that cannot be read, or that turns back.
    """
    where = campaign.where(f"import.files[{index}].channels.{name}.unit")
    curve = _cell_curve(campaign, index, name, column)
    if curve is not None and np.unique(np.sign(np.diff(curve.value))[np.diff(curve.value) != 0]).size > 1:
        back = int(np.flatnonzero(np.diff(np.sign(np.diff(curve.value))) != 0)[0]) + 1
        raise InputError(
            where,
            found=f"thrust that turns back at {curve.logged[back]:g} of {curve.name}: {curve.value[back]:g} N",
            expected="thrust that only rises with the command, or only falls; flat stretches are allowed",
            remedy="smooth the measured points, or leave out the one that is wrong",
        )
    if law.voltage is not None and curve is not None and law.dead_zone is None:
        dead = crossings(np.asarray(curve.logged), np.asarray(curve.value), 0.0)
        if not dead.size:
            raise InputError(
                where,
                found=f"no command without thrust in {curve.name}",
                expected="a curve that goes through 0 N, because the voltage moves the ends of its dead zone",
                remedy="add the commands of no thrust, or a dead_zone",
            )
        law = replace(law, dead_zone=(float(dead.min()), float(dead.max())))
    return _Thrust(law, curve)


@dataclass(frozen=True)
class _Thrust:
    """The law of a thruster, with its table, as a curve of commands."""

    law: ThrustLaw
    table: Curve | None

    @property
    def name(self) -> str:
        """See `CellCurve`."""
        return f"law of thrust, {self.table.name if self.table else 'polynomial'}"

    def __call__(
        self, cells: Float[np.ndarray, " n"], volts: Float[np.ndarray, " n"] | None = None
    ) -> Float[np.ndarray, " n"]:
        """Return the thrust, N; NaN beyond the table, and of no pulse width by a law for pulse widths.

        Args:
            cells: commands.
            volts: battery voltage at each, V; that at which the law is stated if not given.
        """
        lower, upper = self.law.pulses if self.table is None else (self.table.logged[0], self.table.logged[-1])
        # At a higher voltage the last commands act as the end of the table does.
        table = None if self.table is None else partial(np.interp, xp=self.table.logged, fp=self.table.value)
        thrust = self.law.thrust(cells, table, volts)
        return np.where(((cells < lower) | (cells > upper)) & ~self.law.is_dead(cells), np.nan, thrust)

    def check(self, cells: Float[np.ndarray, " n"], time: Float[np.ndarray, " n"], where: str) -> None:
        """Refuse a command out of the dead zone that is beyond the law, or where a polynomial turns back; see `CellCurve`."""
        cells = np.where(self.law.is_dead(cells), np.nan, cells)
        offset = (
            "; a sum of commands needs the offset, in units of the command, that brings its neutral to that of the law"
        )
        if self.table is not None:
            self.table.check(cells, time, where, offset)
            return
        known = cells[np.isfinite(cells)]
        called = f"the pulse widths, us, that a law with neutral = {self.law.neutral:g} is for"
        table = "or give a table instead of the polynomial, [vehicle.thrust_laws.NAME] with curve, if it is for other commands"
        check_within(cells, time, where, self.law.pulses, called, table + offset)
        ends = (min(known.min(), self.law.neutral), max(known.max(), self.law.neutral)) if known.size else (0.0, 0.0)
        tried = np.linspace(*ends, _TRIED_COMMANDS) if known.size else known
        tried = tried[~self.law.is_dead(tried)]
        steps = np.diff(np.polynomial.polynomial.polyval(tried - self.law.neutral, self.law.polynomial))
        if steps.size and steps.min() < 0 < steps.max():
            at = tried[1 + int(np.flatnonzero(np.diff(np.sign(steps)))[0])]
            raise InputError(
                where,
                found=f"commands from {known.min():g} to {known.max():g}, between which the polynomial turns back, near {at:.5g}",
                expected="thrust that only rises with the command, or only falls",
                remedy="check the units of the column, `neutral` and the polynomial, or give a table: curve; or keep other "
                'rows only, by [[import.keep]] with for example when = "armed == 1"',
            )
