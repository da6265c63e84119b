"""Records as datasets, and on disk."""

import json
from pathlib import Path

import numpy as np

from seatrial.core.dataset import Dataset
from seatrial.core.dataset_file import open_dataset, write_dataset
from seatrial.core.errors import InputError
from seatrial.core.record import Channel, Provenance, Record, make_record

FORMAT = "seatrial record 1"


def record_dataset(record: Record) -> Dataset:
    """Return the record as a dataset over `time`, with unit and role of each channel as attributes."""
    columns = {
        channel.name: ("time", record.channel(channel.name), {"units": channel.unit, "role": channel.role})
        for channel in record.channels
    }
    provenance = record.provenance
    return Dataset(
        columns,
        coords={"time": ("time", record.time, {"long_name": "time", "axis": "T", "unit": "s"})},
        attrs={
            "format": FORMAT,
            "label": record.label,
            "configuration": record.configuration,
            "source": provenance.source,
            "sha256": provenance.sha256,
            "options": json.dumps(provenance.options, sort_keys=True),
        },
    )


def write_record(record: Record, path: Path) -> None:
    """Write the record to a NetCDF file, atomically."""
    write_dataset(path, record_dataset(record))


def read_record(path: Path) -> Record:
    """Read a record written by `write_record`.

    Raises:
        InputError: no such file, truncated or foreign file, or contents that are not a valid record.
    """
    dataset = open_dataset(path)
    if dataset.attrs.get("format") != FORMAT:
        raise InputError(
            str(path),
            found=f"format {dataset.attrs.get('format', 'not stated')!r}",
            expected=repr(FORMAT),
            remedy="import the file with `seatrial import`, or write it with this version",
        )
    try:
        channels = tuple(
            Channel(str(name), str(column.attrs["units"]), column.attrs["role"])
            for name, column in dataset.data_vars.items()
        )
        provenance = Provenance(dataset.attrs["source"], dataset.attrs["sha256"], json.loads(dataset.attrs["options"]))
        columns = {str(name): np.asarray(column.values, float) for name, column in dataset.data_vars.items()}
        time, label = np.asarray(dataset["time"].values, float), str(dataset.attrs["label"])
    except (KeyError, ValueError, TypeError) as cause:
        raise InputError(
            str(path),
            found=f"contents that are no record: {cause}",
            expected="the content of `write_record`: time, units and role of each channel, label, source, sha256, options",
            remedy="write the file again",
        ) from cause
    record = make_record(time, columns, channels, provenance, label)
    configuration = dataset.attrs.get("configuration")
    return record.in_configuration(configuration) if configuration else record
