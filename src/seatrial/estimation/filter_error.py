"""Filter-error likelihood: what moves the vehicle and is not in the model is process noise, integrated out by a filter.

    log p(y) = sum_k log N(y_k; h(x_k|k-1), S_k),  du = f(u) dt + q dw

The marginal likelihood of the innovations (Schweppe, IEEE Trans. Automatic Control 11, 1965). Where process noise is real,
output error is too sure of itself; where there is none, the two agree.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from seatrial.core.errors import InputError
from seatrial.core.gaussian import Gaussian
from seatrial.core.record import Record
from seatrial.core.state_space import StateSpace
from seatrial.estimation.output_error import OutputError, output_error
from seatrial.estimation.sensors import Sensor, noise_name
from seatrial.estimation.trial_data import TrialData
from seatrial.filters.belief import Filter
from seatrial.filters.extended import ExtendedKalmanFilter
from seatrial.filters.run import filter_within
from seatrial.numerics.integrate import rk4_step
from seatrial.vehicles.model import VehicleModel

EKF = ExtendedKalmanFilter()
"""Exact for the mean and covariance of a linear step, and cheapest."""


@dataclass(frozen=True)
class FilterError:
    """A filter over each trial; hashable, so that compiled code is shared.

    Process noise is a parameter of each state, `process_u`: the standard deviation that it gains in one second.

    Attributes:
        output: the deterministic part: vehicle, sensors of white noise, and what differs between trials.
        initial_sd: standard deviation of each state at the first sample, before its measurement.
        method: filter.
    """

    output: OutputError
    initial_sd: tuple[float, ...]
    method: Filter = EKF

    @property
    def model(self) -> VehicleModel:
        """Vehicle."""
        return self.output.model

    @property
    def channels(self) -> tuple[str, ...]:
        """Measured channels."""
        return self.output.channels

    @property
    def labels(self) -> tuple[str, ...]:
        """Trial labels."""
        return self.output.labels

    def __call__(self, values: dict[str, Any], data: TrialData) -> Any:
        """Return the log-likelihood of all trials; -inf where the filter diverges."""

        def add(total: Array, trial: tuple) -> tuple[Array, None]:
            return total + self._trial({**values, **trial[0]}, *trial[1:]), None

        trials = (self.output.apart(values), data, self.output.starts(values, data))
        total, _ = jax.lax.scan(add, jnp.zeros(()), trials)
        return jnp.where(jnp.isfinite(total), total, -jnp.inf)

    def _trial(self, values: dict[str, Any], trial: TrialData, start: Array) -> Any:
        control = self.output.simulator.late(values, trial.control, trial.step)
        measured = jnp.stack([jnp.where(c.present > 0, c.measured, jnp.nan) for c in trial.channels], -1)
        # A sample of padding measures nothing, takes no time, and so adds nothing.
        result = filter_within(
            self.method, self._space(values, start), jnp.stack(control, -1), measured, trial.step, jnp.sqrt(trial.step)
        )
        return jnp.where(result.failures > 0, -jnp.inf, result.log_likelihood)

    def _space(self, values: Mapping[str, Any], start: Array) -> StateSpace:
        """Return the vehicle as a state space under these parameters; only its states are estimated by the filter."""
        model, simulator = self.model, self.output.simulator
        none = (None,) * len(simulator.sensors)

        def transition(state: tuple, control: tuple, step: Any) -> tuple:
            return rk4_step(lambda x: model.derivative(values, x, control), state, step)

        def observe(state: tuple, control: tuple) -> tuple:
            return tuple(y for y, _ in simulator.show(values, state, control, none, none))

        return StateSpace(
            Gaussian(start, jnp.diag(jnp.asarray(self.initial_sd))),
            jnp.stack([jnp.asarray(values[process_name(state)], float) for state in model.states]),
            jnp.stack([jnp.asarray(values[noise_name(sensor.channel)], float) for sensor in simulator.sensors]),
            model.states,
            self.channels,
            len(model.states),
            transition,
            observe,
        )


def process_name(state: str) -> str:
    """Return the parameter name of a state's process noise: the standard deviation it gains in one second."""
    return f"process_{state}"


def filter_error(
    model: VehicleModel,
    records: Sequence[Record],
    sensors: Sequence[Sensor | str],
    initial: Sequence[Sequence[float]],
    initial_sd: Sequence[float],
    *,
    method: Filter = EKF,
    delay: bool = False,
    current: bool = False,
    own: Sequence[str] = (),
    varying: Sequence[str] = (),
    starts_over_ground: bool = False,
) -> tuple[FilterError, TrialData]:
    """Return the likelihood of several trials fitted jointly, and its data; arguments as `output_error` but for these.

    Args:
        model: vehicle.
        records: trials.
        sensors: measured channels, with white noise and no lag: what is slow belongs to the process.
        initial: mean of the state at the first sample of each trial.
        initial_sd: its standard deviation, positive.
        method: filter.
        delay: see `output_error`.
        current: see `output_error`.
        own: see `output_error`.
        varying: see `output_error`.
        starts_over_ground: see `output_error`.

    Raises:
        InputError: as `output_error`; a sensor with a lag or with other than white noise; an initial spread that is not positive.
    """
    options = {"delay": delay, "current": current, "own": own, "varying": varying}
    output, data = output_error(model, records, sensors, initial, **options, starts_over_ground=starts_over_ground)
    for sensor in output.simulator.sensors:
        if sensor.lag or sensor.noise != "white":
            raise InputError(
                f"filter error, sensor {sensor.channel}",
                found="a lag" if sensor.lag else f"{sensor.noise} noise",
                expected="white noise and no lag",
                remedy="use the output-error likelihood for these, or leave them out: process noise takes up what is slow",
            )
    if not all(np.isfinite(initial_sd)) or min(initial_sd) <= 0:
        raise InputError(
            "filter error, initial spread",
            found=f"{list(initial_sd)}",
            expected="positive numbers, one for each state",
            remedy="give the noise of the sensor that shows the state",
        )
    return FilterError(output, tuple(map(float, initial_sd)), method), data
