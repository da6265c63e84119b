"""Levels one after another: steps, doublets, 3-2-1-1, spirals, random and pseudo-random steps."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.manoeuvres.shape import NANOSECOND

LEVELS = 4096
"""Random levels that are drawn; a trial that needs more begins them anew."""


@dataclass(frozen=True)
class Steps:
    """Levels one after another, each held for the same share of the period, and then trim.

    Attributes:
        period_is: what the period is, in words.
        levels: shares of the amplitude; of random levels, how they are drawn.
        parts: levels to a period.
        runs: the levels run `once`; again as often as `whole` runs of them fit; or on and on, and are `cut` at the end.
    """

    period_is: str
    levels: tuple[float, ...] | Literal["uniform", "telegraph", "prbs"]
    parts: int
    runs: Literal["once", "whole", "cut"]

    @property
    def sides(self) -> str:
        """See `Shape.sides`."""
        if isinstance(self.levels, str):
            return "±"
        return {(False, True): "+", (True, False): "-"}.get((min(self.levels) < 0, max(self.levels) > 0), "±")

    def draw(self, seed: int) -> Float[np.ndarray, " levels"]:
        """See `Shape.draw`."""
        return _random_levels(self.levels, seed) if isinstance(self.levels, str) else np.array(self.levels)

    def share(self, elapsed: Any, period: Any, active: Any, ramp: Any, levels: Array) -> Array:
        """See `Shape.share`."""
        elapsed, hold = jnp.asarray(elapsed) + NANOSECOND, period / self.parts
        until = jnp.minimum(elapsed, active) if self.runs == "cut" else elapsed
        index = jnp.floor(until / hold)
        count = self._count(levels.size, hold, active)

        def level(index: Any) -> Array:
            inside = (index >= 0) & (index < count)
            return jnp.where(inside, levels[jnp.where(inside, index, 0).astype(int) % levels.size], 0.0)

        def done(since: Any) -> Array:
            return jnp.where(ramp > 0, jnp.clip(since / jnp.where(ramp > 0, ramp, 1.0), 0.0, 1.0), since >= 0)

        before, here = level(index - 1), level(index)
        share = before + (here - before) * done(until - index * hold)
        return share * (1.0 - done(elapsed - active)) if self.runs == "cut" else share

    def shortest(self, period: Any) -> Any:
        """See `Shape.shortest`."""
        return period / self.parts

    def longest(self, active: float) -> float:
        """See `Shape.longest`."""
        return active if self.runs == "cut" or isinstance(self.levels, str) else active * self.parts / len(self.levels)

    def _count(self, size: int, hold: Any, active: Any) -> Any:
        if self.runs == "cut":
            return jnp.ceil(active / hold - NANOSECOND)
        whole = jnp.floor(active / (hold * size) + NANOSECOND)
        return size * (jnp.minimum(whole, 1.0) if self.runs == "once" else whole)


@lru_cache(maxsize=64)
def _random_levels(kind: str, seed: int) -> Float[np.ndarray, " levels"]:
    random = np.random.default_rng(seed)
    if kind == "uniform":
        return random.uniform(-1.0, 1.0, LEVELS)
    if kind == "telegraph":
        return random.choice([-1.0, 1.0], LEVELS)
    return _maximal_sequence(seed)


def _maximal_sequence(seed: int) -> Float[np.ndarray, " levels"]:
    """Maximal-length sequence of +-1 of length 127, from the shift register x^7 + x^6 + 1; the seed turns it round."""
    register, levels = [1] * 7, []
    for _ in range(127):
        levels.append(2.0 * register[-1] - 1.0)
        register = [register[6] ^ register[5], *register[:-1]]
    return np.roll(levels, -(seed % 127))
