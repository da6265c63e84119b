"""What closes a loop: a pilot sees what sensors show at each sample, and decides every control until the next.

A zigzag, a self-oscillating test and an autopilot are pilots. The same law serves design and simulation.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

from seatrial.numerics.integrate import Law


class Pilot(Protocol):
    """What every pilot offers; all methods are traced."""

    @property
    def outputs(self) -> tuple[str, ...]:
        """Channels that are fed back."""
        ...

    def begin(self) -> Any:
        """Return what it remembers before the first sample."""
        ...

    def decide(self, memory: Any, time: Any, seen: tuple, told: tuple) -> Any:
        """Return what it remembers until the next sample.

        Args:
            memory: from the sample before.
            time: of the sample, s.
            seen: what the sensors of `outputs` show, SI; NaN if nothing is measured.
            told: what the schedule commands at this sample, SI.
        """
        ...

    def controls(self, memory: Any, told: tuple) -> tuple:
        """Return every control of the vehicle, SI, by what it remembers and is told."""
        ...


class Moment(NamedTuple):
    """One sample, or all samples, of what a pilot is given from outside.

    Attributes:
        time: s.
        told: what the schedule commands, SI.
        error: of each channel that is fed back, SI; NaN if nothing is measured.
    """

    time: Any
    told: tuple
    error: tuple


def close_loop(pilot: Pilot, show: Callable[[tuple, tuple], tuple]) -> Law:
    """Return the law of a pilot for `time_loop`, of whose samples each is a `Moment`.

    Args:
        pilot: that sees what is shown under the controls in force so far, and then decides.
        show: `(state, controls) ->` the channels that are fed back, without their error.
    """

    def law(state: tuple, memory: Any, moment: Moment) -> tuple[tuple, Any]:
        exact = show(state, pilot.controls(memory, moment.told))
        seen = tuple(y + error for y, error in zip(exact, moment.error, strict=True))
        decided = pilot.decide(memory, moment.time, seen, moment.told)
        return pilot.controls(decided, moment.told), decided

    return law
