"""Numbers as an engineer writes them: a value rounded to its uncertainty, powers of ten pulled out, units with raised powers."""

import re
from math import floor, isfinite, log10
from typing import NamedTuple

from markupsafe import Markup, escape

from seatrial.core import display_units

MINUS = "\u2212"
DASH = "\u2013"
NARROW_SPACE = "\u202f"
_RAISED_DIGITS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


class Digits(NamedTuple):
    """How one parameter is written wherever it stands: a power of ten pulled out of so many decimals.

    Without a standard deviation nothing says how many are worth writing (`decimals` is None), and there are four significant digits.
    """

    exponent: int
    decimals: int | None

    @classmethod
    def of(cls, value: float, sd: float) -> "Digits":
        """Return what shows two significant digits of the standard deviation."""
        if not (isfinite(sd) and sd > 0):
            return cls(_significant(value, 4)[1] if isfinite(value) else 0, None)
        exponent = common_exponent(value, sd)
        # Two significant digits of the standard deviation.
        return cls(exponent, max(0, 1 - floor(log10(float(f"{sd:.1e}")) - exponent)))

    def bare(self, value: float) -> str:
        """Write a number without its power of ten."""
        if not isfinite(value):
            return DASH
        if self.decimals is None:
            return _significant(value / 10.0**self.exponent, 4)[0]
        text = f"{value / 10.0**self.exponent:.{self.decimals}f}"
        return _minus(text.lstrip("-") if float(text) == 0 else text)

    def exact(self, value: float) -> str:
        """Write a number that is known, without its power of ten and with digits of its own: `0.1` where the sd is 14."""
        return _minus(f"{float(f'{value / 10.0**self.exponent:.4g}'):.12g}")

    def unit_html(self, unit: str) -> Markup:
        """Return a unit with the power of ten that the numbers are to be multiplied by."""
        power = Markup(times_ten(self.exponent).removeprefix(" × ") + " ") if self.exponent else Markup("")
        return power + unit_html(unit)

    def pair(self, value: float, sd: float) -> str:
        """Write a value with its standard deviation, without their power of ten."""
        known = self.decimals is not None and isfinite(value) and isfinite(sd)
        return f"{self.bare(value)} ± {self.bare(sd) if known else DASH}"


def rounded(value: float, sd: float) -> tuple[str, str, int]:
    """Round a value to two significant digits of its standard deviation.

    Returns:
        value, standard deviation, and the power of ten both are to be multiplied by (0 where none is pulled out).
    """
    digits = Digits.of(value, sd)
    text, spread = digits.pair(value, sd).split(" ± ")
    return text, spread, digits.exponent


def with_sd(value: float, sd: float) -> str:
    """Write a value with its standard deviation, rounded as `rounded` does: `−3.016 ± 0.081`, `(6.365 ± 0.084) × 10⁻⁴`."""
    digits = Digits.of(value, sd)
    pair = digits.pair(value, sd)
    return f"({pair}){times_ten(digits.exponent)}" if digits.exponent else pair


def common_exponent(*values: float) -> int:
    """Return the power of ten to pull out of numbers, by the largest of them: 0 if that lies between 0.01 and 99999."""
    size = max((abs(value) for value in values if isfinite(value)), default=0.0)
    if size == 0.0 or 0.01 <= size < 1e5:
        return 0
    return floor(log10(size))


def short(value: float, digits: int = 3) -> str:
    """Write a number with a few significant digits and a proper minus, such as `−0.0213` or `2.1 × 10⁻⁵`."""
    if not isfinite(value):
        return DASH
    text, exponent = _significant(value, digits)
    return text + times_ten(exponent)


def plain(value: float, digits: int = 4) -> str:
    """Write a number that a user gave, without zeros that say nothing: `−8.8`, `0`, `2 × 10⁻⁴`."""
    if not isfinite(value):
        return DASH
    value = float(f"{value:.{digits - 1}e}")
    exponent = 0 if value == 0 or 1e-3 <= abs(value) < 10.0**digits else floor(log10(abs(value)))
    return _minus(f"{value / 10.0**exponent:.{digits}g}") + times_ten(exponent)


def times_ten(exponent: int) -> str:
    """Write ` × 10⁻⁴`; empty for no power of ten."""
    return f" × 10{str(exponent).translate(_RAISED_DIGITS)}" if exponent else ""


def probability(value: float, error: float = 0.0) -> str:
    """Write a probability, two digits or those its error leaves; what rounds to nothing is said to be small."""
    if not isfinite(value):
        return DASH
    decimals = 3 if 0 < error < 0.005 else 2
    least = 10.0**-decimals
    if value < least / 2:
        return f"< {least:.{decimals}f}"
    if value > 1 - least / 2:
        return f"> {1 - least:.{decimals}f}" if value < 1 else "1"
    return f"{value:.{decimals}f}"


def decimals(value: float, count: int) -> str:
    """Write a number with so many decimals and a proper minus."""
    return _minus(f"{value:z.{count}f}") if isfinite(value) else DASH


def percent(value: float) -> str:
    """Write a share as a percentage as the terminal does, with a proper minus: `63 %`, `0.31 %`."""
    return _minus(display_units.percent(value)) if isfinite(value) else DASH


def with_percent_signs_kept(html: str) -> str:
    """Return HTML in which a number and its percent sign stay on one line."""
    return re.sub(r"(?<=\d) %", f"{NARROW_SPACE}%", html)


def unit_html(unit: str) -> Markup:
    """Return a unit as safe HTML: `kg m/rad^2` gives `kg m/rad<sup>2</sup>`, a pure number `–`."""
    raised = re.sub(r"\^(-?\d+)", r"<sup>\1</sup>", str(escape(unit)))
    return Markup(DASH if unit in ("", "1") else raised.replace(" ", NARROW_SPACE))


def unit_text(unit: str) -> str:
    """Return a unit as plain text for figures: `kg m/rad²`."""
    return re.sub(r"\^(-?\d+)", lambda match: match[1].translate(_RAISED_DIGITS), unit)


def typeset(text: str) -> str:
    """Write the plain text of a sentence as a book would: `1e-3` as 10⁻³, `m/s^2` as m/s², `P x 2` as P × 2, proper minus and ±.

    What stands in backticks stays as it is.
    """
    if "`" in text:
        return re.sub(r"(`[^`]+`)|[^`]+", lambda part: part[0] if part[1] else typeset(part[0]), text)
    text = re.sub(r"(?<![\w.])(\d+(?:\.\d+)?)e([+-]?\d+)\b", _power, text)
    text = re.sub(r"(?<= )x(?= \d)", "×", unit_text(text)).replace("+-", "±")
    return re.sub(r"(?<=[\s(])-(?=\d)|(?<= )-(?= )|(?<== )-(?=\w)", MINUS, re.sub(r"(?<=\d)%", " %", text))


def _power(number: re.Match) -> str:
    mantissa, exponent = number.groups()
    power = times_ten(int(exponent))
    return power.removeprefix(" × ") if power and float(mantissa) == 1 else mantissa + power


def _significant(value: float, digits: int) -> tuple[str, int]:
    exponent = 0 if value == 0 or 1e-3 <= abs(value) < 1e5 else floor(log10(abs(value)))
    scaled = value / 10.0**exponent
    size = 0 if scaled == 0 else floor(log10(abs(float(f"{scaled:.{digits - 1}e}"))))
    return _minus(f"{scaled:.{max(0, digits - 1 - size)}f}"), exponent


def _minus(text: str) -> str:
    return text.replace("-", MINUS)
