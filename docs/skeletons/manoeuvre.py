"""Skeleton of a manoeuvre: copy to `src/seatrial/manoeuvres/`, and add an instance to `SHAPES`.

This one is a triangular wave: up in a quarter of the period, down in half of it, and back; as many whole periods as fit.
"""

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.manoeuvres.shapes import NANOSECOND, Part


@dataclass(frozen=True)
class TriangularWave:
    """Its fields are fixed settings; amplitude and period are what a design chooses."""

    period_is: str = "period"

    @property
    def sides(self) -> str:
        """See `Shape.sides`."""
        return "±"

    def draw(self, seed: int) -> Float[np.ndarray, " levels"]:
        """See `Shape.draw`: nothing here is random."""
        return np.empty(0)

    def share(self, elapsed: Any, period: Any, active: Any, ramp: Any, levels: Array) -> Array:
        """See `Shape.share`; all arguments may be arrays, and may be traced."""
        elapsed = jnp.asarray(elapsed) + NANOSECOND
        phase = elapsed / period + 0.25 - jnp.floor(elapsed / period + 0.25)
        inside = (elapsed >= 0) & (elapsed < period * jnp.floor(active / period + NANOSECOND))
        return jnp.where(inside, 1.0 - 4.0 * jnp.abs(phase - 0.5), 0.0)

    def shortest(self, period: Any) -> Any:
        """See `Shape.shortest`: from one turn to the next."""
        return period / 2

    def longest(self, active: Any) -> Any:
        """See `Shape.longest`."""
        return active

    def part(self, k: int, of: int) -> Part:
        """See `Shape.part`: the next control follows by a quarter of the period, and so on at half the period."""
        share = 0.5 ** (k // 2)
        return Part(self, delay=(k % 2) * share / 4, period=share)
