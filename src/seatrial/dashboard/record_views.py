"""Views of stored records between two times: long ones from an index of their blocks, short ones from the rows themselves.

The index holds the least and greatest of every block of rows. It is made once while a file stays as it is, in the process that
answers; after that no view reads more rows than a few for each column of pixels.
"""

import json
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from seatrial.core.dataset_file import stored, text_of
from seatrial.core.display_units import shown_unit
from seatrial.core.record import SIMULATED
from seatrial.dashboard.downsample import COLUMNS, Envelope, Load, envelopes, load_of, rows_of, rows_view
from seatrial.dashboard.view_models import RecordAbout

BLOCK_ROWS = 512
"""Rows of a block of the index."""
READ_ROWS = 1 << 18
"""Rows that are read at a time while the index is made; their columns fit into a cache."""


class Index(NamedTuple):
    """Blocks of rows: the time of the first row of each, and the least and greatest of every curve there.

    Attributes:
        time: s, of the first row of each block, shape (b,).
        rows: in all.
        last: time of the last row, s.
        least: by curve, NaN if nothing was measured, shape (b,).
        greatest: likewise.
    """

    time: Float[np.ndarray, " b"]
    rows: int
    last: float
    least: Mapping[str, Float[np.ndarray, " b"]]
    greatest: Mapping[str, Float[np.ndarray, " b"]]


def index_of(rows: int, load: Load) -> Index:
    """Read all rows once.

    Args:
        rows: how many there are.
        load: gives some rows of every curve, `time` among them.
    """
    firsts: list[np.ndarray] = []
    ends: dict[str, tuple[list[np.ndarray], list[np.ndarray]]] = {}
    last = float("nan")
    for begin in range(0, rows, READ_ROWS):
        columns = dict(load(begin, min(begin + READ_ROWS, rows)))
        time = columns.pop("time")
        starts = np.arange(0, time.size, BLOCK_ROWS)
        firsts.append(time[starts])
        last = float(time[-1])
        for name, values in columns.items():
            least, greatest = ends.setdefault(name, ([], []))
            least.append(np.fmin.reduceat(values, starts))
            greatest.append(np.fmax.reduceat(values, starts))
    joined = {name: tuple(map(np.concatenate, both)) for name, both in ends.items()}
    least, greatest = ({name: both[at] for name, both in joined.items()} for at in (0, 1))
    return Index(np.concatenate(firsts), rows, last, least, greatest)


def view_of(index: Index, load: Load, start: float, end: float, columns: int) -> dict[str, Envelope]:
    """Curves between two times, and one row beyond each end where there is one.

    Args:
        index: of `index_of`.
        load: as there.
        start: s.
        end: s.
        columns: of pixels.
    """
    low = max(int(np.searchsorted(index.time, start, side="right")) - 1, 0)
    high = max(int(np.searchsorted(index.time, end, side="right")), low + 1)
    if high - low > 2 * columns:  # a column of pixels holds two blocks or more
        low, high = max(low - 1, 0), min(high + 1, index.time.size)
        least, greatest = (load_of(one)(low, high) for one in (index.least, index.greatest))
        return envelopes(index.time[low:high], least, greatest, columns)
    return rows_view(load(low * BLOCK_ROWS, min(high * BLOCK_ROWS + 1, index.rows)), start, end, columns)


def ready() -> bool:
    """Nothing, but what reading a file needs is imported, and units are known, then."""
    return shown_unit("n")[1] == "rpm"


def about_record(path: Path) -> RecordAbout:
    """Return what a stored record holds, and which part of its files it is.

    Raises:
        InputError: no NetCDF-4 file, a damaged one, or no record.
    """
    with stored(path) as file:
        names = _names(file)
        options, source = json.loads(text_of(file.attrs["options"])), text_of(file.attrs["source"])
        roles = {name: text_of(file[name].attrs["role"]) for name in names}
        rows, last = file["time"].shape[0], float(np.asarray(file["time"][-1:])[0])  # pyright: ignore
    return about(roles, rows, last, options, source)


def about(roles: Mapping[str, str], rows: int, last: float, options: Mapping[str, Any], source: str) -> RecordAbout:
    """Return what a record holds.

    Args:
        roles: `control` or `measurement`, by channel.
        rows: samples.
        last: time of the last, s from the first.
        options: of its provenance.
        source: of its provenance.
    """
    start = origin_of(options, source)
    names = tuple(sorted(roles, key=lambda name: roles[name] == "control"))
    return RecordAbout(
        names,
        tuple(shown_unit(name)[1] for name in names),
        tuple(roles[name] for name in names),
        rows,
        start,
        start + last,
        float(options.get("available", start + last)),
        source,
        (*options.get("notes", ()), *options.get("cautions", ())),
    )


def origin_of(options: Mapping[str, Any], source: str) -> float:
    """Begin of a record, s from the beginning of the record; `start` of a simulated one is that of its manoeuvre."""
    return 0.0 if source == SIMULATED else float(options.get("start") or 0.0)


def record_view(path: Path, start: float, end: float, columns: int = COLUMNS) -> dict[str, Envelope]:
    """Curves of a stored record in the units in which they are shown, over seconds from the beginning of the record.

    Raises:
        InputError: no NetCDF-4 file, a damaged one, or no record.
    """
    there = path.stat()
    index, origin = _record_index(path, there.st_size, there.st_mtime_ns)
    with stored(path) as file:
        curves = view_of(index, _loader(file), start - origin, end - origin, columns)
    return {name: in_shown(name, curve, origin) for name, curve in curves.items()}


def in_shown(name: str, curve: Envelope, origin: float = 0.0) -> Envelope:
    """Return a curve in the unit in which its channel is shown, over seconds from `origin` earlier on."""
    factor = shown_unit(name)[0]
    return Envelope(curve.time + origin, curve.least * factor, curve.greatest * factor)


def read_ahead(path: Path) -> None:
    """Check a record and index it, before anybody waits for it.

    Raises:
        InputError: no NetCDF-4 file, a damaged one, or no record.
    """
    there = path.stat()
    _record_index(path, there.st_size, there.st_mtime_ns)


@lru_cache(maxsize=16)
def _record_index(path: Path, size: int, at: int) -> tuple[Index, float]:
    """Index of a record, and its begin; made again when the file changes."""
    del size, at  # parts of the key only
    with stored(path) as file:
        origin = origin_of(json.loads(text_of(file.attrs["options"])), text_of(file.attrs["source"]))
        return index_of(file["time"].shape[0], _loader(file)), origin  # pyright: ignore[reportAttributeAccessIssue]


def _names(file: Any) -> list[str]:
    return [name for name in file if name != "time" and "role" in file[name].attrs]


def _loader(file: Any) -> Load:
    names = ["time", *_names(file)]
    return lambda a, b: {name: rows_of(file, name, a, b) for name in names}
