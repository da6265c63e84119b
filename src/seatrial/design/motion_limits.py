"""Limits of a vehicle's motion in a trial: a state, the way, the area, the altitude, each between two bounds at every sample.

The room that a limit leaves is the distance of its quantity to the nearer bound, min(upper - q, q - lower), below 0 where it is
broken. Bounds are leaves, so that code compiled for one limit serves every other of its kind.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, isnan
from typing import Any, Protocol

import jax.numpy as jnp

from seatrial.core.display_units import shown_unit
from seatrial.core.errors import InputError
from seatrial.core.pytrees import compiled_tree
from seatrial.design.integrals import Rate, integrals_for
from seatrial.vehicles.model import VehicleModel

METRES = 1.0, "m"
Bounds = tuple[float, float]
"""Lower and upper, SI; infinite where there is none."""


class MotionLimit(Protocol):
    """What every limit of the motion offers; its quantities share one unit."""

    @property
    def signals(self) -> tuple[str, ...]:
        """States, or integrals of `KNOWN`, that it reads."""
        ...

    @property
    def shown(self) -> tuple[float, str]:
        """Factor from SI to the unit in which its quantities are told, and that unit."""
        ...

    @property
    def words(self) -> str:
        """The limit as a table or an error tells it."""
        ...

    @property
    def bounds(self) -> tuple[Bounds, ...]:
        """Bounds of each quantity."""
        ...

    def quantities(self, now: Mapping[str, Any]) -> tuple[Any, ...]:
        """What is bounded, from the signals at one sample; traced."""
        ...


@compiled_tree("state")
@dataclass(frozen=True)
class StateBound:
    """Bounds of a state, for example speed `u`, pitch `theta` or depth `z`; SI."""

    state: str
    lower: float = -inf
    upper: float = inf

    @property
    def signals(self) -> tuple[str, ...]:
        """The state."""
        return (self.state,)

    @property
    def shown(self) -> tuple[float, str]:
        """Of the state."""
        return shown_unit(self.state)

    @property
    def words(self) -> str:
        """For example `u at most 2 m/s`."""
        return _between(self.state, self.lower, self.upper, self.shown)

    @property
    def bounds(self) -> tuple[Bounds, ...]:
        """Of the state."""
        return ((self.lower, self.upper),)

    def quantities(self, now: Mapping[str, Any]) -> tuple[Any, ...]:
        """The state."""
        return (now[self.state],)


@compiled_tree()
@dataclass(frozen=True)
class Distance:
    """Largest distance travelled through the water, the integral of |u|, m."""

    upper: float
    signals, shown = ("travelled",), METRES

    @property
    def words(self) -> str:
        """For example `distance travelled at most 300 m`."""
        return _between("distance travelled", -inf, self.upper, self.shown)

    @property
    def bounds(self) -> tuple[Bounds, ...]:
        """Of the distance."""
        return ((-inf, self.upper),)

    def quantities(self, now: Mapping[str, Any]) -> tuple[Any, ...]:
        """The distance so far."""
        return (now["travelled"],)


@compiled_tree()
@dataclass(frozen=True)
class Advance:
    """Bounds of the distance ahead of the start along the keel, the integral of u, m."""

    lower: float = -inf
    upper: float = inf
    signals, shown = ("advanced",), METRES

    @property
    def words(self) -> str:
        """For example `advance from -10 to 300 m`."""
        return _between("advance", self.lower, self.upper, self.shown)

    @property
    def bounds(self) -> tuple[Bounds, ...]:
        """Of the advance."""
        return ((self.lower, self.upper),)

    def quantities(self, now: Mapping[str, Any]) -> tuple[Any, ...]:
        """The advance so far."""
        return (now["advanced"],)


@compiled_tree()
@dataclass(frozen=True)
class Area:
    """Box in the horizontal plane, m: of the states x and y, or ahead and to starboard of the start and its heading."""

    x: Bounds
    y: Bounds
    signals, shown = ("x", "y"), METRES

    @property
    def words(self) -> str:
        """For example `x from -50 to 200 m and y from -50 to 50 m`."""
        return f"{_between('x', *self.x, self.shown)} and {_between('y', *self.y, self.shown)}"

    @property
    def bounds(self) -> tuple[Bounds, ...]:
        """Of x and of y."""
        return (self.x, self.y)

    def quantities(self, now: Mapping[str, Any]) -> tuple[Any, ...]:
        """Position in the plane."""
        return (now["x"], now["y"])


@compiled_tree()
@dataclass(frozen=True)
class Altitude:
    """Least height `lower` over a flat bottom at the depth `bottom`, m."""

    bottom: float
    lower: float
    signals, shown = ("z",), METRES

    @property
    def words(self) -> str:
        """For example `altitude at least 3 m over the bottom at 40 m`."""
        return f"{_between('altitude', self.lower, inf, self.shown)} over the bottom at {self.bottom:g} m"

    @property
    def bounds(self) -> tuple[Bounds, ...]:
        """Of the altitude."""
        return ((self.lower, inf),)

    def quantities(self, now: Mapping[str, Any]) -> tuple[Any, ...]:
        """Height over the bottom."""
        return (self.bottom - now["z"],)


def room(limit: MotionLimit, now: Mapping[str, Any]) -> Any:
    """Distance to the nearest bound at one sample, in the unit of the limit; below 0 where it is broken; traced."""
    least = jnp.asarray(inf)
    for value, (lower, upper) in zip(limit.quantities(now), limit.bounds, strict=True):
        least = jnp.minimum(least, jnp.minimum(upper - value, value - lower))
    return least


def limit_integrals(model: VehicleModel, limits: Sequence[MotionLimit]) -> dict[str, Rate]:
    """Integrals that must travel with the state for these limits.

    Raises:
        InputError: no limit, bounds that bound nothing or admit nothing, or a signal that the vehicle does not have.
    """
    found: dict[str, Rate] = {}
    for limit in limits:
        found |= integrals_for(model, limit.signals, f"limit on {' and '.join(limit.signals)}")
    return found


def check_motion_limits(model: VehicleModel, limits: Sequence[MotionLimit]) -> None:
    """Check limits before anything is simulated.

    Raises:
        InputError: no limit, bounds that bound nothing or admit nothing, or a signal that the vehicle does not have.
    """
    if not limits:
        raise InputError("safety limits", found="none", expected="at least one", remedy="bound a state or the distance")
    limit_integrals(model, limits)
    for limit in limits:
        for lower, upper in limit.bounds:
            if isnan(lower) or isnan(upper) or not lower < upper or (lower, upper) == (-inf, inf):
                raise InputError(
                    f"limit on {' and '.join(limit.signals)}",
                    found=f"bounds from {lower * limit.shown[0]:g} to {upper * limit.shown[0]:g} {limit.shown[1]}",
                    expected="a finite lower or upper bound, the lower below the upper",
                    remedy="give at least one bound, in SI",
                )


def _between(name: str, lower: float, upper: float, shown: tuple[float, str]) -> str:
    factor, unit = shown
    lower, upper = lower * factor, upper * factor
    if lower == -inf:
        return f"{name} at most {upper:g} {unit}"
    return f"{name} at least {lower:g} {unit}" if upper == inf else f"{name} from {lower:g} to {upper:g} {unit}"
