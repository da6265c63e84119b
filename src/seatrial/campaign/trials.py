"""Getting the trial's records: simulated from the campaign's truth, or imported from real logs."""

import os
from dataclasses import dataclass
from pathlib import Path

import jax
import numpy as np

from seatrial.campaign.config import Campaign
from seatrial.campaign.designs import design_first, design_key
from seatrial.campaign.problem import random_key
from seatrial.campaign.schema import FileTable
from seatrial.campaign.store import Store, is_current, key_of, write_dataset
from seatrial.campaign.watch import SILENT, Watch
from seatrial.core.errors import InputError, nearest
from seatrial.core.files import sha256_of
from seatrial.core.record import Channel, Provenance, Record, make_record
from seatrial.core.record_file import read_record, record_dataset
from seatrial.core.signals import signal_unit
from seatrial.logs.align import align
from seatrial.logs.read import read_csv
from seatrial.logs.source import ColumnMap, LogSource
from seatrial.vehicles.simulate import simulate


@dataclass(frozen=True, eq=False)
class Trials:
    """Records that are fitted, records that are only predicted, and the key of them all."""

    fit: tuple[Record, ...]
    predict: tuple[Record, ...]
    key: str


def get_trials(campaign: Campaign, watch: Watch = SILENT) -> Trials:
    """Simulate or import, as the campaign says."""
    return simulate_trial(campaign, watch) if campaign.source.imported is None else import_trials(campaign, watch)


def simulate_trial(campaign: Campaign, watch: Watch = SILENT) -> Trials:
    """Run the best design on the simulated truth and store the record.

    Raises:
        InputError: a campaign that imports real logs instead.
    """
    if campaign.source.imported is not None:
        raise InputError(
            str(campaign.path), found="[import]", expected="[truth], to simulate", remedy="use `seatrial import`"
        )
    store = Store(campaign.folder)
    source = campaign.source
    key = key_of("simulate", design_key(campaign), source.truth, source.campaign.seed)
    path = store.record("trial")
    if not is_current(path, key):
        manoeuvre = design_first(campaign, watch).best.best_manoeuvre()
        time, control = manoeuvre.sample(campaign.family.sample_time)
        model = campaign.model(campaign.full)
        params = {term.text: source.truth.get(term.text, 0.0) for term in model.coefficients}
        start = np.array([campaign.hull.trim.get(state, 0.0) for state in model.states])
        states = np.asarray(
            simulate(model, params, control[:, None], np.full(time.size, campaign.family.sample_time), start)
        )
        if not np.isfinite(states).all():
            raise InputError(
                campaign.where("truth"),
                found="a simulated vehicle that diverges",
                expected="damping that dissipates",
                remedy="check signs: negative damping coefficients dissipate",
            )
        mask = campaign.measured_mask(time)
        columns = {campaign.family.control: control}
        for index, channel in enumerate(campaign.channels):
            exact = np.asarray(model.output(channel, params, tuple(states.T), (control,)))
            noise = campaign.noise(channel) * np.asarray(
                jax.random.normal(random_key(campaign, f"noise {channel}"), exact.shape)
            )
            columns[channel] = np.where(mask[:, index] > 0, exact + noise, np.nan)
        settings = {name: float(value) for name, value in manoeuvre.parameters.items()}
        provenance = Provenance(
            "simulated",
            key,
            {"manoeuvre": manoeuvre.name, **settings, "truth": source.truth, "seed": source.campaign.seed},
        )
        _write(
            path,
            make_record(
                time, columns, tuple(_channel(name, campaign.family.control) for name in columns), provenance, "trial"
            ),
            key,
        )
    return Trials((read_record(path),), (), key)


def import_trials(campaign: Campaign, watch: Watch = SILENT) -> Trials:
    """Read every run's files and store the records; runs whose files and options have not changed are kept.

    Raises:
        InputError: a campaign that simulates instead, or files that cannot be used.
    """
    table = campaign.source.imported
    if table is None:
        raise InputError(
            str(campaign.path), found="[truth]", expected="[import], to read logs", remedy="use `seatrial simulate`"
        )
    runs = [*table.fit, *table.predict]
    if len(set(runs)) < len(runs):
        raise InputError(
            campaign.where("import"),
            found="a run named twice in fit and predict",
            expected="each run once",
            remedy="a run that was fitted cannot also be a test of prediction",
        )
    records, keys = [], []
    for run in runs:
        record, key = _import_run(campaign, run)
        watch.say(f"run {run}: {record.time.size} samples, {record.time[-1]:.1f} s")
        records.append(record)
        keys.append(key)
    return Trials(tuple(records[: len(table.fit)]), tuple(records[len(table.fit) :]), key_of("import", keys, table.fit))


def _import_run(campaign: Campaign, run: str) -> tuple[Record, str]:
    table = campaign.source.imported
    assert table is not None
    if not run or any(character in run for character in "/\\\0") or run.startswith("."):
        raise InputError(
            campaign.where("import"),
            found=f"run {run!r}",
            expected="a plain name",
            remedy="it becomes a file name: use letters and digits",
        )
    paths = [_locate(campaign, file, run, index) for index, file in enumerate(table.files)]
    key = key_of(
        "record", run, [sha256_of(path) for path in paths], table.model_dump(include={"step", "start", "end", "files"})
    )
    path = Store(campaign.folder).record(run)
    if not is_current(path, key):
        sources = [
            _source(campaign, file, path, index)
            for index, (file, path) in enumerate(zip(table.files, paths, strict=True))
        ]
        seconds = {
            name: None if (text := getattr(table, name)) is None else campaign.si(text, "s", f"import.{name}")
            for name in ("step", "start", "end")
        }
        _write(path, align([read_csv(source) for source in sources], **seconds, label=run), key)
    return read_record(path), key


def _locate(campaign: Campaign, file: FileTable, run: str, index: int) -> Path:
    where = campaign.where(f"import.files[{index}].path")
    text = os.path.expandvars(file.path.replace("{run}", run))
    if "$" in text:
        raise InputError(
            where,
            found=f'"{file.path}" with a variable that is not set',
            expected="environment variables that are set",
            remedy="export the variable, or write the path out",
        )
    path = campaign.folder / Path(text).expanduser()
    if not path.is_file():
        raise InputError(
            where,
            found=f"no file {path}",
            expected="an existing file",
            remedy="correct the path; it is relative to the campaign's folder",
        )
    return path


def _source(campaign: Campaign, file: FileTable, path: Path, index: int) -> LogSource:
    model = campaign.model(campaign.full)
    known = (*model.controls, *model.channel_units())
    for name in file.channels:
        if name not in known:
            raise InputError(
                campaign.where(f"import.files[{index}].channels.{name}"),
                found=f'channel "{name}"',
                expected="one of " + ", ".join(known),
                remedy=nearest(name, known),
            )
    channels = {
        name: ColumnMap(
            column.column, column.unit, "control" if name in model.controls else "measurement", scale=column.scale
        )
        for name, column in file.channels.items()
    }
    return LogSource(
        path,
        file.time.column,
        file.time.unit,
        channels,
        clock=file.clock,
        delimiter=file.delimiter,
        encoding=file.encoding,
        skip_rows=file.skip_rows,
    )


def _channel(name: str, control: str) -> Channel:
    return Channel(name, signal_unit(name), "control" if name == control else "measurement")


def _write(path: Path, record: Record, key: str) -> None:
    write_dataset(path, record_dataset(record), key)
