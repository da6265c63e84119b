"""Data that a likelihood would have made: the measurements of its trials replaced by simulated ones, gaps and times kept."""

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from seatrial.compiled.programs import program
from seatrial.core.signals import QUATERNION
from seatrial.estimation.posterior.filter_error import FilterError
from seatrial.estimation.posterior.output_error import OutputError
from seatrial.estimation.simulation.sensor_errors import (
    Sensor,
    correlation_name,
    dof_name,
    drift_name,
    drift_time_name,
    noise_name,
    share_name,
)
from seatrial.estimation.simulation.trial_data import ChannelData, TrialData


@program(static_argnums=0)
def replicate(
    likelihood: OutputError | FilterError, values: Mapping[str, Any], data: TrialData, key: jax.Array
) -> TrialData:
    """Draw measurements of every trial under given parameter values.

    Args:
        likelihood: what is believed about vehicle, sensors and noise; static.
        values: parameters by name, SI.
        data: trials whose controls, times, gaps and initial states are kept.
        key: random key.
    """
    output = likelihood.output
    keys = jax.random.split(key, 2)
    shown = motions(likelihood, values, data, keys[0])
    noise_keys = jax.random.split(keys[1], (len(output.labels), len(data.channels)))

    def of_trial(apart: dict[str, Array], trial: TrialData, shown: Array, keys: Array) -> TrialData:
        here = {**values, **apart}
        channels = tuple(
            channel._replace(measured=channel.present * (x + draw_noise(sensor, here, channel, x, keys[i])))
            for i, (sensor, channel, x) in enumerate(
                zip(output.simulator.sensors, trial.channels, shown.T, strict=True)
            )
        )
        return trial._replace(channels=_on_the_sphere(output.channels, channels))

    return jax.vmap(of_trial)(output.apart(values), data, shown, noise_keys)


def _on_the_sphere(names: Sequence[str], channels: tuple[ChannelData, ...]) -> tuple[ChannelData, ...]:
    """Return the channels, of which those of a quaternion have length 1, as an attitude filter gives them."""
    if not set(QUATERNION) <= set(names):
        return channels
    parts = [channels[names.index(name)].measured for name in QUATERNION]
    length = jnp.sqrt(sum((part * part for part in parts), jnp.zeros(())))
    length = jnp.where(length > 0, length, 1.0)
    return tuple(
        channel._replace(measured=channel.measured / length) if name in QUATERNION else channel
        for name, channel in zip(names, channels, strict=True)
    )


def motions(
    likelihood: OutputError | FilterError, values: Mapping[str, Any], data: TrialData, key: jax.Array
) -> Float[Array, "trials n m"]:
    """What the sensors would show without their noise; process noise is drawn where there is any. Arguments as `replicate`."""
    output = likelihood.output

    def of_trial(apart: dict[str, Array], trial: TrialData, start: Array, key: jax.Array) -> Array:
        here = {**values, **apart}
        if isinstance(likelihood, FilterError):
            return _noisy_motion(likelihood, here, trial, start, key)
        return output.simulator.outputs(here, start, trial.control, trial.step)

    keys = jax.random.split(key, len(output.labels))
    return jax.vmap(of_trial)(output.apart(values), data, output.starts(dict(values), data), keys)


def draw_noise(
    sensor: Sensor, values: Mapping[str, Any], channel: ChannelData, shown: Float[Array, " n"], key: jax.Array
) -> Float[Array, " n"]:
    """Draw the noise of one channel about what its sensor shows at every sample, SI; arguments as `replicate`."""
    shape, sd = channel.measured.shape, values[noise_name(sensor.channel)]
    match sensor.noise:
        case "white":
            return sd * jax.random.normal(key, shape)
        case "heavy":
            return sd * jax.random.t(key, values[dof_name(sensor.channel)], shape)
        case "proportional":
            return jnp.hypot(sd, values[share_name(sensor.channel)] * shown) * jax.random.normal(key, shape)
        case "coloured":
            return sd * _coloured(jax.random.normal(key, shape), values[correlation_name(sensor.channel)], channel)
        case "drifting":
            white, slow = jax.random.normal(key, (2, *shape))
            drift, time = values[drift_name(sensor.channel)], values[drift_time_name(sensor.channel)]
            return sd * white + drift * _coloured(slow, time, channel)


def _coloured(white: Float[Array, " n"], correlation_time: Any, channel: ChannelData) -> Float[Array, " n"]:
    """Return an Ornstein-Uhlenbeck process of unit variance from white noise."""
    memory = jnp.exp(-channel.gaps / correlation_time)[channel.kind]

    def advance(before: Array, sample: tuple) -> tuple[Array, Array]:
        e, rho, present = sample
        now = rho * before + jnp.sqrt(1.0 - rho * rho) * e
        return jnp.where(present > 0, now, before), now

    _, process = jax.lax.scan(advance, jnp.zeros(()), (white, memory, channel.present))
    return process


def _noisy_motion(
    likelihood: FilterError, values: Mapping[str, Any], trial: TrialData, start: Array, key: jax.Array
) -> Float[Array, "n m"]:
    """Outputs along a motion with process noise and disturbances, of the filter's own state space, from a start that is drawn too."""
    space = likelihood.space(values, start)
    control = likelihood.output.simulator.delayed(values, trial.control, trial.step)
    n, d = trial.step.shape[0], len(space.states)
    first, pushes = jax.random.normal(key, (d,)), jax.random.normal(jax.random.fold_in(key, 1), (n, d))
    begin = tuple(space.initial.mean + space.initial.chol_cov @ first)
    shaken = space.shocks
    draws = jax.random.normal(jax.random.fold_in(key, 2), (n, 0 if shaken is None else 2 * len(likelihood.disturbed)))

    def advance(state: tuple, sample: tuple) -> tuple[tuple, Array]:
        held, step, push, draw = sample
        shown = jnp.stack([jnp.asarray(y, float) for y in space.observe(state, held)])
        moved = space.transition(state, held, step)
        columns = () if shaken is None else shaken(state, held, step)
        moved = tuple(
            x + sd * jnp.sqrt(step) * e + sum(column[i] * draw[j] for j, column in enumerate(columns))
            for i, (x, sd, e) in enumerate(zip(moved, space.process_sd, push, strict=True))
        )
        return moved, shown

    _, shown = jax.lax.scan(advance, begin, (control, trial.step, pushes, draws))
    return shown
