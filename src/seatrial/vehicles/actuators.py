"""Actuators that follow their commands late and within limits.

    d(actual)/dt = clip((clip(command) - actual) / T, -rate, rate)

which, while the command is held, is a ramp until less than rate T is left, then an exponential. The bare control name stays the command;
what the vehicle feels is a state of its own, `n_act` behind `n`. T may be sought: `lag_n`, or `lag_f` for all of f_1, f_2, ….
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Any

import jax.numpy as jnp

from seatrial.core.argument_checks import check_kind, check_number, check_order
from seatrial.core.errors import not_among
from seatrial.core.signals import ACTUAL
from seatrial.vehicles.model import Follow, Params, VehicleModel, VehicleUnknown, cached_model


@dataclass(frozen=True)
class Actuator:
    """Lag and limits of one control.

    Attributes:
        time_constant: T, s; 0 for an actuator without a lag, with only limits.
        lower: least value, SI.
        upper: greatest value, SI.
        rate: greatest speed of change, SI units a second.

    Raises:
        InputError: a time constant below 0, limits that leave nothing between them, or a rate that is not positive.
    """

    time_constant: float
    lower: float = -inf
    upper: float = inf
    rate: float = inf

    def __post_init__(self) -> None:
        """Refuse what no actuator is."""
        check_number(self.time_constant, "Actuator, time_constant", least=0.0, remedy="give its lag in s, 0 for none")
        check_order(self.lower, self.upper, "Actuator", is_finite=False)
        check_number(
            self.rate, "Actuator, rate", above=0.0, is_finite=False, remedy="leave it out if there is no limit"
        )


def lags_of(control: str) -> tuple[str, ...]:
    """Return the names among the parameters of a control's time constant: its own, and that of all thrusters alike."""
    shared = control.rpartition("_")[0] if control[2:].isdigit() else ""
    return (f"lag_{control}", *([f"lag_{shared}"] if shared else []))


@cached_model
def with_actuators(model: VehicleModel, actuators: Mapping[str, Actuator], unknown: Sequence[str] = ()) -> VehicleModel:
    """Put actuators before controls of a vehicle; its other controls act at once.

    Args:
        model: vehicle whose controls are what acts on it.
        actuators: by control.
        unknown: time constants to estimate, see `lags_of`.

    Raises:
        InputError: no such control.
    """
    actuators = dict(actuators)
    for name, actuator in actuators.items():
        place = f'vehicle "{model.name}", actuator {name}'
        if name not in model.controls:
            raise not_among(place, name, model.controls, found="no such control")
        check_kind(actuator, Actuator, place, remedy="write for example Actuator(0.5)")
    lagging = tuple(name for name in model.controls if name in actuators and actuators[name].time_constant > 0)
    count = len(model.states)

    def acting(state: tuple, control: tuple) -> tuple:
        actual = dict(zip(lagging, state[count:], strict=True))
        commands = zip(model.controls, control, strict=True)
        return tuple(
            actual[name] if name in actual else _held(actuators[name], command) if name in actuators else command
            for name, command in commands
        )

    def derivative(params: Params, state: tuple, control: tuple) -> tuple:
        commands = dict(zip(model.controls, control, strict=True))
        return (
            *model.derivative(params, state[:count], acting(state, control)),
            *(
                _rate(actuators[name], commands[name], x, _time_constant(name, actuators[name], params))
                for name, x in zip(lagging, state[count:], strict=True)
            ),
        )

    outputs = {
        name: lambda params, state, control, view=view: view(params, state[:count], acting(state, control))
        for name, view in model.outputs.items()
    }

    def follow_of(name: str) -> Follow:
        at, actuator = model.controls.index(name), actuators[name]
        return lambda params, before, control, time: _after(
            actuator, control[at], before, _time_constant(name, actuator, params), time
        )

    constants = tuple(
        (f"actuator {name} {key}", value)
        for name, actuator in actuators.items()
        for key, value in vars(actuator).items()
    )
    return replace(
        model,
        states=(*model.states, *(name + ACTUAL for name in lagging)),
        constants=(*model.constants, *constants),
        derivative=derivative,
        outputs=outputs,
        exact_lags=(*model.exact_lags, *(follow_of(name) for name in lagging)),
        unknowns=(*model.unknowns, *_unknown_lags(unknown, {name: actuators[name] for name in lagging})),
    )


def _unknown_lags(unknown: Sequence[str], actuators: Mapping[str, Actuator]) -> Iterator[VehicleUnknown]:
    for lag in unknown:
        late = [one.time_constant for name, one in actuators.items() if lag in lags_of(name)]
        if late:
            label = rf"t_{{\mathrm{{lag}},{lag.removeprefix('lag_')}}}"
            yield VehicleUnknown(lag, "s", label, late[0], signed=False)


def _time_constant(name: str, actuator: Actuator, params: Params) -> Any:
    return next((params[lag] for lag in lags_of(name) if lag in params), actuator.time_constant)


def _held(actuator: Actuator, command: Any) -> Any:
    return (
        command
        if (actuator.lower, actuator.upper) == (-inf, inf)
        else jnp.clip(command, actuator.lower, actuator.upper)
    )


def _rate(actuator: Actuator, command: Any, actual: Any, time_constant: Any) -> Any:
    rate = (_held(actuator, command) - actual) / time_constant
    return rate if actuator.rate == inf else jnp.clip(rate, -actuator.rate, actuator.rate)


def _after(actuator: Actuator, command: Any, before: Any, time_constant: Any, time: Any) -> Any:
    """Return where an actuator is some time after it stood at `before`, its command being held since."""
    target = _held(actuator, command)
    rest = before - target
    if actuator.rate == inf:
        return target + rest * jnp.exp(-time / time_constant)
    size = jnp.abs(rest)
    ramp = jnp.clip(size / actuator.rate - time_constant, 0.0, time)
    return target + jnp.sign(rest) * (size - actuator.rate * ramp) * jnp.exp(-(time - ramp) / time_constant)
