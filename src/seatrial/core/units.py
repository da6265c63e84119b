"""Units at the boundary: quantities as users write them in, SI and radians inside.

The registry is closed: only the units below exist, and an angle is a dimension of its own, so that a rate in Hz is
never taken for one in rad/s. Conversion is pint's; expressions are read by a small grammar of our own, since pint computes what it reads:

    unit   = factor ( [ "*" | "·" | "/" ] factor )*        from left to right, so that kg/m s is (kg/m) s
    factor = ( name | "(" unit ")" ) [ ( "^" | "**" ) [ "-" ] digits ]  |  "1" before "/"
"""

import difflib
import re
from collections import deque
from functools import cache, lru_cache
from math import inf, isfinite
from typing import TYPE_CHECKING

from seatrial.core.errors import InputError

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
_USUAL = (
    *("m/s", "kn", "rpm", "deg/s", "rad/s", "deg", "rad", "m", "km", "s", "ms", "min", "kg", "t", "N", "kN"),
    *("N m", "W", "Hz", "1/s", "kg/s", "m/s^2", "%"),
)
"""Units that errors suggest, those of one dimension in this order."""
_LONGEST = 120
"""Characters of a quantity or of a unit."""
_LARGEST_POWER = 27
"""Of one unit in an expression, all factors together; every conversion between such units is a finite number."""
_TOKEN = re.compile(r"\s*([A-Za-z_]+|%|(?:\^|\*\*)\s*-?[1-9][0-9]?(?![0-9])|[*·/()]|1(?![0-9]))\s*")
_RAISED = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
_DECIMAL_COMMA = re.compile(r",\d")
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
    target = _parse(expected_unit, expected_unit, where)
    source = _parse(unit, expected_unit, where)
    if source.dimensionality != target.dimensionality:
        raise InputError(
            where,
            found=f'unit "{unit}" ({_dimension(source)})',
            expected=f'a unit like "{expected_unit}" ({_dimension(target)})',
            remedy=f"convert the value, or correct the unit, to one of: {', '.join(_like(expected_unit))}",
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
        raise _without_unit(repr(text).removesuffix(".0"), expected_unit, where)
    match = _QUANTITY.fullmatch(text) if isinstance(text, str) and len(text) <= _LONGEST else None
    if match is None or not isfinite(float(match[1])):
        raise InputError(
            where,
            found=repr(text)[:_LONGEST],
            expected=f'a quantity such as "1.5 {_like(expected_unit)[0]}"',
            remedy="write a number, a space and a unit",
        )
    if _DECIMAL_COMMA.match(match[2]):
        raise InputError(
            where,
            found=repr(text),
            expected="a number with a decimal point",
            remedy=f'write "{match[1]}{match[2].replace(",", ".", 1)}"; thousands are not parted',
        )
    if not match[2] and _parse(expected_unit, expected_unit, where).dimensionality:
        raise _without_unit(match[1], expected_unit, where)
    return to_si(float(match[1]), match[2] or "1", expected_unit, where)


def _without_unit(number: str, expected_unit: str, where: str) -> InputError:
    quantities = [f'"{number} {unit}"' for unit in _like(expected_unit)]
    return InputError(
        where,
        found=f"{number} without a unit",
        expected=f'a number with a unit like "{expected_unit}", as one string',
        remedy=f"write {' or '.join(quantities)}, whichever is meant",
    )


@lru_cache(maxsize=256)
def _like(expected_unit: str) -> tuple[str, ...]:
    """Usual units of a dimension, the expected one among them."""
    wanted = _unit(expected_unit).dimensionality
    found = tuple(unit for unit in _USUAL if _unit(unit).dimensionality == wanted)
    return found if expected_unit in found else (*found, expected_unit)


def _parse(unit: str, expected_unit: str, where: str) -> "pint.Unit":
    """Unit of an expression; `expected_unit` is what is suggested in its place."""
    text = unit[: _LONGEST + 1]
    for word in re.findall(r"[A-Za-z_%]+", text):
        if word not in UNITS:
            raise InputError(
                where,
                found=f'unknown unit "{word}"' + (f' in "{text}"' if word != text.strip() else ""),
                expected="units such as " + ", ".join(_like(expected_unit)),
                remedy=_meant(word) or "use one of: " + ", ".join(_like(expected_unit)),
            )
    try:
        return _unit(text)
    except ValueError as cause:
        raise InputError(
            where,
            found=f'unit "{text}" that cannot be read',
            expected="a product or quotient of units",
            remedy=f'write it like "{expected_unit}"' if expected_unit != "1" else 'write it like "%", or leave it out',
        ) from cause


def _meant(word: str) -> str:
    """Question after the nearest unit, capitals aside; empty where none is near."""
    names = {unit.casefold() for unit in UNITS}
    close = difflib.get_close_matches(word.casefold(), sorted(names), n=1, cutoff=0.5)
    alike = [f'"{unit}"' for unit in UNITS if unit.casefold() in close]
    return f"did you mean {' or '.join(alike)}?" if alike else ""


@lru_cache(maxsize=1024)
def _unit(text: str) -> "pint.Unit":
    """Unit of an expression; ValueError where the grammar has none."""
    import pint

    if text.strip() in ("", "1", "-"):
        return _registry().parse_units("")
    tokens = _tokens(text)
    powers = _product(tokens)
    if tokens or max(map(abs, powers.values()), default=0) > _LARGEST_POWER:
        raise ValueError(text)
    unit = _registry().Unit(pint.util.UnitsContainer({name: power for name, power in powers.items() if power}))
    if not 0 < float(_registry().get_base_units(unit)[0]) < inf:
        raise ValueError(text)
    return unit


def _tokens(text: str) -> deque[str]:
    """Names, signs, brackets, and powers as `^-2`."""
    text = re.sub("[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+", lambda found: "^" + found[0].translate(_RAISED), text)
    tokens, at = deque[str](), 0
    if len(text) > _LONGEST:
        raise ValueError(text)
    while at < len(text):
        match = _TOKEN.match(text, at)
        if match is None:
            raise ValueError(text)
        tokens.append(re.sub(r"\s+", "", match[1]).replace("**", "^").replace("·", "*"))
        at = match.end()
    return tokens


def _product(tokens: deque[str]) -> dict[str, int]:
    """Power of every name up to the end or a closing bracket."""
    powers, side = dict[str, int](), 1
    while True:
        for name, power in _factor(tokens).items():
            powers[name] = powers.get(name, 0) + side * power
        if not tokens or tokens[0] == ")":
            return powers
        side = 1
        if tokens[0] in ("*", "/"):
            side = 1 if tokens.popleft() == "*" else -1


def _factor(tokens: deque[str]) -> dict[str, int]:
    first = tokens.popleft() if tokens else ""
    if first == "1" and tokens and tokens[0] == "/":
        return {}
    if first == "(":
        powers = _product(tokens)
        if not tokens or tokens.popleft() != ")":
            raise ValueError("a bracket that is not closed")
    elif first in UNITS:
        powers = {"percent" if first == "%" else _registry().get_name(first): 1}
    else:
        raise ValueError(first)
    power = int(tokens.popleft()[1:]) if tokens and tokens[0][0] == "^" else 1
    return {name: each * power for name, each in powers.items()}


def _dimension(unit: "pint.Unit") -> str:
    return str(unit.dimensionality) if unit.dimensionality else "a plain number"


@cache
def _registry() -> "pint.UnitRegistry":
    import pint

    registry = pint.UnitRegistry(None)
    for definition in _DEFINITIONS:
        registry.define(definition)
    return registry
