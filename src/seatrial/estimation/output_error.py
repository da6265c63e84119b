"""Output-error likelihood: the model is simulated without process noise and what the sensors show beside it is noise.

White residuals: y_k = h(x_k) + s e_k. Coloured residuals: an Ornstein-Uhlenbeck process of standard deviation s and
correlation time tau, e_k given e_j being normal with mean rho e_j and variance s^2 (1 - rho^2), rho = exp(-(t_k - t_j) / tau),
which is exact across gaps (Gillespie, Phys. Rev. E 54, 1996). A whole record is one time loop on scalars that keeps only sums.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.core.errors import InputError
from seatrial.core.record import Record
from seatrial.estimation.simulation import delay_control
from seatrial.numerics.integrate import rk4_step
from seatrial.vehicles.model import VehicleModel

NoiseColour = Literal["white", "coloured"]
LOG_2PI = 1.8378770664093453


class TrialData(NamedTuple):
    """Arrays of one trial as the time loop wants them; n samples.

    Attributes:
        control: one array of shape (n,) for each control.
        measured: one array of shape (n,) for each channel, 0 where missing.
        present: 1 where measured, 0 where missing, like `measured`.
        step: time to the next sample, s, shape (n,).
        initial: states at the first sample where they are not estimated.
    """

    control: tuple[Float[Array, " n"], ...]
    measured: tuple[Float[Array, " n"], ...]
    present: tuple[Float[Array, " n"], ...]
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
        total = jnp.zeros(())
        for index, trial in enumerate(data):
            total = total + self._trial(values, trial, index)
        return jnp.where(jnp.isfinite(total), total, -jnp.inf)

    def _trial(self, values: dict[str, Any], trial: TrialData, index: int) -> Any:
        params = {name.text: values[name.text] for name in self.model.coefficients}
        initial = tuple(values[initial_name(state, self.labels[index])] if self.free_initial else start
                        for state, start in zip(self.model.states, trial.initial, strict=True))
        noise = [_COLOURS[self.colour](values, channel, complete)
                 for channel, complete in zip(self.channels, self.complete[index], strict=True)]
        control = tuple(delay_control(column, values["delay"] / trial.step[0]) for column in trial.control) if self.delay else trial.control

        def advance(carry: tuple, sample: tuple) -> tuple[tuple, None]:
            state, sums = carry
            held, measured, present, step = sample
            sums = tuple(model.add(total, y - self.model.output(name, params, state, held), weight, step)
                         for model, total, y, weight, name in zip(noise, sums, measured, present, self.channels, strict=True))
            return (rk4_step(lambda x: self.model.derivative(params, x, held), state, step), sums), None

        start = (tuple(jnp.asarray(x, float) for x in initial), tuple(model.start() for model in noise))
        (_, sums), _ = jax.lax.scan(advance, start, (control, trial.measured, trial.present, trial.step))
        return sum((model.log_likelihood(total, jnp.sum(weight)) for model, total, weight
                    in zip(noise, sums, trial.present, strict=True)), jnp.zeros(()))


class _White:
    """Sum of squares of independent residuals."""

    def __init__(self, values: dict[str, Any], channel: str, complete: bool):
        self.sd, self.complete = values[noise_name(channel)], complete

    def start(self) -> Any:
        return jnp.zeros(())

    def add(self, total: Any, residual: Any, weight: Any, step: Any) -> Any:
        return total + (residual * residual if self.complete else weight * (residual * residual))

    def log_likelihood(self, total: Any, count: Any) -> Any:
        return -count * (jnp.log(self.sd) + 0.5 * LOG_2PI) - 0.5 * total / (self.sd * self.sd)


class _Coloured:
    """Innovations of an Ornstein-Uhlenbeck process; the first sample is stationary."""

    def __init__(self, values: dict[str, Any], channel: str, complete: bool):
        self.sd, self.rate = values[noise_name(channel)], 1.0 / values[correlation_name(channel)]

    def start(self) -> Any:
        zero = jnp.zeros(())
        return zero, zero, zero, zero

    def add(self, sums: Any, residual: Any, weight: Any, step: Any) -> Any:
        squares, log_variances, last, memory = sums
        variance = 1.0 - memory * memory
        innovation = residual - memory * last
        squares = squares + weight * innovation * innovation / variance
        log_variances = log_variances + weight * jnp.log(variance)
        fade = jnp.exp(-step * self.rate)
        return squares, log_variances, weight * residual + (1.0 - weight) * last, fade * (weight + (1.0 - weight) * memory)

    def log_likelihood(self, sums: Any, count: Any) -> Any:
        squares, log_variances, _, _ = sums
        return -count * (jnp.log(self.sd) + 0.5 * LOG_2PI) - 0.5 * (log_variances + squares / (self.sd * self.sd))


_COLOURS = {"white": _White, "coloured": _Coloured}


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
    columns = [np.asarray(record.channel(name)) for name in channels]
    present = [np.isfinite(column) for column in columns]
    return TrialData(tuple(jnp.asarray(record.channel(name)) for name in model.controls),
                     tuple(jnp.asarray(np.where(p, column, 0.0)) for p, column in zip(present, columns, strict=True)),
                     tuple(jnp.asarray(p, float) for p in present), jnp.asarray(record.step),
                     tuple(jnp.asarray(x, float) for x in initial))


def output_error(model: VehicleModel, records: Sequence[Record], channels: Sequence[str], initial: Sequence[Sequence[float]], *,
                 colour: NoiseColour = "white", delay: bool = False, free_initial: bool = False) -> tuple[OutputError, tuple[TrialData, ...]]:
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
        InputError: a missing channel, or a delay with a time step that varies.
    """
    data = tuple(trial_data(record, model, channels, start) for record, start in zip(records, initial, strict=True))
    for record in records if delay else ():
        step = np.diff(record.time)
        if np.ptp(step) > 1e-6 * step[0]:
            raise InputError(f'record "{record.label}"', found=f"time steps from {step.min():g} to {step.max():g} s",
                             expected="a uniform step, since the delay is a parameter",
                             remedy="import the record with a fixed `step`, or estimate without `delay`")
    complete = tuple(tuple(bool(np.isfinite(record.channel(name)).all()) for name in channels) for record in records)
    labels = tuple(record.label for record in records)
    return OutputError(model, tuple(channels), colour, delay, complete, labels, free_initial), data
