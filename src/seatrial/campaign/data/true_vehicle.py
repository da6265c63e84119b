"""The simulated vehicle of a campaign: what is true of it, and what its sensors show in a trial.

What is simulated is what is fitted: [truth] holds a value of each coefficient, and may hold what an estimate knows beside them, by the same
names (`bias_u`, `lag_u`, `delay`, `current`, `sigma_u`, `tau_u`, `dof_u`, `process_u`), and `lag_n`, the lag of an actuator, instead of
what [vehicle.actuators] states.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Array, Bool, Float

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.truth import true_coefficients
from seatrial.core.errors import InputError, NumericalError
from seatrial.core.signals import ACTUAL
from seatrial.estimation.posterior.simulated_record import simulate_trial
from seatrial.estimation.simulation.delayed_control import DELAY
from seatrial.estimation.simulation.sensor_errors import Sensor, bias_name, lag_name, noise_kinds, noise_name
from seatrial.estimation.simulation.simulator import CURRENT, Simulator, samples_remembered
from seatrial.manoeuvres.autopilot import Autopilot
from seatrial.manoeuvres.relay import Relay, read_relay_family
from seatrial.manoeuvres.schedule import Schedule
from seatrial.vehicles.actuators import Actuator, with_actuators
from seatrial.vehicles.model import VehicleModel

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
        autopilot: through which a schedule acts; None if it acts on the controls.
    """

    simulator: Simulator
    values: Mapping[str, float]
    start: tuple[float, ...]
    trim: tuple[tuple[str, float], ...]
    where: str
    autopilot: Autopilot | None = None

    def show(
        self,
        schedule: Schedule,
        measured: Bool[np.ndarray, "n m"],
        keys: Sequence[Array],
        relay: Mapping[str, Any] | None = None,
    ) -> dict[str, Float[np.ndarray, " n"]]:
        """Return every control, every set-point, and what every sensor shows of a trial, SI, NaN if it does not measure.

        Args:
            schedule: controls and set-points over time, sampled evenly from 0.
            measured: whether each sensor gives a sample.
            keys: random key of each sensor's noise.
            relay: the self-oscillating test that makes its control itself, for as long as the schedule is; None if that is run.

        Raises:
            InputError: a true vehicle that runs away, or a schedule or test that is not of this vehicle.
        """
        model, commands = self.simulator.model, schedule.columns(self.trim)
        _check_controls(tuple(schedule.controls), tuple(commands))
        channels = tuple(sensor.channel for sensor in self.simulator.sensors)
        feedback = self.autopilot if relay is None else _relay_of(relay, channels, model.controls)
        start = at_first_command(model, self.start, commands)
        try:
            return simulate_trial(self.simulator, self.values, schedule.time, commands, start, measured, keys, feedback)
        except NumericalError as cause:
            raise InputError(
                self.where,
                found="a simulated vehicle that diverges" + " under its autopilot" * (self.autopilot is not None),
                expected="damping that dissipates" if self.autopilot is None else "an autopilot that stabilises it",
                remedy="check signs: negative damping coefficients dissipate"
                if self.autopilot is None
                else "check the signs under `moves` of [autopilot], and lower its gains",
            ) from cause


def at_first_command(
    model: VehicleModel, start: Sequence[float], commands: Mapping[str, np.ndarray]
) -> tuple[float, ...]:
    """Return the state at the first sample, SI: actuators stand where they are first told to be."""
    states = zip(model.states, start, strict=True)
    return tuple(float(commands[name.removesuffix(ACTUAL)][0]) if name.endswith(ACTUAL) else x for name, x in states)


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
    start, trim, autopilot = campaign.state_trim(model), campaign.control_trim(model), campaign.pilot(model.controls)
    return SimulatedVehicle(simulator, values, start, trim, campaign.where("truth"), autopilot)


def _true_sensor(sensor: Sensor, truth: Mapping[str, float]) -> Sensor:
    """A sensor as it truly is, which an estimate may know otherwise."""
    channel = sensor.channel
    noise = next((kind for name, kind in noise_kinds(channel).items() if name in truth), "white")
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
