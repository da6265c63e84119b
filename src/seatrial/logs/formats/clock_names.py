"""Columns that may be time, and their unit, told by their names where the format does not tell."""

import re
from collections.abc import Sequence

from seatrial.logs.formats.protocol import ColumnInfo

TIME_UNITS = ("ns", "us", "ms", "s", "min", "h")
_NANOSECONDS = re.compile(r"(?:.*[./])?(?:%time|rosbagtimestamp|header\.stamp|stamp)")
_CLOCK = re.compile(
    r"(?:.*[./_\s])?(?:t|time|timestamps?|stamp|utime|elapsed(?:_time)?|time_?(?:stamp|boot|since_\w+)?)"
    r"(?:[\s_]*[\[(]?(?P<unit>ns|nsec|us|usec|ms|msec|s|sec|secs|seconds|min|h)[\])]?)?"
)
_SPELLING = {"nsec": "ns", "usec": "us", "msec": "ms", "sec": "s", "secs": "s", "seconds": "s"}


def clock_unit(name: str, stated: str | None = None) -> str | None:
    """Unit of a column that may be time by its name or its stated unit; None for one that is no clock."""
    lower = name.lower()
    if stated in TIME_UNITS and (_CLOCK.fullmatch(lower) or _NANOSECONDS.fullmatch(lower)):
        return stated
    if stated is not None:
        return None
    if _NANOSECONDS.fullmatch(lower):
        return "ns"
    match = _CLOCK.fullmatch(lower) or re.fullmatch(r"(?P<unit>secs|seconds|sec)", lower)
    return None if match is None else _SPELLING.get(match["unit"] or "s", match["unit"] or "s")


def clocks_among(columns: Sequence[ColumnInfo]) -> tuple[tuple[str, ...], tuple[ColumnInfo, ...]]:
    """Columns that may be time, that of the measurement first, then the plainest name; and all columns with their units."""
    units = {column.name: clock_unit(column.name, column.unit) for column in columns}
    clocks = sorted((name for name, unit in units.items() if unit), key=_order)
    return tuple(clocks), tuple(ColumnInfo(name, units[name] or unit) for name, unit in columns)


def _order(name: str) -> tuple[bool, int, int]:
    return not name.lower().endswith("header.stamp"), name.count("."), len(name)
