"""When a run is what it is taken for, by columns of its logs: armed, in a mode, above a voltage.

condition  = comparison { "and" comparison }
comparison = column ( "==" | "!=" | "<" | "<=" | ">" | ">=" ) number
column     = letters, digits, and . _ / [ ], or anything between single quotes

Numbers are held from their stamp to the next; one that is missing holds nothing.
"""

import operator
import re
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal

import numpy as np
from jaxtyping import Float

from seatrial.core.errors import InputError
from seatrial.logs.read import read_stamped
from seatrial.logs.source import LogSource

_RELATIONS = {
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
_COMPARISON = re.compile(
    r"""\s* (?: '(?P<quoted>[^']+)' | (?P<bare>[A-Za-z_/][\w./\[\]]*) ) \s* (?P<relation>[=!<>]=|[<>]) \s*
        (?P<number>[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?) \s*""",
    re.VERBOSE,
)
_MOST = 16
"""Comparisons of a condition."""


@dataclass(frozen=True)
class Comparison:
    """A column, a relation and the number that it is compared with."""

    column: str
    relation: str
    number: float


Span = tuple[Decimal, Decimal]
"""From one stamp to another, s on the clock of the log."""


def parse_condition(text: str, where: str) -> tuple[Comparison, ...]:
    """Return the comparisons of a condition, all of which have to hold.

    Args:
        text: as written, for example `armed == 1 and voltage > 14.5`.
        where: file and key, for the error.

    Raises:
        InputError: something else than comparisons of columns with numbers.
    """
    found = []
    for part in re.split(r"\band\b", text):
        match = _COMPARISON.fullmatch(part)
        if match is None or len(found) == _MOST:
            raise InputError(
                where,
                found=f'"{part.strip()[:60]}"',
                expected=f"at most {_MOST} comparisons of a column with a number, joined by and",
                remedy='write for example "armed == 1 and voltage > 14.5"; put names with other signs between single quotes; '
                "`seatrial inspect` lists the columns that hold numbers",
            )
        found.append(Comparison(match["quoted"] or match["bare"], match["relation"], float(match["number"])))
    return tuple(found)


def spans_of(source: LogSource, condition: Sequence[Comparison]) -> tuple[Span, ...]:
    """Return when a condition holds in a log.

    Raises:
        InputError: a log or column that cannot be read.
    """
    read = read_stamped(source, [one.column for one in condition])
    holds = np.all([_RELATIONS[one.relation](read.numbers(one.column), one.number) for one in condition], axis=0)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]]).astype(int)))
    last = read.time.size - 1
    return tuple(
        (_instant(read.epoch, read.time, begin), _instant(read.epoch, read.time, min(end, last)))
        for begin, end in edges.reshape(-1, 2).tolist()
    )


def longest(spans: Sequence[Sequence[Span]], within: Span) -> Span | None:
    """Return the longest stretch over which one span of each condition holds, inside another; None where there is none."""
    common = [within]
    for some in spans:
        common = [(max(a, c), min(b, d)) for a, b in common for c, d in some if max(a, c) < min(b, d)]
    return max(common, key=lambda span: span[1] - span[0], default=None)


def _instant(epoch: Decimal, time: Float[np.ndarray, " n"], row: int) -> Decimal:
    return epoch + Decimal(f"{time[row]:.9f}")
