"""How ROS messages lie in bytes.

A message definition becomes a list of steps: numbers, strings, and elements of arrays and sequences. No code is generated
from a definition; `ros_decode` walks the steps.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from seatrial.logs.formats.protocol import MOST_ELEMENTS, ColumnInfo

BASE, NAME, ARRAY = 1, 2, 3
"""Kinds of a field's type in a definition as rosbags parses it; the fourth is a sequence."""
_CODES = {
    "bool": "B",
    "byte": "B",
    "char": "B",
    "octet": "B",
    "int8": "b",
    "uint8": "B",
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
_BULK = ("bool", "byte", "char", "octet", "int8", "uint8")
"""Sequences of these are pictures and raw data, not signals."""
_DEEPEST = 24
_MOST_FIELDS = 50_000

Definitions = Mapping[str, tuple[Any, Sequence[tuple[str, Any]]]]


class Undefined(ValueError):
    """A definition that is missing or that makes no sense."""


class Leaf(NamedTuple):
    """One number of a message: its path and its `struct` code, `t` or `T` for a time or duration in seconds and nanoseconds."""

    path: str
    code: str


class Text(NamedTuple):
    """A string."""


@dataclass(frozen=True)
class Many:
    """Elements that all have the same steps; `count` is None where the message tells how many."""

    path: str
    count: int | None
    steps: tuple["Leaf | Text | Many", ...]


Step = Leaf | Text | Many


def steps_of(kind: str, definitions: Definitions, is_cdr: bool) -> tuple[Step, ...]:
    """Return the steps of a message type.

    Raises:
        Undefined: a type that is not defined, contains itself, or has an unreasonable number of fields.
    """
    budget = [_MOST_FIELDS]
    return tuple(_steps(kind, definitions, is_cdr, "", 0, budget))


def columns_of(steps: Sequence[Step], prefix: str = "") -> Iterator[ColumnInfo]:
    """Columns that a catalogue lists: every number, of arrays the first elements, of sequences the first one."""
    for step in steps:
        if isinstance(step, Leaf):
            yield ColumnInfo(joined(prefix, step.path), "ns" if step.code in "tT" else None)
        elif isinstance(step, Many) and step.path:
            for k in range(1 if step.count is None else min(step.count, MOST_ELEMENTS)):
                yield from columns_of(step.steps, f"{joined(prefix, step.path)}[{k}]")


def joined(prefix: str, path: str) -> str:
    """Dotted path."""
    return f"{prefix}.{path}" if prefix and path else prefix + path


def _steps(
    kind: str, definitions: Definitions, is_cdr: bool, prefix: str, depth: int, budget: list[int]
) -> Iterator[Step]:
    if depth > _DEEPEST:
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
        path = joined(prefix, name)
        if node in (BASE, NAME):
            yield from _single(node, detail, definitions, is_cdr, path, depth, budget)
        else:
            (inner, inner_detail), size = detail
            steps = tuple(_single(inner, inner_detail, definitions, is_cdr, "", depth, budget))
            is_bulk = inner == BASE and inner_detail[0] in _BULK and (node != ARRAY or size > MOST_ELEMENTS)
            yield Many("" if is_bulk else path, size if node == ARRAY else None, steps)


def _single(
    node: int, detail: Any, definitions: Definitions, is_cdr: bool, path: str, depth: int, budget: list[int]
) -> Iterator[Step]:
    if node == NAME:
        yield from _steps(detail, definitions, is_cdr, path, depth + 1, budget)
    elif detail[0] == "string":
        yield Text()
    elif detail[0] == "byte" and not is_cdr:
        yield Leaf(path, "b")
    elif detail[0] in _CODES:
        yield Leaf(path, _CODES[detail[0]])
    else:
        raise Undefined(f"numbers of type {detail[0]} cannot be read")
