"""The simulated vehicle of a campaign: what is true of it, and what its sensors show in a trial.

What is simulated is what is fitted: [truth] holds a value of each coefficient, and may hold what an estimate knows beside them, by the same
names (`bias_u`, `lag_u`, `delay`, `current`, `sigma_u`, `tau_u`, `dof_u`), and `lag_n`, the lag of an actuator, in place of what
[vehicle.actuators] states.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.truth import actuator_lag, true_coefficients
from seatrial.core.errors import InputError
from seatrial.core.programs import program
from seatrial.core.signals import ACTUAL
from seatrial.estimation.delayed_control import DELAY
from seatrial.estimation.replicate import draw_noise
from seatrial.estimation.sensor_errors import (
    Sensor,
    bias_name,
    correlation_name,
    dof_name,
    drift_name,
    lag_name,
    noise_name,
)
from seatrial.estimation.simulation import CURRENT, Feedback, Simulator, samples_remembered
from seatrial.estimation.trial_data import ChannelData, channel_data
from seatrial.manoeuvres.relay import BEGIN, read_relay_family, relay_control
from seatrial.manoeuvres.schedule import Schedule
from seatrial.vehicles.actuators import Actuator, with_actuators

FIRST = "trial"
"""Label of the first trial of a campaign; those decided later are `trial-2`, `trial-3` and so on."""


@dataclass(frozen=True, eq=False)
class TrueVehicle:
    """The true vehicle with its true sensors and actuators.

    Attributes:
        simulator: of the vehicle; what is true of its sensors are parameters.
        values: parameters by name, SI.
        start: state at the first sample, SI.
        trim: every control with the value at which it is held where a schedule leaves it alone.
        where: what says so, for errors.
    """

    simulator: Simulator
    values: Mapping[str, float]
    start: tuple[float, ...]
    trim: tuple[tuple[str, float], ...]
    where: str

    def show(
        self,
        schedule: Schedule,
        measured: Bool[np.ndarray, "n m"],
        keys: Sequence[Array],
        relay: Mapping[str, Any] | None = None,
    ) -> dict[str, Float[np.ndarray, " n"]]:
        """Return every control, and what every sensor shows of a trial, SI, NaN where it does not measure.

        Args:
            schedule: controls over time, sampled evenly from 0.
            measured: whether each sensor gives a sample.
            keys: random key of each sensor's noise.
            relay: the self-oscillating test that makes its control itself, for as long as the schedule is; None where that is run.

        Raises:
            InputError: a true vehicle that runs away, or a schedule or test that is not of this vehicle.
        """
        columns = schedule.columns(self.trim)
        _check_controls(tuple(schedule.controls), tuple(columns))
        there = np.where(measured, 0.0, np.nan)
        channels = tuple(channel_data(schedule.time, column) for column in there.T)
        sensors = self.simulator.sensors
        noise = [np.asarray(one) for one in _noise(sensors, self.values, channels, tuple(keys))]
        start, step = self._start(columns), np.full(schedule.time.size, schedule.time[1])
        if relay is None:
            shown, end = _follow(self.simulator, self.values, start, tuple(columns.values()), step)
        else:
            at = _fed_back(self.simulator, relay, tuple(columns))
            run = _closed_loop(self.simulator, relay, self.values, step)
            shown, end, command = run(start, schedule.time, noise[at] + there[:, at])
            columns = dict(zip(columns, map(np.asarray, command), strict=True))
        if not (np.isfinite(shown).all() and np.isfinite(end).all()):
            raise InputError(
                self.where,
                found="a simulated vehicle that diverges",
                expected="damping that dissipates",
                remedy="check signs: negative damping coefficients dissipate",
            )
        exact = np.asarray(shown)
        return columns | {
            sensor.channel: np.where(measured[:, i], exact[:, i] + noise[i], np.nan) for i, sensor in enumerate(sensors)
        }

    def _start(self, columns: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the state at the first sample: actuators stand where they are first told to be."""
        states = zip(self.simulator.model.states, self.start, strict=True)
        return np.array([columns[name.removesuffix(ACTUAL)][0] if name.endswith(ACTUAL) else x for name, x in states])


def true_vehicle(campaign: Campaign) -> TrueVehicle:
    """Return the vehicle of `[truth]`."""
    truth, model = campaign.truth, campaign.model(campaign.full)
    noise = {noise_name(channel): sd for channel, sd in campaign.noise.items()}
    times = {name: truth.get(actuator_lag(name), 0.0) for name in model.controls if name + ACTUAL not in model.states}
    model = with_actuators(model, {name: Actuator(time) for name, time in times.items() if time > 0})
    sensors = tuple(_true_sensor(sensor, truth) for sensor in campaign.sensor_models)
    return TrueVehicle(
        Simulator(
            model,
            sensors,
            truth.get(DELAY, 0.0) > 0,
            CURRENT in truth,
            samples_remembered(sensors, campaign.family.sample_time),
        ),
        {**noise, **truth, **true_coefficients(campaign, model)},
        campaign.state_trim(model),
        campaign.control_trim(model),
        campaign.where("truth"),
    )


def _true_sensor(sensor: Sensor, truth: Mapping[str, float]) -> Sensor:
    """A sensor as it truly is, which an estimate may know otherwise."""
    channel = sensor.channel
    kinds = {correlation_name(channel): "coloured", dof_name(channel): "heavy", drift_name(channel): "drifting"}
    noise = next((kind for name, kind in kinds.items() if name in truth), "white")
    return Sensor(
        channel,
        noise,
        bias_name(channel) in truth,
        truth.get(lag_name(channel), 0.0) > 0,
        sensor.over_ground,
        sensor.mount,
    )


def _check_controls(given: tuple[str, ...], known: tuple[str, ...]) -> None:
    if unknown := [name for name in given if name not in known]:
        raise InputError(
            "schedule",
            found=f"a control {unknown[0]}, which the vehicle does not have",
            expected="controls of the vehicle: " + ", ".join(known),
            remedy="leave the trial out with `seatrial simulate DIR --design design --alone`, or change the vehicle back",
        )


@program(static_argnums=0)
def _noise(
    sensors: tuple[Sensor, ...], values: Mapping[str, Any], channels: tuple[ChannelData, ...], keys: tuple[Array, ...]
) -> tuple[Array, ...]:
    return tuple(
        draw_noise(sensor, values, channel, key) for sensor, channel, key in zip(sensors, channels, keys, strict=True)
    )


@program(static_argnums=0)
def _follow(
    simulator: Simulator, values: Mapping[str, Any], start: Any, control: tuple, step: Any
) -> tuple[Array, Array]:
    followed = simulator.follow(values, start, control, step)
    return jnp.stack(followed.kept, -1), jnp.stack(followed.end)


def _fed_back(simulator: Simulator, relay: Mapping[str, Any], controls: tuple[str, ...]) -> int:
    """Place of the sensor that is fed back."""
    channels, output = [sensor.channel for sensor in simulator.sensors], relay["family"]["output"]
    family = read_relay_family(relay["family"])
    if output not in channels or tuple(name for name, _ in family.trim) != controls:
        raise InputError(
            "self-oscillation",
            found=f"a test that feeds {output} back and holds {', '.join(name for name, _ in family.trim)}",
            expected=f"sensors {', '.join(channels)} and controls {', '.join(controls)}, which the campaign now has",
            remedy="design the test again, or change the campaign back",
        )
    return channels.index(output)


def _closed_loop(
    simulator: Simulator, relay: Mapping[str, Any], values: Mapping[str, float], step: Float[np.ndarray, " n"]
) -> Callable[[Array, Array, Array], tuple[Array, Array, tuple]]:
    """Return what a self-oscillating test shows, its last state and its controls, by its start, times and errors; compiled."""

    @program
    def run(start: Array, time: Array, error: Array) -> tuple[Array, Array, tuple]:
        followed = simulator.follow(values, start, _relay_feedback(relay, time, error), step)
        return jnp.stack(followed.kept, -1), jnp.stack(followed.end), followed.command

    return run


def _relay_feedback(relay: Mapping[str, Any], time: Float[Array, " n"], error: Float[Array, " n"]) -> Feedback:
    """Return the law of a self-oscillating test."""
    family = read_relay_family(relay["family"])

    def decide(memory: Any, now: Any, seen: Any) -> Any:
        return relay_control(family, relay["amplitude"], relay["threshold"], now, seen - family.output_trim, memory)

    return Feedback(
        family.output,
        BEGIN,
        lambda memory: family.command(memory.applied),
        decide,
        time,
        error,
    )
