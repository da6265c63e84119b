"""Output-error likelihood: the model is simulated without process noise and what the sensors show beside it is noise.

White residuals: y_k = h(x_k) + s e_k, summed inside the time loop. Coloured residuals: an Ornstein-Uhlenbeck process of
standard deviation s and correlation time tau, e_k given e_j before it being normal with mean rho e_j and variance
s^2 (1 - rho^2), rho = exp(-(t_k - t_j) / tau), which is exact across gaps (Gillespie, Phys. Rev. E 54, 1996).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from seatrial.core.errors import InputError
from seatrial.core.record import Record
from seatrial.estimation.simulation import delay_control
from seatrial.numerics.integrate import rk4_step
from seatrial.vehicles.model import VehicleModel

NoiseColour = Literal["white", "coloured"]
LOG_2PI = 1.8378770664093453
FOREVER = 1e12
"""Time since a measurement that was never made, s: its memory is zero, and so are its derivatives."""


class ChannelData(NamedTuple):
    """Measurements of one channel in a trial of n samples, of whose gaps between measurements k are distinct.

    Attributes:
        measured: what the sensor showed, 0 where missing, shape (n,).
        present: 1 where measured, 0 where missing, shape (n,).
        gaps: distinct times since the measurement before, s, `FOREVER` for the first, shape (k,).
        counts: how many measurements follow each gap, shape (k,).
        kind: which of the gaps precedes each sample, 0 where missing, shape (n,).
    """

    measured: Float[Array, " n"]
    present: Float[Array, " n"]
    gaps: Float[Array, " k"]
    counts: Float[Array, " k"]
    kind: Int[Array, " n"]


class TrialData(NamedTuple):
    """Arrays of one trial of n samples.

    Attributes:
        control: one array of shape (n,) for each control.
        channels: measurements of each channel.
        step: time to the next sample, s, shape (n,).
        initial: states at the first sample where they are not estimated.
    """

    control: tuple[Float[Array, " n"], ...]
    channels: tuple[ChannelData, ...]
    step: Float[Array, " n"]
    initial: tuple[Float[Array, ""], ...]


@dataclass(frozen=True)
class OutputError:
    """What is simulated and how its residuals are modelled; hashable, so that compiled code is shared.

    Attributes:
        model: vehicle.
        channels: measured channels that enter the likelihood.
        colour: colour of the residuals.
        delay: whether a delay between command and action is a parameter (`delay`, s); needs a uniform time step.
        complete: for each trial and channel, whether every sample is present.
        labels: trial labels; a trial whose initial state is estimated has parameters `u_0[label]`.
        free_initial: whether initial states are estimated.
    """

    model: VehicleModel
    channels: tuple[str, ...]
    colour: NoiseColour
    delay: bool
    complete: tuple[tuple[bool, ...], ...]
    labels: tuple[str, ...]
    free_initial: bool

    def __call__(self, values: dict[str, Any], data: tuple[TrialData, ...]) -> Any:
        """Log-likelihood of all trials; -inf where the simulation diverges."""
        total = sum((self._trial(values, trial, index) for index, trial in enumerate(data)), jnp.zeros(()))
        return jnp.where(jnp.isfinite(total), total, -jnp.inf)

    def _trial(self, values: dict[str, Any], trial: TrialData, index: int) -> Any:
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
                    noises, sums, self.channels, channels, self.complete[index], strict=True
                )
            )
            return (rk4_step(lambda x: self.model.derivative(params, x, held), state, step), sums), None

        start = tuple(jnp.asarray(x, float) for x in self._start(values, trial, index))
        sampled = tuple((channel.measured, channel.present, channel.kind) for channel in trial.channels)
        empty = tuple(noise.empty() for noise in noises)
        (_, sums), _ = jax.lax.scan(advance, (start, empty), (self._control(values, trial), sampled, trial.step))
        return sum((noise.log_likelihood(total) for noise, total in zip(noises, sums, strict=True)), jnp.zeros(()))

    def _start(self, values: dict[str, Any], trial: TrialData, index: int) -> tuple:
        """Initial state of a trial."""
        if not self.free_initial:
            return trial.initial
        return tuple(values[initial_name(state, self.labels[index])] for state in self.model.states)

    def _control(self, values: dict[str, Any], trial: TrialData) -> tuple:
        """Controls as they act."""
        if not self.delay:
            return trial.control
        return tuple(delay_control(column, values["delay"] / trial.step[0]) for column in trial.control)

    def _noise(self, values: dict[str, Any], name: str, channel: ChannelData) -> Any:
        """Model of one channel's residuals under these parameters."""
        sd = values[noise_name(name)]
        if self.colour == "white":
            return _White(sd, channel.counts)
        memory = jnp.exp(-channel.gaps / values[correlation_name(name)])
        return _Coloured(sd, channel.counts, memory, 1.0 / (1.0 - memory * memory))


class _White(NamedTuple):
    """Independent residuals of standard deviation `sd`; carries their sum of squares."""

    sd: Any
    counts: Float[Array, " k"]

    def empty(self) -> Any:
        return jnp.zeros(())

    def absorb(self, total: Any, e: Any, present: Any, kind: Any, complete: bool) -> Any:
        return total + (e * e if complete else present * (e * e))

    def log_likelihood(self, total: Any) -> Any:
        return -jnp.sum(self.counts) * (jnp.log(self.sd) + 0.5 * LOG_2PI) - 0.5 * total / (self.sd * self.sd)


class _Coloured(NamedTuple):
    """Ornstein-Uhlenbeck residuals; carries the last one measured and the sum of squared innovations over their variances.

    Attributes:
        sd: standard deviation of the process.
        counts: number of measurements after each distinct gap.
        memory: correlation across each distinct gap.
        weight: process variance over innovation variance for each distinct gap.
    """

    sd: Any
    counts: Float[Array, " k"]
    memory: Float[Array, " k"]
    weight: Float[Array, " k"]

    def empty(self) -> Any:
        return (jnp.zeros(()), jnp.zeros(()))

    def absorb(self, carry: Any, e: Any, present: Any, kind: Any, complete: bool) -> Any:
        before, total = carry
        innovation = e - self.memory[kind] * before
        gain = self.weight[kind] * (innovation * innovation)
        if complete:
            return e, total + gain
        return before + present * (e - before), total + present * gain

    def log_likelihood(self, carry: Any) -> Any:
        spread = jnp.log(self.sd) + 0.5 * LOG_2PI - 0.5 * jnp.log(self.weight)
        return -jnp.sum(self.counts * spread) - 0.5 * carry[1] / (self.sd * self.sd)


def noise_name(channel: str) -> str:
    """Parameter name of a channel's noise standard deviation."""
    return f"sigma_{channel}"


def correlation_name(channel: str) -> str:
    """Parameter name of the correlation time of a channel's residuals, s."""
    return f"tau_{channel}"


def initial_name(state: str, label: str) -> str:
    """Parameter name of a trial's initial state."""
    return f"{state}_0[{label}]"


def trial_data(record: Record, model: VehicleModel, channels: Sequence[str], initial: Sequence[float]) -> TrialData:
    """Arrays of a record for the likelihood.

    Raises:
        InputError: a control or channel the record does not have.
    """
    return TrialData(
        control=tuple(jnp.asarray(record.channel(name)) for name in model.controls),
        channels=tuple(channel_data(record.time, np.asarray(record.channel(name))) for name in channels),
        step=jnp.asarray(record.step),
        initial=tuple(jnp.asarray(x, float) for x in initial),
    )


def channel_data(time: Float[np.ndarray, " n"], column: Float[np.ndarray, " n"]) -> ChannelData:
    """Arrays of one channel, NaN where it was not measured; gaps equal to the nanosecond are one, their mean."""
    present = np.isfinite(column)
    between = np.concatenate([[FOREVER], np.diff(time[present])])[: present.sum()]
    _, which, counts = np.unique(np.round(between, 9), return_inverse=True, return_counts=True)
    kind = np.zeros(column.size, int)
    kind[present] = which
    return ChannelData(
        jnp.asarray(np.where(present, column, 0.0)),
        jnp.asarray(present, float),
        jnp.asarray(np.bincount(which, between) / counts),
        jnp.asarray(counts, float),
        jnp.asarray(kind),
    )


def output_error(
    model: VehicleModel,
    records: Sequence[Record],
    channels: Sequence[str],
    initial: Sequence[Sequence[float]],
    *,
    colour: NoiseColour = "white",
    delay: bool = False,
    free_initial: bool = False,
) -> tuple[OutputError, tuple[TrialData, ...]]:
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
    data = tuple(trial_data(record, model, channels, start) for record, start in zip(records, initial, strict=True))
    for record in records if delay else ():
        step = np.diff(record.time)
        if np.ptp(step) > 1e-6 * step[0]:
            raise InputError(
                f'record "{record.label}"',
                found=f"time steps from {step.min():g} to {step.max():g} s",
                expected="a uniform step, since the delay is a parameter",
                remedy="import the record with a fixed `step`, or estimate without `delay`",
            )
    complete = tuple(tuple(bool(np.isfinite(record.channel(name)).all()) for name in channels) for record in records)
    return OutputError(model, tuple(channels), colour, delay, complete, labels, free_initial), data
