"""Output-error likelihood: the model is simulated without process noise and what the sensors show beside it is noise.

White residuals: y_k = h(x_k) + s e_k, summed inside the time loop. Heavy-tailed: e_k of Student's t. Proportional: a part of s is a
share of the signal that is shown, s_k^2 = s^2 + (share h(x_k))^2. Coloured: an Ornstein-Uhlenbeck process of standard deviation s and
correlation time tau, e_k given e_j before it being normal with mean rho e_j and variance s^2 (1 - rho^2), rho = exp(-(t_k - t_j) / tau),
which is exact across gaps (Gillespie, Phys. Rev. E 54, 1996).
Drifting: white residuals and such a process added, as a current, a bias or waves lie under the noise of the sensor.

Trials fitted jointly share every parameter but those that are each trial's own (`bias_u[label]`), and those that vary about
a common value: `X_u` is then X_u + spread_X_u dev_X_u[label], a hierarchical model in which dev has the standard normal prior.
A value of each configuration of the vehicle, such as with and without payload, is a parameter for each: `net_weight@loaded`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import gcd
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.core.coefficients import configuration_name
from seatrial.core.errors import InputError
from seatrial.core.record import Record
from seatrial.core.signals import QUATERNION
from seatrial.estimation.simulation.noise_models import (
    INDEPENDENT,
    Coloured,
    Drifting,
    Heavy,
    NoiseModel,
    Proportional,
    White,
)
from seatrial.estimation.simulation.sensor_errors import (
    Sensor,
    correlation_name,
    dof_name,
    drift_name,
    drift_time_name,
    noise_name,
    share_name,
)
from seatrial.estimation.simulation.simulator import CURRENT, Simulator, Watch, samples_remembered
from seatrial.estimation.simulation.trial_data import ChannelData, TrialData, stack_trials
from seatrial.vehicles.model import VehicleModel

# What each of four parts of a unit quaternion counts: its error has three directions, those along the sphere.
QUATERNION_SHARE = 0.75
ANY_TRIAL = "any"  # Label that stands for every trial's, so that trials of one length share compiled code
BLOCK = 256  # Samples of a block at most: few enough for the cache


@dataclass(frozen=True)
class OutputError:
    """What is simulated and how its residuals are modelled; hashable, so that compiled code is shared.

    Attributes:
        simulator: vehicle and sensors.
        labels: trial labels, which are compared where parameters are named after them.
        free_initial: whether initial states are estimated, as parameters `u_0[label]`; those without a parameter are as in the data.
        own: names of which every trial has its own, as parameters `name[label]`.
        varying: names that vary between trials, by parameters `spread_name` and `dev_name[label]`.
        starts_over_ground: whether initial speeds are over ground, so that the current is taken off them.
        by_configuration: names of which every configuration has its own, as parameters `name@configuration`.
        configurations: that of each trial; empty if nothing differs between them.
    """

    simulator: Simulator
    labels: tuple[str, ...] = field(compare=False)
    free_initial: bool = False
    own: tuple[str, ...] = ()
    varying: tuple[str, ...] = ()
    starts_over_ground: bool = False
    by_configuration: tuple[str, ...] = ()
    configurations: tuple[str, ...] = ()
    _named_after: tuple[str, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Keep the labels that decide what is compiled: elsewhere only their number does."""
        named = self.free_initial or self.own or self.varying
        object.__setattr__(self, "_named_after", self.labels if named else ("",) * len(self.labels))

    @property
    def model(self) -> VehicleModel:
        """Vehicle."""
        return self.simulator.model

    @property
    def output(self) -> "OutputError":
        """Return the deterministic part, which of this likelihood is all; see `FilterError.output`."""
        return self

    @property
    def channels(self) -> tuple[str, ...]:
        """Measured channels."""
        return tuple(sensor.channel for sensor in self.simulator.sensors)

    @property
    def noise_parameters(self) -> frozenset[str]:
        """Names of the parameters of the sensors' noise, which do not change what they show."""
        return frozenset(name for sensor in self.simulator.sensors for name in sensor.noise_parameters)

    @property
    def independent(self) -> bool:
        """Whether measurements are independent given the parameters."""
        return all(sensor.noise in ("white", "heavy", "proportional") for sensor in self.simulator.sensors)

    def __call__(self, values: dict[str, Any], data: TrialData) -> Any:
        """Return the log-likelihood of all trials; -inf where the simulation diverges."""

        def add(total: Array, trial: tuple) -> tuple[Array, None]:
            return total + self._trial({**values, **trial[0]}, *trial[1:]), None

        trials = (self.apart(values), data, self.starts(values, data))
        if len(self.labels) == 1:
            total, _ = add(jnp.zeros(()), jax.tree.map(lambda x: x[0], trials))
        else:
            total, _ = jax.lax.scan(add, jnp.zeros(()), trials)
        return jnp.where(jnp.isfinite(total), total, -jnp.inf)

    def labelled(self, labels: tuple[str, ...], configurations: tuple[str, ...] | None = None) -> "OutputError":
        """Return the likelihood of trials of other labels; the configuration of each remains if no others are given."""
        return replace(
            self, labels=labels, configurations=self.configurations if configurations is None else configurations
        )

    def apart(self, values: Mapping[str, Any]) -> dict[str, Float[Array, " trials"]]:
        """Return the values that differ between trials, by name."""
        own = {name: jnp.stack([values[own_name(name, label)] for label in self.labels]) for name in self.own}
        for name in self.by_configuration:
            own[name] = jnp.stack([values[configuration_name(name, one)] for one in self.configurations])
        return own | {
            name: values.get(name, 0.0)
            + values[spread_name(name)] * jnp.stack([values[deviation_name(name, label)] for label in self.labels])
            for name in self.varying
        }

    def starts(self, values: Mapping[str, Any], data: TrialData) -> Float[Array, "trials n_states"]:
        """Initial states, their `u` through the water."""
        starts = data.initial
        if self.free_initial:
            rows = [
                [values.get(initial_name(state, label), starts[i, j]) for j, state in enumerate(self.model.states)]
                for i, label in enumerate(self.labels)
            ]
            starts = jnp.asarray(rows, float)
            if set(QUATERNION) <= set(self.model.states):
                at = jnp.array([self.model.states.index(part) for part in QUATERNION])
                starts = starts.at[:, at].set(starts[:, at] / jnp.linalg.norm(starts[:, at], axis=1, keepdims=True))
        if not (self.simulator.current and self.starts_over_ground):
            return starts
        apart = self.apart(values)
        current = apart[CURRENT] if CURRENT in apart else values[CURRENT]
        return starts.at[:, self.model.states.index("u")].add(-current)

    def noise(self, values: Mapping[str, Any], sensor: Sensor, data: ChannelData) -> NoiseModel:
        """Model of one channel's residuals under these parameters."""
        sd = values[noise_name(sensor.channel)]
        counts = QUATERNION_SHARE * data.counts if sensor.channel in QUATERNION else data.counts
        match sensor.noise:
            case "white":
                return White(sd, counts)
            case "heavy":
                return Heavy(sd, values[dof_name(sensor.channel)], counts)
            case "proportional":
                return Proportional(sd, values[share_name(sensor.channel)], counts)
            case "coloured":
                memory = jnp.exp(-data.gaps / values[correlation_name(sensor.channel)])
                return Coloured(sd, counts, memory, 1.0 / (1.0 - memory * memory))
            case "drifting":
                # Of two distinct gaps one is that before the first sample.
                gaps = data.gaps[0] if data.gaps.size <= 2 else data.gaps
                rate = -gaps / values[drift_time_name(sensor.channel)]
                ratio = (values[drift_name(sensor.channel)] / sd) ** 2
                return Drifting(sd, ratio, jnp.sum(data.counts), rate, jnp.exp(rate))

    def of_shown(
        self, values: Mapping[str, Any], trial: TrialData, shown: Float[Array, "channels n"]
    ) -> Float[Array, ""]:
        """Return the log-likelihood of one trial if each sensor, but for its noise, had shown this.

        Residuals that are independent need no loop, and one copy of the code for all channels. The derivatives of others need the memory
        of a block of samples: of each block only the sums before it are kept.

        Args:
            values: parameters by name, SI, of which those of noise are used.
            trial: of n samples.
            shown: by each sensor, SI.
        """
        noises = self._noises(values, trial)
        channels = list(zip(noises, shown, _measured(trial), strict=True))
        total = jnp.zeros(())

        def of_channel(noise: White | Heavy | Proportional, x: Array, measured: tuple) -> Array:
            y, present, kind = measured
            return noise.log_likelihood(jnp.sum(noise.absorb(noise.empty(), y - x, x, present, kind)))

        for model in INDEPENDENT:
            alike = [
                (one._replace(counts=one.counts.sum()), *rest) for one, *rest in channels if isinstance(one, model)
            ]
            if alike:
                total += jax.vmap(of_channel)(*jax.tree.map(lambda *parts: jnp.stack(parts), *alike)).sum()
        remembering = [one for one in channels if not isinstance(one[0], INDEPENDENT)]
        if not remembering:
            return total
        noises, *samples = zip(*remembering, strict=True)
        absorb, begin, end = _sums(noises)

        @jax.checkpoint
        def absorb_block(sums: tuple, block: tuple) -> tuple[tuple, None]:
            return jax.lax.scan(lambda sums, sample: absorb(sums, *sample), sums, block)

        length = gcd(trial.step.size, BLOCK)
        blocks = jax.tree.map(lambda x: x.reshape(-1, length), tuple(samples))
        return total + end(jax.lax.scan(absorb_block, begin, blocks)[0])

    def _trial(self, values: dict[str, Any], trial: TrialData, start: Array) -> Any:
        """Return one time loop that simulates and sums what is new in each residual, and keeps nothing else."""
        absorb, begin, end = _sums(self._noises(values, trial))
        followed = self.simulator.simulate(values, start, trial.control, trial.step, absorb, begin, _measured(trial))
        return end(followed.memory)

    def _noises(self, values: Mapping[str, Any], trial: TrialData) -> list[NoiseModel]:
        return [
            self.noise(values, sensor, data)
            for sensor, data in zip(self.simulator.sensors, trial.channels, strict=True)
        ]


def _sums(noises: Sequence[NoiseModel]) -> tuple[Watch, tuple, Callable[[tuple], Any]]:
    """Return what adds a sample's residuals to the running sums, these before the first sample, and the log-likelihood of the last."""

    def absorb(sums: tuple, shown: tuple, channels: tuple) -> tuple[tuple, None]:
        sums = tuple(
            noise.absorb(total, y - x, x, present, kind)
            for noise, total, x, (y, present, kind) in zip(noises, sums, shown, channels, strict=True)
        )
        return sums, None

    def end(sums: tuple) -> Any:
        return sum((noise.log_likelihood(total) for noise, total in zip(noises, sums, strict=True)), jnp.zeros(()))

    return absorb, tuple(noise.empty() for noise in noises), end


def _measured(trial: TrialData) -> tuple:
    return tuple((channel.measured, channel.present, channel.kind) for channel in trial.channels)


def initial_name(state: str, label: str) -> str:
    """Return the parameter name of a trial's initial state."""
    return f"{state}_0[{label}]"


def own_name(name: str, label: str) -> str:
    """Return the parameter name of what is a trial's own."""
    return f"{name}[{label}]"


def spread_name(name: str) -> str:
    """Return the parameter name of the standard deviation by which a value varies between trials."""
    return f"spread_{name}"


def deviation_name(name: str, label: str) -> str:
    """Return the parameter name of a trial's deviation, in units of that spread."""
    return f"dev_{name}[{label}]"


def is_deviation(name: str) -> bool:
    """Return whether a parameter is a trial's deviation."""
    return name.startswith("dev_")


def of_deviation(name: str) -> tuple[str, str]:
    """Return the name and trial of a deviation."""
    varying, _, label = name.removeprefix("dev_").removesuffix("]").partition("[")
    return varying, label


def output_error(
    model: VehicleModel,
    records: Sequence[Record],
    sensors: Sequence[Sensor | str],
    initial: Sequence[Sequence[float]],
    *,
    delay: bool = False,
    current: bool = False,
    free_initial: bool = False,
    own: Sequence[str] = (),
    varying: Sequence[str] = (),
    starts_over_ground: bool = False,
    by_configuration: Sequence[str] = (),
) -> tuple[OutputError, TrialData]:
    """Return the likelihood of several trials fitted jointly, and its data.

    Args:
        model: vehicle.
        records: trials.
        sensors: measured channels to use; a name alone stands for a sensor with white noise.
        initial: state at the first sample of each trial; ignored where `free_initial`.
        delay: whether the delay between command and action is a parameter.
        current: whether a constant current along the course is a parameter.
        free_initial: estimate each trial's initial state.
        own: names of which every trial has its own.
        varying: names that vary between trials about a common value.
        starts_over_ground: whether initial speeds are over ground.
        by_configuration: names of which every configuration of the records has its own.

    Raises:
        InputError: a missing channel, trials of the same label, a delay with a time step that varies, a current that nothing
            tells from a bias, or a model without surge.
    """
    chosen = tuple(Sensor(sensor) if isinstance(sensor, str) else sensor for sensor in sensors)
    labels = tuple(record.label for record in records)
    if len(set(labels)) < len(labels):
        raise InputError(
            "trials fitted jointly",
            found="labels " + ", ".join(f'"{label}"' for label in labels),
            expected="a different label for each trial",
            remedy="rename the records: the labels identify initial states",
        )
    data = stack_trials(records, model, [sensor.channel for sensor in chosen], initial)
    late = samples_remembered(chosen, min(float(np.diff(record.time).min()) for record in records))
    for record in records if delay or late else ():
        _check_even(record, "the delay is a parameter" if delay else "a sensor is late")
    if current:
        _check_current(model, chosen)
    simulator = Simulator(model, chosen, delay, current, late)
    configurations = tuple(record.configuration for record in records) if by_configuration else ()
    differing = tuple(own), tuple(varying), starts_over_ground, tuple(by_configuration), configurations
    return OutputError(simulator, labels, free_initial, *differing), data


def _check_even(record: Record, because: str) -> None:
    """Refuse a record whose time step varies.

    Raises:
        InputError: it does.
    """
    step = np.diff(record.time)
    if np.ptp(step) > 1e-6 * step[0]:
        raise InputError(
            f'record "{record.label}"',
            found=f"time steps from {step.min():g} to {step.max():g} s",
            expected=f"a uniform step, since {because}",
            remedy="import the record with a fixed `step`, or estimate without it",
        )


def _check_current(model: VehicleModel, sensors: Sequence[Sensor]) -> None:
    shown = [sensor for sensor in sensors if sensor.channel == "u" and sensor.over_ground]
    if "u" not in model.states or not shown:
        raise InputError(
            "parameter current",
            found="no speed over ground among the channels",
            expected="a sensor of u over ground, such as a Doppler log with bottom track",
            remedy="estimate without a current: no measurement shows it",
        )
    if any(sensor.bias for sensor in shown):
        raise InputError(
            "parameter current",
            found="a bias of u over ground as well",
            expected="one of the two: a constant current and a constant error of the speed look alike",
            remedy="leave out the bias, or the current",
        )
