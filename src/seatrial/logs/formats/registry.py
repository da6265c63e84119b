"""All formats, and the one that a log has: told by its first bytes, and by its suffix where they say nothing."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from seatrial.core.errors import InputError, nearest
from seatrial.core.files import depend_on, sha256_of, sha256_of_json
from seatrial.core.processes import Elsewhere, apart
from seatrial.logs.formats import dataflash, matlab, mcap_json, moos, netcdf, npz, parquet, ros, telemetry, text, ulog
from seatrial.logs.formats.protocol import Block, LogFile, LogFormat, RawTable, TableInfo, Wanted, unreadable

Answer = TypeVar("Answer")

FORMATS: tuple[LogFormat, ...] = (
    parquet.FORMAT,
    netcdf.FORMAT,
    matlab.FORMAT,
    npz.FORMAT,
    ros.BAG,
    ros.FOLDER,
    mcap_json.FORMAT,
    ros.MCAP,
    ros.SQLITE,
    dataflash.FORMAT,
    telemetry.FORMAT,
    ulog.FORMAT,
    moos.FORMAT,
    text.FORMAT,
)
_HEAD = 512
_SPREADSHEETS = (".xlsx", ".xlsm", ".xlsb", ".xls", ".ods", ".numbers")


def format_of(path: Path) -> LogFormat:
    """Tell the format of a log.

    Raises:
        InputError: no such file, a folder that is no bag, or bytes that are not what the suffix says.
    """
    head = _head(path)
    name = path.name.lower()
    by_suffix = next((format for format in FORMATS if name.endswith(format.suffixes)), None)
    if by_suffix is not None and by_suffix.recognises(path, head):
        return by_suffix
    by_content = next((format for format in FORMATS if format.recognises(path, head)), None)
    if by_content is not None:
        return by_content
    if name.endswith(_SPREADSHEETS):
        raise InputError(
            str(path),
            found="a spreadsheet",
            expected="a log, or a table as text",
            remedy="export the sheet with the log as CSV",
        )
    if by_suffix is None or by_suffix.is_text:
        return text.FORMAT
    raise InputError(
        str(path),
        found="an empty file" if not head else f"a file without the first bytes of {by_suffix.name} does",
        expected=f"{by_suffix.name}, by its suffix",
        remedy="copy or export the log again, or correct the suffix",
    )


def catalogue(log: LogFile) -> tuple[TableInfo, ...]:
    """List the tables of a log and their columns, without keeping its data.

    Raises:
        InputError: a log that cannot be read, or one that holds no table.
    """
    form = format_of(log.path)
    with reading(log.path, form.name):
        tables = tuple(_asked(form, form.catalogue, log))
    if not tables:
        raise InputError(
            str(log.path),
            found=f"{form.name} without a table of numbers",
            expected="at least one",
            remedy="record or export the log again",
        )
    return tables


def stream(log: LogFile, wanted: Wanted) -> Iterator[Block]:
    """Stream the wanted columns of several tables in one pass.

    Raises:
        InputError: a log that cannot be read.
    """
    form = format_of(log.path)
    with reading(log.path, form.name):
        yield from _asked(form, form.blocks, log, wanted)


def read_columns(
    log: LogFile, table: str, columns: Sequence[str], stamps: Sequence[str] = (), words: Sequence[str] = ()
) -> RawTable:
    """Read some columns of one table, keeping nothing else.

    Args:
        log: where.
        table: its name in the catalogue.
        columns: to read; those of the catalogue, or other elements of its arrays.
        stamps: those of them that hold time stamps, which stay exact.
        words: those of them that hold words.

    Raises:
        InputError: a log that cannot be read.
    """
    form = format_of(log.path)
    if form.read is not None:
        with reading(log.path, form.name):
            return form.read(log, table, columns, stamps, words)
    parts: dict[str, list[np.ndarray]] = {name: [] for name in columns}
    for block in stream(log, {table: columns}):
        for name, part in parts.items():
            part.append(block.columns[name])
    return RawTable({name: np.concatenate(part) if part else np.empty(0) for name, part in parts.items()})


def pick(tables: Sequence[TableInfo], name: str | None, where: str) -> TableInfo:
    """Return the table of a name, or the only one.

    Args:
        tables: of the log.
        name: of the table; None for the only one.
        where: file, for the error.

    Raises:
        InputError: no such table, none named though there are several, or one that cannot be read.
    """
    names = [table.name for table in tables]
    is_only = name is None and len(tables) == 1
    chosen = next((table for table in tables if is_only or table.name == name), None)
    if chosen is None:
        listed = "" if len(names) <= 20 else "`seatrial inspect` lists them"
        raise InputError(
            f"{where}, table",
            found=f"{len(tables)} tables and none named" if name is None else f'"{name}"',
            expected="one of " + ", ".join(names[:20]) + (f" and {len(names) - 20} more" if listed else ""),
            remedy="name the table; `seatrial inspect` shows the columns of each"
            if name is None
            else nearest(name, names, listed),
        )
    if chosen.trouble:
        raise InputError(
            f'{where}, table "{chosen.name}"',
            found=chosen.trouble,
            expected="a table that can be read",
            remedy="choose another table, or record the log with its definitions",
        )
    return chosen


def hash_of_log(path: Path) -> str:
    """Return the SHA-256 of a log's bytes; of the hashes of its files where it is a folder."""
    if not path.is_dir():
        return sha256_of(path)
    depend_on(path)
    return sha256_of_json({file.name: sha256_of(file) for file in sorted(path.iterdir()) if file.is_file()})


@contextmanager
def reading(path: Path, what: str) -> Iterator[None]:
    """Turn whatever a library raises on a damaged log into an error for the user."""
    try:
        yield
    except InputError:
        raise
    except Exception as cause:
        text = " ".join(str(cause).split())[:200] or "no reason given"
        kind = cause.kind if isinstance(cause, Elsewhere) else type(cause).__name__
        raise InputError(
            str(path),
            found=f"{what} that cannot be read ({kind}: {text})",
            expected="a whole log",
            remedy="the log is cut off or damaged: copy or export it again",
        ) from cause


def _asked(form: LogFormat, question: Callable[..., Iterable[Answer]], log: LogFile, *about: Any) -> Iterator[Answer]:
    """Return the answers of a format, from a separate process where its library may break."""
    if not form.memory:
        return iter(question(log, *about))
    files = log.path.iterdir() if log.path.is_dir() else (log.path,)
    size = sum(file.stat().st_size for file in files)
    return apart(str(log.path), question, log, *about, memory=form.memory + 4 * size)


def _head(path: Path) -> bytes:
    if path.is_dir():
        if ros.FOLDER.recognises(path, b""):
            return b""
        raise InputError(
            str(path),
            found="a folder",
            expected="a log file, or the folder of a ROS 2 bag with its metadata.yaml",
            remedy="check the path",
        )
    if not path.is_file():
        raise InputError(str(path), found="no such file", expected="a log file", remedy="check the path")
    try:
        with path.open("rb") as stream:
            return stream.read(_HEAD)
    except OSError as cause:
        raise unreadable(path, cause) from cause
