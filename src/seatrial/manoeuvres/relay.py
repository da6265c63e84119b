"""Self-oscillating test, the zigzag generalised: control = trim ± amplitude, reversed when the output has gone far enough.

    side = -1 once effect (y - y_trim) >= threshold, +1 once effect (y - y_trim) <= -threshold, else as before

It is the relay with hysteresis of Åström and Hägglund (Automatica 20, 1984) and, with heading as output, the zigzag of ships.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from math import inf
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from seatrial.compiled.programs import program
from seatrial.manoeuvres.manoeuvre import Manoeuvre
from seatrial.manoeuvres.pilot import Moment, close_loop
from seatrial.numerics.integrate import time_loop
from seatrial.numerics.state_space import StateSpace


@dataclass(frozen=True)
class RelayFamily:
    """What all self-oscillating tests of one kind share; SI.

    Attributes:
        trim: every control's name and trim value, in the vehicle's order.
        control: the control that is switched; the others stay at trim.
        output: the measured channel that is fed back.
        output_trim: its trim value.
        duration: of the trial, s.
        sample_time: s.
        start: when the control first leaves trim, to the positive side, s.
        active: time for which the relay acts, s; the control returns to trim afterwards.
        effect: +1 if more control raises the output, -1 if it lowers it (stern plane on pitch).
        rate: fastest change of the control, per s.
    """

    trim: tuple[tuple[str, float], ...]
    control: str
    output: str
    output_trim: float
    duration: float
    sample_time: float
    start: float = 0.0
    active: float = inf
    effect: float = 1.0
    rate: float = inf

    @property
    def control_trim(self) -> float:
        """Trim value of the control that is switched."""
        return dict(self.trim)[self.control]

    def time(self) -> Float[np.ndarray, " n"]:
        """Sample times, s."""
        return np.arange(round(self.duration / self.sample_time)) * self.sample_time

    def command(self, applied: Any) -> tuple:
        """Return every control, SI, where a change from trim is applied to the one that is switched."""
        return tuple(
            value + applied if name == self.control else jnp.asarray(value, float) for name, value in self.trim
        )

    def as_plain(self) -> dict[str, Any]:
        """Return the family for a file, None if a number is infinite."""
        plain = {name: None if value == inf else value for name, value in asdict(self).items()}
        return {**plain, "trim": [list(pair) for pair in self.trim]}


def read_relay_family(plain: Mapping[str, Any]) -> RelayFamily:
    """Return a family that was written by `as_plain`."""
    values = {name: inf if value is None else value for name, value in plain.items()}
    return RelayFamily(**{**values, "trim": tuple((str(name), float(value)) for name, value in plain["trim"])})


class RelayMemory(NamedTuple):
    """What the relay remembers: the side it is on, +1 or -1, and the change of control now applied."""

    side: Any
    applied: Any


@dataclass(frozen=True, eq=False)
class Relay:
    """One self-oscillating test, a pilot that is told nothing, see `seatrial.manoeuvres.pilot.Pilot`.

    Attributes:
        family: effect, rate and timing.
        amplitude: of the control, SI.
        threshold: change of the output from trim at which the control is reversed, SI.
    """

    family: RelayFamily
    amplitude: Any
    threshold: Any

    @property
    def outputs(self) -> tuple[str, ...]:
        """See `Pilot.outputs`."""
        return (self.family.output,)

    def begin(self) -> RelayMemory:
        """See `Pilot.begin`: on the positive side, at trim."""
        return RelayMemory(1.0, 0.0)

    def decide(self, memory: RelayMemory, time: Any, seen: tuple, told: tuple) -> RelayMemory:
        """See `Pilot.decide`; an output that is not measured leaves the relay as it is."""
        family = self.family
        # Times that should be equal differ by rounding (k * 0.01 s against 1 s); a nanosecond decides.
        elapsed = time - family.start + 1e-9
        running = (elapsed >= 0) & (elapsed < family.active)
        driven = family.effect * (seen[0] - family.output_trim)
        reversed_side = jnp.where(
            driven >= self.threshold, -1.0, jnp.where(driven <= -self.threshold, 1.0, memory.side)
        )
        side = jnp.where(running, reversed_side, memory.side)
        wanted = jnp.where(running, self.amplitude * side, 0.0)
        if family.rate < inf:
            step = family.rate * family.sample_time
            wanted = memory.applied + jnp.clip(wanted - memory.applied, -step, step)
        return RelayMemory(side, wanted)

    def controls(self, memory: RelayMemory, told: tuple) -> tuple:
        """See `Pilot.controls`."""
        return self.family.command(memory.applied)


class RelayRun(NamedTuple):
    """A closed-loop run; n samples, c controls, d dynamic states, m channels.

    Attributes:
        control: shape (n, c).
        state: dynamic states, shape (n, d).
        outputs: noise-free channels, shape (n, m).
        switches: number of reversals; below 2 the loop does not oscillate.
        reached: largest change of the measured output from trim while the relay acts.
    """

    control: Float[Array, "n c"]
    state: Float[Array, "n d"]
    outputs: Float[Array, "n m"]
    switches: Float[Array, ""]
    reached: Float[Array, ""]


def run_relay(
    space: StateSpace,
    family: RelayFamily,
    amplitude: Float[Array, ""],
    threshold: Float[Array, ""],
    start: Float[Array, " d"],
    noise: Float[Array, " n"] | None = None,
) -> RelayRun:
    """Simulate the closed loop. May be batched with `jax.vmap` over any array.

    At each sample the relay sees the output under the control in force so far, and then decides.

    Args:
        space: vehicle; its transition moves it from sample to sample.
        family: what is switched, what is fed back, and timing.
        amplitude: of the control, SI.
        threshold: change of the output from trim at which the control is reversed, SI.
        start: dynamic states and coefficients, in the units of `space`.
        noise: added to the output that is fed back; NaN if it is not measured; None for a perfect sensor.
    """
    error = jnp.zeros(family.time().size) if noise is None else noise
    return _run(space, family, amplitude, threshold, jnp.asarray(start, float), error)


def replay(family: RelayFamily, amplitude: float, threshold: float, run: RelayRun) -> Manoeuvre:
    """Return the open-loop manoeuvre with the control of a run, held from sample to sample: for schedules and figures.

    Args:
        family: of the test.
        amplitude: change of the control from trim, SI.
        threshold: of the output about its trim, SI.
        run: of the test with these two.
    """
    held = np.asarray(run.control)[:, [name for name, _ in family.trim].index(family.control)]
    settings = {"trim": family.control_trim, "amplitude": amplitude, "threshold": threshold, "start": family.start}

    def signal(time: np.ndarray) -> np.ndarray:
        index = np.floor(np.asarray(time) / family.sample_time + 1e-6).astype(int)
        return held[np.clip(index, 0, held.size - 1)]

    return Manoeuvre("self-oscillation", family.control, family.duration, settings, signal)


@program(static_argnums=1)
def _run(space: StateSpace, family: RelayFamily, amplitude: Array, threshold: Array, start: Array, noise: Array):
    d, fed_back = space.n_dynamic, space.outputs.index(family.output)
    fixed, relay = tuple(start[d:]), Relay(family, amplitude, threshold)
    law = close_loop(relay, lambda state, held: (space.observe((*state, *fixed), held)[fed_back],))

    def decide(state: tuple, memory: tuple, moment: Moment) -> tuple[tuple, tuple]:
        before, switches, reached = memory
        held, decided = law(state, before, moment)
        shown = space.observe((*state, *fixed), relay.controls(before, ()))[fed_back]
        deviation = shown + moment.error[0] - family.output_trim
        acts = jnp.isfinite(deviation) & (moment.time < family.start + family.active)
        reached = jnp.maximum(reached, jnp.where(acts, jnp.abs(deviation), 0.0))
        return held, (decided, switches + (decided.side != before.side), reached)

    def look(state: tuple, memory: tuple, held: tuple, _: Moment) -> tuple[tuple, tuple]:
        return memory, (held, state, space.observe((*state, *fixed), held))

    def move(state: tuple, held: tuple, h: Any) -> tuple:
        return space.transition((*state, *fixed), held, h)

    time = jnp.asarray(family.time())
    steps, begin = jnp.full(time.size, family.sample_time), (relay.begin(), jnp.zeros(()), jnp.zeros(()))
    moments = Moment(time, (), (noise,))
    (_, (_, switches, reached)), kept = time_loop(move, tuple(start[:d]), decide, steps, look, begin, moments)
    control, state, outputs = (jnp.stack([jnp.asarray(x, float) for x in part], -1) for part in kept)
    return RelayRun(control, state, outputs, switches, reached)


# What a self-oscillating test shows: its reversals, period and overshoots, the indices of a zigzag (IMO MSC.137(76),
# 2002).
#
# An overshoot is how far the output goes beyond the threshold after the control was reversed; the period is the time
# from one reversal to the next but one.


class Oscillation(NamedTuple):
    """Indices of S runs; NaN if a run has no such reversal.

    Attributes:
        reversals: how often the control was reversed, shape (S,).
        period: median time from one reversal to the next but one, s, shape (S,).
        first_overshoot: of the output, SI, shape (S,).
        second_overshoot: likewise, on the other side.
    """

    reversals: Int[np.ndarray, " S"]
    period: Float[np.ndarray, " S"]
    first_overshoot: Float[np.ndarray, " S"]
    second_overshoot: Float[np.ndarray, " S"]


def oscillation(
    family: RelayFamily, output: Float[np.ndarray, "S n"], seen: Float[np.ndarray, "S n"], threshold: float
) -> Oscillation:
    """Return the indices of runs of one design.

    Args:
        family: timing, effect and trim.
        output: as it was, SI.
        seen: as the relay saw it, with noise; NaN if it was not measured.
        threshold: change of the output from trim at which the control is reversed, SI.
    """
    at = [_reversals(family, row - family.output_trim, threshold) for row in np.asarray(seen)]
    driven = family.effect * (np.asarray(output) - family.output_trim)
    last = int(np.searchsorted(family.time(), family.start + family.active - 1e-9))
    periods = [np.median(np.diff(times[::2])) if times.size > 2 else np.nan for times in (family.time()[i] for i in at)]
    # The relay begins on the positive side, so that its first reversal is at the top and its second at the bottom.
    first = [_overshoot(row, i, 0, last, threshold) for row, i in zip(driven, at, strict=True)]
    second = [_overshoot(-row, i, 1, last, threshold) for row, i in zip(driven, at, strict=True)]
    return Oscillation(np.array([i.size for i in at]), np.array(periods), np.array(first), np.array(second))


def _reversals(family: RelayFamily, deviation: np.ndarray, threshold: float) -> np.ndarray:
    """Return the samples at which the relay changes side."""
    elapsed = family.time() - family.start + 1e-9
    driven = np.where((elapsed >= 0) & (elapsed < family.active), family.effect * deviation, np.nan)
    beyond = np.flatnonzero(np.abs(driven) >= threshold)
    sides = np.concatenate([[1.0], -np.sign(driven[beyond])])
    return beyond[np.diff(sides) != 0]


def _overshoot(driven: np.ndarray, at: np.ndarray, which: int, last: int, threshold: float) -> float:
    """Return the most that the output goes beyond the threshold from one reversal to the next, or to the end of the test."""
    if at.size <= which:
        return float("nan")
    end = at[which + 1] if at.size > which + 1 else last
    return float(driven[at[which] : end + 1].max() - threshold)
