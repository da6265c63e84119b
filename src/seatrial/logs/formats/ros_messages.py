"""The wanted numbers of ROS messages, taken out of their bytes without building a message or compiling its definition.

A definition becomes a list of steps: numbers, strings, and elements of arrays and sequences. One message is walked; all that are as long
and have the same lengths in the same places lie alike, and NumPy reads their numbers at once. CDR (ROS 2) aligns each number to its size;
ROS 1 does not.
"""

import re
import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from seatrial.logs.formats.protocol import BLOCK_ROWS, LOG_TIME, MAX_ELEMENTS, Block, ColumnInfo, as_column

BASE, NAME, ARRAY = 1, 2, 3  # Kinds of a field's type in a definition as rosbags parses it; the fourth is a sequence
_HEADER = 4  # Bytes of CDR in front of a message; numbers are aligned as counted from behind them
_BATCH_BYTES = 1 << 20  # Bytes of messages that are looked at together
_CODES = {
    **dict.fromkeys(("bool", "byte", "char", "octet", "uint8"), "B"),
    "int8": "b",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
    "float32": "f",
    "float64": "d",
}
_STAMPS = {"builtin_interfaces/msg/Time": "t", "builtin_interfaces/msg/Duration": "T"}
# Sequences of these are pictures and raw data, not signals
_BULK_TYPES = ("bool", "byte", "char", "octet", "int8", "uint8")
_MAX_DEPTH = 24
_INDEX = re.compile(r"\[(\d{1,9})\]")
_MOST_FIELDS = 50_000

Definitions = Mapping[str, tuple[Any, Sequence[tuple[str, Any]]]]


class Undefined(ValueError):
    """A definition that is missing or that makes no sense."""


class Leaf(NamedTuple):
    """One number of a message: its path and its `struct` code, `t` or `T` for a time or duration in seconds and nanoseconds."""

    path: str
    code: str


class Text(NamedTuple):
    """A string, and its path."""

    path: str


@dataclass(frozen=True)
class Many:
    """Elements that all have the same steps; `count` is None where the message tells how many, `least` the bytes that each has at least."""

    path: str
    count: int | None
    steps: tuple["Leaf | Text | Many", ...]
    least: int


Step = Leaf | Text | Many


def steps_of(kind: str, definitions: Definitions, is_cdr: bool) -> tuple[Step, ...]:
    """Return the steps of a message type.

    Args:
        kind: name of the type.
        definitions: fields of every type by its name.
        is_cdr: whether the message is in CDR, as of ROS 2, whose numbers are aligned.

    Raises:
        Undefined: a type that is not defined, contains itself, or has an unreasonable number of fields.
    """
    budget = [_MOST_FIELDS]
    return tuple(_steps(kind, definitions, is_cdr, "", 0, budget))


def columns_of(steps: Sequence[Step], lengths: Mapping[str, int], prefix: str = "") -> Iterator[ColumnInfo]:
    """Yield the columns that a catalogue lists: every number, and the elements of arrays and sequences, the first 64 of long ones.

    Args:
        steps: of the message type.
        lengths: of sequences by their path, see `lengths_of`; of one that is not there, or empty, the first element is listed.
        prefix: path so far.
    """
    for step in steps:
        if isinstance(step, Leaf):
            yield ColumnInfo(_joined(prefix, step.path), "ns" if step.code in "tT" else None)
        elif isinstance(step, Many) and step.path:
            path = _joined(prefix, step.path)
            count = max(lengths.get(path, 1), 1) if step.count is None else step.count
            for k in range(min(count, MAX_ELEMENTS)):
                yield from columns_of(step.steps, lengths, f"{path}[{k}]")


def words_of(steps: Sequence[Step]) -> tuple[str, ...]:
    """Return the strings of a message, by path; those of elements are left out."""
    return tuple(step.path for step in steps if isinstance(step, Text))


def has_sequences(steps: Sequence[Step]) -> bool:
    """Return whether the length of a message of these steps is known by the message alone."""
    return any(
        isinstance(step, Many) and step.path and (step.count is None or has_sequences(step.steps)) for step in steps
    )


def lengths_of(messages: Iterable[bytes], steps: Sequence[Step], is_cdr: bool) -> dict[str, int]:
    """Return the greatest length of every sequence in some messages, by its path; what a damaged message has is left out."""
    lengths: dict[str, int] = {}
    for data in messages:
        with suppress(struct.error):
            walk = _Walk(data, is_cdr, frozenset())
            walk.all(steps)
            for path, count in walk.counts.items():
                lengths[path] = max(count, lengths.get(path, 0))
    return lengths


@dataclass(eq=False)
class Decoder:
    """Takes the wanted columns out of the messages of one table.

    Attributes:
        table: name, for the blocks.
        steps: of the message type.
        columns: to take; elements beyond the end of a sequence become NaN.
        is_cdr: whether messages are CDR of ROS 2, not ROS 1.
    """

    table: str
    steps: Sequence[Step]
    columns: Sequence[str]
    is_cdr: bool
    times: list[int] = field(default_factory=list)
    messages: list[bytes] = field(default_factory=list)
    size: int = 0

    def take(self, time: int, data: bytes) -> bool:
        """Take a message, and say whether a block has come together."""
        self.times.append(time)
        self.messages.append(data)
        self.size += len(data)
        return self.size >= _BATCH_BYTES or len(self.messages) >= BLOCK_ROWS

    def block(self, done: float) -> Block:
        """Hand on the rows that have come together.

        Raises:
            struct.error: a message that does not fit its definition.
        """
        parts: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {name: [] for name in self.columns}
        sizes = np.array([len(data) for data in self.messages])
        for size in np.unique(sizes):
            rows = np.flatnonzero(sizes == size)
            text = b"".join([self.messages[row] for row in rows])
            self._read(np.frombuffer(text, np.uint8).reshape(rows.size, size), rows, parts)
        columns = {name: _filled(parts[name], sizes.size) for name in self.columns if name != LOG_TIME}
        if LOG_TIME in self.columns:
            columns[LOG_TIME] = np.array(self.times, np.int64)
        self.times, self.messages, self.size = [], [], 0
        return Block(self.table, columns, done)

    def _read(
        self, messages: np.ndarray, rows: np.ndarray, parts: Mapping[str, list[tuple[np.ndarray, np.ndarray]]]
    ) -> None:
        """Read messages of one length: those that lie as the first does, then those as the first of the others."""
        left = np.arange(rows.size)
        while left.size:
            walk = _Walk(messages[left[0]].tobytes(), self.is_cdr, frozenset(self.columns))
            walk.all(self.steps)
            places = np.array([*range(_HEADER * self.is_cdr), *walk.lengths], int)
            is_alike = (messages[left[:, None], places] == messages[left[0], places]).all(axis=1)
            alike, left = left[is_alike], left[~is_alike]
            for name, (at, code) in walk.numbers.items():
                cells = np.ascontiguousarray(messages[alike, at : at + code.itemsize])
                if code.kind == "S":
                    words = [row.tobytes().rstrip(b"\0").decode("utf-8", "replace") for row in cells]
                    parts[name].append((rows[alike], np.array(words, object)))
                    continue
                raw = cells.view(code)[:, 0]
                values = raw if code.names is None else raw["s"].astype(np.int64) * 10**9 + raw["ns"]
                parts[name].append((rows[alike], as_column(values)))


class _Walk:
    """Places of the wanted numbers of a message (byte and kind) and of the bytes of all lengths in it, and these lengths by path."""

    def __init__(self, data: bytes, is_cdr: bool, wanted: frozenset[str]):
        if is_cdr and (len(data) < _HEADER or data[0] != 0 or data[1] > 1):
            raise struct.error("an encoding other than plain CDR")
        self.data, self.is_cdr, self.wanted = data, is_cdr, wanted
        self.order = ">" if is_cdr and data[1] == 0 else "<"
        self.at = _HEADER if is_cdr else 0
        self.numbers: dict[str, tuple[int, np.dtype]] = {}
        self.lengths: list[int] = []
        self.counts: dict[str, int] = {}

    def all(self, steps: Sequence[Step]) -> None:
        """Walk a whole message.

        Raises:
            struct.error: it does not fit its definition.
        """
        self._steps(steps, "")
        # Some middleware fills CDR up to four bytes.
        if not self.at <= len(self.data) <= self.at + (3 if self.is_cdr else 0):
            raise struct.error(f"{len(self.data)} bytes, but by its definition {self.at}")

    def _steps(self, steps: Sequence[Step], prefix: str) -> None:
        for step in steps:
            if isinstance(step, Text):
                length = self._length()
                if (name := _joined(prefix, step.path)) in self.wanted and self.at + length <= len(self.data):
                    self.numbers[name] = self.at, np.dtype(f"S{length}")
                self.at += length
            elif isinstance(step, Many):
                self._many(step, _joined(prefix, step.path))
            else:
                self._numbers(step, 1, {0: _joined(prefix, step.path)})

    def _many(self, step: Many, path: str) -> None:
        number = self._length() if step.count is None else step.count
        if number * step.least > len(self.data) - self.at:
            raise struct.error(f"{number} elements in {len(self.data) - self.at} bytes")
        if step.count is None and step.path:
            self.counts[path] = number
        leaf = step.steps[0] if len(step.steps) == 1 else None
        if isinstance(leaf, Leaf):
            chosen = self._indices(path) if step.path else ()
            self._numbers(leaf, number, {k: _joined(f"{path}[{k}]", leaf.path) for k in chosen})
            return
        for k in range(number if step.least else 0):
            self._steps(step.steps, f"{path}[{k}]")

    def _numbers(self, leaf: Leaf, count: int, names: Mapping[int, str]) -> None:
        """Return the numbers that follow each other, of which some have a name."""
        code = _kind(leaf.code, self.order, self.is_cdr)
        if self.is_cdr and count:
            self.at += (_HEADER - self.at) % min(code.itemsize, 4 if code.names else 8)
        for k, name in names.items():
            if k < count and name in self.wanted:
                self.numbers[name] = self.at + k * code.itemsize, code
        self.at += count * code.itemsize

    def _length(self) -> int:
        if self.is_cdr:
            self.at += (_HEADER - self.at) % 4
        self.lengths += range(self.at, self.at + 4)
        self.at += 4
        return struct.unpack_from(self.order + "I", self.data, self.at - 4)[0]

    def _indices(self, path: str) -> set[int]:
        """Return the elements of an array that are wanted."""
        matches = (_INDEX.match(name, len(path)) for name in self.wanted if name.startswith(f"{path}["))
        return {int(match[1]) for match in matches if match}


@lru_cache(maxsize=256)
def _kind(code: str, order: str, is_cdr: bool) -> np.dtype:
    """Return the type of a number; of a time or duration its seconds and nanoseconds."""
    if code not in "tT":
        return np.dtype(order + code)
    seconds, nanoseconds = "iI" if is_cdr else {"t": "II", "T": "ii"}[code]
    return np.dtype([("s", order + seconds), ("ns", order + nanoseconds)])


def _filled(parts: Sequence[tuple[np.ndarray, np.ndarray]], rows: int) -> np.ndarray:
    """Return one column of its parts, NaN if none has a row."""
    kinds = {values.dtype.kind for _, values in parts}
    is_whole = sum(at.size for at, _ in parts) == rows and kinds == {"i"}
    column = (
        np.empty(rows, np.int64)
        if is_whole
        else np.full(rows, "" if "O" in kinds else np.nan, object if "O" in kinds else float)
    )
    for at, values in parts:
        column[at] = values
    return column


def _least(step: Step) -> int:
    """Return the fewest bytes that a step may have."""
    if isinstance(step, Leaf):
        return 8 if step.code in "tT" else struct.calcsize("<" + step.code)
    return 4 if isinstance(step, Text) or step.count is None else step.count * step.least


def _joined(prefix: str, path: str) -> str:
    """Return the dotted path."""
    return f"{prefix}.{path}" if prefix and path else prefix + path


def _steps(
    kind: str, definitions: Definitions, is_cdr: bool, prefix: str, depth: int, budget: list[int]
) -> Iterator[Step]:
    if depth > _MAX_DEPTH:
        raise Undefined(f"{kind} contains itself")
    if kind in _STAMPS:
        yield Leaf(prefix, _STAMPS[kind])
        return
    if kind not in definitions:
        raise Undefined(f"the log does not define {kind}")
    fields = definitions[kind][1]
    if not fields and is_cdr:
        # ROS 2 gives an empty message one byte.
        fields = [("structure_needs_at_least_one_member", (BASE, ("uint8", 0)))]
    for name, (node, detail) in fields:
        budget[0] -= 1
        if budget[0] < 0:
            raise Undefined(f"{kind} has too many fields")
        path = _joined(prefix, name)
        if node in (BASE, NAME):
            yield from _single(node, detail, definitions, is_cdr, path, depth, budget)
        else:
            (inner, inner_detail), size = detail
            steps = tuple(_single(inner, inner_detail, definitions, is_cdr, "", depth, budget))
            is_bulk = inner == BASE and inner_detail[0] in _BULK_TYPES and (node != ARRAY or size > MAX_ELEMENTS)
            yield Many("" if is_bulk else path, size if node == ARRAY else None, steps, sum(map(_least, steps)))


def _single(
    node: int, detail: Any, definitions: Definitions, is_cdr: bool, path: str, depth: int, budget: list[int]
) -> Iterator[Step]:
    if node == NAME:
        yield from _steps(detail, definitions, is_cdr, path, depth + 1, budget)
    elif detail[0] == "string":
        yield Text(path)
    elif detail[0] == "byte" and not is_cdr:
        yield Leaf(path, "b")
    elif detail[0] in _CODES:
        yield Leaf(path, _CODES[detail[0]])
    else:
        raise Undefined(f"numbers of type {detail[0]} cannot be read")
