"""The text of a log file: decompressed, decoded, and refused where the file is not what its name says."""

import codecs
import gzip
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from seatrial.core.errors import InputError
from seatrial.logs.formats.protocol import unreadable

_PIECE = 1 << 24
_HEAD = 4096
_GZIP = b"\x1f\x8b"
_MAGIC = {
    _GZIP: "gzip data",
    b"PK\x03\x04": "a zip archive or a spreadsheet",
    b"\x89HDF": "an HDF5 or NetCDF file",
    b"#ROSBAG": "a ROS bag",
    b"SQLite": "an SQLite database",
    b"PAR1": "a Parquet file",
    b"%PDF": "a PDF",
    b"\xff\xfe": "UTF-16 text",
    b"\xfe\xff": "UTF-16 text",
}


def decoded(path: Path, encoding: str) -> Iterator[bytes]:
    """Read a log piece by piece.

    Yields:
        its text in UTF-8, every line ended by a line feed, in pieces of about 16 MB cut anywhere between characters.

    Raises:
        InputError: not what its suffix says, empty, binary, or text in another encoding.
    """
    lines, empty, held, first = 0, True, b"", b""
    with _opened(path) as stream:
        decoder = _decoder(path, encoding)
        while True:
            data = _read(stream, path)
            first = first or data[:_HEAD]
            text, last = _decode(data, decoder, path, encoding, lines, first), not data
            text = held + text
            # A carriage return at the end may be half of a line end.
            held = b"\r" if text.endswith(b"\r") and not last else b""
            text = text[: len(text) - len(held)]
            if b"\r" in text:
                text = text.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
            empty = empty and (not text or text.isspace())
            lines += text.count(b"\n")
            if last and empty:
                raise InputError(
                    str(path),
                    found=f"an empty file ({path.stat().st_size} bytes)",
                    expected="a header and rows of numbers",
                    remedy="export the log again",
                )
            if text:
                yield text
            if last:
                return


def _opened(path: Path) -> BinaryIO:
    return gzip.open(path) if path.suffix.lower() == ".gz" else path.open("rb")  # pyright: ignore[reportReturnType]


def _read(stream: BinaryIO, path: Path) -> bytes:
    try:
        return stream.read(_PIECE)
    except (EOFError, zlib.error) as cause:
        raise InputError(
            str(path),
            found=f"gzip data cut off or damaged ({cause})",
            expected="a whole gzip file",
            remedy="copy or export the file again",
        ) from cause
    except gzip.BadGzipFile as cause:
        with path.open("rb") as raw:
            kind = _kind(raw.read(_HEAD))
        raise InputError(
            str(path),
            found=f"{kind}, not gzip data",
            expected="gzip data, as the suffix .gz says",
            remedy="rename the file if it is plain text, or export it again",
        ) from cause
    except OSError as cause:
        raise unreadable(path, cause) from cause


def _decoder(path: Path, encoding: str) -> codecs.IncrementalDecoder:
    try:
        " ".encode(encoding)
        name = "utf-8-sig" if codecs.lookup(encoding).name == "utf-8" else encoding
        return codecs.getincrementaldecoder(name)()
    except (LookupError, UnicodeError) as cause:
        raise InputError(
            f"{path}, encoding",
            found=repr(encoding),
            expected='an encoding such as "utf-8" or "cp1252"',
            remedy="correct the name of the encoding",
        ) from cause


def _decode(
    data: bytes, decoder: codecs.IncrementalDecoder, path: Path, encoding: str, lines: int, first: bytes
) -> bytes:
    """Return the text of a piece in UTF-8, refusing what is not text."""
    row = lines + 1
    try:
        text = decoder.decode(data, not data).encode()
        zero = text.find(b"\0")
        if zero < 0:
            return text
        row += text.count(b"\n", 0, zero)
    except UnicodeError as cause:
        row += data.count(b"\n", 0, getattr(cause, "start", 0))
    kind = _kind(first)
    raise InputError(
        f"{path}, row {row}",
        found=f"{kind}, not {encoding} text",
        expected=f"text in {encoding}",
        remedy="add the suffix .gz to its name"
        if kind == _MAGIC[_GZIP]
        else 'export the log as CSV; if it is text already, name its encoding ("utf-16", "cp1252")',
    )


def _kind(data: bytes) -> str:
    """What the first bytes say a file is."""
    return next(
        (kind for magic, kind in _MAGIC.items() if data.startswith(magic)),
        "binary data" if b"\0" in data[:_HEAD] or not data[:64].isascii() else "other data",
    )
