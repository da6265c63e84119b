"""Sums of sines, and sines that grow faster."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.manoeuvres.shape import NANOSECOND


@dataclass(frozen=True)
class Multisine:
    """Sum of harmonics of the period with phases that keep its peaks low, as many whole periods as fit; peak 1.

    Phases are Schroeder's (IEEE Trans. Inf. Theory 16, 1970) for a flat spectrum. Actuators that take different harmonics are
    orthogonal over a period.
    """

    period_is: str
    harmonics: tuple[int, ...]

    @property
    def sides(self) -> str:
        """See `Shape.sides`."""
        return "±"

    def draw(self, seed: int) -> Float[np.ndarray, " levels"]:
        """See `Shape.draw`."""
        return np.empty(0)

    def share(self, elapsed: Any, period: Any, active: Any, ramp: Any, levels: Array) -> Array:
        """See `Shape.share`; the ends are joined smoothly by the wave itself, which starts where it is zero."""
        elapsed = jnp.asarray(elapsed) + NANOSECOND
        phases, shift, peak = _schroeder(self.harmonics)
        angle = 2 * jnp.pi * (elapsed / period + shift)
        wave = sum(jnp.cos(k * angle + phase) for k, phase in zip(self.harmonics, phases, strict=True)) / peak
        inside = (elapsed >= 0) & (elapsed < period * jnp.floor(active / period + NANOSECOND))
        return jnp.where(inside, wave, 0.0)

    def shortest(self, period: Any) -> Any:
        """See `Shape.shortest`: half the shortest wave."""
        return period / (2 * max(self.harmonics))

    def longest(self, active: float) -> float:
        """See `Shape.longest`."""
        return active


@dataclass(frozen=True)
class Chirp:
    """Sine whose frequency grows exponentially over the active time, by a stated ratio; it ends on a whole wave.

    The first wave is as long as the period, or longer by what makes the number of waves whole.
    """

    period_is: str
    ratio: float

    @property
    def sides(self) -> str:
        """See `Shape.sides`."""
        return "±"

    def draw(self, seed: int) -> Float[np.ndarray, " levels"]:
        """See `Shape.draw`."""
        return np.empty(0)

    def share(self, elapsed: Any, period: Any, active: Any, ramp: Any, levels: Array) -> Array:
        """See `Shape.share`."""
        elapsed = jnp.asarray(elapsed) + NANOSECOND
        growth = jnp.log(self.ratio) / active
        waves = jnp.maximum(1.0, jnp.floor((self.ratio - 1.0) / (growth * period) + NANOSECOND))
        done = jnp.expm1(growth * jnp.clip(elapsed, 0.0, active)) / (self.ratio - 1.0)
        return jnp.sin(2 * jnp.pi * waves * done)

    def shortest(self, period: Any) -> Any:
        """See `Shape.shortest`: half the shortest wave."""
        return period / (2 * self.ratio)

    def longest(self, active: float) -> float:
        """See `Shape.longest`."""
        return active


@lru_cache(maxsize=16)
def _schroeder(harmonics: tuple[int, ...]) -> tuple[tuple[float, ...], float, float]:
    """Phases, the share of the period at which the sum rises through zero, and its peak."""
    n = len(harmonics)
    phases = tuple(-np.pi * i * (i + 1) / n for i in range(n))
    at = np.linspace(0.0, 1.0, 400 * max(harmonics) + 1)
    wave = np.cos(2 * np.pi * np.outer(at, harmonics) + phases).sum(1)
    rising = int(np.flatnonzero((wave[:-1] < 0) & (wave[1:] >= 0))[0])
    shift = at[rising] - wave[rising] * (at[1] - at[0]) / (wave[rising + 1] - wave[rising])
    return phases, float(shift), float(np.abs(wave).max())
