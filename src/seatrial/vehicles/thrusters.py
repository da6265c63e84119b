"""Where thrust acts: one propeller on the axis, or the several thrusters of an open frame, tau = B T.

    column of B = (d, r x d)    d: direction, r: place;    inflow = d . (v + omega x r)

Thrust is the sum of the terms of the axis T, the same for every thruster, in its own speed n or commanded force f, its inflow u and the
voltage V; without such terms it is the commanded force. In a dead zone d of the command, f - d sign(f) acts, or nothing.
Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2nd ed., 2021, section 9.1.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from seatrial.core.coefficients import CoefficientName
from seatrial.core.signals import RATES, is_thruster, signal_unit, thruster_controls
from seatrial.numerics.array_module import array_module
from seatrial.numerics.rotations import cross, dot, total
from seatrial.vehicles.model import VehicleUnknown

# Pulse widths that a speed controller may be sent, us: 800 to 2200 at most by ArduPilot, a margin on either side.
PULSE_WIDTHS = (500.0, 2500.0)
NEUTRAL_PULSE_WIDTHS = (1000.0, 2000.0)  # Neutral commands of a polynomial that is one of pulse widths, us
# Share of the largest force or moment of a thruster, per m, up to which it has none along or about an axis.
NO_PUSH = 1e-9


@dataclass(frozen=True)
class VoltageEffect:
    """Change of a law of thrust with the battery voltage V: its dead zone shrinks, and what lies beyond it gains.

        ends of the dead zone:    lower - w, upper + w,    w = widening (V_0 / V - 1)
        thrust:    T(c_0) (V / V_0)^k(x),    k(x) = k_0 + k_1 x + …

    T is the law at V_0, c_0 the command that lies as far beyond the dead zone at V_0 as the command does at V, and x this distance. An
    electric motor starts from a voltage, so that its dead zone has a part in proportion to 1 / V. Above some voltage the thrust of a
    part of the throttle gains less, so that k may differ there.

    Attributes:
        stated: V_0, V.
        exponent: k up to V_0 by powers of x, the constant first.
        exponent_above: k above it.
        widening: w at half of V_0, in units of the command.
    """

    stated: float
    exponent: tuple[float, ...]
    exponent_above: tuple[float, ...]
    widening: float = 0.0

    def at_stated(
        self, command: Float[np.ndarray, " n"], volts: Float[np.ndarray, " n"], zone: tuple[float, float]
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Return c_0, inside the dead zone if the command is, and the factor on its thrust.

        Args:
            command: as logged.
            volts: battery voltage at each command, V.
            zone: ends of the dead zone at V_0.
        """
        lower, upper = zone
        moved = np.maximum(self.widening * (self.stated / volts - 1.0), 0.5 * (lower - upper))
        beyond = np.where(command < lower - moved, command - lower + moved, np.maximum(command - upper - moved, 0.0))
        acting = np.where(beyond == 0, 0.5 * (lower + upper), np.where(beyond < 0, lower, upper) + beyond)
        power = np.polynomial.polynomial.polyval
        k = np.where(
            volts > self.stated, power(np.abs(beyond), self.exponent_above), power(np.abs(beyond), self.exponent)
        )
        return acting, (volts / self.stated) ** k


@dataclass(frozen=True)
class ThrustLaw:
    """Thrust of a command, such as a pulse width: by a table or a polynomial, none in a dead zone, and a share of it astern.

    Attributes:
        table: name of the file of a table; empty if there is a polynomial.
        polynomial: thrust, N, by powers of the command less `neutral`, the constant first.
        neutral: command of no thrust.
        dead_zone: commands from the first to the second of which there is none, ends included.
        reverse: share of the thrust that is left where it is negative.
        voltage: effect of the battery voltage; None for a law of any voltage.
    """

    table: str = ""
    polynomial: tuple[float, ...] = ()
    neutral: float = 0.0
    dead_zone: tuple[float, float] | None = None
    reverse: float = 1.0
    voltage: VoltageEffect | None = None

    def thrust(
        self,
        command: Float[np.ndarray, " n"],
        table: Callable[[Float[np.ndarray, " n"]], Float[np.ndarray, " n"]] | None = None,
        volts: Float[np.ndarray, " n"] | None = None,
    ) -> Float[np.ndarray, " n"]:
        """Return the thrust, N; NaN stays NaN.

        Args:
            command: as logged, shape (n,).
            table: returns the thrust by the table, N, if there is one.
            volts: battery voltage, V, shape (n,); that at which the law is stated if not given.
        """
        growth: Any = 1.0
        if self.voltage is not None and volts is not None:
            command, growth = self.voltage.at_stated(command, volts, self.dead_zone or (self.neutral, self.neutral))
        polynomial = partial(np.polynomial.polynomial.polyval, c=self.polynomial)
        thrust = polynomial(command - self.neutral) if table is None else table(command)
        thrust = np.where(self.is_dead(command), 0.0, growth * thrust)
        return np.where(thrust < 0, self.reverse * thrust, thrust)

    def command(self, thrust: float, points: tuple[Sequence[float], Sequence[float]] | None = None) -> float:
        """Return the command that makes a thrust, N; NaN if none does, as at less than the jump at the end of a dead zone.

        It is that at the voltage at which the law is stated. Of several commands it is the one nearest to neutral; of no thrust the middle
        of those of a table or of the dead zone.

        Args:
            thrust: N.
            points: commands of the table, increasing, and their thrusts, if there is one.
        """
        if thrust == 0 and self.dead_zone is not None:
            return sum(self.dead_zone) / 2
        if thrust < 0 and self.reverse == 0:
            return np.nan
        ahead = thrust / self.reverse if thrust < 0 else thrust
        if points is None:
            roots = (np.polynomial.Polynomial(self.polynomial) - ahead).roots()
            commands = self.neutral + roots[np.isclose(roots.imag, 0.0, atol=1e-9)].real
            table = None
        else:
            commands = crossings(np.asarray(points[0]), np.asarray(points[1]), ahead)
            table = partial(np.interp, xp=points[0], fp=points[1])
        commands = commands[np.isclose(self.thrust(commands, table), thrust, rtol=1e-6, atol=1e-9)]
        if not commands.size:
            return np.nan
        return float(
            (commands.min() + commands.max()) / 2
            if thrust == 0 and points
            else commands[np.argmin(np.abs(commands - self.neutral))]
        )

    @property
    def pulses(self) -> tuple[float, float]:
        """Commands for which a polynomial of pulse widths is; without bounds where it is of other commands, or the law is a table."""
        lower, upper = NEUTRAL_PULSE_WIDTHS
        is_of_pulses = not self.table and lower <= self.neutral <= upper
        return PULSE_WIDTHS if is_of_pulses else (-np.inf, np.inf)

    def is_dead(self, command: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
        """Return whether commands, shape (n,), lie in the dead zone, ends included."""
        lower, upper = self.dead_zone or (np.inf, -np.inf)
        return (command >= lower) & (command <= upper)


@dataclass(frozen=True)
class Thruster:
    """Place and direction of positive thrust, in body axes; m, and any length of direction."""

    place: tuple[float, float, float]
    direction: tuple[float, float, float]

    @property
    def column(self) -> tuple[float, ...]:
        """Force and moment of a thrust of 1 N, as (X, Y, Z, K, M, N)."""
        direction = np.array(self.direction) / np.linalg.norm(self.direction)
        return (*(float(x) for x in direction), *(float(x) for x in np.cross(self.place, direction)))

    def inflow(self, velocity: Sequence[Any]) -> Any:
        """Return the velocity of the thruster along its direction."""
        moved = cross((velocity[3], velocity[4], velocity[5]), self.place)
        local = (total((v, extra)) for v, extra in zip(velocity[:3], moved, strict=True))
        return dot(self.column[:3], local)


PROPELLER = Thruster((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))  # One propeller on the axis of the hull, whose control is `n`


def crossings(
    command: Float[np.ndarray, " n"], thrust: Float[np.ndarray, " n"], wanted: float
) -> Float[np.ndarray, " k"]:
    """Return the commands at which straight lines between the points of a table, shape (n,), have a thrust."""
    rise, short = np.diff(thrust), wanted - thrust[:-1]
    share = np.divide(short, rise, out=np.where(short == 0, 0.0, np.nan), where=rise != 0)
    inside = (share >= 0) & (share <= 1)
    inner = (command[:-1] + share * np.diff(command))[inside]
    return np.append(inner, command[1:][thrust[1:] == wanted])


def allocation(thrusters: Sequence[Thruster]) -> Float[np.ndarray, "6 n"]:
    """Return the matrix B of the force and moment (X, Y, Z, K, M, N) of each thruster's newton."""
    return np.array([thruster.column for thruster in thrusters]).reshape(-1, 6).T


def controls_of(
    thrusters: Sequence[Thruster], named: Iterable[CoefficientName], moves: Sequence[str] = ()
) -> tuple[str, ...]:
    """Return the controls of thrusters: their speeds if a term of T has the speed n, their forces if not.

    Args:
        thrusters: all of a vehicle.
        named: terms of its model.
        moves: velocities that are modelled, where only thrusters that push along or about one of them count; none for all thrusters.
    """
    return tuple(control for _, _, control in acting_thrusters(thrusters, named, moves))


def acting_thrusters(
    thrusters: Sequence[Thruster], named: Iterable[CoefficientName], moves: Sequence[str] = ()
) -> list[tuple[int, Thruster, str]]:
    """Return the place, from 1, of each of the thrusters of `controls_of`, itself and its control."""
    names = thruster_controls(len(thrusters), not any(one.axis == "T" and "n" in one.signals for one in named))
    axes = [RATES.index(rate) for rate in moves] or [*range(len(RATES))]
    return [
        (place, thruster, control)
        for place, (thruster, control) in enumerate(zip(thrusters, names, strict=True), 1)
        if max(abs(thruster.column[i]) for i in axes) > NO_PUSH * max(map(abs, thruster.column))
    ]


def thrust_unknowns(controls: Sequence[str], thrusters: Sequence[Thruster]) -> tuple[VehicleUnknown, ...]:
    """Return what of thrust may be sought: a gain of each thruster, and of all a gain, the share that is left astern, and a dead zone.

    Args:
        controls: of the vehicle.
        thrusters: of an open frame; none of a vehicle with one propeller on its axis, whose gain is T_nabsn.
    """
    own = tuple(name for name in controls if is_thruster(name)) if thrusters else ()
    letters = dict.fromkeys(name[0] for name in own)
    return (
        *(VehicleUnknown(f"gain_{name}", "1", rf"g_{{{name[2:]}}}", 1.0) for name in own),
        *(VehicleUnknown(f"gain_{letter}", "1", "g", 1.0) for letter in letters),
        *(VehicleUnknown(f"reverse_{letter}", "1", r"g_{\mathrm{astern}}", 1.0, signed=False) for letter in letters),
        *(
            VehicleUnknown(f"dead_{letter}", signal_unit(letter), f"{letter}_{{0}}", 0.0, signed=False)
            for letter in letters
        ),
    )


def beyond_dead_zone(values: Mapping[str, Any], control: str, command: Any) -> Any:
    """Return what of a thruster's command lies beyond the dead zone, if one is among the values."""
    width = values.get(f"dead_{control[0]}")
    if width is None:
        return command
    xp = array_module(command, width)
    return xp.sign(command) * xp.maximum(xp.abs(command) - width, 0.0)


def real_thrust(values: Mapping[str, Any], control: str, push: Any) -> Any:
    """Return the thrust that a thruster gives for the one it should give, by the `thrust_unknowns` that are among the values."""
    for name in (f"gain_{control}", f"gain_{control[0]}"):
        if name in values:
            push = values[name] * push
    astern = values.get(f"reverse_{control[0]}")
    return push if astern is None else array_module(push, astern).where(push < 0, astern * push, push)
