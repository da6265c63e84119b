"""Units at the boundary, on the way out: rpm for the propeller, degrees for angles, newtons for forces; SI everywhere inside."""

from math import pi

from seatrial.core.signals import ANGLE, ANGULAR_RATE, FORCE, MOMENT, SET, SIGNALS, signal_unit

_SHOWN = {ANGLE: (180 / pi, "deg"), ANGULAR_RATE: (180 / pi, "deg/s"), FORCE: (1.0, "N"), MOMENT: (1.0, "N m")}


def shown_unit(signal: str) -> tuple[float, str]:
    """Return the factor from SI to the unit in which a signal is shown, and that unit: `n` in rpm, `delta_r` in deg, `tau_X` in N."""
    signal = signal.removesuffix(SET)
    if signal == "n":
        return 30 / pi, "rpm"
    if signal in SIGNALS:
        return _SHOWN.get(SIGNALS[signal].dimension, (1.0, signal_unit(signal)))
    return 1.0, signal_unit(signal)
