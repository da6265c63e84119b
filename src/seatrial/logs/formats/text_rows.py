"""Rows and cells of a text: found and counted before anything is parsed, so that every fault has its line number."""

import csv
import io
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Int

from seatrial.core.errors import InputError
from seatrial.logs.formats.protocol import LogFile
from seatrial.logs.formats.text_load import decoded

WHITESPACE = "whitespace"
_BY_SUFFIX = {".csv": ",", ".tsv": "\t"}
_BLOCK = 1 << 22
_LONGEST_ROW = 1 << 26


@dataclass(frozen=True, eq=False)
class Rows:
    """A text divided into rows; blank lines are left out, and a quoted cell may span lines.

    Attributes:
        text: UTF-8, lines ended by a line feed.
        delimiter: one character, or `whitespace`.
        starts: position of each row's first byte, shape (n,).
        widths: number of cells in each row, shape (n,).
        where: the file, for errors.
        empty: rows of nothing but delimiters that were cut off at the end, as spreadsheets leave them.
        above: lines of the file above this text.
    """

    text: bytes
    delimiter: str
    starts: Int[np.ndarray, " n"]
    widths: Int[np.ndarray, " n"]
    where: str
    empty: int = 0
    above: int = 0

    def line(self, row: int) -> int:
        """Line at which a row starts, as a text editor counts."""
        return 1 + self.above + self.text.count(b"\n", 0, int(self.starts[row]))

    def cells(self, row: int) -> list[str]:
        """Cells of a row, without the spaces around them."""
        end = int(self.starts[row + 1]) if row + 1 < self.starts.size else len(self.text)
        line = self.text[int(self.starts[row]) : end].decode()
        character, spaces = (" ", True) if self.delimiter == WHITESPACE else (self.delimiter, False)
        line = line.strip().replace("\t", " ") if spaces else line.rstrip("\n")
        try:
            cells = next(csv.reader(io.StringIO(line, newline="\n"), delimiter=character, skipinitialspace=spaces), [])
        except csv.Error as cause:
            raise InputError(
                f"{self.where}, row {self.line(row)}",
                found=f"a row that is not cells ({cause})",
                expected=f"cells separated by {self.delimiter!r}",
                remedy="mend or delete the row",
            ) from cause
        return [cell.strip() for cell in cells]


def pieces(log: LogFile) -> Iterator[tuple[tuple[str, ...], Rows]]:
    """Column names and rows of data, a piece of the file at a time, having checked that every row has all its cells.

    Raises:
        InputError: no data, or a row of another width than the header.
    """
    where, layout = str(log.path), log.layout
    character = separator(log)
    names, above, waiting = None, 0, b""
    texts = decoded(log.path, layout.encoding)
    following = next(texts, None)
    while following is not None:
        text, following = waiting + following, next(texts, None)
        first = 0 if layout.names or names else layout.header_rows
        every = replace(_divide(text, character, 0 if names else layout.skip_rows, where), above=above)
        full = _without_empty_end(every)
        if following is not None:
            # The last row may go on in the next piece, and so may empty rows at its end.
            kept = min(full.starts.size, every.starts.size - 1)
            cut = int(every.starts[kept]) if kept >= 0 else len(text) if names else 0
            if len(text) - cut > _LONGEST_ROW:
                raise _endless(every)
            if kept <= first:
                waiting = text
                continue
            full = replace(every, text=text[:cut], starts=every.starts[:kept], widths=every.widths[:kept])
            waiting, above = text[cut:], above + text.count(b"\n", 0, cut)
        if names is None:
            if full.starts.size <= first:
                raise InputError(
                    where,
                    found=f"no row below the header and the first {layout.skip_rows} lines",
                    expected="rows of numbers",
                    remedy="export the log again, or correct skip_rows and header_rows",
                )
            names = tuple(layout.names or full.cells(0))
        rows = replace(full, starts=full.starts[first:], widths=full.widths[first:])
        _check_widths(rows, len(names))
        yield names, rows


def _endless(rows: Rows) -> InputError:
    row = rows.line(rows.starts.size - 1) if rows.starts.size else rows.above + 1
    return InputError(
        f"{rows.where}, row {row}",
        found=f"a row that does not end within {_LONGEST_ROW >> 20} MB",
        expected="rows of cells",
        remedy="look for a stray quotation mark",
    )


def separator(log: LogFile) -> str:
    """Return what separates the cells: one ASCII character, or `whitespace`.

    Raises:
        InputError: nothing said where the suffix does not tell, or not a single ASCII character.
    """
    suffix = Path(log.path.name.lower().removesuffix(".gz")).suffix
    found = log.layout.delimiter if log.layout.delimiter is not None else _BY_SUFFIX.get(suffix)
    where = f"{log.path}, delimiter"
    if found is None:
        raise InputError(
            where,
            found=f'suffix "{suffix}" and no delimiter',
            expected=".csv, .tsv, or the delimiter",
            remedy=f'say which: ",", ";", "\\t" or "{WHITESPACE}"',
        )
    if found != WHITESPACE and not (
        len(found) == 1
        and found.isascii()
        and (found.isprintable() or found == "\t")
        and not found.isalnum()
        and found not in '".+-'
    ):
        raise InputError(
            where,
            found=repr(found),
            expected=f'one character that no number contains, or "{WHITESPACE}"',
            remedy='use ",", ";", "\\t" or "whitespace"',
        )
    return found


def _without_empty_end(rows: Rows) -> Rows:
    blanks = b" \t\n" + (b"" if rows.delimiter == WHITESPACE else rows.delimiter.encode())
    kept = int(np.searchsorted(rows.starts, len(rows.text.rstrip(blanks))))
    if kept == rows.starts.size:
        return rows
    return replace(
        rows,
        text=rows.text[: int(rows.starts[kept])],
        starts=rows.starts[:kept],
        widths=rows.widths[:kept],
        empty=rows.starts.size - kept,
    )


def _check_widths(rows: Rows, width: int) -> None:
    ragged = np.flatnonzero(rows.widths != width)
    if not ragged.size:
        return
    row = int(ragged[0])
    if np.ptp(rows.widths) == 0:
        remedy = "correct the delimiter, or skip the header and give the name of every column with `names`"
    elif row == rows.starts.size - 1:
        remedy = "the last row is cut off: delete it"
    else:
        remedy = "mend or delete the row" + ("; look for a stray quotation mark" if b'"' in rows.text else "")
    raise InputError(
        f"{rows.where}, row {rows.line(row)}",
        found=f"{rows.widths[row]} cells; {ragged.size} of {rows.widths.size} rows are so",
        expected=f"{width} cells, as in the header",
        remedy=remedy,
    )


def _divide(text: bytes, delimiter: str, skip_rows: int, where: str) -> Rows:
    """Find the rows below the first `skip_rows` lines and count their cells."""
    begin = 0
    for _ in range(skip_rows):
        begin = text.find(b"\n", begin) + 1 or len(text)
    marks = _marks(text, begin, delimiter)
    is_end = np.frombuffer(text, np.uint8)[marks] == ord("\n")
    order = np.flatnonzero(is_end)
    ends = marks[order]
    if begin < len(text) and (not ends.size or ends[-1] != len(text) - 1):
        order, ends = np.append(order, marks.size), np.append(ends, len(text))
    starts = np.concatenate(([begin], ends[:-1] + 1)) if ends.size else ends
    widths = np.diff(order, prepend=-1) - (delimiter == WHITESPACE)
    lone = np.flatnonzero(widths <= 1)
    blank = [row for row in lone.tolist() if not text[starts[row] : ends[row]].strip(b" \t")]
    return Rows(text, delimiter, np.delete(starts, blank), np.delete(widths, blank), where)


def _marks(text: bytes, begin: int, delimiter: str) -> np.ndarray:
    """Positions of line ends and delimiters outside quotes; by whitespace, of the first bytes of the cells instead."""
    marks, quoted, after_space, has_quotes = [np.empty(0, np.int64)], np.False_, np.True_, b'"' in text
    for at in range(begin, len(text), _BLOCK):
        codes, outside = np.frombuffer(text, np.uint8, min(_BLOCK, len(text) - at), at), np.True_
        if has_quotes:
            inside = np.logical_xor.accumulate(np.append(quoted, codes == ord('"')))
            quoted, outside = inside[-1], ~inside[1:]
        end = (codes == ord("\n")) & outside
        if delimiter == WHITESPACE:
            space = np.append(after_space, ((codes == ord(" ")) | (codes == ord("\t"))) & outside | end)
            mark, after_space = ~space[1:] & space[:-1], space[-1]
        else:
            mark = (codes == ord(delimiter)) & outside
        marks.append(np.flatnonzero(mark | end) + at)
    return np.concatenate(marks)
