"""What the shape of an open-loop input is: share of the amplitude, from -1 to 1, as a function of the time since the start.

Every shape has one time of its own, its period: of a doublet, of one level, of the longest wave. Amplitude and period are what a
design chooses. Functions take NumPy or JAX arrays, and may be batched over settings.
"""

from typing import Any, Protocol

import numpy as np
from jaxtyping import Array, Float

NANOSECOND = 1e-9
"""Times that should be equal differ by rounding (k * 0.01 s against 1 + j * period); a nanosecond decides."""


class Shape(Protocol):
    """What every shape offers."""

    @property
    def period_is(self) -> str:
        """What the period is, in words."""
        ...

    @property
    def sides(self) -> str:
        """Sign of the sides of trim to which it goes: `+`, `-` or `±`."""
        ...

    def draw(self, seed: int) -> Float[np.ndarray, " levels"]:
        """Levels one after another, shares of the amplitude; none of a smooth shape."""
        ...

    def share(self, elapsed: Any, period: Any, active: Any, ramp: Any, levels: Float[Array, " levels"]) -> Array:
        """Share of the amplitude.

        Args:
            elapsed: time since the start, s, any shape; the settings broadcast against it.
            period: s.
            active: time for which the input may differ from trim, s.
            ramp: time every edge takes, from one level to the next, s; 0 for a step.
            levels: as drawn.
        """
        ...

    def shortest(self, period: Any) -> Any:
        """Shortest time between two turns of the input, s: what a ramp must fit into."""
        ...

    def longest(self, active: float) -> float:
        """Longest period that fits into the active time, s."""
        ...
