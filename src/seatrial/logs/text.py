"""The text of a log: decompressed, decoded and divided into rows, with every fault named before a number is parsed."""

import csv
import gzip
import hashlib
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Int

from seatrial.core.errors import InputError
from seatrial.logs.source import WHITESPACE

_BLOCK = 1 << 22
_MAGIC = {b"\x1f\x8b": "gzip data", b"PK\x03\x04": "a zip archive or a spreadsheet", b"\x89HDF": "an HDF5 or NetCDF-4 file",
          b"#ROSBAG": "a ROS bag", b"SQLite": "an SQLite database", b"PAR1": "a Parquet file", b"%PDF": "a PDF document",
          b"\xff\xfe": "UTF-16 text", b"\xfe\xff": "UTF-16 text"}


@dataclass(frozen=True, eq=False)
class Rows:
    """A text divided into rows; blank lines are left out, and a quoted cell may span lines.

    Attributes:
        text: UTF-8, lines ended by a line feed.
        delimiter: one character, or `whitespace`.
        starts: position of each row's first byte, shape (n,).
        widths: number of cells in each row, shape (n,).
        where: the file, for errors.
    """

    text: bytes
    delimiter: str
    starts: Int[np.ndarray, " n"]
    widths: Int[np.ndarray, " n"]
    where: str

    def line(self, row: int) -> int:
        """Line at which a row starts, as a text editor counts."""
        return 1 + self.text.count(b"\n", 0, int(self.starts[row]))

    def cells(self, row: int) -> list[str]:
        """Cells of a row, without the spaces around them."""
        end = int(self.starts[row + 1]) if row + 1 < self.starts.size else len(self.text)
        line = self.text[int(self.starts[row]):end].decode()
        character, spaces = (" ", True) if self.delimiter == WHITESPACE else (self.delimiter, False)
        line = line.strip().replace("\t", " ") if spaces else line.strip("\n")
        try:
            # A quoted cell may hold line feeds, and csv wants to be given them line by line.
            cells = next(csv.reader(line.splitlines(keepends=True), delimiter=character, skipinitialspace=spaces), [])
        except csv.Error as cause:
            raise InputError(f"{self.where}, row {self.line(row)}", found=f"a row that cannot be divided into cells ({cause})",
                             expected=f"cells separated by {self.delimiter!r}", remedy="mend or delete the row") from cause
        return [cell.strip() for cell in cells]


def load_text(path: Path, encoding: str) -> tuple[bytes, str]:
    """Read a log whole.

    Returns:
        its text in UTF-8 with every line ended by a line feed, and the SHA-256 of the file's bytes as they stand.

    Raises:
        InputError: no such file, not what its suffix says, empty, binary, or text in another encoding.
    """
    if not path.is_file():
        raise InputError(str(path), found="a folder" if path.is_dir() else "no such file", expected="a CSV or TSV file",
                         remedy="check the path")
    try:
        raw = path.read_bytes()
    except OSError as cause:
        raise InputError(str(path), found=f"a file that cannot be read ({cause.strerror})", expected="a readable file",
                         remedy="check its permissions and the disk") from cause
    text = _decode(_decompress(raw, path), path, encoding)
    if b"\r" in text:
        text = text.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if not text.strip():
        raise InputError(str(path), found=f"an empty file ({len(raw)} bytes)", expected="a header and rows of numbers",
                         remedy="export the log again")
    return text, hashlib.sha256(raw).hexdigest()


def divide(text: bytes, delimiter: str, skip_rows: int, where: str) -> Rows:
    """Find the rows of a text and count their cells, without parsing them.

    Args:
        text: as `load_text` gives it.
        delimiter: one character, or `whitespace`.
        skip_rows: lines to leave out at the top.
        where: the file, for errors.
    """
    begin = 0
    for _ in range(skip_rows):
        begin = text.find(b"\n", begin) + 1 or len(text)
    marks = _marks(text, begin, delimiter)
    is_end = np.frombuffer(text, np.uint8)[marks] == ord("\n")
    order = np.flatnonzero(is_end)
    ends = marks[order]
    if text[begin:] and (not ends.size or ends[-1] != len(text) - 1):
        order, ends = np.append(order, marks.size), np.append(ends, len(text))
    starts = np.concatenate(([begin], ends[:-1] + 1)) if ends.size else ends
    widths = np.diff(order, prepend=-1) - (delimiter == WHITESPACE)
    lone = np.flatnonzero(widths <= 1)
    blank = [row for row in lone.tolist() if not text[starts[row]:ends[row]].strip(b" \t")]
    return Rows(text, delimiter, np.delete(starts, blank), np.delete(widths, blank), where)


def _marks(text: bytes, begin: int, delimiter: str) -> np.ndarray:
    """Positions of the line ends outside quotes, and of the delimiters (or, by whitespace, of the cells' first bytes)."""
    marks, quoted, after_space = [np.empty(0, np.int64)], np.bool_(False), np.bool_(True)
    for at in range(begin, len(text), _BLOCK):
        codes = np.frombuffer(text, np.uint8, min(_BLOCK, len(text) - at), at)
        inside = np.logical_xor.accumulate(np.append(quoted, codes == ord('"')))[1:] if b'"' in text else np.False_
        end = codes == ord("\n")
        if delimiter == WHITESPACE:
            space = np.append(after_space, ((codes == ord(" ")) | (codes == ord("\t")) | end) & ~inside)
            mark, after_space = ~space[1:] & space[:-1], space[-1]
        else:
            mark = codes == ord(delimiter)
        if b'"' in text:
            end, quoted = end & ~inside, inside[-1]
            mark = mark if delimiter == WHITESPACE else mark & ~inside
        marks.append(np.flatnonzero(mark | end) + at)
    return np.concatenate(marks)


def _decompress(raw: bytes, path: Path) -> bytes:
    if path.suffix.lower() != ".gz":
        return raw
    try:
        return gzip.decompress(raw)
    except (EOFError, zlib.error) as cause:
        raise InputError(str(path), found=f"gzip data cut off or damaged ({cause})", expected="a whole gzip file",
                         remedy="copy or export the file again") from cause
    except gzip.BadGzipFile as cause:
        raise InputError(str(path), found=f"{_kind(raw)}, not gzip data", expected="gzip data, as the suffix .gz says",
                         remedy="rename the file if it is plain text, or export it again") from cause


def _decode(data: bytes, path: Path, encoding: str) -> bytes:
    """Return the text in UTF-8, refusing what is not text."""
    try:
        if encoding.lower().replace("_", "-") not in ("utf-8", "utf8"):
            return data.decode(encoding).encode()
        data = data.removeprefix(b"\xef\xbb\xbf")
        if b"\0" not in data and (data.isascii() or data.decode()):
            return data
        row = data.count(b"\n", 0, data.find(b"\0")) + 1
    except LookupError as cause:
        raise InputError(f"{path}, encoding", found=repr(encoding), expected='an encoding such as "utf-8" or "cp1252"',
                         remedy="correct the name of the encoding") from cause
    except UnicodeError as cause:
        row = data.count(b"\n", 0, getattr(cause, "start", 0)) + 1
    raise InputError(f"{path}, row {row}", found=f"{_kind(data)}, not {encoding} text", expected=f"text in {encoding}",
                     remedy='export the log as CSV; if it is text, name its encoding ("utf-16", "cp1252")')


def _kind(data: bytes) -> str:
    """What the first bytes say a file is."""
    return next((kind for magic, kind in _MAGIC.items() if data.startswith(magic)),
                "no data" if not data else "binary data" if b"\0" in data[:4096] or not data[:64].isascii() else "other data")
