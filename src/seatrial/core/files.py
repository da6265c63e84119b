"""Files that are either whole or absent: every result is written beside its place and then moved there."""

import hashlib
import json
import logging
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

_UNFINISHED: set[Path] = set()
"""Temporary files being written in this process."""


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Yield a temporary path in the folder of `path`; move it into place when the block ends without an error."""
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".part")
    except OSError as cause:  # which names the temporary file
        raise OSError(cause.errno, cause.strerror, str(path)) from cause
    os.close(handle)
    temporary = Path(name)
    _UNFINISHED.add(temporary)
    try:
        yield temporary
        os.chmod(temporary, 0o644)
        _flush(temporary)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
        _UNFINISHED.discard(temporary)


def discard_unfinished() -> None:
    """Remove the temporary files of this process, before it ends at once."""
    for path in list(_UNFINISHED):
        path.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically, in UTF-8."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: Path, content: Any) -> None:
    """Write JSON atomically; NaN and infinities are refused, since no other reader agrees on them."""
    write_text(path, json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n")


def set_aside(path: Path, found: str) -> None:
    """Move a damaged file, or a folder in its place, out of the way under a name of its own, and say so on the log of the package.

    Args:
        path: of what can be made again.
        found: what is wrong with it.
    """
    names = (f"{path.name}.damaged{number or ''}" for number in range(1000))
    kept = next(place for name in names if not os.path.lexists(place := path.with_name(name)))
    try:
        os.replace(path, kept)
    except FileNotFoundError:  # another process was faster
        return
    logging.getLogger("seatrial").warning(
        "caution: %s is damaged (%s): kept as %s, and made again", path, found, kept.name
    )


def sha256_of(path: Path) -> str:
    """Hash of a file's bytes, read in blocks."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def sha256_of_json(content: Any) -> str:
    """Hash of a JSON-able value, independent of the order of its keys."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _flush(path: Path) -> None:
    with path.open("rb") as stream:
        os.fsync(stream.fileno())
