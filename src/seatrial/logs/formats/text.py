"""CSV and TSV: one table, its columns named by the header; a cell that is neither empty nor a number is an error.

The text is gone through twice: rows are found and their cells counted, so that every fault has its line; then pandas parses the wanted
columns. Both take quotation marks as RFC 4180 does.
"""

import csv
import gzip
import re
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from io import TextIOWrapper
from itertools import chain, islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from jaxtyping import Bool, Float

from seatrial.core.errors import InputError, nearest
from seatrial.logs.formats.protocol import (
    Block,
    ColumnInfo,
    LogFile,
    LogFormat,
    NoColumn,
    RawTable,
    TableInfo,
    Wanted,
    clock_unit,
    clocks_among,
    unreadable,
)
from seatrial.logs.formats.text_layout import WHITESPACE, codec_of, is_date, nanoseconds, signs_of, split_stamps
from seatrial.logs.known_messages import message_of_file

TABLE = "rows"
_SAMPLE_ROWS = 10_000  # Rows that tell which columns hold numbers
_PIECE_ROWS = 1 << 16  # Rows that are parsed at a time
_MAX_LINE_BYTES = 1 << 24
_MAX_STAMP_LENGTH = 40
_MAX_STAMP = 2.0**62
_NO_STAMP = "correct the stamp, remove the row, or map another clock"
_NO_DATE = (
    "correct the stamp or remove the row. For a leap second (23:59:60) map a clock that counts seconds, or import two runs, before and "
    "after it"
)
_SPACES = re.compile(r"[ \t]+")
_GZIP = b"\x1f\x8b"
_MAGIC = {
    _GZIP: "gzip data",
    b"PK\x03\x04": "a zip archive or a spreadsheet",
    b"\xd0\xcf\x11\xe0": "a spreadsheet",
    b"\x89HDF": "an HDF5 or NetCDF file",
    b"#ROSBAG": "a ROS bag",
    b"SQLite": "an SQLite database",
    b"PAR1": "a Parquet file",
    b"%PDF": "a PDF",
    b"\xff\xfe": "UTF-16 text",
    b"\xfe\xff": "UTF-16 text",
}

_Row = tuple[int, int, str | list[str]]
"""Line at which a row begins, as a text editor counts; number of its cells; the cells, as text where none is quoted."""
_Stamps = tuple[np.ndarray, int]
"""Stamps times 10^decimals, int64, and those decimals; text and 0 if a number does not fit."""


@dataclass(frozen=True)
class _Layout:
    """What the first pass finds.

    Attributes:
        names: of the columns.
        above: lines above the first row of numbers.
        rows: how many there are.
        last: line of the last.
        empty: rows of nothing but delimiters at the end, as spreadsheets leave them.
    """

    names: tuple[str, ...]
    above: int
    rows: int
    last: int
    empty: int


class _Rounded(Exception):
    """Stamps that must be parsed as text, since floats may not hold them."""


def _recognises(path: Path, head: bytes) -> bool:
    """Recognise nothing for certain: any text may be a table."""
    return False


def _catalogue(log: LogFile) -> tuple[TableInfo, ...]:
    """List the columns that hold a number in the first rows."""
    with _opened(log) as (stream, _):
        names, rows = _header(log, _rows(log, stream))
        first, *others = islice(rows, _SAMPLE_ROWS)
    layout = _Layout(names, first[0] - 1, 1 + len(others), first[0], 0)
    single = [at for at, name in enumerate(names) if names.count(name) == 1]
    cells = next(_frames(log, layout, single))[0] if single else {}
    signs, dates = signs_of(log), [names[at] for at in single if _are_dates(cells[at])]
    numeric = {names[at]: values for at in single if np.isfinite(values := _floats(cells[at])).any()}
    stated = dict(zip(names, signs.units, strict=False))
    clocks, columns = clocks_among(
        [ColumnInfo(name, stated.get(name) or _unit_of_stamps(name, numeric[name])) for name in numeric]
    )
    whole = [*dates, *split_stamps(names)]
    notes = ()
    if not signs.has_header:
        notes = (f"no header: the first row holds numbers, and the columns are named {names[0]} to {names[-1]}",)
        clocks = tuple(name for name in names if name in numeric and (np.diff(numeric[name]) > 0).all())[:1]
        columns = tuple(ColumnInfo(name, "s" if name in clocks else unit) for name, unit in columns)
    columns = (*(ColumnInfo(name, "ns") for name in whole), *columns)
    words = tuple(
        names[at] for at in single if names[at] not in numeric and names[at] not in dates and _has_words(cells[at])
    )
    kind = message_of_file(log.path.stem)
    return (TableInfo(TABLE, columns, (*whole, *clocks), kind=kind, notes=notes, words=words, dates=tuple(dates)),)


def _are_dates(cells: np.ndarray) -> bool:
    return cells.dtype.kind not in "iuf" and cells.size > 0 and is_date(str(cells[0]))


def _has_words(cells: np.ndarray) -> bool:
    return cells.dtype.kind == "O" and any(isinstance(cell, str) for cell in cells)


def _unit_of_stamps(name: str, values: np.ndarray) -> str | None:
    """Return seconds for a column whose name alone says nanoseconds, of which there are no fractions."""
    return "s" if clock_unit(name) == "ns" and (values[np.isfinite(values)] % 1).any() else None


def _blocks(log: LogFile, wanted: Wanted) -> Iterator[Block]:
    """Stream columns; cells that are not numbers come as NaN."""
    layout = _survey(log)
    pairs = split_stamps(layout.names)
    names = wanted.get(TABLE, ())
    at = {name: _find(name, layout.names, log) for name in _parts(names, pairs)}
    for cells, done in _frames(log, layout, sorted(set(at.values()))) if at else ():
        plain = {name: _plain(cells[place]) for name, place in at.items()}
        yield Block(TABLE, {name: _whole(name, plain, pairs) for name in names}, done)


def _parts(names: Sequence[str], pairs: Mapping[str, tuple[str, str]]) -> list[str]:
    """Return the columns of which some are made: a stamp of its seconds and nanoseconds."""
    return list(dict.fromkeys(part for name in names for part in pairs.get(name, (name,))))


def _whole(name: str, columns: Mapping[str, np.ndarray], pairs: Mapping[str, tuple[str, str]]) -> np.ndarray:
    if name not in pairs:
        return columns[name]
    seconds, nanos = (columns[part] for part in pairs[name])
    return seconds * 10**9 + nanos


def _read(log: LogFile, table: str, columns: Sequence[str], stamps: Sequence[str], words: Sequence[str]) -> RawTable:
    """Read columns, refusing cells that are not numbers; stamps stay whole numbers, or decimal ones as text, and words words."""
    layout = _survey(log)
    pairs = split_stamps(layout.names)
    at = {name: _find(name, layout.names, log) for name in _parts(columns, pairs)}
    stamps = _parts(stamps, pairs)
    word_types = {at[name]: str for name in words}
    try:
        values, decimals = _columns(log, layout, at, stamps, word_types, words)
    except _Rounded:
        kinds = {at[name]: f"S{_MAX_STAMP_LENGTH + 1}" for name in stamps}
        values, decimals = _columns(log, layout, at, stamps, kinds | word_types, words)
    notes = (f"{layout.empty} empty rows at the end were left out",) if layout.empty else ()
    values = {name: _whole(name, values, pairs) for name in columns}
    return RawTable(values, lambda row: _row(log, row)[0], notes, decimals)


def _columns(
    log: LogFile,
    layout: _Layout,
    at: dict[str, int],
    stamps: Sequence[str],
    kinds: dict[int, Any],
    words: Sequence[str],
) -> tuple[dict[str, np.ndarray], dict[str, int]]:
    """Return all rows of some columns, of which stamps may be kept as text, and the decimals of the stamps.

    Raises:
        _Rounded: stamps that are not whole numbers and were not kept as text.
    """
    parts: dict[str, list[Any]] = {name: [] for name in at}
    first = 0
    for frame, _ in _frames(log, layout, sorted(set(at.values())), kinds):
        for name, place in at.items():
            if name in words:
                parts[name].append(
                    np.array([cell.strip() if isinstance(cell, str) else "" for cell in frame[place]], object)
                )
                continue
            if name in stamps and frame[place].dtype.kind not in "iu" and place not in kinds:
                raise _Rounded
            read = _stamps if name in stamps else _checked
            parts[name].append(read(frame[place], log, first, place, name))
        first += len(next(iter(frame.values())))
    joined = {name: _joined(parts[name]) for name in stamps}
    values = {name: joined[name][0] if name in joined else np.concatenate(parts[name]) for name in at}
    return values, {name: decimals for name, (_, decimals) in joined.items()}


def _checked(
    cells: np.ndarray, log: LogFile, first: int, place: int, name: str, remedy: str = ""
) -> Float[np.ndarray, " n"]:
    """Return a parsed column as float64, NaN if a cell is empty.

    Raises:
        InputError: the first cell that is neither empty nor a finite number.
    """
    import pandas as pd

    values = _floats(cells)
    is_text = np.isnan(values) & np.asarray(pd.notna(cells))
    _refuse(is_text, log, first, place, name, "a number", remedy)
    _refuse(np.isinf(values), log, first, place, name, "a finite number", remedy)
    return values


def _floats(cells: np.ndarray) -> Float[np.ndarray, " n"]:
    """Convert a parsed column; NaN if a cell is not a number."""
    if cells.dtype.kind in "iuf":
        return cells.astype(float)
    import pandas as pd

    return np.asarray(pd.to_numeric(np.array([str(cell) for cell in cells], object), errors="coerce"), float)


def _plain(cells: np.ndarray) -> np.ndarray:
    if _are_dates(cells):
        stamps, none = nanoseconds([str(cell) for cell in cells])
        return np.where(none, np.nan, stamps) if none.any() else stamps
    return cells if cells.dtype in (np.int64, np.float64) else _floats(cells)


def _stamps(cells: np.ndarray, log: LogFile, first: int, place: int, name: str) -> _Stamps:
    """Return the stamps of some rows: 1669909203.330 as 1669909203330 and 3 decimals, if they are so plain, or as text.

    Raises:
        InputError: the first row without a stamp, or with one that is no number or too long.
    """
    if cells.dtype.kind in "iu":
        return _scaled(cells, 0, 0) or (cells, 0)
    texts: Any = np.strings.strip(np.asarray(cells, "S"))
    if signs_of(log).decimal == ",":
        texts = np.strings.replace(texts, b",", b".")
    length, point = np.strings.str_len(texts), np.strings.find(texts, b".")
    _refuse(length == 0, log, first, place, name, "a time stamp in every row", _NO_STAMP)
    expected = f"a time stamp of at most {_MAX_STAMP_LENGTH} characters"
    _refuse(length > _MAX_STAMP_LENGTH, log, first, place, name, expected, _NO_STAMP)
    if is_date(texts[0].decode("utf-8", "replace")):
        dates, none = nanoseconds([text.decode("utf-8", "replace") for text in texts])
        expected = "a date and time of the calendar, in the zone of the first"
        _refuse(none, log, first, place, name, expected, _NO_DATE)
        return dates, 0
    decimals = np.where(point < 0, 0, length - 1 - point)
    with suppress(ValueError, OverflowError):
        whole = np.strings.replace(texts, b".", b"", 1).astype(np.int64)
        if np.strings.find(texts, b"_").max() < 0 and (exact := _scaled(whole, decimals, int(decimals.max()))):
            return exact
    words = np.array([text.decode("utf-8", "replace") for text in texts], object)
    _checked(words, log, first, place, name, _NO_STAMP)
    return words, 0


def _scaled(whole: np.ndarray, decimals: np.ndarray | int, finest: int) -> _Stamps | None:
    """Return the whole numbers of the finest of their decimals, where they fit."""
    more = finest - np.asarray(decimals)
    if finest > 18 or (np.abs(whole.astype(float)) * 10.0**more).max() >= _MAX_STAMP:
        return None
    return whole * 10**more, finest


def _joined(parts: Sequence[_Stamps]) -> _Stamps:
    """Return the stamps of several pieces on the finest of their decimals; as text where one is, or they do not fit."""
    finest = max(decimals for _, decimals in parts)
    scaled = [_scaled(values, decimals, finest) if values.dtype.kind == "i" else None for values, decimals in parts]
    if all(scaled):
        return np.concatenate([part[0] for part in scaled if part]), finest
    texts = [
        values.tolist() if values.dtype.kind == "O" else [f"{value}e-{decimals}" for value in values.tolist()]
        for values, decimals in parts
    ]
    return np.array(list(chain.from_iterable(texts)), object), 0


def _find(name: str, names: Sequence[str], log: LogFile) -> int:
    """Return the position of a column."""
    if names.count(name) == 1:
        return names.index(name)
    where = f'{log.path}, column "{name}"'
    if name in names:
        places = ", ".join(str(i + 1) for i, other in enumerate(names) if other == name)
        raise InputError(
            where,
            found=f"several columns of that name, at positions {places}",
            expected="one",
            remedy="give distinct names with `names` and skip the header",
        )
    other = next((mark for mark in (";", "\t", "|", ",") if mark in names[0]), None) if len(names) == 1 else None
    if other:
        remedy = f"set the delimiter to {other!r}"
    elif not signs_of(log).has_header:
        remedy = f"the file has no header: its columns are {names[0]}, …; or give their names with `names`"
    else:
        remedy = nearest(name, names)
    raise NoColumn(
        where, found="no column of that name", expected=f"one of the {len(names)} in the header", remedy=remedy
    )


def _frames(
    log: LogFile, layout: _Layout, places: list[int], kinds: Any = None
) -> Iterator[tuple[dict[int, np.ndarray], float]]:
    """Parse some columns, some thousand rows at a time; yields them by position, and the share of the file that is read."""
    import pandas as pd  # a third of a second, which only a log that is read is worth

    size, n_rows = max(log.path.stat().st_size, 1), 0
    with _opened(log) as (stream, raw):
        for _ in range(layout.above):
            stream.readline()
        try:
            frames = pd.read_csv(
                stream,
                sep=r"\s+" if signs_of(log).separator == WHITESPACE else signs_of(log).separator,
                decimal=signs_of(log).decimal,
                header=None,
                names=list(range(len(layout.names))),
                usecols=places,
                dtype=kinds,
                index_col=False,
                engine="c",
                lineterminator="\n",
                low_memory=False,
                nrows=layout.rows,
                chunksize=_PIECE_ROWS,
            )
            for frame in frames:
                n_rows += len(frame)
                yield {place: frame[place].to_numpy() for place in places}, min(raw.tell() / size, 1.0)
        except pd.errors.ParserError as cause:
            raise _undivided(log, layout, str(cause)) from cause
    if n_rows != layout.rows:
        raise _undivided(log, layout, f"{n_rows} rows or {layout.rows}, depending on how quotation marks are read")


def _undivided(log: LogFile, layout: _Layout, cause: str) -> InputError:
    return InputError(
        str(log.path),
        found=f"rows that cannot be divided into cells ({cause})",
        expected=f"{layout.rows} rows of {len(layout.names)} cells",
        remedy=f"look for a stray quotation mark in row {layout.last} or above",
    )


def _survey(log: LogFile) -> _Layout:
    """Go through the rows, having checked that each has all its cells.

    Raises:
        InputError: no data, or a row of another width than the header.
    """
    blanks = " \t\n" + _mark(log)
    count = filled = last = wrong = 0
    above: int | None = None
    first_wrong: _Row | None = None
    waiting: list[_Row] = []
    with _opened(log) as (stream, _):
        names, rows = _header(log, _rows(log, stream))
        expected = len(names)
        for count, row in enumerate(rows, 1):
            line, width, cells = row
            if above is None:
                above = line - 1
            if width != expected:
                waiting.append(row)
            if cells[0] in blanks and isinstance(cells, str) and not cells.strip(blanks):
                continue
            filled, last = count, line
            if waiting:
                first_wrong = first_wrong or waiting[0]
                wrong += len(waiting)
                waiting = []
    if not filled or above is None:
        raise _no_rows(log, is_empty=not (count or log.layout.skip_rows))
    if first_wrong:
        raise _ragged(log, len(names), filled, wrong, first_wrong, last)
    return _Layout(names, above, filled, last, count - filled)


def _ragged(log: LogFile, expected: int, rows: int, wrong: int, first: _Row, last: int) -> InputError:
    line, width, cells = first
    if wrong == rows:
        remedy = "correct the delimiter, or skip the header and give the name of every column with `names`"
    elif not isinstance(cells, str):
        remedy = "correct or delete the row; look for a stray quotation mark"
    elif line == last:
        remedy = "the last row is cut off: delete it"
    else:
        remedy = "correct or delete the row"
    return InputError(
        f"{log.path}, row {line}",
        found=f"{width} cell{'s' if width != 1 else ''}; {wrong} of {rows} rows {'are' if wrong != 1 else 'is'} so",
        expected=f"{expected} cells, as in the header",
        remedy=remedy,
    )


def _no_rows(log: LogFile, is_empty: bool) -> InputError:
    skipped, count = log.layout.skip_rows, log.layout.header_rows
    head = [
        f"the {skipped} lines that skip_rows leaves out" if skipped > 1 else "the line that skip_rows leaves out"
    ] * bool(skipped)
    head += [f"the header's {count} lines" if count > 1 else "the header"] * bool(count)
    keys = [
        f"{key} is too large"
        for key, value, usual in (("skip_rows", skipped, 0), ("header_rows", count, 1))
        if value > usual
    ]
    return InputError(
        str(log.path),
        found=f"an empty file ({log.path.stat().st_size} bytes)"
        if is_empty
        else f"no row{' below ' if head else ''}{' and '.join(head)}",
        expected="rows of numbers",
        remedy=" or ".join([*keys, "nothing was recorded: export the log again"]),
    )


def _refuse(
    bad: Bool[np.ndarray, " n"], log: LogFile, first: int, place: int, name: str, expected: str, remedy: str
) -> None:
    """Refuse the first bad cell of some rows of a column, if there is one, with its line and text."""
    if not bad.any():
        return
    line, _, cells = _row(log, first + int(bad.argmax()))
    cell = _cells(log, cells)[place]
    whole, comma, part = cell.lstrip("+-").partition(",")
    remedy = remedy or (
        "write decimals with a point, not with a comma"
        if comma and whole.isdigit() and part.isdigit()
        else "correct the cell, leave it empty if there is no measurement, or map another column"
    )
    raise InputError(
        f'{log.path}, row {line}, column "{name}"',
        found=repr(cell[:60]) if cell else "an empty cell",
        expected=expected,
        remedy=remedy,
    )


def _row(log: LogFile, row: int) -> _Row:
    """Return a row of data, found by reading the file once more: only an error asks for it."""
    with _opened(log) as (stream, _):
        return next(islice(_header(log, _rows(log, stream))[1], row, None))


def _header(log: LogFile, rows: Iterator[_Row]) -> tuple[tuple[str, ...], Iterator[_Row]]:
    """Return the names of the columns, and the rows below them."""
    if log.layout.names:
        return log.layout.names, rows
    signs = signs_of(log)
    header = list(islice(rows, log.layout.header_rows + bool(signs.units))) if signs.has_header else []
    first = next(rows, None)
    if first is None:
        raise _no_rows(log, is_empty=not (header or log.layout.skip_rows))
    names = _cells(log, header[0][2]) if header else [f"column_{k + 1}" for k in range(first[1])]
    return tuple(names), chain((first,), rows)


def _rows(log: LogFile, stream: TextIOWrapper) -> Iterator[_Row]:
    """Yield the rows below the first lines that are skipped; blank lines are left out, and a quoted cell may span lines."""
    mark, skip, number = _mark(log), log.layout.skip_rows, 0
    lines: Iterator[str] = iter(partial(stream.readline, _MAX_LINE_BYTES), "")
    if signs_of(log).separator == WHITESPACE:
        lines = (_SPACES.sub(" ", line.strip(" \t\n")) + "\n" for line in lines)
    for line in lines:
        number += 1
        if "\0" in line:
            raise _not_text(log, number)
        if len(line) == _MAX_LINE_BYTES:
            raise _no_cells(log, number, f"it does not end within {_MAX_LINE_BYTES >> 20} million characters")
        if number <= skip:
            continue
        if '"' in line:
            first, reader = number, csv.reader(chain((line,), lines), delimiter=mark)
            try:
                cells = next(reader)
            except csv.Error as cause:
                raise _no_cells(log, first, str(cause)) from cause
            number += reader.line_num - 1
            yield first, len(cells), cells
        elif (width := line.count(mark)) or line.strip(" \t\n"):
            yield number, width + 1, line


def _mark(log: LogFile) -> str:
    return " " if signs_of(log).separator == WHITESPACE else signs_of(log).separator


def _cells(log: LogFile, cells: str | list[str]) -> list[str]:
    """Return the cells of a row, without the spaces around them."""
    return [cell.strip() for cell in (cells.split(_mark(log)) if isinstance(cells, str) else cells)]


def _no_cells(log: LogFile, line: int, found: str) -> InputError:
    return InputError(
        f"{log.path}, row {line}",
        found=f"a row that is not cells ({found})",
        expected=f"cells separated by {signs_of(log).separator!r}",
        remedy="correct or delete the row; look for a stray quotation mark",
    )


@contextmanager
def _opened(log: LogFile) -> Iterator[tuple[TextIOWrapper, BinaryIO]]:
    """Open a log as text, every line ended by a line feed, and as the bytes of the file.

    Raises:
        InputError: not what its suffix says, empty, binary, or text in another encoding.
    """
    path = log.path
    codec = codec_of(path, log.layout.encoding)
    try:
        with path.open("rb") as raw, gzip.open(raw) if path.suffix.lower() == ".gz" else raw as unpacked:
            yield TextIOWrapper(unpacked, codec), raw  # type: ignore[arg-type]
    except (EOFError, zlib.error) as cause:
        raise InputError(
            str(path),
            found=f"gzip data cut off or damaged ({cause})",
            expected="a whole gzip file",
            remedy="copy or export the file again",
        ) from cause
    except gzip.BadGzipFile as cause:
        if _kind(path) == _MAGIC[_GZIP]:
            raise InputError(
                str(path),
                found=f"gzip data with a wrong checksum, or followed by bytes that are none ({cause})",
                expected="a whole gzip file",
                remedy=f"copy the file again, or unpack it: gzip -dc {path.name} > {path.stem}",
            ) from cause
        raise InputError(
            str(path),
            found=f"{_kind(path)}, not gzip data",
            expected="gzip data, by the suffix .gz",
            remedy="rename the file if it is plain text, or export it again",
        ) from cause
    except UnicodeError as cause:
        with gzip.open(path) if path.suffix.lower() == ".gz" else path.open("rb") as raw:
            lines = enumerate(TextIOWrapper(raw, codec, "replace"), 1)  # type: ignore[arg-type]
            raise _not_text(log, next((number for number, line in lines if "\ufffd" in line), 1)) from cause
    except OSError as cause:
        raise unreadable(path, cause) from cause


def _not_text(log: LogFile, line: int) -> InputError:
    kind = "other data" if log.path.suffix.lower() == ".gz" else _kind(log.path)
    return InputError(
        f"{log.path}, row {line}",
        found=f"{kind}, not {log.layout.encoding} text",
        expected=f"text in {log.layout.encoding}",
        remedy="add the suffix .gz to its name"
        if kind == _MAGIC[_GZIP]
        else "export the sheet with the log as CSV"
        if "spreadsheet" in kind
        else 'export the log as CSV; if it is text already, write encoding = "cp1252" (or "utf-16") under its [[import.files]]',
    )


def _kind(path: Path) -> str:
    """Return what the first bytes say a file is."""
    with path.open("rb") as stream:
        data = stream.read(4096)
    return next(
        (kind for magic, kind in _MAGIC.items() if data.startswith(magic)),
        "binary data" if b"\0" in data or not data[:64].isascii() else "other data",
    )


FORMAT = LogFormat(
    "a table of text", (".csv", ".tsv", ".csv.gz", ".tsv.gz"), _recognises, _catalogue, _blocks, _read, is_text=True
)
