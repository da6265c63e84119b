"""Files that are either whole or absent: every result is written beside its place and then moved there.

Whoever writes in a folder holds a shared lock on the folder, which the system drops with the process: a temporary file in a folder that
nobody holds was left by a process that was killed. What reads or writes files of a campaign tells so, for those who keep an answer for as
long as what it was made from stays the same.

A folder may come from a stranger: no file is written through a link, and no pipe is opened, which would wait for its other end.
"""

import errno
import hashlib
import json
import logging
import os
import re
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache, wraps
from io import FileIO
from pathlib import Path
from typing import Any, Literal, TypeVar

from seatrial.core.errors import InputError

try:
    import fcntl
except ImportError:
    fcntl = None

Answer = TypeVar("Answer")

_TEMPORARY = re.compile(r"\..+\.[a-z0-9_]{8}\.part")
_UNFINISHED: set[Path] = set()  # Temporary files being written in this process
Look = tuple[int, int, int] | None  # A file at first sight, by inode, size and time of change; None where there is none
_WATCHERS: list[dict[Path, Look]] = []


@contextmanager
def watching_files() -> Iterator[dict[Path, Look]]:
    """Yield what is made of the files that work in the block depends on: each as it was first seen, or last written by the work."""
    seen: dict[Path, Look] = {}
    _WATCHERS.append(seen)
    try:
        yield seen
    finally:
        _WATCHERS[:] = [one for one in _WATCHERS if one is not seen]


def depend_on(path: Path) -> None:
    """Tell whoever watches that the work depends on a file or a folder as it is, or on there being none."""
    for seen in _WATCHERS:
        seen.setdefault(path.absolute(), look_of(path))


def is_there(path: Path) -> bool:
    """Return whether there is a file, on which the work depends."""
    depend_on(path)
    return path.is_file()


def look_of(path: Path) -> Look:
    """Return by what a change of a file is noticed without reading it."""
    try:
        status = path.stat()
    except (OSError, ValueError):
        return None
    return status.st_ino, status.st_size, status.st_mtime_ns


def kept_per_file(answers: int) -> Callable[[Callable[..., Answer]], Callable[..., Answer]]:
    """Decorate a function of a path, and of what can be hashed: that many answers are kept, each while the file stays as it is."""

    def decorate(function: Callable[..., Answer]) -> Callable[..., Answer]:
        kept = lru_cache(maxsize=answers)(lambda look, *about: function(*about))
        return wraps(function)(lambda path, *about: kept(look_of(path), path, *about))

    return decorate


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Yield a temporary path in the folder of `path`; move it into place when the block ends without an error."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with _locked(path.parent, alone=False), _named(path):
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".part")
        os.close(handle)
        temporary = Path(name)
        _UNFINISHED.add(temporary)
        try:
            yield temporary
            os.chmod(temporary, 0o644)
            with temporary.open("rb") as stream:
                os.fsync(stream.fileno())
            os.replace(temporary, path)
            for seen in _WATCHERS:
                seen[path.absolute()] = look_of(path)
        finally:
            temporary.unlink(missing_ok=True)
            _UNFINISHED.discard(temporary)


def remove_orphans(folder: Path) -> None:
    """Remove temporary files that killed processes left in a folder and below it, wherever nobody writes just now.

    On a system or a disk without locks nobody can tell, and they stay.
    """
    for base, folders, names in os.walk(folder):
        folders[:] = [one for one in folders if not one.startswith(".")]
        orphans = [Path(base, name) for name in names if _TEMPORARY.fullmatch(name)]
        if not orphans:
            continue
        with _locked(Path(base), alone=True) as held:
            for path in orphans if held else ():
                with suppress(OSError):
                    path.unlink()


def discard_unfinished() -> None:
    """Remove the temporary files of this process, before it ends at once."""
    for path in list(_UNFINISHED):
        path.unlink(missing_ok=True)


def begin_file(path: Path) -> FileIO:
    """Open a new file that is written in place, without a buffer; it replaces a file, a link or a pipe of that name.

    Raises:
        OSError: a folder stands there, or the file cannot be made.
    """
    path.unlink(missing_ok=True)
    return FileIO(path, "xb")


def open_regular(path: Path, mode: Literal["rb", "ab"] = "rb", links: bool = False) -> FileIO:
    """Open a file to read it or to add to it, without a buffer.

    Args:
        path: of the file.
        mode: of `open`.
        links: whether a link to a file is followed.

    Raises:
        InputError: a link, a pipe or a device.
        OSError: no file, a folder, or a file that cannot be opened.
    """
    extra = getattr(os, "O_NONBLOCK", 0) | (0 if links else getattr(os, "O_NOFOLLOW", 0))
    try:
        stream = FileIO(path, mode, opener=lambda name, flags: os.open(name, flags | extra, 0o644))
    except OSError as cause:
        if cause.errno not in (errno.ELOOP, errno.ENXIO):
            raise
        raise _irregular(path) from cause
    if not stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
        stream.close()
        raise _irregular(path)
    return stream


def read_bytes(path: Path) -> bytes:
    """Read a whole file, also through a link; raises as `open_regular`."""
    with open_regular(path, links=True) as stream:
        return stream.readall()


def write_text(path: Path, text: str) -> None:
    r"""Write a text file atomically, in UTF-8; what a path has that is no UTF-8 becomes `\udcff`, which JSON reads as it was."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="backslashreplace")


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file atomically, byte by byte as given."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(content)


def write_json(path: Path, content: Any) -> None:
    """Write JSON atomically; NaN and infinities are refused, since no other reader agrees on them. A file that says it stays as it is."""
    text = json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    if not is_there(path) or path.read_bytes() != text.encode(errors="backslashreplace"):
        write_text(path, text)


def set_aside(path: Path, damage: str) -> None:
    """Move a damaged file, or a folder in its place, out of the way under a separate name, and say so on the log of the package.

    Args:
        path: of what can be made again.
        damage: what is wrong with it.
    """
    names = (f"{path.name}.damaged{number or ''}" for number in range(1000))
    kept = next(place for name in names if not os.path.lexists(place := path.with_name(name)))
    try:
        os.replace(path, kept)
    except FileNotFoundError:  # another process was faster
        return
    logging.getLogger("seatrial").warning(
        "caution: %s is damaged (%s): kept as %s, and made again when needed", path, damage, kept.name
    )


def sha256_of(path: Path) -> str:
    """Hash of a file's bytes, read in blocks."""
    depend_on(path)
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def sha256_of_json(content: Any) -> str:
    """Hash of a JSON-able value, independent of the order of its keys."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _irregular(path: Path) -> InputError:
    description = "a link" if path.is_symlink() else "a pipe, a socket or a device"
    return InputError(
        str(path), found=description, expected="a file", remedy="remove it, then run the same command again"
    )


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Name the file in errors of the system that name none, such as of a full disk, or only its temporary one."""
    try:
        yield
    except OSError as cause:
        if cause.errno is None or not (cause.filename is None or _TEMPORARY.fullmatch(Path(cause.filename).name)):
            raise
        raise OSError(cause.errno, os.strerror(cause.errno), str(path)) from cause


@contextmanager
def _locked(folder: Path, alone: bool) -> Iterator[bool]:
    """Share a lock on a folder while the block runs, waiting for whoever has it alone; or have it alone if nobody shares it."""
    try:
        handle = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
    except (OSError, AttributeError):
        yield False
        return
    try:
        yield _lock(handle, alone)
    finally:
        os.close(handle)


def _lock(handle: int, alone: bool) -> bool:
    if fcntl is None:
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB if alone else fcntl.LOCK_SH)
    except OSError:
        return False
    return True
