"""Datasets on disk: NetCDF that any xarray user can open without seatrial, sealed so that a damaged file is never believed.

Behind the last byte of HDF5 stands the hash of all before it, which HDF5 passes over. It is checked before the library sees the file:
a few wrong bits can have it walk in circles without end. The attribute `sha256_of_content` is for files that another tool wrote again.
"""

import hashlib
import json
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.core.dataset import Dataset, Variable
from seatrial.core.errors import InputError
from seatrial.core.files import atomic_path, depend_on, kept_per_file

if TYPE_CHECKING:
    import h5py
    import xarray as xr

SEAL = "sha256_of_content"
_MARK = b"\nsha256 of all above: "
_TAIL = len(_MARK) + 65
_HEAP = b"GCOL\x01\0\0\0"
_PIECE = 1 << 24
# Attributes by which NetCDF-4 keeps dimensions in an HDF5 file.
_OF_NETCDF = frozenset(
    ("CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST", "_Netcdf4Dimid", "_Netcdf4Coordinates", "_NCProperties")
)
_NO_VARIABLE = "This is a netCDF dimension but not a netCDF variable"


def write_dataset(path: Path, dataset: "Dataset | xr.Dataset") -> None:
    """Write a NetCDF file atomically, with the hash of its content as the attribute `sha256_of_content`, and of its bytes behind them.

    HDF5 writes to memory: where a disk is full it would break the interpreter at its end.
    """
    content = _encoded(Dataset.of(dataset))
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        stream.write(content)
        stream.write(_MARK + hashlib.sha256(content).hexdigest().encode() + b"\n")


def open_dataset(path: Path) -> Dataset:
    """Load a whole NetCDF file into memory and close it.

    Raises:
        InputError: no such file, one that is truncated or not NetCDF, or one whose content was changed after it was written.
    """
    with stored(path) as file:
        file.visititems(lambda _, item: dict(item.attrs) and None)  # what is broken fails here, not in a destructor
        if is_sealed(path):  # its bytes were compared with their hash: that of the content would only cost time
            dataset = Dataset(**_decoded(file))
            dataset.attrs.pop(SEAL, None)
            return dataset
    with _sound(path):
        # Another tool wrote it: xarray knows every encoding that a NetCDF file may have.
        import xarray  # with pandas half a second, which files of our own need not wait for

        dataset = Dataset.of(xarray.load_dataset(path, engine="h5netcdf", decode_times=False))
        seal = dataset.attrs.pop(SEAL, None)
        damaged = seal is not None and seal != _hash(dataset)
    if damaged:
        raise _changed(path)
    return dataset


@contextmanager
def stored(path: Path) -> "Iterator[h5py.File]":
    """Open a NetCDF file to read some of it; whatever goes wrong with that is damage.

    Raises:
        InputError: as `open_dataset`, where the bytes behind the file tell; or what is read in the block is not there.
    """
    depend_on(path)
    if not path.is_file():
        raise InputError(
            str(path),
            found="a folder" if path.is_dir() else "no such file",
            expected="a NetCDF file",
            remedy="move it away and run the step that writes the file"
            if path.is_dir()
            else "run the step that writes it",
        )
    with _sound(path):
        if _is_changed(path):
            raise _changed(path)
        import h5py  # an answer that is given again reads no dataset

        with h5py.File(path) as file:
            dict(file.attrs)
            yield file


def is_sealed(path: Path) -> bool:
    """Return whether the hash of a file's bytes stands behind them, as in all that was not written again by another tool."""
    with path.open("rb") as stream:
        stream.seek(max(path.stat().st_size - _TAIL, 0))
        return stream.read().startswith(_MARK)


def check_heaps(path: Path) -> None:
    """Walk the global heaps of an HDF5 file, which hold strings and references: in an object of no size the library walks without end.

    Source: HDF5 File Format Specification 3.0, III.E.

    Raises:
        ValueError: a heap that makes no sense.
    """
    with path.open("rb") as stream:
        base, held = 0, b""
        while data := stream.read(_PIECE):
            piece, at = held + data, -1
            while (at := piece.find(_HEAP, at + 1)) >= 0:
                _check_heap(path, base + at)
            held = piece[-len(_HEAP) + 1 :]
            base += len(piece) - len(held)


@contextmanager
def _sound(path: Path) -> Iterator[None]:
    """Turn whatever the libraries raise on damaged bytes into an error for the user."""
    try:
        yield
    except InputError:
        raise
    except Exception as cause:
        raise InputError(
            str(path),
            found=f"{path.stat().st_size} bytes that cannot be read as NetCDF ({' '.join(str(cause).split())[:200]})",
            expected="a whole NetCDF-4 file",
            remedy="the file is truncated or of another kind: write it again",
        ) from cause


def _changed(path: Path) -> InputError:
    return InputError(
        str(path),
        found="content that does not match its hash",
        expected="the content as it was written",
        remedy="the file was damaged or edited: delete it and run the step that writes it",
    )


@kept_per_file(512)
def _is_changed(path: Path) -> bool:
    """Whether the bytes are others than those that were written, as far as they tell; asked once while a file stays as it is."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        stream.seek(max(size - _TAIL, 0))
        tail = stream.read()
        if not tail.startswith(_MARK):
            check_heaps(path)
            if _MARK[:8] in tail:
                raise ValueError("its end is cut off")
            return False
        stream.seek(0)
        digest, left = hashlib.sha256(), size - _TAIL
        while left and (piece := stream.read(min(left, _PIECE))):
            digest.update(piece)
            left -= len(piece)
    return tail != _MARK + digest.hexdigest().encode() + b"\n"


def _encoded(dataset: Dataset) -> bytes:
    """Return a NetCDF-4 file as xarray would write it: missing numbers are NaN, booleans whole numbers, coordinates named by attributes."""
    import h5netcdf

    stream, axes = BytesIO(), set(dataset.sizes)
    beside = sorted(dataset.coordinates - axes)
    with h5netcdf.File(stream, "w") as file:
        file.dimensions = dataset.sizes
        named = set()
        for name, one in dataset.variables.items():
            near = (
                []
                if name in dataset.coordinates
                else [x for x in beside if {*dataset.variables[x].dims} <= {*one.dims}]
            )
            named |= {*near}
            _write_variable(file, name, one, {"coordinates": " ".join(near)} if near else {})
        alone = [name for name in beside if name not in named]
        others = {"coordinates": " ".join(alone)} if alone else {}
        file.attrs.update({**dataset.attrs, **others, SEAL: _hash(dataset)})
    return stream.getvalue()


def _write_variable(file: Any, name: str, one: Variable, attrs: dict[str, str]) -> None:
    import h5py

    values, kind = one.values, one.values.dtype.kind
    if kind == "b":
        values, attrs = values.astype("i1"), {**attrs, "dtype": "bool"}
    elif kind not in "fiu":
        values = values.astype(object)
    stored = h5py.string_dtype() if values.dtype.kind == "O" else values.dtype
    fill = values.dtype.type("nan") if kind == "f" else None
    made = file.create_variable(name, one.dims, stored, data=values, fillvalue=fill)
    made.attrs.update({**one.attrs, **attrs})


def _decoded(file: "h5py.File") -> dict[str, Any]:
    """Return the parts of a dataset as `write_dataset` has encoded it, in an eighth of the time that xarray takes for any NetCDF file.

    Source: NetCDF-4 file format (dimension scales), and xarray's encoding of booleans, fill values and coordinates.
    """
    import h5py

    variables: dict[str, Any] = {}
    attrs = _attributes(file)
    others = {*str(attrs.pop("coordinates", "")).split()}
    for name, item in file.items():
        if text_of(item.attrs.get("NAME", "")).startswith(_NO_VARIABLE):
            continue
        about = _attributes(item)
        about.pop("_FillValue", None)
        others |= {*str(about.pop("coordinates", "")).split()}
        values = np.asarray(item.asstr()[()] if h5py.check_string_dtype(item.dtype) else item[()])
        values = values.astype(str) if values.dtype.kind == "O" else values
        scales = [str(file[reference[0]].name)[1:] for reference in item.attrs.get("DIMENSION_LIST", ())]
        dims = tuple(scales) or ((name,) if "CLASS" in item.attrs else ())
        variables[name] = (dims, values.astype(bool) if about.pop("dtype", None) == "bool" else values, about)
        others |= {name} if dims == (name,) else set()
    data = {name: one for name, one in variables.items() if name not in others}
    return {"data_vars": data, "coords": {name: variables[name] for name in others}, "attrs": attrs}


def _attributes(item: Any) -> dict[str, Any]:
    """Attributes that users see, single values as such."""
    attributes = {name: value for name, value in item.attrs.items() if name not in _OF_NETCDF}
    return {name: _plain(value) for name, value in attributes.items()}


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray) and value.dtype.kind in "SO":
        texts = [text_of(one) for one in value.ravel()]
        return texts[0] if len(texts) == 1 else texts
    if isinstance(value, np.ndarray) and value.size == 1:
        return value.ravel()[0]
    return text_of(value) if isinstance(value, bytes) else value


def text_of(value: object) -> str:
    """Return an attribute or a name of an HDF5 file as text."""
    return value.decode() if isinstance(value, bytes) else str(value)


def _hash(dataset: Dataset) -> str:
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


def _check_heap(path: Path, place: int) -> None:
    with path.open("rb") as stream:
        stream.seek(place + 8)
        size = int.from_bytes(stream.read(8), "little")
        at, end = 16, min(size, path.stat().st_size - place)
        while at + 16 <= end:
            stream.seek(place + at)
            index, _, _, length = struct.unpack("<HHIQ", stream.read(16))
            step = length if index == 0 else 16 + -(-length // 8) * 8
            if step < 16 or at + step > end:
                raise ValueError(f"an invalid heap at byte {place + at}")
            at += step
