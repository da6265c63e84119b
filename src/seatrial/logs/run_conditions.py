"""When a run is what it is taken for, by columns of its logs: armed, in a mode, above a voltage.

condition  = comparison { "and" comparison }
comparison = column ( "==" | "!=" | "<" | "<=" | ">" | ">=" ) number | column ( "==" | "!=" ) word
column     = letters, digits, and . _ / [ ], or anything between single quotes
word       = anything between double quotes, such as "MANUAL"

What a row says holds from its stamp to the next; a cell that is missing holds nothing. The modes of ArduSub may be named where the log
numbers them.
"""

import operator
import re
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal

import numpy as np
from jaxtyping import Bool, Float

from seatrial.core.errors import InputError, nearest
from seatrial.logs.known_messages import ARDUSUB_MODES, MODE_MESSAGES, autopilot_message
from seatrial.logs.log_table import Stamped, read_stamped
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
        (?: (?P<number>[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?) | "(?P<word>[^"]+)" ) \s*""",
    re.VERBOSE,
)
_AND = re.compile(r"""\band\b(?=(?:[^"]*"[^"]*")*[^"]*$)""")  # Between two comparisons, not inside a word
_MAX_COMPARISONS = 16  # Comparisons of a condition


@dataclass(frozen=True)
class Comparison:
    """A column, a relation and the number or word that it is compared with."""

    column: str
    relation: str
    value: float | str


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
    comparisons = []
    for part in _AND.split(text):
        match = _COMPARISON.fullmatch(part)
        if (
            match is None
            or len(comparisons) == _MAX_COMPARISONS
            or (match["word"] and match["relation"] not in ("==", "!="))
        ):
            raise InputError(
                where,
                found=f'"{part.strip()[:60]}"',
                expected=f"at most {_MAX_COMPARISONS} comparisons of a column with a number or a word, joined by and",
                remedy='write for example armed == 1 and voltage > 14.5 and mode == "MANUAL"; put names of columns with other signs '
                "between single quotes; `seatrial inspect` lists the columns",
            )
        value = match["word"] or float(match["number"])
        comparisons.append(Comparison(match["quoted"] or match["bare"], match["relation"], value))
    return tuple(comparisons)


def spans_of(source: LogSource, condition: Sequence[Comparison]) -> tuple[Span, ...]:
    """Return when a condition holds in a log.

    Raises:
        InputError: a log or column that cannot be read.
    """
    words = [one.column for one in condition if isinstance(one.value, str)]
    read = read_stamped(source, [one.column for one in condition if not isinstance(one.value, str)], words)
    holds = np.all([_holds(read, one, source) for one in condition], axis=0)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]]).astype(int)))
    last = read.time.size - 1
    return tuple(
        (_instant(read.epoch, read.time, begin), _instant(read.epoch, read.time, min(end, last)))
        for begin, end in edges.reshape(-1, 2).tolist()
    )


def _holds(read: Stamped, comparison: Comparison, source: LogSource) -> Bool[np.ndarray, " n"]:
    """Return in which rows a comparison holds.

    Raises:
        InputError: a word that the column never says, or a column of numbers that stand for no words.
    """
    relation = _RELATIONS[comparison.relation]
    if not isinstance(comparison.value, str):
        return relation(read.numbers(comparison.column), comparison.value)
    words = read.words(comparison.column)
    if words.dtype.kind != "O":
        words = _modes(words, read.info.name if read.info else "", comparison, source)
    if comparison.value not in words:
        known_words = sorted({str(word) for word in words if word})
        raise InputError(
            f'{read.where}, column "{comparison.column}"',
            found=f'no "{comparison.value}" in any row',
            expected="one of " + ", ".join(known_words[:20]) if known_words else "words",
            remedy=nearest(comparison.value, known_words) if known_words else "compare it with a number",
        )
    return (words != "") & relation(words, comparison.value)


def _modes(numbers: np.ndarray, table: str, comparison: Comparison, source: LogSource) -> np.ndarray:
    """Return the names of ArduSub's modes, where a message numbers them."""
    if autopilot_message(table) not in MODE_MESSAGES:
        raise InputError(
            f'{source.path}, column "{comparison.column}"',
            found=f'numbers, compared with "{comparison.value}"',
            expected="a column of words, or one that numbers the modes of ArduSub: MODE or HEARTBEAT",
            remedy="compare it with a number",
        )
    return np.array(
        [ARDUSUB_MODES.get(int(number), str(number)) if number == number else "" for number in numbers], object
    )


def longest(spans: Sequence[Sequence[Span]], within: Span) -> Span | None:
    """Return the longest stretch over which one span of each condition holds, inside another; None if there is none."""
    common = [within]
    for some in spans:
        common = [(max(a, c), min(b, d)) for a, b in common for c, d in some if max(a, c) < min(b, d)]
    return max(common, key=lambda span: span[1] - span[0], default=None)


def _instant(epoch: Decimal, time: Float[np.ndarray, " n"], row: int) -> Decimal:
    return epoch + Decimal(f"{time[row]:.9f}")
