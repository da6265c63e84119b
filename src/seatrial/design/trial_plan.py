"""What every trial that is planned for one vehicle shares, and what any control would show and teach on it.

A plan is a pytree: the numbers are leaves, so that code compiled for one vehicle serves its plans at any noise and any start.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from seatrial.core.array_module import array_module
from seatrial.core.programs import program
from seatrial.core.pytrees import compiled_tree
from seatrial.estimation.information import coefficient_information
from seatrial.numerics.integrate import time_loop
from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.simulate import move_by


@compiled_tree("model", "channels")
@dataclass(frozen=True)
class TrialPlan:
    """A vehicle at the start of a trial, and its sensors. Build it with `plan_trial`.

    Attributes:
        model: vehicle; its k coefficients, in its order, are what the trial is to tell.
        channels: measured channels.
        start: state at the first sample, shape (n_states,).
        step: time to the next sample, s, shape (n,).
        weight: one over the standard deviation of each channel at each sample, SI, 0 where it is not measured, shape (n, m).
    """

    model: VehicleModel
    channels: tuple[str, ...]
    start: Float[Array, " n_states"]
    step: Float[Array, " n"]
    weight: Float[Array, "n m"]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coefficients."""
        return tuple(coefficient.text for coefficient in self.model.coefficients)

    @property
    def time(self) -> Float[np.ndarray, " n"]:
        """Sample times, s."""
        step = np.asarray(self.step)
        return np.concatenate([[0.0], np.cumsum(step)[:-1]])

    def until(self, samples: Int[Array, ""] | int) -> "TrialPlan":
        """The plan of a trial that is ended after so many samples: from then on the motion stands still and nothing is measured.

        Its arrays keep their shapes, so that what is compiled serves any end; traced, may be batched over the samples.
        """
        xp = array_module(samples, self.step, self.weight)
        taken = xp.arange(self.step.shape[0]) < samples
        return replace(self, step=xp.where(taken, self.step, 0.0), weight=xp.where(taken[:, None], self.weight, 0.0))

    def motion(self, values: Float[Array, " k"], control: Float[Array, "n c"]) -> Float[Array, "n n_states"]:
        """States at every sample under a control, without noise; may be batched.

        Args:
            values: coefficients, SI.
            control: every control, held from each sample to the next, SI.
        """
        return self._run(values, control)[0]

    def outputs(self, values: Float[Array, " k"], control: Float[Array, "n c"]) -> Float[Array, "n m"]:
        """What the sensors would show without noise, over their noise, 0 where nothing is measured; may be batched."""
        return self._run(values, control)[1]

    def information(self, values: Float[Array, " k"], control: Float[Array, "n c"]) -> Float[Array, "k k"]:
        """Fisher information about the coefficients, SI; may be batched.

        Args:
            values: coefficients about which it is linearised, SI.
            control: every control, held from each sample to the next, SI.
        """
        params = self.named(values)
        return coefficient_information(self.model, self.channels, params, control, self.step, self.start, self.weight)

    def named(self, values: Float[Array, " k"]) -> dict[str, Array]:
        """Coefficients by name, SI."""
        return {name: values[i] for i, name in enumerate(self.names)}

    @program
    def _run(self, values: Array, control: Array) -> tuple[Array, Array]:
        params = self.named(values)

        def look(state: tuple, memory: tuple, held: tuple, counts: Array) -> tuple:
            shown = tuple(
                self.model.output(name, params, state, held) * counts[i] for i, name in enumerate(self.channels)
            )
            return memory, (state, shown)

        columns = tuple(control[:, i] for i in range(control.shape[1]))
        start = tuple(self.start[i] for i in range(self.start.shape[0]))
        move = move_by(self.model, params)
        _, (states, shown) = time_loop(move, start, columns, self.step, look, extra=self.weight)
        return jnp.stack(states, 1), jnp.stack(shown, 1)


def plan_trial(
    model: VehicleModel,
    start: Sequence[float],
    noise: Mapping[str, float],
    n: int,
    sample_time: float,
    measured: Float[np.ndarray, "n m"] | None = None,
) -> TrialPlan:
    """Plan trials of n samples.

    Args:
        model: vehicle.
        start: state at the first sample, SI.
        noise: standard deviation of each measured channel, SI.
        n: samples.
        sample_time: s.
        measured: 1 where a channel is measured, 0 elsewhere, in the order of `noise`; None for every sample.
    """
    weight = np.broadcast_to(1.0 / np.array(list(noise.values()), float), (n, len(noise)))
    return TrialPlan(
        model,
        tuple(noise),
        np.asarray(start, float),
        np.full(n, float(sample_time)),
        weight if measured is None else np.where(measured > 0, weight, 0.0),
    )
