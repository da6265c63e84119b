"""What every trial that is planned for one vehicle shares, and what any control would show and teach on it.

A plan is a pytree: the numbers are leaves, so that code compiled for one vehicle serves its plans at any noise and any start.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from seatrial.compiled.programs import program
from seatrial.compiled.pytrees import compiled_tree
from seatrial.estimation.posterior.information import coefficient_information, fed_back
from seatrial.manoeuvres.autopilot import Autopilot
from seatrial.manoeuvres.pilot import Moment, close_loop
from seatrial.numerics.array_module import array_module
from seatrial.numerics.integrate import Look, Move, State, time_loop
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
        weight: one over the standard deviation of each channel at each sample, SI, 0 if it is not measured, shape (n, m).
        autopilot: through which a design acts, and which feeds back measured channels; None if it acts on the controls themselves.
        process: standard deviation that each state gains in one second, SI, as far as what is learned is concerned; None for none.
    """

    model: VehicleModel
    channels: tuple[str, ...]
    start: Float[Array, " n_states"]
    step: Float[Array, " n"]
    weight: Float[Array, "n m"]
    autopilot: Autopilot | None = None
    process: Float[Array, " n_states"] | None = None

    @property
    def commands(self) -> tuple[str, ...]:
        """Return what a design commands, in the order of its columns: the controls, and behind them set-points of the autopilot."""
        return self.model.controls if self.autopilot is None else self.autopilot.commands

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
            control: every command, held from each sample to the next, SI.
        """
        return self._run(values, control)[0]

    def outputs(self, values: Float[Array, " k"], control: Float[Array, "n c"]) -> Float[Array, "n m"]:
        """What the sensors would show without noise, over their noise, 0 if nothing is measured; may be batched."""
        return self._run(values, control)[1]

    def information(self, values: Float[Array, " k"], control: Float[Array, "n c"]) -> Float[Array, "k k"]:
        """Fisher information about the coefficients, SI; may be batched.

        Under an autopilot it is that of the outputs given the controls that were logged, along the motion of the closed loop.

        Args:
            values: coefficients about which it is linearised, SI.
            control: every command, held from each sample to the next, SI.
        """
        parts = self.model, self.channels, self.named(values), control, self.step, self.start, self.weight
        return coefficient_information(*parts, self.autopilot, self.process)

    def named(self, values: Float[Array, " k"]) -> dict[str, Array]:
        """Coefficients by name, SI."""
        return {name: values[i] for i, name in enumerate(self.names)}

    def applied(
        self, values: Float[Array, " k"], control: Float[Array, "n c"], noise: Float[Array, "n m"] | None = None
    ) -> Float[Array, "n n_controls"]:
        """Return the vehicle's controls as they act under a design, SI; may be batched.

        Args:
            values: coefficients, SI.
            control: every command, held from each sample to the next, SI.
            noise: of each channel over its standard deviation, as the autopilot sees it; None for perfect sensors.
        """
        start = tuple(self.start[i] for i in range(self.start.shape[0]))
        params = self.named(values)
        move = move_by(self.model, params)
        *_, held = self.follow(params, move, start, control, lambda state, memory, held, _: (memory, held), noise=noise)
        return jnp.stack(held, 1)

    def moments(
        self, control: Float[Array, "n c"], noise: Float[Array, "n m"] | None = None
    ) -> tuple[tuple[Array, ...], Moment]:
        """Return the columns of a design, and all that its autopilot is given; traced.

        Args:
            control: every command, SI.
            noise: of each channel over its standard deviation; None for perfect sensors.
        """
        columns = tuple(control[:, i] for i in range(control.shape[1]))
        fed_back = () if self.autopilot is None else self.autopilot.outputs
        places = [self.channels.index(name) for name in fed_back]
        errors = []
        for at in places:
            weight = self.weight[:, at]
            safe_weight = jnp.where(weight > 0, weight, 1.0)
            errors.append(jnp.where(weight > 0, 0.0 if noise is None else noise[:, at] / safe_weight, jnp.nan))
        time = jnp.concatenate([jnp.zeros(1), jnp.cumsum(self.step)[:-1]])
        return columns, Moment(time, columns, tuple(errors))

    def follow(
        self,
        params: Mapping[str, Array],
        move: Move,
        start: State,
        control: Float[Array, "n c"],
        look: Look,
        memory: Any = (),
        extra: Any = None,
        noise: Float[Array, "n m"] | None = None,
    ) -> tuple[State, tuple, Any, Any]:
        """Follow a motion of the vehicle under a design, through the autopilot where there is one; traced.

        Args:
            params: coefficients and unknowns by name, SI.
            move: takes the state to the next sample.
            start: state at the first sample; what travels with the vehicle's own stands behind it.
            control: every command, held from each sample to the next, SI.
            look: sees the state, and the vehicle's controls as they act.
            memory: of `look`.
            extra: arrays, or a tree of them, of which look is given each sample's own.
            noise: of each channel over its standard deviation, as the autopilot sees it; None for perfect sensors.

        Returns:
            State after the last step, the controls of that step, the memory, and what was kept.
        """
        autopilot, (columns, moments) = self.autopilot, self.moments(control, noise)
        if autopilot is None:
            (end, memory), kept = time_loop(move, start, columns, self.step, look, memory, extra)
            return end, tuple(column[-1] for column in columns), memory, kept
        closed = close_loop(autopilot, fed_back(self.model, autopilot, params))

        def law(state: tuple, carry: tuple, sample: tuple) -> tuple[tuple, tuple]:
            held, decided = closed(state, carry[0], sample[0])
            return held, (decided, held, carry[2])

        def seen(state: tuple, carry: tuple, held: tuple, sample: tuple) -> tuple[tuple, Any]:
            after, kept = look(state, carry[2], held, sample[1])
            return (*carry[:2], after), kept

        begin = autopilot.begin()
        first = autopilot.controls(begin, tuple(column[0] for column in columns))
        (end, (_, last, memory)), kept = time_loop(
            move, start, law, self.step, seen, (begin, first, memory), (moments, extra)
        )
        return end, last, memory, kept

    def shown(self, params: Mapping[str, Array], control: Float[Array, "n c"]) -> Float[Array, "n m"]:
        """Return `outputs` of a vehicle of which unknowns beside the coefficients may be given too, all by name, SI; traced."""
        return self._followed(params, control)[1]

    @program
    def _run(self, values: Array, control: Array) -> tuple[Array, Array]:
        return self._followed(self.named(values), control)

    def _followed(self, params: Mapping[str, Array], control: Array) -> tuple[Array, Array]:
        def look(state: tuple, memory: tuple, held: tuple, counts: Array) -> tuple:
            shown = tuple(
                self.model.output(name, params, state, held) * counts[i] for i, name in enumerate(self.channels)
            )
            return memory, (state, shown)

        start = tuple(self.start[i] for i in range(self.start.shape[0]))
        *_, (states, shown) = self.follow(params, move_by(self.model, params), start, control, look, extra=self.weight)
        return jnp.stack(states, 1), jnp.stack(shown, 1)


def plan_trial(
    model: VehicleModel,
    start: Sequence[float],
    noise: Mapping[str, float],
    n: int,
    sample_time: float,
    measured: Float[np.ndarray, "n m"] | None = None,
    autopilot: Autopilot | None = None,
    process: Sequence[float] | None = None,
) -> TrialPlan:
    """Plan trials of n samples.

    Args:
        model: vehicle.
        start: state at the first sample, SI.
        noise: standard deviation of each measured channel, SI.
        n: samples.
        sample_time: s.
        measured: 1 if a channel is measured, 0 elsewhere, in the order of `noise`; None for every sample.
        autopilot: through which designs act; None if they act on the controls.
        process: standard deviation that each state gains in one second, SI; None for none.
    """
    weight = np.broadcast_to(1.0 / np.array(list(noise.values()), float), (n, len(noise)))
    return TrialPlan(
        model,
        tuple(noise),
        np.asarray(start, float),
        np.full(n, float(sample_time)),
        weight if measured is None else np.where(measured > 0, weight, 0.0),
        autopilot,
        None if process is None else np.asarray(process, float),
    )
