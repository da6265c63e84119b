"""A vehicle's autopilot: PID loops that hold speed, heading, depth or attitude, sampled, with limits and rates.

    e = set-point - y,  v = kp e + ki sum(e T) - kd dy/dt,  |v| <= limit,  |change of v| <= rate T

y is what the sensor shows at the loop's own interval T, and v is held in between. While v is at its limit the sum does not grow
beyond it (conditional integration: Åström and Hägglund, Advanced PID Control, 2006, section 3.5). The derivative acts on the
measurement, so that a step of the set-point does not kick. A loop may move controls, each by its share of v, or the set-point of a
later loop: depth through pitch is such a cascade. What a schedule commands of a control is added to it: the excitation.
"""

from dataclasses import dataclass, replace
from math import inf, lcm, pi
from typing import Any, NamedTuple

import jax.numpy as jnp

from seatrial.compiled.pytrees import compiled_tree
from seatrial.core.signals import ANGLES, set_point

# Gains of a loop by the name of their key, in words.
GAINS = {"kp": "proportional", "ki": "integral", "kd": "derivative"}


class LoopMemory(NamedTuple):
    """What a loop remembers: the sum of errors, the last measurement and its rate of change, and its output; SI."""

    total: Any = 0.0
    seen: Any = 0.0
    rate: Any = 0.0
    output: Any = 0.0


@compiled_tree("holds", "moves", "derivative", "every")
@dataclass(frozen=True)
class Loop:
    """One PID loop. Gains are in SI: unit of v over unit of y, times 1, 1/s or s.

    Attributes:
        holds: measured channel y.
        moves: controls, or set-points of later loops, each with its share of v.
        kp: proportional gain.
        ki: integral gain.
        kd: derivative gain.
        derivative: measured channel that shows dy/dt; None to take differences of y.
        limit: largest |v|, in the unit of what is moved.
        rate: fastest change of v, per second.
        every: samples of the trial from one decision to the next.
        interval: the same in s.
    """

    holds: str
    moves: tuple[tuple[str, float], ...]
    kp: float
    ki: float = 0.0
    kd: float = 0.0
    derivative: str | None = None
    limit: float = inf
    rate: float = inf
    every: int = 1
    interval: float = 0.1

    @property
    def set_point(self) -> str:
        """Name of the signal that it follows: `psi_set`."""
        return set_point(self.holds)

    def decide(self, before: LoopMemory, count: Any, wanted: Any, seen: dict[str, Any]) -> LoopMemory:
        """Take one decision, or none between two intervals; traced.

        Args:
            before: what it remembers.
            count: samples since the beginning of the trial.
            wanted: set-point, SI.
            seen: what sensors show, by channel, SI, NaN if nothing is measured.
        """
        shown = seen[self.holds]
        y = jnp.where(jnp.isfinite(shown), shown, before.seen)
        if self.derivative is None:
            change = self._turned(y - before.seen) / self.interval
            rate = jnp.where(count > 0, change, 0.0)
        else:
            rate = jnp.where(jnp.isfinite(seen[self.derivative]), seen[self.derivative], before.rate)
        error = self._turned(wanted - y)
        grown = before.total + error * self.interval

        def output(total: Any) -> Any:
            return self.kp * error + self.ki * total - self.kd * rate

        outward = (jnp.abs(output(grown)) > self.limit) & (self.ki * error * output(grown) > 0)
        total = jnp.where(outward, before.total, grown)
        most = self.rate * self.interval
        wished = jnp.clip(output(total), -self.limit, self.limit)
        decided = LoopMemory(total, y, rate, before.output + jnp.clip(wished - before.output, -most, most))
        due = count % self.every == 0
        return LoopMemory(*(jnp.where(due, new, old) for new, old in zip(decided, before, strict=True)))

    def _turned(self, angle: Any) -> Any:
        """Return the shorter way round of a heading or another angle; other numbers as they are."""
        return (angle + pi) % (2 * pi) - pi if self.holds in ANGLES else angle


class AutopilotMemory(NamedTuple):
    """What an autopilot remembers: samples since the beginning, and what each loop does."""

    count: Any
    loops: tuple[LoopMemory, ...]


@compiled_tree("vehicle")
@dataclass(frozen=True)
class Autopilot:
    """Loops that act together on one vehicle, see `seatrial.manoeuvres.pilot.Pilot`.

    Attributes:
        vehicle: its controls, in order.
        loops: in the order in which they decide, the outer ones of a cascade first.
        lower: least value of each control, SI.
        upper: greatest value of each.
    """

    vehicle: tuple[str, ...]
    loops: tuple[Loop, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]

    @property
    def outputs(self) -> tuple[str, ...]:
        """Channels that are fed back."""
        channels = [channel for loop in self.loops for channel in (loop.holds, loop.derivative) if channel]
        return tuple(dict.fromkeys(channels))

    @property
    def commands(self) -> tuple[str, ...]:
        """What a schedule commands: additions to the controls, and set-points."""
        return (*self.vehicle, *(loop.set_point for loop in self.loops))

    @property
    def cycle(self) -> int:
        """Samples after which all loops decide at the same time again."""
        return lcm(*(loop.every for loop in self.loops))

    def begin(self) -> AutopilotMemory:
        """See `Pilot.begin`."""
        zero = jnp.zeros(())
        return AutopilotMemory(jnp.zeros((), int), tuple(LoopMemory(zero, zero, zero, zero) for _ in self.loops))

    def decide(self, memory: AutopilotMemory, time: Any, seen: tuple, told: tuple) -> AutopilotMemory:
        """See `Pilot.decide`; the time is that of its own count."""
        shown = dict(zip(self.outputs, seen, strict=True))
        wanted = dict(zip(self.commands, told, strict=True))
        decided = []
        for loop, before in zip(self.loops, memory.loops, strict=True):
            after = loop.decide(before, memory.count, wanted[loop.set_point], shown)
            wanted |= {name: wanted[name] + share * after.output for name, share in loop.moves}
            decided.append(after)
        return AutopilotMemory(memory.count + 1, tuple(decided))

    def controls(self, memory: AutopilotMemory, told: tuple) -> tuple:
        """See `Pilot.controls`."""
        wanted = dict(zip(self.commands, told, strict=True))
        for loop, known in zip(self.loops, memory.loops, strict=True):
            wanted |= {name: wanted[name] + share * known.output for name, share in loop.moves}
        bounds = zip(self.vehicle, self.lower, self.upper, strict=True)
        return tuple(jnp.clip(wanted[name], lower, upper) for name, lower, upper in bounds)

    def with_gain(self, holds: str, gain: str, factor: float) -> "Autopilot":
        """Return the autopilot with one gain of one loop multiplied."""
        loops = (
            replace(loop, **{gain: factor * getattr(loop, gain)}) if loop.holds == holds else loop
            for loop in self.loops
        )
        return replace(self, loops=tuple(loops))
