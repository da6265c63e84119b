"""A trial as it is commanded: controls over time, each value held from sample to sample."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, eq=False)
class Schedule:
    """Controls over time.

    Attributes:
        time: sample times, s, rising from 0, shape (n,).
        controls: by name, held from each sample to the next, SI, each of shape (n,).
    """

    time: Float[np.ndarray, " n"]
    controls: Mapping[str, Float[np.ndarray, " n"]]

    def columns(self, trim: Sequence[tuple[str, float]]) -> dict[str, Float[np.ndarray, " n"]]:
        """Return every control of a vehicle, SI, in its order; those that the schedule leaves alone are held at trim."""
        return {name: self.controls.get(name, np.full(self.time.size, value)) for name, value in trim}
