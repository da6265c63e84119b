"""Getting the trial's records: simulated from the campaign's truth, or imported from real logs."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from xarray import Dataset

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.named_files import find
from seatrial.campaign.config.settings import Imports, LogFile
from seatrial.campaign.data.simulate import check_simulated, no_record, simulated_records
from seatrial.campaign.store.stored_result import Store, StoredResult, key_of
from seatrial.core.argument_checks import check_kind
from seatrial.core.errors import InputError, located
from seatrial.core.progress import SILENT, Reporter
from seatrial.core.record import Record, Role
from seatrial.core.record_file import read_record, record_dataset
from seatrial.logs.align import align
from seatrial.logs.body_frame import to_body
from seatrial.logs.curve import read_curve
from seatrial.logs.formats.registry import format_of, hash_of_log
from seatrial.logs.read import read_log
from seatrial.logs.segments import cut
from seatrial.logs.source import ColumnMap, LogSource
from seatrial.vehicles.model import VehicleModel


@dataclass(frozen=True, eq=False)
class Trials:
    """Records that are fitted, records that are only predicted, and the key of them all."""

    fit: tuple[Record, ...]
    predict: tuple[Record, ...]
    key: str


def get_trials(campaign: Campaign, reporter: Reporter = SILENT) -> Trials:
    """Simulate the campaign's trials or import their logs, as it says.

    Args:
        campaign: of `load_campaign`.
        reporter: told how far the work has come.

    Returns:
        the records that are fitted and those that are only predicted, SI.

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
        InputError: a campaign that simulates instead or says nothing of its trials, or files that cannot be used.
    """
    imports = campaign.imports
    if not campaign.has_records:
        raise no_record(campaign)
    if imports is None:
        raise InputError(
            str(campaign.path), found="[truth]", expected="[import], to read logs", remedy="use `seatrial simulate`"
        )
    pieces, keys = {}, []
    for run in imports.runs:
        record, key = _import_run(campaign, imports, run)
        pieces[run] = (record,) if imports.split is None else cut(record, imports.split)
        said = f", in {len(pieces[run])} pieces" if len(pieces[run]) > 1 else ""
        reporter.say(f"run {run}: {record.time.size} samples, {record.time[-1]:.1f} s{said}")
        keys.append(key)
    fit, predict = (tuple(one for run in some for one in pieces[run]) for some in (imports.fit, imports.predict))
    return Trials(fit, predict, trials_key(imports, keys))


def trials_key(imports: Imports, records: list[str]) -> str:
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
    return _aligned(campaign, imports, run, _located(campaign, imports, run), {})


def stored_record(
    campaign: Campaign, imports: Imports, run: str, hash_of: Callable[[Path], str] = hash_of_log
) -> StoredResult[Record]:
    """Return where the record of one run is kept, and what it depends on; of its files no more is read than `hash_of` does.

    Raises:
        InputError: a name that cannot be a file's, or files that are missing.
    """
    key = _key(campaign, imports, run, _located(campaign, imports, run), hash_of)
    return StoredResult(Store(campaign.folder).record(run), key, read_record)


def _import_run(campaign: Campaign, imports: Imports, run: str) -> tuple[Record, str]:
    kept = stored_record(campaign, imports, run)

    def read_files() -> Dataset:
        paths = _located(campaign, imports, run)
        return record_dataset(_aligned(campaign, imports, run, paths, imports.ends.get(run, {})))

    return kept.read_or_make(read_files), kept.key


def _aligned(campaign: Campaign, imports: Imports, run: str, paths: list[Path], ends: Mapping[str, float]) -> Record:
    """Read the files of a run, and put them on one axis between its ends."""
    logs, roles = [], _roles(campaign.model(campaign.full))
    for index, (file, path) in enumerate(zip(imports.files, paths, strict=True)):
        source = _source(campaign, file, path, index, roles)
        with located(campaign.where(f"import.files[{index}]")):
            logs.append(read_log(source))
    return align(to_body(logs, roles), step=imports.step, **ends, label=run)


def _located(campaign: Campaign, imports: Imports, run: str) -> list[Path]:
    return [
        find(campaign.folder, file.path, campaign.where(f"import.files[{index}].path"), run)
        for index, file in enumerate(imports.files)
    ]


def _key(campaign: Campaign, imports: Imports, run: str, paths: list[Path], hash_of: Callable[[Path], str]) -> str:
    curves = [
        _curve(campaign, index, name, column.curve)
        for index, file in enumerate(imports.files)
        for name, column in file.channels.items()
        if column.curve
    ]
    hashes = [hash_of(path) for path in (*paths, *curves)]
    return key_of("record", run, hashes, imports.step, imports.files, imports.ends.get(run, {}))


def _curve(campaign: Campaign, index: int, name: str, written: str) -> Path:
    """Curve of a channel of a file, which has one."""
    return find(campaign.folder, written, campaign.where(f"import.files[{index}].channels.{name}.curve"))


def _roles(model: VehicleModel) -> dict[str, Role]:
    """Every signal that a record may hold, and whether it drives the vehicle or observes it."""
    return {
        name: "control" if name in model.controls else "measurement"
        for name in (*model.controls, *model.channel_units())
    }


def _source(campaign: Campaign, file: LogFile, path: Path, index: int, roles: Mapping[str, Role]) -> LogSource:
    if file.layout and not format_of(path).is_text:
        raise InputError(
            campaign.where(f"import.files[{index}].{file.layout[0]}"),
            found=f"a key without effect: {path.name} is {format_of(path).name}",
            expected="keys that something reads",
            remedy=f"remove {', '.join(file.layout)}: they say how text is laid out",
        )
    channels = {
        name: ColumnMap(
            column.column,
            column.unit,
            roles.get(name, "measurement"),
            scale=column.scale,
            offset=column.offset,
            curve=read_curve(
                _curve(campaign, index, name, column.curve),
                campaign.where(f"import.files[{index}].channels.{name}.curve"),
            )
            if column.curve
            else None,
        )
        for name, column in file.channels.items()
    }
    return LogSource(
        path,
        file.time,
        file.time_unit,
        channels,
        clock=file.clock,
        delimiter=file.delimiter,
        encoding=file.encoding,
        skip_rows=file.skip_rows,
        header_rows=file.header_rows,
        names=file.names,
        table=file.table,
        axes=file.axes,
    )
