"""Numeric arrays of an HDF5 file by path, read a block of rows at a time; NetCDF 4 and MATLAB 7.3 stand on it."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from h5py import h5o  # pyright: ignore[reportAttributeAccessIssue]

from seatrial.core.dataset_file import check_heaps
from seatrial.core.errors import InputError

_MAX_DEPTH = 32
_MAX_ARRAYS = 20_000
_MAX_CHUNK_BYTES = 1 << 28
# Bytes of an array that stay unpacked: a piece of it that is larger is unpacked again for every block of rows
_CACHE_BYTES = 1 << 26
_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_MAX_EXPANSION = 2000  # How many times larger an array may be than what the file keeps of it; deflate reaches 1032


@contextmanager
def opened(path: Path) -> Iterator[h5py.File]:
    """Open a file to read, having checked what the library would follow without end.

    Raises:
        ValueError: a damaged heap.
        InputError: a damaged superblock.
    """
    _check_superblock(path)
    check_heaps(path)
    with h5py.File(path, "r", locking=False, rdcc_nbytes=_CACHE_BYTES) as file:
        yield file


def arrays(group: Any, prefix: str = "", seen: set[tuple[int, int]] | None = None) -> Iterator[tuple[str, Any]]:
    """Yield the numeric datasets below a group as (path with slashes, dataset), without links out of the file and empty ones.

    A group that has several paths is listed by the first only: groups that share others have more paths than can be followed.

    Args:
        group: file or group to begin from.
        prefix: its path with a slash at the end; empty for the file.
        seen: file and address of the groups that were listed.
    """
    seen = set() if seen is None else seen
    about = h5o.get_info(group.id)
    if prefix.count("/") > _MAX_DEPTH or (about.fileno, about.addr) in seen or len(seen) > _MAX_ARRAYS:
        return
    seen.add((about.fileno, about.addr))
    count = 0
    for name in group:
        link = group.get(name, getlink=True)
        if isinstance(link, h5py.ExternalLink | h5py.SoftLink) or name == "#refs#":
            continue
        item = group[name]
        if isinstance(item, h5py.Group):
            yield from arrays(item, f"{prefix}{name}/", seen)
        elif (
            isinstance(item, h5py.Dataset)
            and item.shape is not None
            and item.dtype.kind in "biuf"
            and not item.external
            and not item.is_virtual
        ):
            count += 1
            _check_size(item)
            yield f"{prefix}{name}", item
        if count > _MAX_ARRAYS:
            return


def _check_size(dataset: Any) -> None:
    """Refuse an array that claims more than the file can hold, or that opens only in pieces too large for memory."""
    size, kept = dataset.size * dataset.dtype.itemsize, dataset.id.get_storage_size()
    chunk = int(np.prod(dataset.chunks, dtype=float)) * dataset.dtype.itemsize if dataset.chunks else 0
    if size > (1 << 20) + _MAX_EXPANSION * kept or chunk > _MAX_CHUNK_BYTES + size:
        raise InputError(
            f'{dataset.file.filename}, array "{dataset.name}"',
            found=f"shape {dataset.shape} in pieces of {chunk} bytes, of which the file keeps {kept} bytes in all",
            expected="an array that the file contains",
            remedy="the file is damaged: copy or save it again",
        )


def _check_superblock(path: Path) -> None:
    """Refuse an address of a driver, which files in several parts have: the library takes as many gigabytes as stand there.

    Source: HDF5 File Format Specification 3.0, II.A.
    """
    with path.open("rb") as stream:
        data, place = b"", 0
        while data[:8] != _SIGNATURE:
            stream.seek(place)
            data = stream.read(64)
            if len(data) < 64:
                return
            place = max(512, 2 * place)
    version, width = data[8], data[13]
    at = (24 if version == 0 else 28) + 3 * width
    if version < 2 and data[at : at + width] != b"\xff" * width:
        raise InputError(
            str(path),
            found=f"the address of a driver at byte {at} of the superblock",
            expected="a whole HDF5 file in one part",
            remedy="the file is damaged: copy or save it again",
        )
