"""Units at the boundary, on the way out: rpm for the propeller, degrees for angles, newtons for forces; SI everywhere inside.

A parameter is shown in the unit in which its prior is written.
"""

from collections.abc import Callable, Iterable, Mapping
from math import floor, log10, pi

from seatrial.core.coefficients import base_name
from seatrial.core.errors import InputError
from seatrial.core.signals import ANGLE, ANGULAR_RATE, FORCE, GAUGE_CHANNELS, MOMENT, SET, SIGNALS, signal_unit
from seatrial.core.units import to_si

_SHOWN_UNITS = {
    str(ANGLE): (180 / pi, "deg"),
    str(ANGULAR_RATE): (180 / pi, "deg/s"),
    str(FORCE): (1.0, "N"),
    str(MOMENT): (1.0, "N m"),
}
# Gives of a parameter's name and SI unit the factor from SI to the unit in which it is shown, and that unit.
Shown = Callable[[str, str], tuple[float, str]]


def plain(value: float) -> str:
    """Return a positive number in two digits, and from 10 to a million as a whole number, where two digits would need a power of ten."""
    return f"{value:.0f}" if 10 <= value < 1e6 else f"{value:.2g}"


def percent(share: float) -> str:
    """Return a share in percent, two digits: `63 %`, `0.31 %`."""
    return f"{100 * share:.0f} %" if abs(share) >= 0.1 else f"{100 * share:.2g} %"


def count_below(count: float, enough: float) -> str:
    """Return a count of effective samples; one that is too low, but rounds to what is enough, with a digit, cut and not rounded."""
    return f"{floor(10 * count) / 10:.1f}" if round(count) >= enough > count else f"{count:.0f}"


def listed(names: Iterable[object], last: str = "and") -> str:
    """Return names as a sentence has them: `a`, `a and b`, `a, b and c`."""
    words = list(map(str, names))
    return f" {last} ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def measured(value: float, sd: float, unit: str) -> str:
    """Return a value to two digits of its standard deviation, as in `-5.70 +- 0.04 kg/s`.

    Args:
        value: in `unit`.
        sd: its standard deviation, in `unit`.
        unit: as it is printed.
    """
    decimals = 1 - floor(log10(sd)) if sd > 0 else 4
    number = (
        f"{value:.{max(decimals, 0)}f} +- {sd:.{max(decimals, 0)}f}" if decimals < 5 else f"{value:.4g} +- {sd:.2g}"
    )
    return number if unit == "1" else f"{number} {unit}"


def shown_as_written(written: Mapping[str, str]) -> Shown:
    """Return how parameters are shown: in the unit that was written for them, else in SI.

    Args:
        written: units by the names of parameters; one of a trial alone, `X_u[1]`, or of a configuration is shown as `X_u` is. A unit of
            another dimension, such as one that was written after the result was made, is left aside.
    """

    def shown(name: str, unit: str) -> tuple[float, str]:
        own = written.get(base_name(name), unit)
        try:
            return 1.0 / to_si(1.0, own, unit, name), own
        except InputError:
            return 1.0, unit

    return shown


def shown_unit(signal: str) -> tuple[float, str]:
    """Return the factor from SI to the unit in which a signal is shown, and that unit: `n` in rpm, `delta_r` in deg, `tau_X` in N."""
    signal = signal.removesuffix(SET)
    if signal == "n":
        return 30 / pi, "rpm"
    unit = signal_unit(signal)
    is_named = signal in (*SIGNALS, *GAUGE_CHANNELS) or signal[:2] == "f_"
    return _SHOWN_UNITS.get(unit, (1.0, unit)) if is_named else (1.0, unit)
