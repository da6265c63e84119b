"""Limits of a vehicle's motion in a trial: one signal between two bounds at every sample.

The room that a limit leaves is the distance of its signal to the nearer bound, min(upper - q, q - lower), below 0 if it is
broken. Bounds are leaves, so that code compiled for one limit serves every other of the same signal.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, isnan
from typing import Any

import jax.numpy as jnp

from seatrial.compiled.pytrees import compiled_tree
from seatrial.core.display_units import shown_unit
from seatrial.core.errors import InputError
from seatrial.design.integrals import Rate, integrals_for
from seatrial.vehicles.model import VehicleModel


@compiled_tree("signal")
@dataclass(frozen=True)
class MotionLimit:
    """Bounds of a state, for example speed `u`, pitch `theta` or depth `z`, or of an integral of `KNOWN`: the `distance` travelled through
    the water, the `advance` along the keel, or `x` and `y`, ahead and to starboard of the start; SI, infinite if there is none."""

    signal: str
    lower: float = -inf
    upper: float = inf

    @property
    def shown(self) -> tuple[float, str]:
        """Factor from SI to the unit in which the signal is told, and that unit."""
        return shown_unit(self.signal)

    @property
    def words(self) -> str:
        """The limit as a table or an error tells it: `u at most 2 m/s`."""
        factor, unit = self.shown
        name = "distance travelled" if self.signal == "distance" else self.signal
        lower, upper = self.lower * factor, self.upper * factor
        if lower == -inf:
            return f"{name} at most {upper:g} {unit}"
        return f"{name} at least {lower:g} {unit}" if upper == inf else f"{name} from {lower:g} to {upper:g} {unit}"


def room(limit: MotionLimit, now: Mapping[str, Any]) -> Any:
    """Return the distance to the nearest bound at one sample, SI; below 0 if it is broken; traced."""
    value = now[limit.signal]
    return jnp.minimum(limit.upper - value, value - limit.lower)


def limit_integrals(model: VehicleModel, limits: Sequence[MotionLimit]) -> dict[str, Rate]:
    """Return the integrals that must travel with the state for these limits.

    Raises:
        InputError: a signal that the vehicle does not have.
    """
    integrals: dict[str, Rate] = {}
    for limit in limits:
        integrals |= integrals_for(model, (limit.signal,), f"limit on {limit.signal}")
    return integrals


def check_motion_limits(model: VehicleModel, limits: Sequence[MotionLimit]) -> None:
    """Check limits before anything is simulated.

    Raises:
        InputError: bounds that bound nothing or admit nothing, or a signal that the vehicle does not have.
    """
    limit_integrals(model, limits)
    for limit in limits:
        lower, upper = limit.lower, limit.upper
        if isnan(lower) or isnan(upper) or not lower < upper or (lower, upper) == (-inf, inf):
            factor, unit = limit.shown
            raise InputError(
                f"limit on {limit.signal}",
                found=f"bounds from {lower * factor:g} to {upper * factor:g} {unit}",
                expected="a finite lower or upper bound, the lower below the upper",
                remedy="give at least one bound, in SI",
            )
