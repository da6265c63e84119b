"""Datasets on disk: NetCDF that any xarray user can open without seatrial, sealed so that a damaged file is never believed."""

import hashlib
import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr

from seatrial.core.errors import InputError
from seatrial.core.files import atomic_path

SEAL = "sha256_of_content"


def write_dataset(path: Path, dataset: xr.Dataset) -> None:
    """Write a NetCDF file atomically, with the hash of its content as the attribute `sha256_of_content`."""
    with atomic_path(path) as temporary:
        dataset.assign_attrs({SEAL: _hash(dataset)}).to_netcdf(temporary, engine="h5netcdf")


def open_dataset(path: Path) -> xr.Dataset:
    """Load a whole NetCDF file into memory and close it.

    Raises:
        InputError: no such file, one that is truncated or not NetCDF, or one whose content was changed after it was written.
    """
    if not path.is_file():
        raise InputError(
            str(path), found="no such file", expected="a NetCDF file", remedy="run the step that writes it"
        )
    try:
        _visit(path)
        dataset = xr.load_dataset(path, engine="h5netcdf", decode_times=False)
        seal = dataset.attrs.pop(SEAL, None)
        damaged = seal is not None and seal != _hash(dataset)
    except (OSError, LookupError, ValueError, TypeError, AttributeError, RuntimeError) as cause:
        raise InputError(
            str(path),
            found=f"{path.stat().st_size} bytes that cannot be read as NetCDF ({cause})",
            expected="a whole NetCDF-4 file",
            remedy="the file is truncated or of another kind: write it again",
        ) from cause
    if damaged:
        raise InputError(
            str(path),
            found="content that does not match its hash",
            expected="the content as it was written",
            remedy="the file was damaged or edited: delete it and run the step that writes it",
        )
    return dataset


def _visit(path: Path) -> None:
    """Touch every object: what is broken fails here, with a plain error, and not in the destructor of a half-open file."""
    with h5py.File(path) as file:
        dict(file.attrs)
        file.visititems(lambda _, item: dict(item.attrs) and None)


def _hash(dataset: xr.Dataset) -> str:
    """Hash of variables and attributes, the same before and after a round trip through a file."""
    digest = hashlib.sha256(_text(dataset.attrs))
    for name in sorted(map(str, dataset.variables)):
        variable = dataset.variables[name]
        digest.update(_text([name, list(map(str, variable.dims)), variable.attrs]))
        values = np.asarray(variable.values)
        digest.update(values.tobytes() if values.dtype.kind in "fiub" else _text(values.astype(str).tolist()))
    return digest.hexdigest()


def _text(content: Any) -> bytes:
    """Attributes as JSON; numbers of any kind become plain ones."""
    return json.dumps(content, sort_keys=True, default=lambda value: np.asarray(value).tolist()).encode()
