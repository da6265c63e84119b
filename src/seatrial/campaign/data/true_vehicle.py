"""The simulated vehicle of a campaign: what is true of it, and what its sensors show in a trial.

What is simulated is what is fitted: [truth] holds a value of each coefficient, and may hold what an estimate knows beside them, by the same
names (`bias_u`, `lag_u`, `delay`, `current`, `sigma_u`, `tau_u`, `dof_u`, `process_u`), and `lag_n`, the lag of an actuator, in place of
what [vehicle.actuators] states.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.truth import true_coefficients
from seatrial.compiled.programs import program
from seatrial.core.errors import InputError
from seatrial.core.signals import ACTUAL
from seatrial.estimation.posterior.filter_error import process_name
from seatrial.estimation.posterior.replicate import draw_noise
from seatrial.estimation.simulation.delayed_control import DELAY
from seatrial.estimation.simulation.sensor_errors import (
    Sensor,
    bias_name,
    correlation_name,
    dof_name,
    drift_name,
    lag_name,
    noise_name,
)
from seatrial.estimation.simulation.simulator import CURRENT, Feedback, Simulator, samples_remembered
from seatrial.estimation.simulation.trial_data import ChannelData, channel_data
from seatrial.manoeuvres.autopilot import Autopilot
from seatrial.manoeuvres.pilot import Moment, Pilot
from seatrial.manoeuvres.relay import Relay, read_relay_family
from seatrial.manoeuvres.schedule import Schedule
from seatrial.vehicles.actuators import Actuator, with_actuators
from seatrial.vehicles.model import VehicleModel, cached_model

FIRST = "trial"  # Label of the first trial of a campaign; those decided later are `trial-2`, `trial-3` and so on


@dataclass(frozen=True, eq=False)
class SimulatedVehicle:
    """The true vehicle with its true sensors and actuators.

    Attributes:
        simulator: of the vehicle; what is true of its sensors are parameters.
        values: parameters by name, SI.
        start: state at the first sample, SI.
        trim: all that a schedule commands, with the value at which it is held where that leaves it alone.
        where: what says so, for errors.
        autopilot: through which a schedule acts; None where it acts on the controls.
        shaken: states with process noise, each of which has a control of its own, the last ones of the simulator's model.
    """

    simulator: Simulator
    values: Mapping[str, float]
    start: tuple[float, ...]
    trim: tuple[tuple[str, float], ...]
    where: str
    autopilot: Autopilot | None = None
    shaken: tuple[str, ...] = ()

    def show(
        self,
        schedule: Schedule,
        measured: Bool[np.ndarray, "n m"],
        keys: Sequence[Array],
        relay: Mapping[str, Any] | None = None,
    ) -> dict[str, Float[np.ndarray, " n"]]:
        """Return every control, every set-point, and what every sensor shows of a trial, SI, NaN where it does not measure.

        Args:
            schedule: controls and set-points over time, sampled evenly from 0.
            measured: whether each sensor gives a sample.
            keys: random key of each sensor's noise; that of the process noise follows from the first.
            relay: the self-oscillating test that makes its control itself, for as long as the schedule is; None where that is run.

        Raises:
            InputError: a true vehicle that runs away, or a schedule or test that is not of this vehicle.
        """
        commands = schedule.columns(self.trim)
        _check_controls(tuple(schedule.controls), tuple(commands))
        there = np.where(measured, 0.0, np.nan)
        channels = tuple(channel_data(schedule.time, column) for column in there.T)
        sensors = self.simulator.sensors
        noise = [np.asarray(one) for one in _noise(sensors, self.values, channels, tuple(keys))]
        errors = {sensor.channel: noise[i] + there[:, i] for i, sensor in enumerate(sensors)}
        count = len(commands) - (0 if self.autopilot is None else len(self.autopilot.loops))
        names = tuple(commands)[:count]
        pilot = self.autopilot if relay is None else _relay_of(relay, tuple(errors), names)
        step = np.full(schedule.time.size, schedule.time[1])
        pushes = _pushes(self.shaken, self.values, step, keys[0])
        held = list(commands.values())
        if pilot is None:
            shown, end = _follow(self.simulator, self.values, self._start(commands), (*held, *pushes), step)
        else:
            moments = Moment(
                schedule.time, (*held[:count], *pushes, *held[count:]), tuple(errors[name] for name in pilot.outputs)
            )
            if relay is not None:
                moments = moments._replace(told=())
            shown, end, command = _closed_loop(self.simulator, pilot, self.values, step)(self._start(commands), moments)
            commands |= dict(zip(names, map(np.asarray, command), strict=False))
        if not (np.isfinite(shown).all() and np.isfinite(end).all()):
            raise InputError(
                self.where,
                found="a simulated vehicle that diverges" + " under its autopilot" * (self.autopilot is not None),
                expected="damping that dissipates" if self.autopilot is None else "an autopilot that holds it",
                remedy="check signs: negative damping coefficients dissipate"
                if self.autopilot is None
                else "check the signs under `moves` of [autopilot], and lower its gains",
            )
        exact = np.asarray(shown)
        return commands | {
            sensor.channel: np.where(measured[:, i], exact[:, i] + noise[i], np.nan) for i, sensor in enumerate(sensors)
        }

    def _start(self, columns: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the state at the first sample: actuators stand where they are first told to be."""
        states = zip(self.simulator.model.states, self.start, strict=True)
        return np.array([columns[name.removesuffix(ACTUAL)][0] if name.endswith(ACTUAL) else x for name, x in states])


def true_vehicle(campaign: Campaign) -> SimulatedVehicle:
    """Return the vehicle of `[truth]`."""
    truth, model = campaign.truth, campaign.model(campaign.full)
    noise = {noise_name(channel): sd for channel, sd in campaign.noise.items()}
    times = {name: truth.get(lag_name(name), 0.0) for name in model.controls if name + ACTUAL not in model.states}
    model = with_actuators(model, {name: Actuator(time) for name, time in times.items() if time > 0})
    sensors = tuple(_true_sensor(sensor, truth) for sensor in campaign.sensor_models)
    values = {**noise, **truth, **true_coefficients(campaign, model)}
    remembered = samples_remembered(sensors, campaign.family.sample_time)
    simulator = Simulator(model, sensors, truth.get(DELAY, 0.0) > 0, CURRENT in truth, remembered)
    return simulated_vehicle(campaign, simulator, values, campaign.state_trim(model), campaign.control_trim(model))


def simulated_vehicle(
    campaign: Campaign,
    simulator: Simulator,
    values: Mapping[str, float],
    start: tuple[float, ...],
    trim: tuple[tuple[str, float], ...],
) -> SimulatedVehicle:
    """Return a true vehicle under the campaign's autopilot, with the process noise that its values name; arguments as its attributes."""
    model = simulator.model
    shaken = tuple(state for state in model.states if values.get(process_name(state), 0.0) > 0)
    moved = with_process_noise(model, shaken)
    autopilot, where = campaign.pilot(moved.controls), campaign.where("truth")
    return SimulatedVehicle(replace(simulator, model=moved), values, start, trim, where, autopilot, shaken)


@cached_model
def with_process_noise(model: VehicleModel, states: Sequence[str]) -> VehicleModel:
    """Return the vehicle with a further control for each of some states, which is added to its rate of change."""
    if not states:
        return model
    count, places = len(model.controls), [model.states.index(state) for state in states]

    def derivative(params: Any, state: tuple, control: tuple) -> tuple:
        rates = list(model.derivative(params, state, control[:count]))
        for place, push in zip(places, control[count:], strict=True):
            rates[place] = rates[place] + push
        return tuple(rates)

    outputs = {
        name: lambda params, state, control, view=view: view(params, state, control[:count])
        for name, view in model.outputs.items()
    }
    controls = (*model.controls, *map(process_name, states))
    return replace(model, controls=controls, derivative=derivative, outputs=outputs)


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
            remedy="leave the trial out with `seatrial simulate DIR --design design --only`, or change the vehicle back",
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
    followed = simulator.simulate(values, start, control, step)
    return jnp.stack(followed.kept, -1), jnp.stack(followed.end)


def _pushes(
    shaken: tuple[str, ...], values: Mapping[str, float], step: Float[np.ndarray, " n"], key: Array
) -> tuple[Float[np.ndarray, " n"], ...]:
    """Draw the rates, held over each step, by which states gain the process noise of that step."""
    if not shaken:
        return ()
    draws = np.asarray(jax.random.normal(jax.random.fold_in(key, 1), (len(shaken), step.size)))
    return tuple(values[process_name(state)] * one / np.sqrt(step) for state, one in zip(shaken, draws, strict=True))


def _relay_of(relay: Mapping[str, Any], channels: tuple[str, ...], controls: tuple[str, ...]) -> Relay:
    """Return a self-oscillating test, checked."""
    family = read_relay_family(relay["family"])
    if family.output not in channels or tuple(name for name, _ in family.trim) != controls:
        raise InputError(
            "self-oscillation",
            found=f"a test that feeds {family.output} back and holds {', '.join(name for name, _ in family.trim)}",
            expected=f"sensors {', '.join(channels)} and controls {', '.join(controls)}, which the campaign now has",
            remedy="design the test again, or change the campaign back",
        )
    return Relay(family, relay["amplitude"], relay["threshold"])


def _closed_loop(
    simulator: Simulator, pilot: Pilot, values: Mapping[str, float], step: Float[np.ndarray, " n"]
) -> Callable[[Array, Moment], tuple[Array, Array, tuple]]:
    """Return what a trial under a pilot shows, its last state and its controls; compiled."""

    @program
    def run(start: Array, moments: Moment) -> tuple[Array, Array, tuple]:
        followed = simulator.simulate(values, start, Feedback(pilot, moments), step)
        return jnp.stack(followed.kept, -1), jnp.stack(followed.end), followed.command

    return run
