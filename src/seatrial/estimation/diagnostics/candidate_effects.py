"""Effects that a model may lack: which to look for, and what the sensors show with them."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Literal

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from seatrial.compiled.programs import program
from seatrial.core.coefficients import CoefficientName, is_coefficient
from seatrial.core.signals import ACTUAL, ANGLES, PROPULSION, QUATERNION, RATES, SPEEDS, is_thruster, signal_unit
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.estimation.simulation.delayed_control import delay_control
from seatrial.vehicles.model import VehicleModel, outside_force

MOTIONS = {*RATES, *ANGLES}  # Controls that are motions given as measured, and no commands
# How controls begin that may act on other axes than the model has them on: generalised forces, which may act off the
# centre, and fins.
COUPLED = ("tau_", "delta_")
INSTANT = 1e-9  # Lag that is none, s


@dataclass(frozen=True)
class Effect:
    """Something that a model may lack.

    Attributes:
        kind: a force of the vehicle, an error of a command or of a sensor, or a start that is not known; a command leads that acts
            before its stamps, such as one that was measured while it changed and is taken as held; a thrust loss is the share of every
            command of propulsion that each m/s ahead takes away.
        of: coefficient of the force, control, measured channel or state; empty for the delay of all commands.
        unit: of its size, SI.
    """

    kind: Literal[
        "force", "command offset", "command lag", "command lead", "delay", "thrust loss", "sensor offset", "start"
    ]
    of: str
    unit: str

    @property
    def is_positive(self) -> bool:
        """Whether its size cannot be below zero."""
        return self.kind in ("delay", "command lag", "command lead")


DELAYED = Effect("delay", "", "s")
THRUST_LOSS = Effect("thrust loss", "", "s/m")


def candidate_effects(posterior: Posterior) -> Iterator[Effect]:
    """Yield what to look for: the same for all structures of a vehicle, so that they share a program.

    Forces along each axis (constant, linear, quadratic and cubic in its own velocity, in that times the speed ahead, linear in a control
    that drives other axes, and terms that other structures of the posterior have), a thrust that falls with the speed, offset, lag and
    lead of each command, a common delay, offsets of the sensors and starts, as far as the model has none.
    """
    likelihood: Any = posterior.likelihood
    model, simulator = likelihood.model, likelihood.simulator
    known = {CoefficientName.parse(name) for name, _ in model.constants if is_coefficient(name)}
    terms = {one: one.text for one in model.coefficients}
    driven = {(one.axis, control) for one in (*terms, *known) for control in model.controls if control in one.signals}
    driven |= {(axis, f"tau_{axis}") for axis in model.disturbance_axes}
    for axis in model.disturbance_axes:
        speed = SPEEDS[axis]
        texts = [f"{axis}_0"]
        texts += [f"{axis}_{speed}", f"{axis}_{speed}abs{speed}", f"{axis}_{speed}3"] * (speed in model.states)
        texts += [f"{axis}_u{speed}"] * (speed != "u" and {"u", speed} <= {*model.states})
        coupled = [one for one in model.controls if one.startswith(COUPLED) and (axis, one) not in driven]
        texts += [f"{axis}_{control}" for control in coupled]
        for name in map(CoefficientName.parse, texts):
            terms.setdefault(name, name.text)
    for name, text in terms.items():
        if name not in known:
            yield Effect("force", text, model.unit_of(name))
    driving = {name for name in model.controls if _propels(name)}
    if (
        driving
        and "u" in model.states
        and not any("u" in one.signals and driving & {*one.signals} for one in (*terms, *known))
    ):
        yield THRUST_LOSS
    lags = {unknown.name for unknown in model.unknowns}
    for control in model.controls:
        if control not in MOTIONS:
            yield Effect("command offset", control, signal_unit(control))
            yield Effect("command lead", control, "s")
            if f"lag_{control}" not in lags and control + ACTUAL not in model.states:
                yield Effect("command lag", control, "s")
    if not simulator.delay and not MOTIONS & set(model.controls):
        yield DELAYED
    for sensor in simulator.sensors:
        if not sensor.bias:
            yield Effect("sensor offset", sensor.channel, signal_unit(sensor.channel))
    if not likelihood.free_initial:
        for state in model.states:
            if state not in QUATERNION:
                yield Effect("start", state, signal_unit(state))


@program(static_argnums=1)
def show_with_effects(
    posterior: Posterior,
    effects: tuple[Effect, ...],
    z: Float[Array, " d"],
    sizes: Float[Array, " m"],
    ways: Float[Array, "k dm"],
) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    """Return what each sensor shows, shape (trials, n), and its slopes along ways of z and then the sizes, shape (k, trials, n)."""
    likelihood: Any = posterior.likelihood
    simulator = replace(likelihood.simulator, model=_pushed(likelihood.model, effects))

    def shown(z: Array, sizes: Array) -> tuple[Array, ...]:
        size = dict(zip(effects, sizes, strict=True))
        named: dict[str, Any] = dict(zip(posterior.names, posterior.constrain(z), strict=True))
        for one, x in size.items():
            if one.kind in ("force", "thrust loss"):
                own = one.of if one.of in named else _omitted(one)
                named[own] = named.get(own, 0.0) + x

        def of_one_trial(apart: dict, trial: Any, start: Array) -> tuple[Array, ...]:
            control = dict(zip(likelihood.model.controls, trial.control, strict=True))
            starts, biases = start, {}
            for one, x in size.items():
                match one.kind:
                    case "command offset":
                        control[one.of] = control[one.of] + x
                    case "command lead":
                        control[one.of] = _early(control[one.of], trial.step, x)
                    case "command lag":
                        control[one.of] = _late(control[one.of], trial.step, x + INSTANT)
                    case "start":
                        starts = starts.at[likelihood.model.states.index(one.of)].add(x)
                    case "sensor offset":
                        biases[one.of] = x
            if DELAYED in size:
                control = {
                    name: column if name in MOTIONS else delay_control(column, size[DELAYED] / trial.step[0])
                    for name, column in control.items()
                }
            seen = simulator.simulate({**named, **apart}, starts, tuple(control.values()), trial.step).kept
            return tuple(x + biases.get(channel, 0.0) for channel, x in zip(likelihood.channels, seen, strict=True))

        return jax.vmap(of_one_trial)(likelihood.apart(named), posterior.data, likelihood.starts(named, posterior.data))

    along = ways[:, : z.size], ways[:, z.size :]
    return jax.vmap(lambda *way: jax.jvp(shown, (z, sizes), way), out_axes=(None, 0))(*along)


def _propels(control: str) -> bool:
    """Return whether a control is the speed or the force of a propeller or thruster, or drives the vehicle ahead by itself."""
    return control in PROPULSION or is_thruster(control)


def _omitted(effect: Effect) -> str:
    """Name the size of an effect among the parameters of the model with the effects."""
    return f"omitted {effect.of or effect.kind}"


def _pushed(model: VehicleModel, effects: tuple[Effect, ...]) -> VehicleModel:
    """Return the model with the forces that it has no coefficient for, and with the loss of its thrust."""
    coefficients = {one.text for one in model.coefficients}
    forces = [CoefficientName.parse(one.of) for one in effects if one.kind == "force" and one.of not in coefficients]
    trim = {name.removeprefix("trim "): value for name, value in model.constants if name.startswith("trim ")}

    def derivative(params: Any, state: tuple, control: tuple) -> tuple:
        if THRUST_LOSS in effects:
            left = 1.0 - params[_omitted(THRUST_LOSS)] * state[model.states.index("u")]
            control = tuple(left * x if _propels(name) else x for name, x in zip(model.controls, control, strict=True))
        signals = dict(zip((*model.states, *model.controls), (*state, *control), strict=True))
        pushes: dict[str, Any] = {}
        for force in forces:
            name = outside_force(force.axis)
            before = pushes.get(name, params.get(name, 0.0))
            pushes[name] = before + params[_omitted(Effect("force", force.text, ""))] * force.regressor(signals, trim)
        return model.derivative({**params, **pushes}, state, control)

    return replace(model, derivative=derivative)


def _early(control: Float[Array, " n"], step: Float[Array, " n"], lead: Any) -> Float[Array, " n"]:
    """Return the mean over each step of a held command whose every change comes so much before its sample, at most one step."""
    return control + lead / jnp.where(step > 0, step, jnp.inf) * jnp.append(jnp.diff(control), 0.0)


def _late(control: Float[Array, " n"], step: Float[Array, " n"], lag: Any) -> Float[Array, " n"]:
    """Return the mean over each step of what follows a held command with a lag, from where the first one holds it."""

    def follow(actual: Array, sample: tuple) -> tuple[Array, Array]:
        command, h = sample
        h = jnp.where(h > 0, h, 1.0)
        left = jnp.exp(-h / lag)
        away = actual - command
        return command + away * left, command + away * (1.0 - left) * lag / h

    return jax.lax.scan(follow, control[0], (control, step))[1]
