"""The named signals a hydrodynamic force may depend on: body velocities, attitude and controls (SNAME and Fossen).

A unit is kept as integer exponents of (kg, m, s, rad, V), so that the unit of any product of signals is exact.
"""

from dataclasses import dataclass
from typing import NamedTuple

from seatrial.core.errors import InputError
from seatrial.core.units import si_powers


class Dimension(NamedTuple):
    """Integer exponents of the base units; angles count, so that rad/s is not 1/s, and so does a battery's voltage."""

    kg: int = 0
    m: int = 0
    s: int = 0
    rad: int = 0
    V: int = 0

    def times(self, other: "Dimension", power: int = 1) -> "Dimension":
        """Return the dimension of `self * other**power`."""
        return Dimension(*(a + power * b for a, b in zip(self, other, strict=True)))

    def __str__(self) -> str:
        """Print as SI, for example `kg/s`, `kg m/rad^2` or `1`."""
        above = [_power(name, exponent) for name, exponent in zip(self._fields, self, strict=True) if exponent > 0]
        below = [_power(name, -exponent) for name, exponent in zip(self._fields, self, strict=True) if exponent < 0]
        numerator = " ".join(above) or "1"
        if not below:
            return numerator
        return f"{numerator}/{below[0]}" if len(below) == 1 else f"{numerator}/({' '.join(below)})"


@dataclass(frozen=True)
class Signal:
    """One scalar signal: its dimension, how it prints (LaTeX) and what it is."""

    dimension: Dimension
    label: str
    meaning: str


FORCE = Dimension(kg=1, m=1, s=-2)
MOMENT = Dimension(kg=1, m=2, s=-2)
SPEED = Dimension(m=1, s=-1)
ANGLE = Dimension(rad=1)
ANGULAR_RATE = Dimension(rad=1, s=-1)
VOLTAGE = Dimension(V=1)

SIGNALS: dict[str, Signal] = {
    "u": Signal(SPEED, "u", "surge velocity"),
    "v": Signal(SPEED, "v", "sway velocity"),
    "w": Signal(SPEED, "w", "heave velocity"),
    "p": Signal(ANGULAR_RATE, "p", "roll rate"),
    "q": Signal(ANGULAR_RATE, "q", "pitch rate"),
    "r": Signal(ANGULAR_RATE, "r", "yaw rate"),
    "phi": Signal(ANGLE, r"\phi", "roll angle"),
    "theta": Signal(ANGLE, r"\theta", "pitch angle"),
    "psi": Signal(ANGLE, r"\psi", "heading"),
    "n": Signal(ANGULAR_RATE, "n", "propeller speed"),
    "f": Signal(FORCE, "f", "commanded thrust of a thruster"),
    "V": Signal(VOLTAGE, "V", "battery voltage"),
    "delta_r": Signal(ANGLE, r"\delta_r", "rudder angle"),
    "delta_s": Signal(ANGLE, r"\delta_s", "stern plane angle"),
    "tau_X": Signal(FORCE, r"\tau_X", "commanded surge force"),
    "tau_Y": Signal(FORCE, r"\tau_Y", "commanded sway force"),
    "tau_Z": Signal(FORCE, r"\tau_Z", "commanded heave force"),
    "tau_K": Signal(MOMENT, r"\tau_K", "commanded roll moment"),
    "tau_M": Signal(MOMENT, r"\tau_M", "commanded pitch moment"),
    "tau_N": Signal(MOMENT, r"\tau_N", "commanded yaw moment"),
}
POSITIONS = ("x", "y", "z")  # States no hydrodynamic force depends on; in m
TRACKS = ("distance", "advance")  # Way from the start of a trial: the integral of |u|, and of u; in m
ANGLES = ("phi", "theta", "psi")
# Attitude as a unit quaternion from body to north-east-down axes, scalar part first; q alone is the pitch rate.
QUATERNION = ("q_w", "q_x", "q_y", "q_z")
# Velocity of the water over ground, north, east and down; in m/s.
CURRENT_COMPONENTS = ("current_x", "current_y", "current_z")
# Velocity over ground along the body axes, where u, v and w are through the water; in m/s.
OVER_GROUND = ("u_g", "v_g", "w_g")
# What an accelerometer shows: acceleration less gravity along the body axes, (0, 0, -9.81) at rest and level; in m/s^2.
SPECIFIC_FORCE = ("a_x", "a_y", "a_z")
# What a gauge that holds the vehicle shows: force and moment that thrust and water exert on it along the body axes; in
# N and N m.
GAUGE_CHANNELS = ("force_X", "force_Y", "force_Z", "moment_K", "moment_M", "moment_N")
PROPULSION = ("n", "tau_X")  # Controls that drive a vehicle ahead, and hold its speed
# Velocity over ground along north, east and down, as some logs hold it; in m/s.
OVER_EARTH = ("v_north", "v_east", "v_down")
ACTUAL = "_act"  # Ending of an actuator's state, where the bare name is the command: `n_act` follows `n`
SET = "_set"  # Ending of a set-point of an autopilot: `psi_set` is the heading that it is told to hold
# Dimensions of signals that models of one's own declare. One list for the process, because records and plots know a
# signal by its name alone.
_OWN_SIGNALS: dict[str, Dimension] = {}
# Signals whose time derivative may be written, as in `X_udot`.
RATES = ("u", "v", "w", "p", "q", "r")
SPEEDS = dict(zip("XYZKMN", RATES, strict=True))  # Velocity along or about each axis, by its force or moment
BATTERY = "V"  # Channel of the battery voltage
CONTROLS = ("n", "delta_r", "delta_s", "tau_X", "tau_Y", "tau_Z", "tau_K", "tau_M", "tau_N")


def motion_name(rate: str) -> str:
    """Return what a velocity of the vehicle is called: `u` surge, `v` sway, `w` heave, `p` roll, `q` pitch, `r` yaw."""
    return SIGNALS[rate].meaning.partition(" ")[0]


def signal_unit(name: str) -> str:
    """SI unit of a signal, position or other state, or of its derivative when written with `dot` (`udot` is in m/s^2)."""
    if name in SIGNALS:
        return str(SIGNALS[name].dimension)
    if name.endswith(SET):
        return signal_unit(name.removesuffix(SET))
    base = name.removesuffix("dot")
    if base != name and (base not in SIGNALS or base in (*RATES, *ANGLES)):
        return str(_dimension(base).times(Dimension(s=-1)))
    return str(_dimension(name))


def declare_signal(name: str, unit: str) -> None:
    """Let records, tables and plots know a signal of a model with an equation of its own.

    Args:
        name: of a state or control; one that seatrial has must have its unit.
        unit: SI, for example `m/s`.

    Raises:
        InputError: an unknown unit, one that is not of SI, or another than the signal has already.
    """
    if not name.isidentifier() or name.endswith(("dot", ACTUAL, SET)):
        raise InputError(
            f'signal "{name}"',
            found="an invalid name of a signal",
            expected=f"letters, digits and underscores, without the endings dot, {ACTUAL} and {SET}",
            remedy="choose another name",
        )
    known, dimension = is_signal(name), Dimension(**si_powers(unit, f'signal "{name}", unit'))
    if known and signal_unit(name) != str(dimension):
        raise InputError(
            f'signal "{name}", unit',
            found=unit,
            expected=f"{signal_unit(name)}, as {'declared before' if name in _OWN_SIGNALS else 'seatrial has it'}",
            remedy="convert the equation to that unit, or choose another name",
        )
    if not known:
        _OWN_SIGNALS[name] = dimension


def signal_label(name: str) -> str:
    """LaTeX of a signal, of a thruster's, of the force on a gauge, or of their derivative when written with `dot`; else the name itself."""
    base = name.removesuffix("dot")
    label = f"{'F' if base in GAUGE_CHANNELS[:3] else 'M'}_{base[-1]}" if base in GAUGE_CHANNELS else base
    label = SIGNALS[base].label if base in SIGNALS else label
    label = f"{base[0]}_{{{base[2:]}}}" if is_thruster(base) else label
    return label if base == name else rf"\dot{{{label}}}"


def is_signal(name: str) -> bool:
    """Whether `signal_unit` knows a name."""
    try:
        signal_unit(name)
    except KeyError:
        return False
    return True


def set_point(channel: str) -> str:
    """Return the name of the set-point of a channel: `psi_set` of `psi`."""
    return channel + SET


def is_thruster(name: str) -> bool:
    """Whether a name is that of the control of one of several thrusters: `f_1`, `n_1`, …."""
    return name[:2] in ("n_", "f_") and name[2:].isdigit()


def thruster_controls(count: int, commanded_force: bool) -> tuple[str, ...]:
    """Controls of several thrusters: speeds `n_1`, `n_2`, … in rad/s, or forces `f_1`, `f_2`, … in N."""
    return tuple(f"{'f' if commanded_force else 'n'}_{number}" for number in range(1, count + 1))


def _dimension(name: str) -> Dimension:
    base = name.removesuffix(ACTUAL)
    for names, dimension in (
        ((*POSITIONS, *TRACKS), Dimension(m=1)),
        (QUATERNION, Dimension()),
        ((*CURRENT_COMPONENTS, *OVER_GROUND, *OVER_EARTH), SPEED),
        (SPECIFIC_FORCE, Dimension(m=1, s=-2)),
        (GAUGE_CHANNELS[:3], FORCE),
        (GAUGE_CHANNELS[3:], MOMENT),
    ):
        if base in names:
            return dimension
    if is_thruster(base):
        return ANGULAR_RATE if base[0] == "n" else FORCE
    return _OWN_SIGNALS[base] if base in _OWN_SIGNALS else SIGNALS[base].dimension


def _power(name: str, exponent: int) -> str:
    return name if exponent == 1 else f"{name}^{exponent}"
