"""A force that no term of the model makes: an Ornstein-Uhlenbeck process along an axis, of standard deviation s and correlation time tau.

It is exact from sample to sample (Gillespie, Phys. Rev. E 54, 1996). With r = h / tau over a step h, of which f is the mean of d,

    d' = e^-r d + s sqrt(1 - e^-2r) e1,    f = (d + d') tanh(r/2) / r + s sqrt((2 r - 4 tanh(r/2)) / r^2) e2

with e1 and e2 independent and standard normal: f given both ends is that of a bridge. The vehicle moves under f over the step. As tau goes
to 0 with s^2 tau fixed, f is white noise, and the velocity gains s sqrt(2 tau) over its inertia in one second: process noise.
"""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp

from seatrial.core.signals import SPEEDS
from seatrial.vehicles.model import VehicleModel, outside_force

AXES = "XYZKMN"
# Steps over correlation times below which differences of near equal numbers are replaced by their series, to ten digits
# or more.
_SHORT_STEP = 0.1


class OverStep(NamedTuple):
    """A disturbance over one step, from its value d at the beginning.

    Attributes:
        memory: what is left of d at the end.
        mean: force over the step, over d.
        gained: standard deviation of what is new at the end.
        with_gained: what is new of the force over the step, over what is new at the end.
        apart: standard deviation of the rest of the force.
    """

    memory: Any
    mean: Any
    gained: Any
    with_gained: Any
    apart: Any


def over_step(sd: Any, time: Any, step: Any) -> OverStep:
    """Return what a disturbance does over a step, in the unit of `sd`; nothing over a step of 0 s, whose derivatives are 0 too.

    Args:
        sd: standard deviation, SI.
        time: correlation time, s.
        step: s.
    """
    moves = step > 0
    r = jnp.where(moves, step, 1.0) / time
    left, half = jnp.exp(-r), jnp.tanh(0.5 * r)
    is_short = r < _SHORT_STEP
    long = jnp.where(is_short, 1.0, r)
    bridge = jnp.where(
        is_short,
        r / 6 * (1 - r**2 / 10 * (1 - 17 * r**2 / 168 * (1 - 31 * r**2 / 306))),
        (2 * long - 4 * jnp.tanh(0.5 * long)) / long**2,
    )
    over_step = OverStep(left, -jnp.expm1(-r) / r, sd * jnp.sqrt(-jnp.expm1(-2 * r)), half / r, sd * jnp.sqrt(bridge))
    still = OverStep(1.0, 0.0, 0.0, 0.0, 0.0)
    return OverStep(*(jnp.where(moves, moving, resting) for moving, resting in zip(over_step, still, strict=True)))


def disturbance_name(axis: str) -> str:
    """Return the parameter name of the standard deviation of a disturbance, in the unit of a constant force on its axis."""
    return f"disturbance_{axis}"


def disturbance_time_name(axis: str) -> str:
    """Return the parameter name of the correlation time of a disturbance, s."""
    return f"disturbance_time_{axis}"


def disturbed_axes(names: Iterable[str], model: VehicleModel) -> tuple[str, ...]:
    """Return the axes of a vehicle on which there is a disturbance, of which any parameter is among some names."""
    known = set(names)
    return tuple(
        axis for axis in model.disturbance_axes if {disturbance_name(axis), disturbance_time_name(axis)} & known
    )


def force_per_rate(model: VehicleModel, axis: str, values: Mapping[str, Any]) -> float:
    """Return the force on an axis that accelerates the vehicle along it by 1 m/s^2 or rad/s^2, SI.

    Args:
        model: vehicle.
        axis: one of `disturbance_axes`.
        values: of all parameters of the model, SI.
    """
    at = model.states.index(SPEEDS[axis])
    rest, controls = (1.0,) * len(model.states), (0.0,) * len(model.controls)
    free, pushed = (
        float(model.derivative({**values, outside_force(axis): force}, rest, controls)[at]) for force in (0.0, 1.0)
    )
    return 1.0 / abs(pushed - free)
