"""The text of a log file: decompressed, decoded, and refused where the file is not what its name says."""

import codecs
import gzip
import hashlib
import zlib
from pathlib import Path

from seatrial.core.errors import InputError

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


def load_text(path: Path, encoding: str) -> tuple[bytes, str]:
    """Read a log whole.

    Returns:
        its text in UTF-8 with every line ended by a line feed, and the SHA-256 of the file's bytes as they stand.

    Raises:
        InputError: no such file, not what its suffix says, empty, binary, or text in another encoding.
    """
    if not path.is_file():
        raise InputError(
            str(path),
            found="a folder" if path.is_dir() else "no such file",
            expected="a CSV or TSV file",
            remedy="check the path",
        )
    try:
        raw = path.read_bytes()
    except OSError as cause:
        raise InputError(
            str(path),
            found=f"a file that cannot be read ({cause.strerror})",
            expected="a readable file",
            remedy="check its permissions and the disk",
        ) from cause
    text = _decode(_decompress(raw, path), path, encoding)
    if b"\r" in text:
        text = text.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if not text or text.isspace():
        raise InputError(
            str(path),
            found=f"an empty file ({len(raw)} bytes)",
            expected="a header and rows of numbers",
            remedy="export the log again",
        )
    return text, hashlib.sha256(raw).hexdigest()


def _decompress(raw: bytes, path: Path) -> bytes:
    if path.suffix.lower() != ".gz":
        return raw
    try:
        return gzip.decompress(raw)
    except (EOFError, zlib.error) as cause:
        raise InputError(
            str(path),
            found=f"gzip data cut off or damaged ({cause})",
            expected="a whole gzip file",
            remedy="copy or export the file again",
        ) from cause
    except gzip.BadGzipFile as cause:
        raise InputError(
            str(path),
            found=f"{_kind(raw)}, not gzip data",
            expected="gzip data, as the suffix .gz says",
            remedy="rename the file if it is plain text, or export it again",
        ) from cause


def _decode(data: bytes, path: Path, encoding: str) -> bytes:
    """Return the text in UTF-8, refusing what is not text."""
    row = 1
    try:
        is_utf8 = codecs.lookup(encoding).name == "utf-8"
        text = data.removeprefix(codecs.BOM_UTF8) if is_utf8 else data.decode(encoding).encode()
        if text.isascii() or text.decode():
            zero = text.find(b"\0")
            if zero < 0:
                return text
            row += text.count(b"\n", 0, zero)
    except LookupError as cause:
        raise InputError(
            f"{path}, encoding",
            found=repr(encoding),
            expected='an encoding such as "utf-8" or "cp1252"',
            remedy="correct the name of the encoding",
        ) from cause
    except UnicodeError as cause:
        row += data.count(b"\n", 0, getattr(cause, "start", 0))
    kind = _kind(data)
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
        "binary data" if b"\0" in data[:4096] or not data[:64].isascii() else "other data",
    )
