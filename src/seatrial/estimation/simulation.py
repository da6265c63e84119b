"""What the sensors would show, without noise, for given parameters: the forward model of the output-error likelihood."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from seatrial.estimation.sensors import Memory, Sensor, lag_name, lags_before
from seatrial.numerics.integrate import rk4_step
from seatrial.vehicles.model import VehicleModel

CURRENT = "current"
"""Parameter name of a constant current along the vehicle's course, m/s, positive from astern."""


@dataclass(frozen=True)
class Simulator:
    """A vehicle with its sensors; hashable, so that compiled code is shared.

    Attributes:
        model: vehicle, whose `u` is the speed through the water.
        sensors: what is measured.
        delay: whether a delay between command and action is a parameter, `delay`, s; needs a uniform time step.
        current: whether a constant current along the course is a parameter, `current`, m/s.
    """

    model: VehicleModel
    sensors: tuple[Sensor, ...]
    delay: bool = False
    current: bool = False

    def outputs(
        self,
        values: Mapping[str, Any],
        start: Float[Array, " n_states"],
        control: tuple[Float[Array, " n"], ...],
        step: Float[Array, " n"],
    ) -> Float[Array, "n m"]:
        """Outputs at every sample, SI.

        Args:
            values: parameters by name, SI.
            start: state at the first sample.
            control: controls, held from each sample to the next.
            step: time to the next sample, s.
        """
        samples = self.samples(values, control, step)
        _, shown = jax.lax.scan(lambda carry, sample: self.advance(values, carry, sample), self.begin(start), samples)
        return jnp.stack(shown, -1)

    def samples(self, values: Mapping[str, Any], control: tuple, step: Float[Array, " n"]) -> tuple:
        """What the time loop reads: controls as they act, steps, and the coefficients of the sensors' lags."""
        if self.delay:
            control = tuple(delay_control(column, values["delay"] / step[0]) for column in control)
        lags = tuple(
            lags_before(step, values[lag_name(sensor.channel)]) if sensor.lag else None for sensor in self.sensors
        )
        return control, step, lags

    def begin(self, start: Float[Array, " n_states"]) -> tuple:
        """State and memories of the sensors before the first sample."""
        zero = jnp.zeros(())
        memories = tuple(Memory(zero, zero) if sensor.lag else None for sensor in self.sensors)
        return tuple(start[i] for i in range(start.shape[0])), memories

    def advance(self, values: Mapping[str, Any], carry: tuple, sample: tuple) -> tuple[tuple, tuple]:
        """State one step later, and what the sensors show now."""
        (state, memories), (held, h, lags) = carry, sample
        shown = [
            sensor.show(values, self._true(sensor, values, state, held), memory, lag)
            for sensor, memory, lag in zip(self.sensors, memories, lags, strict=True)
        ]
        state = rk4_step(lambda x: self.model.derivative(values, x, held), state, h)
        return (state, tuple(memory for _, memory in shown)), tuple(y for y, _ in shown)

    def _true(self, sensor: Sensor, values: Mapping[str, Any], state: tuple, held: tuple) -> Any:
        x = self.model.output(sensor.channel, values, state, held)
        return x + values[CURRENT] if self.current and sensor.over_ground and sensor.channel == "u" else x


def delay_control(control: Float[Array, " n"], samples: Float[Array, ""]) -> Float[Array, " n"]:
    """One control as it was a number of samples ago, the first value held before the start.

    The mean over each step of a command that is held between samples: exact, and continuous in the delay.
    """
    n = control.shape[0]
    whole = jnp.floor(samples)
    share, first = samples - whole, n - whole.astype(int)
    held = jnp.concatenate([jnp.full(n, control[0]), control])
    here, before = (jax.lax.dynamic_slice(held, (jnp.maximum(start, 0),), (n,)) for start in (first, first - 1))
    return (1.0 - share) * here + share * before
