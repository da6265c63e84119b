"""Numeric arrays of a MATLAB file of version 4 to 7, walked one after another, of which only the wanted are kept.

The walk follows MathWorks' description of the format (MAT-File Format, R2024a). An array, a struct or a variable that
claims more than the file holds is refused before anything is allocated. SciPy's reader builds every object of a variable
and leaves the process with a segmentation fault where a damaged file misleads it.
"""

import struct
import zlib
from collections.abc import Iterator
from math import prod
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from seatrial.core.errors import InputError

_MATRIX, _COMPRESSED = 14, 15
_STRUCT, _NUMERIC = 2, range(6, 16)
_CELL = 1
_DEEPEST = 32
_MOST_BYTES = 1 << 29
"""Of one array: it is read whole."""
_KINDS_4 = ("f8", "f4", "i4", "i2", "u2", "u1")
_KINDS_5 = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_FLOATS = (6, 7)

Found = Iterator["MatlabArray"]


class MatlabArray(NamedTuple):
    """A real numeric array that no cell or object holds: dotted path, shape, and its values if they are wanted."""

    path: str
    shape: tuple[int, ...]
    values: np.ndarray | None


def matlab_arrays(path: Path, wanted: frozenset[str] = frozenset()) -> Found:
    """Walk a file and keep the wanted arrays.

    Raises:
        InputError: a file that claims more than it holds, or a wanted array too large to be read whole.
    """
    total = path.stat().st_size
    with path.open("rb") as stream:
        head = stream.read(128)
        order = version_4_order(head)
        if order is not None:
            stream.seek(0)
            yield from _walk_4(stream, order, total, path, wanted)
        else:
            yield from _walk_5(stream, {b"IM": "<", b"MI": ">"}[head[126:128]], total, path, wanted)


def version_4_order(head: bytes) -> str | None:
    """Byte order of a version 4 file, whose first number says how its numbers are kept; None for any other file."""
    for order, machine in (("<", 0), (">", 1)):
        if len(head) < 20:
            return None
        kind, rows, columns, imaginary, length = struct.unpack(f"{order}5i", head[:20])
        thousands, rest = divmod(kind, 1000)
        is_kind = kind >= 0 and thousands == machine and rest // 100 == 0 and rest // 10 % 10 <= 5 and rest % 10 <= 2
        if is_kind and rows >= 0 and columns >= 0 and imaginary in (0, 1) and 0 < length < 256:
            return order
    return None


def _walk_4(stream: BinaryIO, order: str, total: int, path: Path, wanted: frozenset[str]) -> Found:
    while stream.tell() < total:
        at = stream.tell()
        header = stream.read(20)
        if len(header) < 20:
            raise _damaged(path, f"a header cut off at byte {at}")
        kind, rows, columns, imaginary, length = struct.unpack(f"{order}5i", header)
        name_and_kind = 0 <= kind // 10 % 10 <= 5 and 0 < length < 256
        if not (name_and_kind and rows >= 0 and columns >= 0 and imaginary in (0, 1)):
            raise _damaged(path, f"a header that makes no sense at byte {at}")
        dtype = np.dtype(order + _KINDS_4[kind // 10 % 10])
        size = rows * columns * dtype.itemsize * (1 + imaginary)
        if at + 20 + length + size > total:
            raise _damaged(path, f"an array of {size} bytes at byte {at}, beyond the end of the file")
        name = stream.read(length).rstrip(b"\0").decode("latin-1")
        values = None
        if name in wanted:
            _check_size(path, name, size)
            values = np.frombuffer(stream.read(size), dtype).reshape(columns, rows).T
        else:
            stream.seek(size, 1)
        if kind % 10 == 0 and not imaginary:
            yield MatlabArray(name, (rows, columns), values)


def _walk_5(stream: BinaryIO, order: str, total: int, path: Path, wanted: frozenset[str]) -> Found:
    while (at := stream.tell()) < total:
        tag = stream.read(8)
        if len(tag) < 8:
            raise _damaged(path, f"a variable cut off at byte {at}")
        kind, size = struct.unpack(f"{order}2I", tag)
        if at + 8 + size > total:
            raise _damaged(path, f"a variable of {size} bytes at byte {at}, beyond the end of the file")
        if kind == _COMPRESSED:
            source = _Bytes(stream, size, True, path)
            kind, size = struct.unpack(f"{order}2I", source.take(8))
        else:
            source = _Bytes(stream, size, False, path)
        if kind == _MATRIX:
            yield from _matrix(source, size, order, "", 0, wanted)
        stream.seek(at + 8 + struct.unpack(f"{order}2I", tag)[1])


class _Bytes:
    """Bytes of one variable, unpacked a little at a time where they are compressed."""

    def __init__(self, stream: BinaryIO, size: int, compressed: bool, path: Path):
        self.stream, self.left, self.path = stream, size, path
        self.unpack = zlib.decompressobj() if compressed else None
        self.held = b""

    def take(self, count: int) -> bytes:
        parts = []
        while count > 0:
            part = self._next(min(count, 1 << 16))
            if not part:
                raise _damaged(self.path, "a variable that ends before its arrays do")
            parts.append(part)
            count -= len(part)
        return b"".join(parts)

    def skip(self, count: int) -> None:
        while count > 0:
            part = self._next(min(count, 1 << 16))
            if not part:
                raise _damaged(self.path, "a variable that ends before its arrays do")
            count -= len(part)

    def _next(self, count: int) -> bytes:
        if self.unpack is None:
            part = self.stream.read(min(count, self.left))
            self.left -= len(part)
            return part
        while True:
            part = self.unpack.decompress(self.held, count)
            self.held = self.unpack.unconsumed_tail
            if part or self.unpack.eof:
                return part
            self.held = self.held or self.stream.read(min(1 << 16, self.left))
            if not self.held:
                return b""
            self.left -= len(self.held)


def _matrix(source: _Bytes, size: int, order: str, path: str | None, depth: int, wanted: frozenset[str]) -> Found:
    """Walk one array and what is below it, and leave `source` behind it; below a path of None nothing has a name."""
    if depth > _DEEPEST:
        raise _damaged(source.path, "structs within structs without end")
    if size == 0:
        return
    left = _Left(source, size)
    flags = struct.unpack(f"{order}I", left.element(order)[:4])[0]
    kind, is_complex = flags & 0xFF, bool(flags & 0x0800)
    if kind not in (_STRUCT, _CELL, *_NUMERIC):
        left.rest()
        return
    dimensions = left.element(order)
    shape = struct.unpack(f"{order}{len(dimensions) // 4}i", dimensions)
    name = left.element(order).rstrip(b"\0").decode("latin-1")
    here = None if path is None else f"{path}{name}"
    count = prod(shape)
    if not 1 < len(shape) <= 8 or any(extent < 0 for extent in shape):
        raise _damaged(source.path, f"an array of shape {shape}")
    if kind in _NUMERIC:
        # Whole numbers may be kept in one byte each, whatever their class.
        if count > left.size:
            raise _damaged(source.path, f"an array of shape {shape} in {left.size} bytes")
        if here and not is_complex:
            values = _values(left, order, shape, kind in _FLOATS, here) if here in wanted else None
            left.rest()
            yield MatlabArray(here, shape, values)
    elif kind == _CELL:
        if count * 8 > left.size:
            raise _damaged(source.path, f"cells of shape {shape} in {left.size} bytes")
        for _ in range(count):
            yield from _child(left, order, None, depth, wanted)
    else:
        length = max(struct.unpack(f"{order}i", left.element(order)[:4])[0], 1)
        text = left.element(order)
        names = [text[k : k + length].split(b"\0")[0].decode("latin-1") for k in range(0, len(text), length)]
        if count * max(len(names), 1) * 8 > left.size + 8:
            raise _damaged(source.path, f"a struct of shape {shape} in {left.size} bytes")
        for _ in range(count):
            for field in names:
                yield from _child(left, order, f"{here}.{field}" if count == 1 and here else None, depth, wanted)
    left.rest()


def _child(left: "_Left", order: str, path: str | None, depth: int, wanted: frozenset[str]) -> Found:
    kind, size = left.tag(order)
    if kind != _MATRIX:
        raise _damaged(left.source.path, "something other than an array within a struct")
    left.size -= size
    yield from _matrix(left.source, size, order, path, depth + 1, wanted)


def _values(left: "_Left", order: str, shape: tuple[int, ...], is_float: bool, path: str) -> np.ndarray:
    """Real part of an array."""
    code, raw = left.numbers(order, path)
    if code not in _KINDS_5:
        raise _damaged(left.source.path, f"numbers of an unknown type in {path}")
    dtype = np.dtype(order + _KINDS_5[code])
    if len(raw) != prod(shape) * dtype.itemsize:
        raise _damaged(left.source.path, f"{len(raw)} bytes for {path} of shape {shape}")
    values = np.frombuffer(raw, dtype).reshape(shape, order="F")
    return values.astype(float) if is_float else values


class _Left:
    """What is left of one array: elements of tag and data, padded to eight bytes."""

    def __init__(self, source: _Bytes, size: int):
        self.source, self.size = source, size

    def tag(self, order: str) -> tuple[int, int]:
        self._spend(8)
        kind, size = struct.unpack(f"{order}2I", self.source.take(8))
        if size > self.size:
            raise _damaged(self.source.path, "an element longer than the array around it")
        return kind, size

    def element(self, order: str) -> bytes:
        """Data of the next small element."""
        return self._data(order, 1 << 20)[1]

    def numbers(self, order: str, path: str) -> tuple[int, bytes]:
        """Type and data of the next element, whatever its size."""
        _check_size(self.source.path, path, self.size)
        return self._data(order, self.size)

    def _data(self, order: str, most: int) -> tuple[int, bytes]:
        self._spend(8)
        tag = self.source.take(8)
        first, size = struct.unpack(f"{order}2I", tag)
        if first >> 16:
            if first >> 16 > 4:
                raise _damaged(self.source.path, "a short element of more than four bytes")
            return first & 0xFFFF, tag[4 : 4 + (first >> 16)]
        padded = -(-size // 8) * 8
        if size > most:
            raise _damaged(self.source.path, f"an element of {size} bytes")
        # The last element of a variable may end without its padding.
        padded = min(padded, max(size, self.size))
        self._spend(padded)
        return first, self.source.take(padded)[:size]

    def rest(self) -> None:
        self.source.skip(self.size)
        self.size = 0

    def _spend(self, count: int) -> None:
        self.size -= count
        if self.size < 0:
            raise _damaged(self.source.path, "an array shorter than its header")


def _check_size(path: Path, name: str, size: int) -> None:
    if size > _MOST_BYTES:
        raise InputError(
            f"{path}, array {name}",
            found=f"{size >> 20} MB",
            expected=f"at most {_MOST_BYTES >> 20} MB",
            remedy="save the file with -v7.3, which can be read in parts",
        )


def _damaged(path: Path, found: str) -> InputError:
    return InputError(
        str(path),
        found=found,
        expected="a whole MATLAB file",
        remedy="the file is cut off or damaged: copy or save it again",
    )
