"""Sums of columns as a channel: `0.12 f_1 - 0.12 f_2` is a factor and a column for each part, and nothing else.

sum    = ["+" | "-"] part { ("+" | "-") part }
part   = [number ["*"]] column
column = letters, digits, and . _ / [ ], or anything between single quotes
"""

import re

from seatrial.core.errors import InputError

_PART = re.compile(
    r"""\s* (?P<sign>[+-])? \s*
        (?: (?P<number> (?:\d+\.?\d*|\.\d+) (?:[eE][+-]?\d+)? ) \s* (?:\*\s*|(?<=[\s])|(?=')) )?
        (?: '(?P<quoted>[^']+)' | (?P<bare>[A-Za-z_/][\w./\[\]]*) ) \s*""",
    re.VERBOSE,
)
_MAX_PARTS = 64  # Parts of a sum


def parse_sum(text: str, where: str) -> tuple[tuple[float, str], ...]:
    """Return the factors and columns of a sum.

    Args:
        text: as written, for example `0.12 data[0] - 0.12 data[1]`.
        where: file and key, for the error.

    Raises:
        InputError: something else than a sum of columns with factors.
    """
    parts: list[tuple[float, str]] = []
    at = 0
    while at < len(text) or not parts:
        match = _PART.match(text, at)
        if match is None or (parts and not match["sign"]) or len(parts) == _MAX_PARTS:
            raise InputError(
                where,
                found=f'"{text[at:].strip()[:60]}"' + (f' in "{text[:120]}"' if at else ""),
                expected=f"a sum of at most {_MAX_PARTS} columns, each with a number before it or none",
                remedy='write for example "0.12 data[0] - 0.12 data[1]"; put names with other signs between single quotes',
            )
        factor = float(match["number"] or 1.0)
        parts.append((-factor if match["sign"] == "-" else factor, match["quoted"] or match["bare"]))
        at = match.end()
    return tuple(parts)
