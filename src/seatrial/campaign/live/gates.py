"""What may pass: stamps in their order, and values that the vehicle can have. What may not is told once, in words."""

from collections import deque
from collections.abc import Callable, Mapping
from decimal import Decimal
from math import isfinite
from typing import Literal, NamedTuple

from seatrial.core.display_units import shown_unit
from seatrial.core.record import MAX_MAGNITUDE

LATE = 1.0
"""Seconds by which a stamp may lie behind the latest and be of one that was overtaken; further back the clock was set anew."""
BEYOND = 50.0
"""Times what the priors foresee, from which a value is none of this vehicle in this unit."""
BEYOND_LIMIT = 5.0
"""Likewise times the limit of a control."""
RECENT = 20
"""Values of a channel over which is looked whether most of them can be."""
INSIDE = 2.0
"""Times what is foreseen, or the limit, below which most must lie before a channel that was left out is taken again."""


class Notes:
    """What is told to the user: each kind once, what happens to the clock every time, and how often each was found."""

    MOST = 20
    """Times that one thing is told."""

    def __init__(self) -> None:
        self.fresh: list[str] = []
        self.counts: dict[str, int] = {}

    def say(self, kind: str, text: str) -> None:
        """Note something."""
        self.counts[kind] = self.counts.get(kind, 0) + 1
        if self.counts[kind] <= (self.MOST if kind in ("gap", "restart") else 1):
            self.fresh.append(text)

    def take(self) -> list[str]:
        """Return what has not been told yet."""
        found, self.fresh = self.fresh, []
        return found


class Passed(NamedTuple):
    """What becomes of a stamp.

    Attributes:
        step: s since the sample before; 0 where states begin anew.
        kind: `goes on`, `begins` (the first, or behind a gap or a restart), or `dropped`.
    """

    step: float
    kind: Literal["goes on", "begins", "dropped"]


class ClockGate:
    """Stamps in their order.

    Args:
        gap: s without a sample, beyond which states begin anew.
        say: told what is dropped, and where states begin anew.
    """

    def __init__(self, gap: float, say: Callable[[str, str], None]):
        self.gap, self.say = Decimal(repr(gap)), say
        self.last: Decimal | None = None
        self.parts: set[int] = set()
        self.origin = Decimal(0), 0.0
        self.time = 0.0
        """Seconds since the first sample, strictly increasing whatever the stream's clock does."""

    def admit(self, stamp: Decimal, part: int, elapsed: float) -> Passed:
        """Judge a stamp.

        Args:
            stamp: on the stream's clock, s.
            part: of the stream.
            elapsed: s since the last sample by this machine's clock, which counts where the stream's was set anew.
        """
        if self.last is None:
            return self._pass(stamp, part, 0.0, "begins")
        step = stamp - self.last
        if step == 0 and part in self.parts:
            self.say("repeats", "repeated stamps are dropped")
            return Passed(0.0, "dropped")
        if step < -Decimal(LATE):
            self.say(
                "restart",
                f"the clock went back by {-step:.6g} s: the states are initialised again, the estimates of the coefficients stay",
            )
            return self._pass(stamp, part, max(elapsed, 1e-3), "begins")
        if step < 0:
            self.say("late", f"samples that come late (by {-step:.3g} s) are dropped")
            return Passed(0.0, "dropped")
        if step > self.gap:
            self.say("gap", f"nothing came for {step:.4g} s: the states are initialised again")
            return self._pass(stamp, part, float(step), "begins")
        return self._pass(stamp, part, float(step), "goes on")

    def _pass(self, stamp: Decimal, part: int, step: float, kind: Literal["goes on", "begins"]) -> Passed:
        if self.last is None or stamp < self.last:
            self.origin = stamp, self.time + step
        self.parts = {*self.parts, part} if stamp == self.last else {part}
        self.last = stamp
        self.time = self.origin[1] + float(stamp - self.origin[0])
        return Passed(step, kind)


class ValueGate:
    """Values that a vehicle can have.

    Args:
        sizes: largest magnitude that is foreseen of a channel, SI; of others only what a record cannot hold is left out.
        limits: of a control, SI.
        say: told what is left out.
    """

    def __init__(self, sizes: Mapping[str, float], limits: Mapping[str, float], say: Callable[[str, str], None]):
        self.most = {name: BEYOND * size for name, size in sizes.items()}
        self.most |= {name: BEYOND_LIMIT * limit for name, limit in limits.items()}
        self.sizes, self.limits, self.say = sizes, limits, say
        self.recent: dict[str, deque[float]] = {}
        self.left_out: set[str] = set()
        """Channels of which no value is taken, since most of the latest cannot be: the others are in the same wrong unit."""

    def admit(self, values: dict[str, float]) -> dict[str, float]:
        """Return the values that can be."""
        found = {name: value for name, value in values.items() if isfinite(value)}
        can_be = {name: value for name, value in found.items() if not self._is_beyond(name, value)}
        for name in found:
            self._judge(name, abs(found[name]))
        return {name: value for name, value in can_be.items() if name not in self.left_out}

    def _judge(self, name: str, size: float) -> None:
        recent = self.recent.setdefault(name, deque(maxlen=RECENT))
        recent.append(size)
        usual = {**self.sizes, **self.limits}.get(name, MAX_MAGNITUDE)
        least = INSIDE * usual if name in self.left_out else self.most.get(name, MAX_MAGNITUDE)
        if 2 * sum(one >= least for one in recent) > len(recent):
            self.left_out.add(name)
        else:
            self.left_out.discard(name)

    def _is_beyond(self, name: str, value: float) -> bool:
        most = self.most.get(name, MAX_MAGNITUDE)
        if abs(value) < most:
            return False
        factor, unit = shown_unit(name)
        known = f"no vehicle has {most * factor:.3g} {unit}"
        if name in self.limits:
            known = f"its limit is {most / BEYOND_LIMIT * factor:.3g} {unit}"
        elif name in self.sizes:
            known = f"the priors allow {most / BEYOND * factor:.3g} {unit} at most"
        self.say(
            f"beyond {name}",
            f"{name} of {value * factor:.3g} {unit}, where {known}: check the unit of its column; such values are left out",
        )
        return True
