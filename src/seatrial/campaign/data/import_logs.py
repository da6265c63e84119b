"""Getting the trial's records: simulated from the campaign's truth, or imported from real logs."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from xarray import Dataset

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.named_files import find
from seatrial.campaign.config.schema import FileTable
from seatrial.campaign.data.simulate import check_simulated, no_record, simulated_records
from seatrial.campaign.store.files import Store, StoredResult, key_of
from seatrial.core.errors import InputError, located, nearest
from seatrial.core.progress import SILENT, Reporter
from seatrial.core.record import Record, Role
from seatrial.core.record_file import read_record, record_dataset
from seatrial.core.signals import signal_unit
from seatrial.core.units import to_si
from seatrial.logs.align import align
from seatrial.logs.body_frame import SOURCES, to_body
from seatrial.logs.curve import read_curve
from seatrial.logs.formats.registry import format_of, hash_of_log
from seatrial.logs.read import read_log
from seatrial.logs.segments import cut
from seatrial.logs.source import ColumnMap, LogSource

LONGEST = 80
"""Characters of a run's name."""
LAYOUT = {"delimiter", "encoding", "skip_rows", "header_rows", "names"}
"""Keys of `[[import.files]]` for text alone."""


@dataclass(frozen=True, eq=False)
class Trials:
    """Records that are fitted, records that are only predicted, and the key of them all."""

    fit: tuple[Record, ...]
    predict: tuple[Record, ...]
    key: str


def get_trials(campaign: Campaign, reporter: Reporter = SILENT) -> Trials:
    """Simulate or import, as the campaign says.

    Raises:
        InputError: it says neither, or as the two.
    """
    return (
        simulate_trials(campaign, reporter) if campaign.source.imported is None else import_trials(campaign, reporter)
    )


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
    table = campaign.source.imported
    if not campaign.has_records:
        raise no_record(campaign)
    if table is None:
        raise InputError(
            str(campaign.path), found="[truth]", expected="[import], to read logs", remedy="use `seatrial simulate`"
        )
    runs = [*table.fit, *table.predict]
    length = None if table.split is None else campaign.si(table.split, "s", "import.split")
    pieces, keys = {}, []
    for run in runs:
        record, key = _import_run(campaign, run)
        pieces[run] = (record,) if length is None else cut(record, length)
        said = f", in {len(pieces[run])} pieces" if len(pieces[run]) > 1 else ""
        reporter.say(f"run {run}: {record.time.size} samples, {record.time[-1]:.1f} s{said}")
        keys.append(key)
    fit, predict = (tuple(one for run in some for one in pieces[run]) for some in (table.fit, table.predict))
    return Trials(fit, predict, trials_key(campaign, keys))


def check_import(campaign: Campaign) -> None:
    """Check everything about an import that can be checked without opening a log; nothing where there is none.

    Raises:
        InputError: a channel or unit that is none, a scale of zero, times that are not positive, or a key without effect.
    """
    table = campaign.source.imported
    if table is None:
        return
    for key, text in (("step", table.step), ("split", table.split)):
        if text is not None and not campaign.si(text, "s", f"import.{key}") > 0:
            raise InputError(
                campaign.where(f"import.{key}"),
                found=text,
                expected="more than 0 s",
                remedy="correct it, or leave the key out",
            )
    runs = (*table.fit, *table.predict)
    if len(set(runs)) < len(runs):
        raise InputError(
            campaign.where("import.predict" if table.predict else "import.fit"),
            found="a run named twice in fit and predict",
            expected="each run once",
            remedy="a run that was fitted cannot also be a test of prediction",
        )
    for run in runs:
        if not (0 < len(run) <= LONGEST and run.isprintable()) or set(run) & set("/\\") or run.startswith("."):
            raise InputError(
                campaign.where("import.fit" if run in table.fit else "import.predict"),
                found=f"run {run[: 2 * LONGEST]!r}",
                expected=f"a plain name of at most {LONGEST} characters",
                remedy="it becomes a file name: use letters and digits",
            )
        _ends(campaign, run)
    known = tuple(_roles(campaign))
    for index, file in enumerate(table.files):
        key = f"import.files[{index}]"
        if file.time is not None and file.time.unit is not None:
            to_si(1.0, file.time.unit, "s", campaign.where(f"{key}.time.unit"))
        if file.names is not None and "header_rows" in file.model_fields_set:
            raise InputError(
                campaign.where(f"{key}.header_rows"),
                found="a key without effect: `names` says that the file has no header",
                expected="one of the two",
                remedy="remove it, or remove names",
            )
        for name, column in file.channels.items():
            where = f"{key}.channels.{name}"
            if name not in (*known, *SOURCES):
                raise InputError(
                    campaign.where(where),
                    found=f'channel "{name}"',
                    expected=f"one of {', '.join(known)}, or a part of the attitude or of a velocity over the earth",
                    remedy=f"leave it out where no term needs it; else {nearest(name, known)}",
                )
            to_si(1.0, column.unit, signal_unit(name), campaign.where(f"{where}.unit"))
            if column.scale == 0:
                raise InputError(
                    campaign.where(f"{where}.scale"), found="0", expected="a number other than 0", remedy="correct it"
                )


def trials_key(campaign: Campaign, records: list[str]) -> str:
    """Key of all imported trials from those of their records."""
    table = campaign.source.imported
    assert table is not None
    return key_of("import", records, table.fit, table.split)


def read_untrimmed(campaign: Campaign, run: str) -> Record:
    """The record of one run with all that its files hold between start and end of their overlap; nothing is stored.

    Raises:
        InputError: files that cannot be used.
    """
    return _aligned(campaign, run, _located(campaign, run), {})


def stored_record(campaign: Campaign, run: str, hash_of: Callable[[Path], str] = hash_of_log) -> StoredResult[Record]:
    """Return where the record of one run is kept, and what it depends on; of its files no more is read than `hash_of` does.

    Raises:
        InputError: a name that cannot be a file's, or files that are missing.
    """
    key = _key(campaign, run, _located(campaign, run), hash_of)
    return StoredResult(Store(campaign.folder).record(run), key, read_record)


def _import_run(campaign: Campaign, run: str) -> tuple[Record, str]:
    kept = stored_record(campaign, run)

    def read_files() -> Dataset:
        return record_dataset(_aligned(campaign, run, _located(campaign, run), _ends(campaign, run)))

    return kept.read_or_make(read_files), kept.key


def _ends(campaign: Campaign, run: str) -> dict[str, float]:
    """Where a run begins and ends, s, as far as anything is said of it.

    Raises:
        InputError: before where its files overlap, or an end that is not after the start.
    """
    table = campaign.source.imported
    assert table is not None
    found = {}
    for name in ("start", "end"):
        own = getattr(table.trim.get(run), name, None)
        text, key = (getattr(table, name), f"import.{name}") if own is None else (own, f"import.trim.{run}.{name}")
        if text is not None:
            found[name] = campaign.si(text, "s", key)
            if found[name] < 0 or (name == "end" and found[name] <= found.get("start", 0.0)):
                raise InputError(
                    campaign.where(key),
                    found=text
                    + (f", with a start at {found['start']:g} s" if name == "end" and "start" in found else ""),
                    expected="0 s or more, and an end after the start",
                    remedy="count from where the files of the run overlap",
                )
    return found


def _aligned(campaign: Campaign, run: str, paths: list[Path], ends: Mapping[str, float]) -> Record:
    """Read the files of a run, and put them on one axis between its ends."""
    table = campaign.source.imported
    assert table is not None
    logs = []
    for index, (file, path) in enumerate(zip(table.files, paths, strict=True)):
        source = _source(campaign, file, path, index)
        with located(campaign.where(f"import.files[{index}]")):
            logs.append(read_log(source))
    step = None if table.step is None else campaign.si(table.step, "s", "import.step")
    tables = to_body(logs, _roles(campaign))
    return align(tables, step=step, **ends, label=run)


def _located(campaign: Campaign, run: str) -> list[Path]:
    table = campaign.source.imported
    assert table is not None
    return [
        find(campaign.folder, file.path, campaign.where(f"import.files[{index}].path"), run)
        for index, file in enumerate(table.files)
    ]


def _key(campaign: Campaign, run: str, paths: list[Path], hash_of: Callable[[Path], str]) -> str:
    table = campaign.source.imported
    assert table is not None
    options = table.model_dump(include={"step", "files"}) | _ends(campaign, run)
    curves = [
        _curve(campaign, index, name)
        for index, file in enumerate(table.files)
        for name, column in file.channels.items()
        if column.curve
    ]
    return key_of("record", run, [hash_of(path) for path in (*paths, *curves)], options)


def _curve(campaign: Campaign, index: int, name: str) -> Path:
    """Curve of a channel of a file, which has one."""
    table = campaign.source.imported
    assert table is not None
    key = f"import.files[{index}].channels.{name}.curve"
    return find(campaign.folder, str(table.files[index].channels[name].curve), campaign.where(key))


def _roles(campaign: Campaign) -> dict[str, Role]:
    """Every signal that a record may hold, and whether it drives the vehicle or observes it."""
    model = campaign.model(campaign.full)
    return {
        name: "control" if name in model.controls else "measurement"
        for name in (*model.controls, *model.channel_units())
    }


def _source(campaign: Campaign, file: FileTable, path: Path, index: int) -> LogSource:
    roles = _roles(campaign)
    idle = sorted(LAYOUT & file.model_fields_set)
    if idle and not format_of(path).is_text:
        raise InputError(
            campaign.where(f"import.files[{index}].{idle[0]}"),
            found=f"a key without effect: {path.name} is {format_of(path).name}",
            expected="keys that something reads",
            remedy=f"remove {', '.join(idle)}: they say how text is laid out",
        )
    channels = {
        name: ColumnMap(
            column.column,
            column.unit,
            roles.get(name, "measurement"),
            scale=column.scale,
            offset=column.offset,
            curve=read_curve(
                _curve(campaign, index, name), campaign.where(f"import.files[{index}].channels.{name}.curve")
            )
            if column.curve
            else None,
        )
        for name, column in file.channels.items()
    }
    return LogSource(
        path,
        None if file.time is None else file.time.column,
        None if file.time is None else file.time.unit,
        channels,
        clock=file.clock,
        delimiter=file.delimiter,
        encoding=file.encoding,
        skip_rows=file.skip_rows,
        header_rows=file.header_rows,
        names=None if file.names is None else tuple(file.names),
        table=file.table,
        axes=file.axes,
    )
