"""The wanted numbers of ROS messages, taken out of their bytes without building a message.

Numbers that follow each other are read by one `struct` call that skips what is not wanted, so that a message costs a few
microseconds whatever it holds. CDR (ROS 2) aligns each number to its size, counted from behind the four-byte header; ROS 1
does not align.
"""

import math
import re
import struct
from collections.abc import Callable, Sequence
from typing import NamedTuple

from seatrial.logs.formats.protocol import BLOCK_ROWS, LOG_TIME, Block, Columns
from seatrial.logs.formats.ros_layout import Leaf, Many, Step, Text, joined

_HEADER = 4
_UNROLLED = 256
_NUMBERS = 1 << 16
_SECONDS, _NANOSECONDS = "\0seconds", "\0nanoseconds"
_INDEX = re.compile(r"\[(\d{1,9})\]")

_Walk = Callable[[bytes, int], int]
"""Walks on from a position in a message and returns the next, having taken what is wanted on the way."""


class _Item(NamedTuple):
    """A number, or numbers to pass over: `struct` code, bytes, alignment, and columns it goes to."""

    code: str
    size: int
    align: int
    sinks: tuple[str, ...]


class Decoder:
    """Takes the wanted columns out of the messages of one table."""

    def __init__(self, table: str, steps: Sequence[Step], columns: Sequence[str], is_cdr: bool):
        """Prepare for messages of some steps.

        Args:
            table: name, for the blocks.
            steps: of the message type.
            columns: to take; elements beyond the end of a sequence become NaN.
            is_cdr: whether messages are CDR of ROS 2, not ROS 1.
        """
        self.names, self.is_cdr, self.steps = tuple(columns), is_cdr, steps
        self.wanted = {name for name in columns if name != LOG_TIME}
        codes = _codes(steps, self.wanted, "", False)
        if LOG_TIME in columns:
            codes[LOG_TIME] = "q"
        if unknown := [name for name in self.wanted if name not in codes and name + _SECONDS not in codes]:
            raise ValueError(f"no number {unknown[0]!r} in its messages")
        self.columns = Columns(table, codes)
        self.full = min(BLOCK_ROWS, max(64, _NUMBERS // max(len(codes), 1)))
        self.walks: dict[str, _Walk] = {}

    def take(self, time: int, data: bytes) -> bool:
        """Take the numbers of one message, and say whether a block has come together.

        Raises:
            struct.error: a message that does not fit its definition.
        """
        start, order = 0, "<"
        if self.is_cdr:
            if len(data) < _HEADER or data[0] != 0 or data[1] > 1:
                raise struct.error("an encoding other than plain CDR")
            start, order = _HEADER, "<" if data[1] else ">"
        if order not in self.walks:
            self.walks[order] = self._walk(self.steps, self.wanted, "", order)
        end = self.walks[order](data, start)
        # Some middleware fills CDR up to four bytes.
        if end > len(data) or len(data) - end > (3 if self.is_cdr else 0):
            raise struct.error(f"{len(data)} bytes where its definition makes {end}")
        if LOG_TIME in self.columns.buffers:
            self.columns.buffers[LOG_TIME].append(time)
        return self.columns.rows >= self.full

    def block(self, done: float) -> Block:
        """Hand on the rows that have come together."""
        block = self.columns.block(done)
        columns = {}
        for name in self.names:
            if name in block.columns:
                columns[name] = block.columns[name]
            else:
                columns[name] = block.columns[name + _SECONDS] * 10**9 + block.columns[name + _NANOSECONDS]
        return Block(block.table, columns, done)

    def _walk(self, steps: Sequence[Step], wanted: set[str], prefix: str, order: str) -> _Walk:
        walks: list[_Walk] = []
        run: list[_Item] = []
        for step in steps:
            items = self._items(step, wanted, prefix)
            if items is not None:
                run += items
                continue
            if run:
                walks.append(self._run(run, order))
                run = []
            if isinstance(step, Many):
                walks.append(self._many(step, wanted, prefix, order))
            else:
                walks.append(self._text(order))
        if run or not walks:
            walks.append(self._run(run, order))
        if len(walks) == 1:
            return walks[0]

        def walk(data: bytes, at: int) -> int:
            for each in walks:
                at = each(data, at)
            return at

        return walk

    def _items(self, step: Step, wanted: set[str], prefix: str) -> list[_Item] | None:
        """Numbers at fixed places; None for a step that the message itself decides."""
        if isinstance(step, Text):
            return None
        if isinstance(step, Leaf):
            name = joined(prefix, step.path)
            taken = name in wanted
            if step.code in "tT":
                code = "iI" if self.is_cdr else {"t": "II", "T": "ii"}[step.code]
                return [_Item(code, 8, 4, (name + _SECONDS, name + _NANOSECONDS) if taken else ())]
            size = struct.calcsize("<" + step.code)
            return [_Item(step.code, size, size, (name,) if taken else ())]
        if step.count is None or not all(isinstance(inner, Leaf) for inner in step.steps):
            return None
        indices = _indices(joined(prefix, step.path), wanted)
        if len(step.steps) == 1 and not indices:
            item = (self._items(step.steps[0], set(), "") or [])[0]
            return [_Item("x", item.size * step.count, item.align, ())] if step.count else []
        if step.count * len(step.steps) > _UNROLLED:
            return None
        return [
            item
            for k in range(step.count)
            for inner in step.steps
            for item in self._items(inner, wanted, f"{joined(prefix, step.path)}[{k}]") or ()
        ]

    def _run(self, items: Sequence[_Item], order: str) -> _Walk:
        """Read numbers that follow each other, laid out for each of the eight ways in which they may be aligned."""
        appends = [self.columns.buffers[sink].append for item in items for sink in item.sinks]
        layouts = []
        for start in range(8 if self.is_cdr else 1):
            at, form = start, order
            for item in items:
                pad = -at % item.align if self.is_cdr else 0
                form += f"{pad}x" + (item.code if item.sinks else f"{item.size}x")
                at += pad + item.size
            layouts.append((struct.Struct(form), at - start))
        mask = 7 if self.is_cdr else 0

        def run(data: bytes, at: int) -> int:
            layout, size = layouts[(at - _HEADER) & mask]
            if appends:
                for append, value in zip(appends, layout.unpack_from(data, at), strict=True):
                    append(value)
            return at + size

        return run

    def _text(self, order: str) -> _Walk:
        length, is_cdr = struct.Struct(order + "I").unpack_from, self.is_cdr

        def text(data: bytes, at: int) -> int:
            at += (_HEADER - at) % 4 if is_cdr else 0
            return at + 4 + length(data, at)[0]

        return text

    def _many(self, step: Many, wanted: set[str], prefix: str, order: str) -> _Walk:
        length, is_cdr, count = struct.Struct(order + "I").unpack_from, self.is_cdr, step.count
        path = joined(prefix, step.path)
        chosen = {k: self._walk(step.steps, wanted, f"{path}[{k}]", order) for k in _indices(path, wanted)}
        absent = {k: self._absent(step.steps, wanted, f"{path}[{k}]") for k in chosen}
        pass_over = self._walk(step.steps, set(), "", order)
        least, fixed = _least(step.steps), self._fixed(step.steps)
        size, align = fixed or (0, 1)

        def many(data: bytes, at: int) -> int:
            number = count
            if number is None:
                at += (_HEADER - at) % 4 if is_cdr else 0
                number = length(data, at)[0]
                at += 4
            if number * least > len(data) - at:
                raise struct.error(f"{number} elements in {len(data) - at} bytes")
            if fixed and not chosen:
                at += (_HEADER - at) % align if is_cdr and number else 0
                return at + number * size
            for k in range(number if least else 0):
                at = chosen.get(k, pass_over)(data, at)
            for k, fill in absent.items():
                if k >= number:
                    fill()
            return at

        return many

    def _absent(self, steps: Sequence[Step], wanted: set[str], prefix: str) -> Callable[[], None]:
        buffers = [self.columns.buffers[name] for name in _codes(steps, wanted, prefix, True)]

        def fill() -> None:
            for buffer in buffers:
                buffer.append(math.nan)

        return fill

    def _fixed(self, steps: Sequence[Step]) -> tuple[int, int] | None:
        """Bytes and alignment of an element that always has as many, wherever it lies."""
        if self.is_cdr and len(steps) > 1:
            return None
        items = [self._items(step, set(), "") for step in steps]
        flat = [item for group in items if group is not None for item in group]
        if None in items or not flat:
            return None
        return sum(item.size for item in flat), flat[0].align


def _codes(steps: Sequence[Step], wanted: set[str], prefix: str, may_miss: bool) -> dict[str, str]:
    """Buffers that the wanted columns need; floats where an element may be missing."""
    codes: dict[str, str] = {}
    for step in steps:
        if isinstance(step, Leaf) and (name := joined(prefix, step.path)) in wanted:
            code = "d" if may_miss or step.code in "fdQ" else "q"
            codes.update({name + _SECONDS: code, name + _NANOSECONDS: code} if step.code in "tT" else {name: code})
        elif isinstance(step, Many) and step.path:
            path = joined(prefix, step.path)
            for k in _indices(path, wanted):
                if step.count is None or k < step.count:
                    codes |= _codes(step.steps, wanted, f"{path}[{k}]", may_miss or step.count is None)
    return codes


def _indices(path: str, wanted: set[str]) -> list[int]:
    """Elements of an array that are wanted."""
    found = (_INDEX.match(name, len(path)) for name in wanted if name.startswith(f"{path}["))
    return sorted({int(match[1]) for match in found if match})


def _least(steps: Sequence[Step]) -> int:
    """Fewest bytes that an element may have."""
    total = 0
    for step in steps:
        if isinstance(step, Leaf):
            total += 8 if step.code in "tT" else struct.calcsize("<" + step.code)
        elif isinstance(step, Text):
            total += 4
        else:
            total += 4 if step.count is None else step.count * _least(step.steps)
    return total
