"""Filter-error likelihood: what moves the vehicle and is not in the model is process noise, integrated out by a filter.

    log p(y) = sum_k log N(y_k; h(x_k|k-1), S_k),  du = f(u, d) dt + q dw

Noise q of a state, and disturbances d, forces with a memory (`simulation/disturbance.py`), which are states of the filter too. The
marginal likelihood of the innovations (Schweppe, IEEE Trans. Automatic Control 11, 1965). Where what it adds is real, output error is too
sure of itself; if there is none of it, the two agree.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.core.errors import InputError
from seatrial.core.record import Record
from seatrial.estimation.posterior.output_error import OutputError, output_error
from seatrial.estimation.simulation.disturbance import OverStep, disturbance_name, disturbance_time_name, over_step
from seatrial.estimation.simulation.sensor_errors import Sensor, noise_name
from seatrial.estimation.simulation.trial_data import TrialData
from seatrial.filters.belief import Filter
from seatrial.filters.extended import MAX_UNROLLED_STATES, extended_filter
from seatrial.filters.run import filter_within
from seatrial.numerics.gaussian import Gaussian
from seatrial.numerics.integrate import rk4_step
from seatrial.numerics.state_space import StateSpace
from seatrial.vehicles.model import VehicleModel, outside_force
from seatrial.vehicles.simulate import move_by


@dataclass(frozen=True)
class FilterError:
    """A filter over each trial; hashable, so that compiled code is shared.

    Process noise is a parameter of a state, `process_u`: the standard deviation that it gains in one second; a state without one has none.

    Attributes:
        output: the deterministic part: vehicle, sensors of white noise, and what differs between trials.
        initial_sd: standard deviation of each state at the first sample, before its measurement.
        method: filter.
        disturbed: axes on which there is a disturbance.
    """

    output: OutputError
    initial_sd: tuple[float, ...]
    method: Filter
    disturbed: tuple[str, ...] = ()

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

    @property
    def varying(self) -> tuple[str, ...]:
        """Names that vary between trials."""
        return self.output.varying

    def __call__(self, values: dict[str, Any], data: TrialData) -> Any:
        """Return the log-likelihood of all trials; -inf where the filter diverges."""

        def add(total: Array, trial: tuple) -> tuple[Array, None]:
            return total + self._trial({**values, **trial[0]}, *trial[1:]), None

        trials = (self.output.apart(values), data, self.output.starts(values, data))
        total, _ = jax.lax.scan(add, jnp.zeros(()), trials)
        return jnp.where(jnp.isfinite(total), total, -jnp.inf)

    def labelled(self, labels: tuple[str, ...], configurations: tuple[str, ...] | None = None) -> "FilterError":
        """Return the likelihood of trials of other labels; see `OutputError.labelled`."""
        return replace(self, output=self.output.labelled(labels, configurations))

    def _trial(self, values: dict[str, Any], trial: TrialData, start: Array) -> Any:
        control = jnp.stack(self.output.simulator.delayed(values, trial.control, trial.step), -1)
        measured = jnp.stack([jnp.where(c.present > 0, c.measured, jnp.nan) for c in trial.channels], -1)
        # A sample of padding measures nothing, takes no time, and so adds nothing.
        result = filter_within(
            self.method, self.space(values, start), control, measured, trial.step, jnp.sqrt(trial.step)
        )
        return jnp.where(result.failures > 0, -jnp.inf, result.log_likelihood)

    def space(self, values: Mapping[str, Any], start: Float[Array, " n_states"]) -> StateSpace:
        """Return the vehicle as a state space under these parameters: its states, then the disturbances, are estimated by the filter.

        Process noise is that of one second, in which it grows as the root of time.

        Args:
            values: parameters by name, SI, those of one trial without its label.
            start: mean of the vehicle's state at the first sample, SI.
        """
        model, simulator, n = self.model, self.output.simulator, len(self.model.states)
        none = ((None, None),) * len(simulator.sensors)
        spreads = [jnp.asarray(values[disturbance_name(axis)], float) for axis in self.disturbed]
        times = [values[disturbance_time_name(axis)] for axis in self.disturbed]

        def under(forces: Sequence[Any]) -> dict[str, Any]:
            return {**values, **dict(zip(map(outside_force, self.disturbed), forces, strict=True))}

        def move(state: tuple, control: tuple, step: Any, forces: Sequence[Any]) -> tuple:
            params = under(forces)
            # Of many states the filter carries so many derivatives that one copy of the model is compiled in a tenth of the time.
            return move_by(model, params, partial(rk4_step, large=MAX_UNROLLED_STATES + 1))(state[:n], control, step)

        def over(step: Any) -> list[OverStep]:
            return [over_step(sd, time, step) for sd, time in zip(spreads, times, strict=True)]

        def transition(state: tuple, control: tuple, step: Any) -> tuple:
            parts = list(zip(state[n:], over(step), strict=True))
            moved = move(state, control, step, [part.mean * d for d, part in parts])
            return (*moved, *(part.memory * d for d, part in parts))

        def observe(state: tuple, control: tuple) -> tuple:
            return tuple(y for y, _ in simulator.show(under(state[n:]), state[:n], control, none, none))

        def shocks(state: tuple, control: tuple, step: Any) -> tuple[tuple, ...]:
            parts, columns = over(step), []
            mean = tuple(part.mean * d for d, part in zip(state[n:], parts, strict=True))
            for i, part in enumerate(parts):
                along = tuple(jnp.ones(()) if i == j else jnp.zeros(()) for j in range(len(parts)))
                _, by_force = jax.jvp(lambda *forces: move(state, control, step, forces), mean, along)
                behind = tuple(part.gained if i == j else 0.0 for j in range(len(parts)))
                columns.append((*(x * part.with_gained * part.gained for x in by_force), *behind))
                columns.append((*(x * part.apart for x in by_force), *(0.0 for _ in parts)))
            return tuple(columns)

        process = [jnp.asarray(values.get(process_name(state), 0.0), float) for state in model.states]
        return StateSpace(
            Gaussian(
                jnp.concatenate([start, jnp.zeros(len(spreads))]),
                jnp.diag(jnp.stack([*map(jnp.asarray, self.initial_sd), *spreads])),
            ),
            jnp.stack([*process, *(jnp.zeros(()) for _ in spreads)]),
            jnp.stack([jnp.asarray(values[noise_name(sensor.channel)], float) for sensor in simulator.sensors]),
            (*model.states, *map(disturbance_name, self.disturbed)),
            self.channels,
            n + len(spreads),
            transition,
            observe,
            shocks if spreads else None,
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
    method: Filter | None = None,
    disturbed: Sequence[str] = (),
    delay: bool = False,
    current: bool = False,
    own: Sequence[str] = (),
    varying: Sequence[str] = (),
    starts_over_ground: bool = False,
    by_configuration: Sequence[str] = (),
) -> tuple[FilterError, TrialData]:
    """Return the likelihood of several trials fitted jointly, and its data; arguments as `output_error` but for these.

    Args:
        model: vehicle.
        records: trials.
        sensors: measured channels, with white noise and no lag: what is slow belongs to the process.
        initial: mean of the state at the first sample of each trial.
        initial_sd: its standard deviation, positive.
        method: filter; None for the extended Kalman filter, exact for a linear step and cheapest.
        disturbed: axes on which there is a disturbance.
        delay: see `output_error`.
        current: see `output_error`.
        own: see `output_error`.
        varying: see `output_error`.
        starts_over_ground: see `output_error`.
        by_configuration: see `output_error`.

    Raises:
        InputError: as `output_error`; a sensor with a lag or with other than white noise; an initial spread that is not positive; a
            disturbance on an axis that does not move.
    """
    options = {"delay": delay, "current": current, "own": own, "varying": varying, "by_configuration": by_configuration}
    output, data = output_error(model, records, sensors, initial, **options, starts_over_ground=starts_over_ground)
    for sensor in output.simulator.sensors:
        if sensor.lag or sensor.is_late or sensor.noise != "white":
            raise InputError(
                f"filter error, sensor {sensor.channel}",
                found="a lag" if sensor.lag else "a late clock" if sensor.is_late else f"{sensor.noise} noise",
                expected="white noise, no lag and a correct clock",
                remedy="use the output-error likelihood for these, or leave them out: process noise describes slow errors",
            )
    if not all(np.isfinite(initial_sd)) or min(initial_sd) <= 0:
        raise InputError(
            "filter error, initial spread",
            found=f"{list(initial_sd)}",
            expected="positive numbers, one for each state",
            remedy="give the noise of the sensor of the state",
        )
    if still := [axis for axis in disturbed if axis not in model.disturbance_axes]:
        raise InputError(
            "filter error, disturbances",
            found=f"one on the axis {still[0]}",
            expected="axes that move: "
            + (", ".join(model.disturbance_axes) or "none of this vehicle takes a force from outside"),
            remedy="leave it out, or let the vehicle move along it",
        )
    chosen = extended_filter(len(model.states) + len(disturbed)) if method is None else method
    return FilterError(output, tuple(map(float, initial_sd)), chosen, tuple(disturbed)), data
