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
from seatrial.estimation.simulation import delay_control, simulate_outputs
from seatrial.numerics.integrate import rk4_step
from seatrial.vehicles.model import VehicleModel

NoiseColour = Literal["white", "coloured"]
LOG_2PI = 1.8378770664093453
FOREVER = 1e12
"""Time since a measurement that was never made, s: its memory is zero, and so are its derivatives."""


class TrialData(NamedTuple):
    """Arrays of one trial; n samples, m of them measured in a channel.

    Attributes:
        control: one array of shape (n,) for each control.
        measured: one array of shape (n,) for each channel, 0 where missing.
        present: 1 where measured, 0 where missing, like `measured`.
        samples: indices of the measured samples of each channel, shape (m,).
        gaps: time since the measured sample before, s, `FOREVER` for the first, like `samples`.
        step: time to the next sample, s, shape (n,).
        initial: states at the first sample where they are not estimated.
    """

    control: tuple[Float[Array, " n"], ...]
    measured: tuple[Float[Array, " n"], ...]
    present: tuple[Float[Array, " n"], ...]
    samples: tuple[Int[Array, " m"], ...]
    gaps: tuple[Float[Array, " m"], ...]
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
        one = self._white if self.colour == "white" else self._coloured
        total = sum((one(values, trial, index) for index, trial in enumerate(data)), jnp.zeros(()))
        return jnp.where(jnp.isfinite(total), total, -jnp.inf)

    def _start(self, values: dict[str, Any], trial: TrialData, index: int) -> tuple:
        """Initial state of a trial."""
        if not self.free_initial:
            return trial.initial
        return tuple(values[initial_name(state, self.labels[index])] for state in self.model.states)

    def _white(self, values: dict[str, Any], trial: TrialData, index: int) -> Any:
        """Sums of squares in one time loop that keeps nothing else."""
        params = {name.text: values[name.text] for name in self.model.coefficients}
        control = (
            tuple(delay_control(column, values["delay"] / trial.step[0]) for column in trial.control)
            if self.delay
            else trial.control
        )

        def advance(carry: tuple, sample: tuple) -> tuple[tuple, None]:
            state, squares = carry
            held, measured, present, step = sample
            residuals = [
                y - self.model.output(name, params, state, held)
                for name, y in zip(self.channels, measured, strict=True)
            ]
            squares = tuple(
                total + (e * e if complete else weight * (e * e))
                for total, e, weight, complete in zip(squares, residuals, present, self.complete[index], strict=True)
            )
            return (rk4_step(lambda x: self.model.derivative(params, x, held), state, step), squares), None

        start = tuple(jnp.asarray(x, float) for x in self._start(values, trial, index))
        zeros = (jnp.zeros(()),) * len(self.channels)
        (_, squares), _ = jax.lax.scan(advance, (start, zeros), (control, trial.measured, trial.present, trial.step))
        total = jnp.zeros(())
        for channel, square, samples in zip(self.channels, squares, trial.samples, strict=True):
            sd = values[noise_name(channel)]
            total = total - samples.size * (jnp.log(sd) + 0.5 * LOG_2PI) - 0.5 * square / (sd * sd)
        return total

    def _coloured(self, values: dict[str, Any], trial: TrialData, index: int) -> Any:
        """Innovations of the residual process at the measured samples of each channel."""
        start = jnp.stack([jnp.asarray(x, float) for x in self._start(values, trial, index)])
        outputs = simulate_outputs(
            self.model, self.channels, self.delay, values, start, jnp.stack(trial.control, -1), trial.step
        )
        total = jnp.zeros(())
        for c, channel in enumerate(self.channels):
            samples, sd = trial.samples[c], values[noise_name(channel)]
            residual = trial.measured[c][samples] - outputs[samples, c]
            memory = jnp.exp(-trial.gaps[c] / values[correlation_name(channel)])
            before = jnp.concatenate([jnp.zeros(1), residual[:-1]])
            variance = sd * sd * (1.0 - memory * memory)
            total = total - 0.5 * jnp.sum((residual - memory * before) ** 2 / variance + jnp.log(variance) + LOG_2PI)
        return total


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
    samples = [np.flatnonzero(p) for p in present]
    return TrialData(
        control=tuple(jnp.asarray(record.channel(name)) for name in model.controls),
        measured=tuple(jnp.asarray(np.where(p, column, 0.0)) for p, column in zip(present, columns, strict=True)),
        present=tuple(jnp.asarray(p, float) for p in present),
        samples=tuple(jnp.asarray(index) for index in samples),
        gaps=tuple(jnp.asarray(np.concatenate([[FOREVER], np.diff(record.time[index])])) for index in samples),
        step=jnp.asarray(record.step),
        initial=tuple(jnp.asarray(x, float) for x in initial),
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
