"""Output-error likelihood: the model is simulated without process noise and what the sensors show beside it is noise.

White residuals: y_k = h(x_k) + s e_k, summed inside the time loop. Coloured residuals: an Ornstein-Uhlenbeck process of
standard deviation s and correlation time tau, e_k given e_j before it being normal with mean rho e_j and variance
s^2 (1 - rho^2), rho = exp(-(t_k - t_j) / tau), which is exact across gaps (Gillespie, Phys. Rev. E 54, 1996).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.core.errors import InputError
from seatrial.core.record import Record
from seatrial.estimation.residuals import Coloured, White
from seatrial.estimation.simulation import delay_control
from seatrial.estimation.trial_data import ChannelData, TrialData, stack_trials
from seatrial.numerics.integrate import rk4_step
from seatrial.vehicles.model import VehicleModel

NoiseColour = Literal["white", "coloured"]


@dataclass(frozen=True)
class OutputError:
    """What is simulated and how its residuals are modelled; hashable, so that compiled code is shared.

    Attributes:
        model: vehicle.
        channels: measured channels that enter the likelihood.
        colour: colour of the residuals.
        delay: whether a delay between command and action is a parameter (`delay`, s); needs a uniform time step.
        complete: for each channel, whether every sample of every trial is present.
        labels: trial labels; a trial whose initial state is estimated has parameters `u_0[label]`.
        free_initial: whether initial states are estimated.
    """

    model: VehicleModel
    channels: tuple[str, ...]
    colour: NoiseColour
    delay: bool
    complete: tuple[bool, ...]
    labels: tuple[str, ...]
    free_initial: bool

    def __call__(self, values: dict[str, Any], data: TrialData) -> Any:
        """Log-likelihood of all trials; -inf where the simulation diverges."""

        def add(total: Array, trial: tuple[TrialData, Array]) -> tuple[Array, None]:
            return total + self._trial(values, *trial), None

        trials = (data, self.starts(values, data))
        if len(self.labels) == 1:
            total = self._trial(values, *jax.tree.map(lambda x: x[0], trials))
        else:
            total, _ = jax.lax.scan(add, jnp.zeros(()), trials)
        return jnp.where(jnp.isfinite(total), total, -jnp.inf)

    def starts(self, values: dict[str, Any], data: TrialData) -> Float[Array, "trials n_states"]:
        """Initial states."""
        if not self.free_initial:
            return data.initial
        starts = [[values[initial_name(state, label)] for state in self.model.states] for label in self.labels]
        return jnp.asarray(starts, float)

    def _trial(self, values: dict[str, Any], trial: TrialData, start: Array) -> Any:
        """One time loop that simulates and sums the squares of what is new in each residual, and keeps nothing else."""
        params = {name.text: values[name.text] for name in self.model.coefficients}
        noises = [
            self._noise(values, name, channel) for name, channel in zip(self.channels, trial.channels, strict=True)
        ]

        def advance(carry: tuple, sample: tuple) -> tuple[tuple, None]:
            state, sums = carry
            held, channels, step = sample
            sums = tuple(
                noise.absorb(total, y - self.model.output(name, params, state, held), present, kind, complete)
                for noise, total, name, (y, present, kind), complete in zip(
                    noises, sums, self.channels, channels, self.complete, strict=True
                )
            )
            return (rk4_step(lambda x: self.model.derivative(params, x, held), state, step), sums), None

        sampled = tuple((channel.measured, channel.present, channel.kind) for channel in trial.channels)
        begin = tuple(start[i] for i in range(start.shape[0])), tuple(noise.empty() for noise in noises)
        (_, sums), _ = jax.lax.scan(advance, begin, (self._control(values, trial), sampled, trial.step))
        return sum((noise.log_likelihood(total) for noise, total in zip(noises, sums, strict=True)), jnp.zeros(()))

    def _control(self, values: dict[str, Any], trial: TrialData) -> tuple:
        """Controls as they act."""
        if not self.delay:
            return trial.control
        return tuple(delay_control(column, values["delay"] / trial.step[0]) for column in trial.control)

    def _noise(self, values: dict[str, Any], name: str, channel: ChannelData) -> White | Coloured:
        """Model of one channel's residuals under these parameters."""
        sd = values[noise_name(name)]
        if self.colour == "white":
            return White(sd, channel.counts)
        memory = jnp.exp(-channel.gaps / values[correlation_name(name)])
        return Coloured(sd, channel.counts, memory, 1.0 / (1.0 - memory * memory))


def noise_name(channel: str) -> str:
    """Parameter name of a channel's noise standard deviation."""
    return f"sigma_{channel}"


def correlation_name(channel: str) -> str:
    """Parameter name of the correlation time of a channel's residuals, s."""
    return f"tau_{channel}"


def initial_name(state: str, label: str) -> str:
    """Parameter name of a trial's initial state."""
    return f"{state}_0[{label}]"


def output_error(
    model: VehicleModel,
    records: Sequence[Record],
    channels: Sequence[str],
    initial: Sequence[Sequence[float]],
    *,
    colour: NoiseColour = "white",
    delay: bool = False,
    free_initial: bool = False,
) -> tuple[OutputError, TrialData]:
    """Likelihood of several trials fitted jointly, and its data.

    Args:
        model: vehicle.
        records: trials.
        channels: measured channels to use.
        initial: state at the first sample of each trial; ignored where `free_initial`.
        colour: colour of the residuals.
        delay: whether the delay between command and action is a parameter.
        free_initial: estimate each trial's initial state.

    Raises:
        InputError: a missing channel, trials of the same label, or a delay with a time step that varies.
    """
    labels = tuple(record.label for record in records)
    if len(set(labels)) < len(labels):
        raise InputError(
            "trials fitted jointly",
            found="labels " + ", ".join(f'"{label}"' for label in labels),
            expected="a label of its own for each trial",
            remedy="rename the records: initial states are told apart by these labels",
        )
    data = stack_trials(records, model, channels, initial)
    for record in records if delay else ():
        step = np.diff(record.time)
        if np.ptp(step) > 1e-6 * step[0]:
            raise InputError(
                f'record "{record.label}"',
                found=f"time steps from {step.min():g} to {step.max():g} s",
                expected="a uniform step, since the delay is a parameter",
                remedy="import the record with a fixed `step`, or estimate without `delay`",
            )
    complete = tuple(bool(channel.present.all()) for channel in data.channels)
    return OutputError(model, tuple(channels), colour, delay, complete, labels, free_initial), data
