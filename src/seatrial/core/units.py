"""Units at the boundary: quantities as users write them in, SI and radians inside.

The table is closed: only the units below exist, and an angle is a dimension of its own, so that a rate in Hz is
never taken for one in rad/s. Expressions are read by a small grammar:

    unit   = factor ( [ "*" | "·" | "/" ] factor )*        from left to right, so that kg/m s is (kg/m) s
    factor = ( name | "(" unit ")" ) [ ( "^" | "**" ) [ "-" ] digits ]  |  "1" before "/"
"""

import difflib
import re
from collections import deque
from dataclasses import dataclass
from functools import lru_cache
from math import inf, isfinite, pi, prod

from seatrial.core.errors import InputError


@dataclass(frozen=True)
class ParsedUnit:
    """A unit.

    Attributes:
        factor: worth in SI.
        powers: of the dimensions that it has, by name, such as `[length]`.
    """

    factor: float
    powers: tuple[tuple[str, int], ...]


# Units in which all others are defined, and what they measure.
_DIMENSIONS = {"meter": "[length]", "second": "[time]", "kilogram": "[mass]", "radian": "[angle]", "volt": "[voltage]"}
# Name, symbol, worth in SI, and powers of the units of SI.
_DEFINITIONS = (
    ("meter", "m", 1.0, {"meter": 1}),
    ("second", "s", 1.0, {"second": 1}),
    ("kilogram", "kg", 1.0, {"kilogram": 1}),
    ("radian", "rad", 1.0, {"radian": 1}),
    ("volt", "V", 1.0, {"volt": 1}),
    ("millivolt", "mV", 1e-3, {"volt": 1}),
    ("millimeter", "mm", 1e-3, {"meter": 1}),
    ("centimeter", "cm", 1e-2, {"meter": 1}),
    ("kilometer", "km", 1e3, {"meter": 1}),
    ("nautical_mile", "nmi", 1852.0, {"meter": 1}),
    ("nanosecond", "ns", 1e-9, {"second": 1}),
    ("microsecond", "us", 1e-6, {"second": 1}),
    ("millisecond", "ms", 1e-3, {"second": 1}),
    ("minute", "min", 60.0, {"second": 1}),
    ("hour", "h", 3600.0, {"second": 1}),
    ("gram", "g", 1e-3, {"kilogram": 1}),
    ("tonne", "t", 1e3, {"kilogram": 1}),
    ("pound", "lb", 0.45359237, {"kilogram": 1}),
    ("foot", "ft", 0.3048, {"meter": 1}),
    ("degree", "deg", pi / 180, {"radian": 1}),
    ("revolution", "rev", 2 * pi, {"radian": 1}),
    ("rpm", "rpm", 2 * pi / 60, {"radian": 1, "second": -1}),
    ("knot", "kn", 1852 / 3600, {"meter": 1, "second": -1}),
    ("hertz", "Hz", 1.0, {"second": -1}),
    ("newton", "N", 1.0, {"kilogram": 1, "meter": 1, "second": -2}),
    ("kilonewton", "kN", 1e3, {"kilogram": 1, "meter": 1, "second": -2}),
    ("kilogram_force", "kgf", 9.80665, {"kilogram": 1, "meter": 1, "second": -2}),
    ("pound_force", "lbf", 4.4482216152605, {"kilogram": 1, "meter": 1, "second": -2}),
    ("pascal", "Pa", 1.0, {"kilogram": 1, "meter": -1, "second": -2}),
    ("joule", "J", 1.0, {"kilogram": 1, "meter": 2, "second": -2}),
    ("watt", "W", 1.0, {"kilogram": 1, "meter": 2, "second": -3}),
    ("percent", "%", 0.01, {}),
)
_NAMES = {written: name for name, symbol, *_ in _DEFINITIONS for written in (name, symbol)}
_FACTORS = {name: factor for name, _, factor, _ in _DEFINITIONS}
_POWERS = {name: {_DIMENSIONS[one]: power for one, power in powers.items()} for name, _, _, powers in _DEFINITIONS}
UNITS = tuple(sorted(_NAMES))
# Units that errors suggest, those of one dimension in this order.
_USUAL_UNITS = (
    *("m/s", "kn", "rpm", "deg/s", "rad/s", "deg", "rad", "m", "km", "s", "ms", "min", "kg", "t", "N", "kN", "kgf"),
    *("N m", "V", "W", "Hz", "1/s", "kg/s", "m/s^2", "%"),
)
# What logs call some units.
_SPELLED_UNITS = {"kt": "kn", "kts": "kn", "knots": "kn", "feet": "ft", "lbs": "lb", "secs": "s"}
# Remedy for a unit that is written in words.
_IN_SYMBOLS = 'write symbols, with / for per and ^ for powers, as in "m/s" or "kg m^2"'
_MAX_CHARACTERS = 120  # Characters of a quantity or of a unit
# Of one unit in an expression, all factors together; every conversion between such units is a finite number.
_MAX_POWER = 27
_TOKEN = re.compile(r"\s*([A-Za-z_]+|%|(?:\^|\*\*)\s*-?[1-9][0-9]?(?![0-9])|[*·/()]|1(?![0-9]))\s*")
_RAISED_DIGITS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
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
    if source.powers != target.powers:
        raise InputError(
            where,
            found=f'unit "{unit}" ({_dimension(source)})',
            expected=f'a unit like "{expected_unit}" ({_dimension(target)})',
            remedy=f"convert the value, or correct the unit, to one of: {', '.join(_like(expected_unit))}",
        )
    return float(value) * (source.factor / target.factor)


def si_powers(unit: str, where: str) -> dict[str, int]:
    """Return the powers of kg, m, s, rad and V whose product a unit is, for example `{"m": 1, "s": -1}` for `m/s`.

    Raises:
        InputError: unknown unit, or one that is not of SI, such as `rpm`.
    """
    parsed = _parse(unit, "m/s", where)
    if parsed.factor != 1.0:
        raise InputError(
            where,
            found=f'unit "{unit}", which is {parsed.factor:g} units of SI',
            expected="a unit of SI: a product of kg, m, s, rad, V, N",
            remedy="write the equation in SI, and convert inputs and outputs",
        )
    symbols = {dimension: symbol for name, symbol, *_ in _DEFINITIONS if (dimension := _DIMENSIONS.get(name))}
    return {symbols[dimension]: power for dimension, power in parsed.powers}


def quantity(text: str | float, expected_unit: str, where: str) -> float:
    """Read a quantity such as `"200 rpm"` into SI; a bare number is accepted only where a plain number is expected.

    Raises:
        InputError: no unit where one is needed, malformed number, unknown unit or wrong dimension.
    """
    if isinstance(text, int | float) and not isinstance(text, bool):
        if expected_unit == "1" and isfinite(text):
            return float(text)
        raise _without_unit(repr(text).removesuffix(".0"), expected_unit, where)
    match = _QUANTITY.fullmatch(text) if isinstance(text, str) and len(text) <= _MAX_CHARACTERS else None
    if match is None or not isfinite(float(match[1])):
        raise InputError(
            where,
            found=repr(text)[:_MAX_CHARACTERS],
            expected=f'a quantity such as "1.5 {_like(expected_unit)[0]}"',
            remedy="write a number, a space and a unit",
        )
    if _DECIMAL_COMMA.match(match[2]):
        raise InputError(
            where,
            found=repr(text),
            expected="a number with a decimal point",
            remedy=f'write "{match[1]}{match[2].replace(",", ".", 1)}"; do not separate thousands',
        )
    if not match[2] and _parse(expected_unit, expected_unit, where).powers:
        raise _without_unit(match[1], expected_unit, where)
    return to_si(float(match[1]), match[2] or "1", expected_unit, where)


def _without_unit(number: str, expected_unit: str, where: str) -> InputError:
    quantities = [f'"{number} {unit}"' for unit in _like(expected_unit)]
    return InputError(
        where,
        found=f"{number} without a unit",
        expected=f'a number with a unit like "{expected_unit}", as one string',
        remedy=f"write {' or '.join(quantities)}, as intended",
    )


@lru_cache(maxsize=256)
def _like(expected_unit: str) -> tuple[str, ...]:
    """Usual units of a dimension, the expected one among them."""
    wanted = _unit(expected_unit).powers
    alike = tuple(unit for unit in _USUAL_UNITS if _unit(unit).powers == wanted)
    return alike if expected_unit in alike else (*alike, expected_unit)


def _parse(unit: str, expected_unit: str, where: str) -> ParsedUnit:
    """Unit of an expression; `expected_unit` is what is suggested in its place."""
    text = unit[: _MAX_CHARACTERS + 1]
    unknown = [word for word in re.findall(r"[A-Za-z_%]+", text) if word not in UNITS]
    if unknown:
        is_in_words = len(unknown) > 1 or unknown[0].casefold() == "per"
        remedy = _IN_SYMBOLS if is_in_words else _meant(unknown[0])
        raise InputError(
            where,
            found=f'unknown unit "{unknown[0]}"' + (f' in "{text}"' if unknown[0] != text.strip() else ""),
            expected="units such as " + ", ".join(_like(expected_unit)),
            remedy=remedy or "use one of: " + ", ".join(_like(expected_unit)),
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
    """Question after the nearest unit, capitals aside; empty if none is near."""
    if word.casefold() in _SPELLED_UNITS:
        return f'write "{_SPELLED_UNITS[word.casefold()]}"'
    names = {unit.casefold() for unit in UNITS}
    close = difflib.get_close_matches(word.casefold(), sorted(names), n=1, cutoff=0.5)
    alike = [f'"{unit}"' for unit in UNITS if unit.casefold() in close]
    return f"did you mean {' or '.join(alike)}?" if alike else ""


@lru_cache(maxsize=1024)
def _unit(text: str) -> ParsedUnit:
    """Unit of an expression; ValueError where the grammar has none."""
    if text.strip() in ("", "1", "-"):
        return ParsedUnit(1.0, ())
    tokens = _tokens(text)
    powers = _product(tokens)
    if tokens or max(map(abs, powers.values()), default=0) > _MAX_POWER:
        raise ValueError(text)
    factor = prod(_FACTORS[name] ** power for name, power in powers.items())
    if not 0 < factor < inf:
        raise ValueError(text)
    # Powers of dimensions from those of units; those that cancel are left out.
    dimensions: dict[str, int] = {}
    for name, power in powers.items():
        for dimension, each in _POWERS[name].items():
            dimensions[dimension] = dimensions.get(dimension, 0) + power * each
    return ParsedUnit(factor, tuple(sorted((dimension, power) for dimension, power in dimensions.items() if power)))


def _tokens(text: str) -> deque[str]:
    """Names, signs, brackets, and powers as `^-2`."""
    text = re.sub("[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+", lambda found: "^" + found[0].translate(_RAISED_DIGITS), text)
    tokens, at = deque[str](), 0
    if len(text) > _MAX_CHARACTERS:
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
        powers = {_NAMES[first]: 1}
    else:
        raise ValueError(first)
    power = int(tokens.popleft()[1:]) if tokens and tokens[0][0] == "^" else 1
    return {name: each * power for name, each in powers.items()}


def _dimension(unit: ParsedUnit) -> str:
    """Dimension of a unit in an error, such as `[length] / [time] ** 2`."""
    above, below = (
        [name if size == 1 else f"{name} ** {size}" for name, power in unit.powers if (size := sign * power) > 0]
        for sign in (1, -1)
    )
    return " / ".join((" * ".join(above) or "1", *below)) if unit.powers else "a plain number"
