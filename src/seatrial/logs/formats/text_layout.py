"""How a table of text is laid out where nothing is said of it, by its first lines: separator, decimal comma, header, units, dates."""

import codecs
import csv
import gzip
import re
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Int

from seatrial.core.errors import InputError
from seatrial.core.files import kept_per_file
from seatrial.logs.formats.protocol import LogFile, TextLayout

WHITESPACE = "whitespace"
_BY_SUFFIX = {".csv": ",", ".tsv": "\t"}
_SEPARATORS = (";", "\t", "|", ",")
_SAMPLE_BYTES = 1 << 16  # Bytes of the file
_SAMPLE_LINES = 20
_QUOTED = re.compile(r'"[^"]*"')  # A cell in which any separator is text
_NUMBER = re.compile(r"[-+]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][-+]?\d+)?")
_COMMA = re.compile(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?")
_POINT = re.compile(r"[-+]?\d*\.\d+(?:[eE][-+]?\d+)?")
_DATE = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(?::\d\d(?:[.,]\d+)?)?(?P<zone>Z|[+-]\d\d:?\d\d)?")
# Codecs of names of hosts and of source code, which Python lists beside those of text
_NO_ENCODINGS = {"idna", "punycode", "undefined", "unicode-escape", "raw-unicode-escape"}
# Endings of a stamp in two columns, as ROS splits it
_SECONDS = {"nanosec": "sec", "nsec": "sec", "nsecs": "secs", "nanosecs": "secs"}


@dataclass(frozen=True)
class TextSigns:
    """What the first lines say.

    Attributes:
        separator: of cells, one character or `whitespace`.
        decimal: point or comma.
        has_header: whether the first line names the columns.
        units: of the line below it, for each column, empty if there is none such.
    """

    separator: str
    decimal: str = "."
    has_header: bool = True
    units: tuple[str, ...] = ()


def signs_of(log: LogFile) -> TextSigns:
    """Return how a table of text is laid out: as it is said, else as its first lines show.

    Raises:
        InputError: a separator that is none, or one that nothing tells.
    """
    return _signs(log.path, log.layout)


@kept_per_file(16)
def _signs(path: Path, layout: TextLayout) -> TextSigns:
    lines = _first_lines(path, layout)
    mark = _separator(path, layout, lines)
    rows = [_cells(line, mark) for line in lines]
    below = [cell for row in rows[1:] for cell in row]
    has_comma = mark != "," and any(map(_COMMA.fullmatch, below)) and not any(map(_POINT.fullmatch, below))
    if layout.names or layout.header_rows != 1 or not rows:
        return TextSigns(mark, "," if has_comma else ".")
    has_header = not all(map(_is_value, rows[0]))
    units = rows[1] if len(rows) > 2 and _are_units(rows) else []
    return TextSigns(mark, "," if has_comma else ".", has_header, tuple(unit.strip("[](){} ") for unit in units))


def codec_of(path: Path, encoding: str) -> str:
    """Return the codec of a text in an encoding; of UTF-8 that which leaves out the mark that some editors put before it.

    Raises:
        InputError: no such encoding, or a codec of Python that is none of a text in lines.
    """
    try:
        name = codecs.lookup(encoding).name
        if name.replace("_", "-") in _NO_ENCODINGS:
            raise LookupError
        " ".encode(encoding)  # what turns bytes into bytes, such as hex, fails here
    except (LookupError, ValueError) as cause:
        raise InputError(
            f"{path}, encoding",
            found=repr(encoding[:60]),
            expected='an encoding such as "utf-8" or "cp1252"',
            remedy="correct the name of the encoding",
        ) from cause
    return "utf-8-sig" if name == "utf-8" else encoding


def _first_lines(path: Path, layout: TextLayout) -> list[str]:
    codec = codec_of(path, layout.encoding)
    try:
        with path.open("rb") as raw, gzip.open(raw) if path.suffix.lower() == ".gz" else raw as unpacked:
            text = unpacked.read(_SAMPLE_BYTES).decode(codec, "replace").removeprefix("\ufeff")
    except (OSError, EOFError, zlib.error):
        return []  # whoever reads the whole file says what is wrong with it
    lines = [line for line in text.splitlines()[layout.skip_rows :] if line.strip()]
    return lines[: min(_SAMPLE_LINES, max(len(lines) - 1, 2))]


def _separator(path: Path, layout: TextLayout, lines: Sequence[str]) -> str:
    suffix = Path(path.name.lower().removesuffix(".gz")).suffix
    separator, where = layout.delimiter, f"{path}, delimiter"
    if separator is None:
        separator = _BY_SUFFIX.get(suffix)
        head = _QUOTED.sub("", lines[0]) if len(lines) > 1 else ""
        if len(lines) > 1 and (separator is None or separator not in head):
            separator = _shared_by(lines[:2]) or separator or _shared_by(lines[-2:])  # the first lines may be remarks
    if separator is None:
        raise InputError(
            where,
            found=f'suffix "{suffix}" and no delimiter',
            expected=".csv, .tsv, or the delimiter",
            remedy=f'give one of: ",", ";", "\\t" or "{WHITESPACE}"',
        )
    is_mark = len(separator) == 1 and separator.isascii() and (separator.isprintable() or separator == "\t")
    if separator != WHITESPACE and (not is_mark or separator.isalnum() or separator in '".+-'):
        raise InputError(
            where,
            found=repr(separator),
            expected=f'one character that no number contains, or "{WHITESPACE}"',
            remedy='use ",", ";", "\\t" or "whitespace"',
        )
    return separator


def _shared_by(lines: Sequence[str]) -> str | None:
    """Return the separator by which two lines have as many cells; None for none."""
    head, first = (_QUOTED.sub("", line) for line in lines)
    alike = [mark for mark in _SEPARATORS if 0 < head.count(mark) == first.count(mark)]
    spaced = 1 < len(head.split()) == len(first.split())
    return alike[0] if alike else WHITESPACE if spaced else None


def _cells(line: str, mark: str) -> list[str]:
    if mark == WHITESPACE:
        return line.split()
    cells = next(csv.reader([line], delimiter=mark)) if '"' in line else line.split(mark)
    return [cell.strip(' \t"') for cell in cells]


def _is_value(cell: str) -> bool:
    return _NUMBER.fullmatch(cell) is not None or is_date(cell)


def _are_units(rows: Sequence[Sequence[str]]) -> bool:
    """Return whether the second line holds words, and the third numbers."""
    below = rows[1]
    is_words = any(below) and not any(map(_is_value, below)) and len(below) == len(rows[0])
    return is_words and any(map(_is_value, rows[2]))


def is_date(cell: str) -> bool:
    """Return whether a cell is a date and time as ISO 8601 has them."""
    return _DATE.fullmatch(cell.strip()) is not None


def nanoseconds(cells: Sequence[str]) -> tuple[Int[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Return dates and times as nanoseconds since 1970, and which cells are none, or are of another zone than the first."""
    matches = [_DATE.fullmatch(cell.strip()) for cell in cells]
    zone = next((match["zone"] for match in matches if match), None)
    texts = [
        match[0].removesuffix(zone or "").replace(",", ".") if match and match["zone"] == zone else "NaT"
        for match in matches
    ]
    try:
        instants = np.array(texts, "datetime64[ns]")
    except ValueError:  # the calendar lacks one, such as a leap second or 30 February
        instants = np.array([_instant(text) for text in texts])
    return instants.astype(np.int64), np.isnat(instants)


def _instant(text: str) -> np.datetime64:
    try:
        return np.datetime64(text, "ns")
    except ValueError:
        return np.datetime64("NaT", "ns")


def split_stamps(names: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Return the stamps that lie in two columns, seconds and nanoseconds: by their common name."""
    parts = {}
    for name in names:
        base, dot, last = name.rpartition(".")
        base, last = (base, last) if dot else ("", name)
        if last in _SECONDS and (other := f"{base}{dot}{_SECONDS[last]}") in names:
            parts[base or "stamp"] = (other, name)
    return {base: pair for base, pair in parts.items() if base not in names}
