"""Units at the boundary, on the way out: rpm for the propeller, degrees for angles, newtons for forces; SI everywhere inside."""

from math import pi

from seatrial.core.signals import ANGLE, ANGULAR_RATE, FORCE, HELD, MOMENT, SET, SIGNALS, signal_unit

_SHOWN = {
    str(ANGLE): (180 / pi, "deg"),
    str(ANGULAR_RATE): (180 / pi, "deg/s"),
    str(FORCE): (1.0, "N"),
    str(MOMENT): (1.0, "N m"),
}


def shown_unit(signal: str) -> tuple[float, str]:
    """Return the factor from SI to the unit in which a signal is shown, and that unit: `n` in rpm, `delta_r` in deg, `tau_X` in N."""
    signal = signal.removesuffix(SET)
    if signal == "n":
        return 30 / pi, "rpm"
    unit = signal_unit(signal)
    return _SHOWN.get(unit, (1.0, unit)) if signal in (*SIGNALS, *HELD) or signal[:2] == "f_" else (1.0, unit)
