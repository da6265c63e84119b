"""Units at the boundary: quantities as users write them in, SI and radians inside.

The registry is closed: only the units below exist, and an angle is a dimension of its own, so that a rate in Hz is
never taken for one in rad/s. Parsing and conversion are pint's.
"""

import re
import tokenize
from functools import cache
from math import isfinite
from typing import TYPE_CHECKING

from seatrial.core.errors import InputError, nearest

if TYPE_CHECKING:
    import pint

_DEFINITIONS = (
    "meter = [length] = m",
    "second = [time] = s",
    "kilogram = [mass] = kg",
    "radian = [angle] = rad",
    "pi = 3.14159265358979323846264338327950288",
    "millimeter = 1e-3 m = mm",
    "centimeter = 1e-2 m = cm",
    "kilometer = 1e3 m = km",
    "nautical_mile = 1852 m = nmi",
    "nanosecond = 1e-9 s = ns",
    "microsecond = 1e-6 s = us",
    "millisecond = 1e-3 s = ms",
    "minute = 60 s = min",
    "hour = 3600 s = h",
    "gram = 1e-3 kg = g",
    "tonne = 1e3 kg = t",
    "degree = pi / 180 rad = deg",
    "revolution = 2 * pi rad = rev",
    "rpm = revolution / minute",
    "knot = nautical_mile / hour = kn",
    "hertz = 1 / s = Hz",
    "newton = kg * m / s ** 2 = N",
    "kilonewton = 1e3 N = kN",
    "pascal = N / m ** 2 = Pa",
    "joule = N * m = J",
    "watt = J / s = W",
    "percent = 0.01 = %",
)
UNITS = tuple(
    sorted(
        {
            part
            for line in _DEFINITIONS
            for part in (line.split(" = ")[0], line.split(" = ")[-1])
            if re.fullmatch(r"[A-Za-z_]+|%", part)
        }
        - {"pi"}
    )
)
_UNIT = re.compile(r"(?:[A-Za-z_%\s*/()·²³]|1\s*/|(?:\^|\*\*)\s*-?[1-9](?!\d))+")
"""What a unit may consist of; pint would compute anything else, 9^9^9^9 included."""
_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*")


def to_si(value: float, unit: str, expected_unit: str, where: str) -> float:
    """Convert `value` from `unit` to SI, checking that it has the dimension of `expected_unit`.

    Args:
        value: number as written.
        unit: its unit, for example `rpm`, `N/(rev/s)^2`.
        expected_unit: SI unit the caller needs, for example `rad/s`.
        where: file and key, for the error.

    Raises:
        InputError: unknown unit, or one of another dimension.
    """
    source, target = _parse(unit, where), _parse(expected_unit, where)
    if source.dimensionality != target.dimensionality:
        raise InputError(
            where,
            found=f'unit "{unit}" ({_dimension(source)})',
            expected=f'a unit like "{expected_unit}" ({_dimension(target)})',
            remedy=f"convert the value, or correct the unit; SI here is {expected_unit}",
        )
    # pint's float arithmetic on `value` would round 100 rpm and 100*rpm differently; one multiplication is enough.
    return float(value) * float(_registry().convert(1.0, source, target))


def quantity(text: str | float, expected_unit: str, where: str) -> float:
    """Read a quantity such as `"200 rpm"` into SI; a bare number is accepted only where a plain number is expected.

    Raises:
        InputError: no unit where one is needed, malformed number, unknown unit or wrong dimension.
    """
    if isinstance(text, int | float) and not isinstance(text, bool):
        if expected_unit == "1" and isfinite(text):
            return float(text)
        raise InputError(
            where,
            found=f"{text!r} without a unit",
            expected=f'a quantity such as "{text} {expected_unit}"',
            remedy="write the number and its unit as one string",
        )
    match = _QUANTITY.fullmatch(text) if isinstance(text, str) else None
    if match is None or not isfinite(float(match[1])):
        raise InputError(
            where,
            found=repr(text),
            expected=f'a quantity such as "1.5 {expected_unit}"',
            remedy="write a number, a space and a unit",
        )
    return to_si(float(match[1]), match[2] or "1", expected_unit, where)


def _parse(unit: str, where: str) -> "pint.Unit":
    import pint

    text = unit.strip()
    if text in ("", "1", "-"):
        return _registry().parse_units("")
    for word in re.findall(r"[A-Za-z_%]+", text):
        if word not in UNITS:
            raise InputError(
                where,
                found=f'unknown unit "{word}"' + (f' in "{unit}"' if word != text else ""),
                expected="units such as " + ", ".join(("m/s", "kn", "rpm", "rad/s", "deg", "N", "kg/s", "ms")),
                remedy=nearest(word, UNITS),
            )
    try:
        if "//" in text or not _UNIT.fullmatch(text):
            raise ValueError(text)
        return _registry().parse_units(text.replace("%", "percent"))
    except (
        pint.PintError,
        ValueError,
        TypeError,
        AttributeError,
        SyntaxError,
        AssertionError,
        tokenize.TokenError,
    ) as cause:
        raise InputError(
            where,
            found=f'unit "{unit}" that cannot be read',
            expected="a product or quotient of units",
            remedy='write it like "kg/s" or "N/(rev/s)^2"',
        ) from cause


def _dimension(unit: "pint.Unit") -> str:
    return str(unit.dimensionality) if unit.dimensionality else "a plain number"


@cache
def _registry() -> "pint.UnitRegistry":
    import pint

    registry = pint.UnitRegistry(None)
    for definition in _DEFINITIONS:
        registry.define(definition)
    return registry
