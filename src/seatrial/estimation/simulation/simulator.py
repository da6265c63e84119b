"""What the sensors show, but for their noise, for given parameters: the forward model of the likelihoods and of simulated trials.

An actuator that follows a held command c late, da/dt = (c - a) / T, is, from a at a sample, after the step h and on average over it

    a' = c + (a - c) e,  mean = c + (a - c) (1 - e) T / h,  e = exp(-h / T)

A sensor whose clock is late shows at a sample what was true some time before, on a straight line between the samples about that time;
what was true at the first sample is taken to have been so before.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from seatrial.estimation.simulation.delayed_control import DELAY, delay_control
from seatrial.estimation.simulation.mounts import MAX_LATENESS
from seatrial.estimation.simulation.sensor_errors import LagMemory, Sensor, lag_name, lags_before
from seatrial.manoeuvres.pilot import Moment, Pilot
from seatrial.numerics.integrate import Law, time_loop
from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.simulate import move_by

CURRENT = "current"  # Parameter name of a constant current along the vehicle's course, m/s, positive from astern


# `(memory, shown, datum) ->` what is remembered at the next sample, and what is kept of this one.
Watch = Callable[[Any, tuple, Any], tuple[Any, Any]]


@dataclass(frozen=True, eq=False)
class Feedback:
    """Controls that a pilot gives: at each sample it sees what its sensors show under those in force so far.

    Attributes:
        pilot: that decides; it feeds back channels that are measured.
        moments: what it is given from outside at every sample, n of them.
    """

    pilot: Pilot
    moments: Moment


class Followed(NamedTuple):
    """A motion that was followed.

    Attributes:
        end: state after the last step.
        memory: what the one who watched remembers.
        kept: what it kept of the samples.
        command: every control as the feedback gave it; empty if there was none.
    """

    end: tuple
    memory: Any
    kept: Any
    command: tuple


@dataclass(frozen=True)
class Simulator:
    """A vehicle with its sensors; hashable, so that compiled code is shared.

    Attributes:
        model: vehicle, whose `u` is the speed through the water.
        sensors: what is measured.
        delay: whether a delay between command and action is a parameter, `delay`, s; needs a uniform time step.
        current: whether a constant current along the course is a parameter, `current`, m/s.
        late: samples that sensors whose clock is late remember, see `samples_remembered`; needs a uniform time step.
    """

    model: VehicleModel
    sensors: tuple[Sensor, ...]
    delay: bool = False
    current: bool = False
    late: int = 0

    def outputs(
        self,
        values: Mapping[str, Any],
        start: Float[Array, " n_states"],
        control: tuple[Float[Array, " n"], ...],
        step: Float[Array, " n"],
    ) -> Float[Array, "n m"]:
        """Outputs at every sample, SI; arguments as `simulate`."""
        return jnp.stack(self.simulate(values, start, control, step).kept, -1)

    def simulate(
        self,
        values: Mapping[str, Any],
        start: Float[Array, " n_states"],
        control: tuple[Float[Array, " n"], ...] | Feedback,
        step: Float[Array, " n"],
        watch: Watch = lambda memory, shown, _: (memory, shown),
        memory: Any = (),
        data: Any = None,
    ) -> Followed:
        """Simulate a trial and watch what the sensors show; traced, but for the delay of a feedback, which has to be a number.

        Args:
            values: parameters by name, SI.
            start: state at the first sample.
            control: controls, held from each sample to the next, or the feedback that gives them.
            step: time to the next sample, s.
            watch: sees what is shown at each sample.
            memory: what it remembers before the first.
            data: arrays, or a tree of them, of which it is given each sample's own.
        """

        def look(state: tuple, carry: tuple, held: tuple, sample: tuple) -> tuple[tuple, tuple]:
            (memories, past, memory), (lags, _, datum) = carry, sample
            shown = self.show(values, state, held, memories, lags)
            memory, kept = watch(memory, tuple(y for y, _ in shown), datum)
            command = past[1][0] if past else ()
            return (tuple(after for _, after in shown), past, memory), (kept, command)

        first = jnp.arange(step.shape[0]) == 0
        lags = tuple(
            (
                lags_before(step, values[lag_name(sensor.channel)]) if sensor.lag else None,
                (first, jnp.broadcast_to(sensor.samples_late(values, step[0]), first.shape))
                if sensor.is_late
                else None,
            )
            for sensor in self.sensors
        )
        zero, clock, past = jnp.zeros(()), None, ()
        memories = tuple(
            (LagMemory(zero, zero) if sensor.lag else None, jnp.zeros(self.late) if sensor.is_late else None)
            for sensor in self.sensors
        )
        if isinstance(control, Feedback):
            clock = control.moments
            drive, past = self._closed(values, control, step)
        else:
            drive = self.delayed(values, control, step)
        begin = tuple(start[i] for i in range(start.shape[0]))
        (end, (_, _, memory)), (kept, command) = time_loop(
            move_by(self.model, values), begin, drive, step, look, (memories, past, memory), (lags, clock, data)
        )
        return Followed(end, memory, kept, command)

    def delayed(self, values: Mapping[str, Any], control: tuple, step: Float[Array, " n"]) -> tuple:
        """Return controls as they act: after the delay, if that is a parameter."""
        return tuple(delay_control(column, values[DELAY] / step[0]) for column in control) if self.delay else control

    def show(self, values: Mapping[str, Any], state: tuple, held: tuple, memories: tuple, lags: tuple) -> list[tuple]:
        """Return what each sensor shows at a sample without its noise, and what it remembers."""
        shown = []
        for sensor, (memory, past), (lag, late) in zip(self.sensors, memories, lags, strict=True):
            x = self._true(sensor, values, state, held)
            if late is not None:
                x, past = _before(x, past, *late)
            y, memory = sensor.show(values, x, memory, lag)
            shown.append((y, (memory, past)))
        return shown

    def _true(self, sensor: Sensor, values: Mapping[str, Any], state: tuple, held: tuple) -> Any:
        def known(name: str) -> Any:
            has = name.removesuffix("dot") in self.model.states or name in self.model.outputs
            given = dict(zip(self.model.controls, held, strict=True))
            return self.model.output(name, values, state, held) if has else given.get(name, 0.0)

        if sensor.mount is None:
            x = self.model.output(sensor.channel, values, state, held)
        else:
            x = sensor.mount.show(sensor.channel, values, known)
        return x + values[CURRENT] if self.current and sensor.over_ground and sensor.channel == "u" else x

    def _closed(self, values: Mapping[str, Any], feedback: Feedback, step: Float[Array, " n"]) -> tuple[Law, tuple]:
        """Return the law of a feedback, and what it remembers: its memory, and its commands so far, the last one first."""
        pilot, channels = feedback.pilot, [sensor.channel for sensor in self.sensors]
        places = [channels.index(output) for output in pilot.outputs]
        samples = float(values[DELAY]) / float(step[0]) if self.delay else 0.0
        whole = int(samples)
        share = samples - whole

        def in_force(commands: tuple) -> tuple:
            """As `delay_control`: the mean over a step."""
            pairs = zip(commands[whole], commands[whole + 1], strict=True)
            return tuple((1.0 - share) * here + share * before for here, before in pairs)

        def law(state: tuple, carry: tuple, sample: tuple) -> tuple[tuple, tuple]:
            (memories, (before, commands), memory), (lags, moment, _) = carry, sample
            shown = self.show(values, state, in_force(commands), memories, lags)
            seen = tuple(shown[at][0] + error for at, error in zip(places, moment.error, strict=True))
            decided = pilot.decide(before, moment.time, seen, moment.told)
            commands = (pilot.controls(decided, moment.told), *commands[:-1])
            return in_force(commands), (memories, (decided, commands), memory)

        begin = pilot.begin()
        first = pilot.controls(begin, tuple(stated[0] for stated in feedback.moments.told))
        return law, (begin, (first,) * (whole + 2))


def samples_remembered(sensors: Sequence[Sensor], step: float) -> int:
    """Return how many samples of even steps sensors remember, whose clock is late by `MOST_LATE` at most; 0 if none is."""
    return ceil(MAX_LATENESS / step) + 2 if any(sensor.is_late for sensor in sensors) else 0


def _before(x: Any, past: Array, is_first: Any, samples: Any) -> tuple[Any, Array]:
    """Return what was true some samples ago, and all that is remembered, the newest first."""
    past = jnp.where(is_first, x, jnp.concatenate([jnp.reshape(x, (1,)), past[:-1]]))
    at = jnp.clip(samples, 0.0, past.shape[0] - 2.0)
    whole = jnp.floor(at)
    share, place = at - whole, whole.astype(int)
    return (1.0 - share) * past[place] + share * past[place + 1], past
