"""Every unknown that a posterior may have: its name, unit, label, sign, usual prior, and the assumption that makes it unknown.

X_u, T_nabsn, …          a coefficient of the vehicle            sigma_u          the noise of a sensor, always needed
tau_u, dof_u, share_u    where its noise is coloured, heavy,     bias_u, lag_u    where the sensor has them
                         or proportional to the signal           gain_f, …        a number of the vehicle or of a mount
drift_u, drift_time_u    where it drifts
delay                    between command and action, s           current          of the water along the course, m/s
process_u                process noise of a state, of all or of none: a filter then integrates it out
disturbance_X            a force that no term makes, its standard deviation, and disturbance_time_X, its correlation time, s: a filter
                         integrates it out too, and process noise is then of any states or none
spread_X_u               X_u differs between trials, by so much  u_0              the initial state of each trial, all states or none;
                         of an actuator's state only where it is named
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import NamedTuple

from seatrial.core.coefficients import CoefficientName, base_name, configuration_name
from seatrial.core.signals import ACTUAL, signal_label, signal_unit
from seatrial.core.usual_priors import DRIFT_TIMES
from seatrial.estimation.posterior.filter_error import process_name
from seatrial.estimation.posterior.output_error import deviation_name, own_name, spread_name
from seatrial.estimation.posterior.posterior import Parameter
from seatrial.estimation.priors import LogUniform, Normal, Prior, Uniform
from seatrial.estimation.simulation.delayed_control import DELAY
from seatrial.estimation.simulation.disturbance import disturbance_name, disturbance_time_name, disturbed_axes
from seatrial.estimation.simulation.mounts import LATE, SCALE, mount_unit
from seatrial.estimation.simulation.sensor_errors import (
    Sensor,
    bias_name,
    correlation_name,
    dof_name,
    drift_name,
    drift_time_name,
    lag_name,
    noise_name,
    share_name,
)
from seatrial.estimation.simulation.simulator import CURRENT
from seatrial.vehicles.model import VehicleModel

DOF_PRIOR = LogUniform(1.5, 200.0)  # Usual prior of degrees of freedom: from tails without a variance to the normal
# Usual prior of the share of the signal that is noise: from what no record shows to half of it
SHARE_PRIOR = LogUniform(1e-4, 0.5)
MAX_NOISE_RATIO = 5.0  # Upper end of the usual prior of a sensor's noise, over its nominal noise
# Ends of the usual prior of the slow part of that noise, over the middle of the prior of its white part: from what no record shows to a
# slow error that hides the white noise.
SLOW_SHARES = (1e-3, 5.0)


class Unknown(NamedTuple):
    """One unknown.

    Attributes:
        name: of its prior.
        unit: SI.
        label: LaTeX.
        signed: whether it may be below 0.
        default: prior where none is stated; None if one has to be.
        why: the assumption that makes it unknown, in words; empty of a coefficient.
        is_initial: whether it is a state at the start, of which each trial has its own.
    """

    name: str
    unit: str
    label: str
    signed: bool = False
    default: Prior | None = None
    why: str = ""
    is_initial: bool = False

    def parameter(self, prior: Prior) -> Parameter:
        """Return the parameter that all trials share."""
        return Parameter(self.name, self.unit, self.label, prior)

    def of_trial(self, label: str, prior: Prior) -> Parameter:
        """Return the parameter of one trial."""
        return Parameter(own_name(self.name, label), self.unit, f"{self.label}[{label}]", prior)

    def of_configuration(self, configuration: str, prior: Prior) -> Parameter:
        """Return the parameter of one configuration of the vehicle."""
        name = configuration_name(self.name, configuration)
        return Parameter(name, self.unit, f"{self.label}[{configuration}]", prior)


def unknowns_of(
    model: VehicleModel, sensors: Sequence[Sensor], stated: Collection[str], noise: Mapping[str, float] | None = None
) -> list[Unknown]:
    """Return every unknown, in the order of the parameters of a posterior.

    Args:
        model: vehicle; its coefficients are unknown.
        sensors: of the measured channels.
        stated: names of unknowns that are asked for beside those of the vehicle and the sensors, such as `delay` or `process_u`.
        noise: nominal noise of some sensors by channel, SI, from which usual priors of noise are made.
    """
    result = [*_coefficients(model), *_of_vehicle(model, sensors, stated)]
    for sensor in sensors:
        result += unknowns_of_sensor(sensor, (noise or {}).get(sensor.channel))
    disturbed, noisy = disturbed_axes(stated, model), noisy_states(stated, model)
    for axis in disturbed:
        unit, why = model.unit_of(CoefficientName.parse(f"{axis}_0")), f"a force with a memory disturbs {axis}"
        result += [
            Unknown(disturbance_name(axis), unit, rf"s_{{d,{axis}}}", why=why),
            Unknown(disturbance_time_name(axis), "s", rf"\tau_{{d,{axis}}}", why=why),
        ]
    for state in noisy:
        # Its own unit: a standard deviation that the state gains in one second.
        label = rf"q_{{{signal_label(state)}}}"
        result.append(Unknown(process_name(state), signal_unit(state), label, why=f"process noise disturbs {state}"))
    # A filter takes initial states as uncertain anyway.
    if not (disturbed or noisy) and any(f"{state}_0" in stated for state in model.states):
        result += [
            Unknown(f"{state}_0", signal_unit(state), f"{signal_label(state)}_0", True, is_initial=True)
            for state in model.states
            # An actuator stands where it is commanded to be.
            if not state.endswith(ACTUAL) or f"{state}_0" in stated
        ]
    return result


def unknowns_of_sensor(sensor: Sensor, noise: float | None = None) -> list[Unknown]:
    """Return the unknowns of a sensor, whose nominal noise is given in SI if it is known."""
    channel, label = sensor.channel, signal_label(sensor.channel)
    unit, slow = signal_unit(channel), f"the residuals of {channel} are {sensor.noise}"
    usual = {} if noise is None else {noise_name(channel): Uniform(0.0, MAX_NOISE_RATIO * noise)}
    usual |= slow_noise_priors([sensor], usual)
    known = {
        noise_name(channel): Unknown("", unit, rf"\sigma_{{{label}}}", why=f"{channel} is measured"),
        correlation_name(channel): Unknown("", "s", rf"\tau_{{{label}}}", why=slow),
        dof_name(channel): Unknown("", "1", rf"\nu_{{{label}}}", default=DOF_PRIOR, why=slow),
        share_name(channel): Unknown("", "1", rf"\kappa_{{{label}}}", default=SHARE_PRIOR, why=slow),
        drift_name(channel): Unknown("", unit, rf"\sigma_{{\mathrm{{drift}},{label}}}", why=slow),
        drift_time_name(channel): Unknown("", "s", rf"\tau_{{\mathrm{{drift}},{label}}}", why=slow),
        bias_name(channel): Unknown("", unit, rf"b_{{{label}}}", True, why=f"the sensor of {channel} has a bias"),
        lag_name(channel): Unknown("", "s", rf"t_{{\mathrm{{lag}},{label}}}", why=f"the sensor of {channel} lags"),
    }
    defaults = {name: usual.get(name, one.default) for name, one in known.items()}
    return [known[name]._replace(name=name, default=defaults[name]) for name in sensor.parameters]


def slow_noise_priors(sensors: Sequence[Sensor], priors: Mapping[str, Prior]) -> dict[str, Prior]:
    """Return a usual prior of the size and of the time of each sensor's slow noise that has none.

    Args:
        sensors: of the measured channels.
        priors: of the unknowns, those of white noise among them.
    """
    stated, usual = {base_name(name) for name in priors}, {}
    for sensor in sensors:
        white = priors.get(noise_name(sensor.channel))
        if sensor.noise == "drifting" and white is not None:
            middle = float(white.constrain(0.0))
            usual[drift_name(sensor.channel)] = LogUniform(*(share * middle for share in SLOW_SHARES))
            usual[drift_time_name(sensor.channel)] = LogUniform(*DRIFT_TIMES)
    return {name: prior for name, prior in usual.items() if name not in stated}


def noisy_states(stated: Collection[str], model: VehicleModel) -> tuple[str, ...]:
    """Return the states whose process noise is asked for: all or none of them, but those that are named beside a disturbance.

    Args:
        stated: names of unknowns that are asked for.
        model: vehicle.
    """
    named = tuple(state for state in model.states if process_name(state) in stated)
    return named if disturbed_axes(stated, model) or not named else model.states


def may_vary(model: VehicleModel) -> tuple[Unknown, ...]:
    """Return the unknowns that may lie about a common value in each trial: those of the vehicle that may have either sign."""
    return tuple(one for one in (*_coefficients(model), *_others(model)) if one.signed)


def may_differ(model: VehicleModel) -> tuple[str, ...]:
    """Return the names of the unknowns that may have a value for each configuration: all of the vehicle."""
    return tuple(one.name for one in (*_coefficients(model), *_others(model)))


def deviations(varying: Sequence[Unknown], labels: Sequence[str]) -> list[Parameter]:
    """Return the distance of each trial's unknowns from the common ones, in units of their spread."""
    return [
        Parameter(deviation_name(one.name, label), "1", rf"\delta_{{{one.label}}}[{label}]", Normal(0.0, 1.0))
        for one in varying
        for label in labels
    ]


def _coefficients(model: VehicleModel) -> list[Unknown]:
    return [Unknown(term.text, model.unit_of(term), term.label, signed=True) for term in model.coefficients]


def _others(model: VehicleModel) -> list[Unknown]:
    """Return the unknowns of a vehicle beside its coefficients."""
    return [Unknown(one.name, one.unit, one.label, one.signed) for one in model.unknowns]


def _of_vehicle(model: VehicleModel, sensors: Sequence[Sensor], stated: Collection[str]) -> Iterator[Unknown]:
    """Yield what is unknown of the motion and of mounts beside the coefficients."""
    for one in may_vary(model):
        if spread_name(one.name) in stated:
            why = f"{one.name} varies between trials"
            yield Unknown(spread_name(one.name), one.unit, rf"s_{{{one.label}}}", why=why)
    if DELAY in stated:
        yield Unknown(DELAY, "s", r"t_{\mathrm{delay}}", why="controls act late")
    if CURRENT in stated:
        yield Unknown(CURRENT, "m/s", r"u_{\mathrm{current}}", True, why="the water moves along the course")
    yield from _others(model)
    for name in dict.fromkeys(name for sensor in sensors if sensor.mount for name in sensor.mount.unknown):
        part, _, mount = name.partition("_")
        yield Unknown(name, mount_unit(name), rf"{part}_{{\mathrm{{{mount}}}}}", part not in (SCALE, LATE))
