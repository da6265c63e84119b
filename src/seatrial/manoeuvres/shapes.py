"""Every shape of an open-loop input by its name in a campaign file."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import log, pi
from typing import Any, Literal, Protocol

import numpy as np
from jaxtyping import Array, Float

from seatrial.numerics.array_module import array_module

# What the shape of an open-loop input is: share of the amplitude, from -1 to 1, as a function of the time since the
# start.
#
# Every shape has one time of its own, its period: of a doublet, of one level, of the longest wave. Amplitude and
# period are what a design chooses. Functions take NumPy or JAX arrays, and may be batched over settings.

# Times that should be equal differ by rounding (k * 0.01 s against 1 + j * period); a nanosecond decides.
NANOSECOND = 1e-9


@dataclass(frozen=True)
class Part:
    """How one of several controls that move together runs a shape.

    Attributes:
        shape: that it runs.
        delay: of its begin, as a share of the period.
        period: its own, as a share of the period.
        seed: added to that of random levels.
    """

    shape: "Shape"
    delay: float = 0.0
    period: float = 1.0
    seed: int = 0


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
        """Return the levels one after another, shares of the amplitude; none of a smooth shape."""
        ...

    def share(self, elapsed: Any, period: Any, active: Any, ramp: Any, levels: Float[Array, " levels"]) -> Array:
        """Return the share of the amplitude.

        Args:
            elapsed: time since the start, s, any shape; the settings broadcast against it.
            period: s.
            active: time for which the input may differ from trim, s.
            ramp: time every edge takes, from one level to the next, s; 0 for a step.
            levels: as drawn.
        """
        ...

    def shortest(self, period: Any) -> Any:
        """Return the shortest time between two turns of the input, s: what a ramp must fit into."""
        ...

    def longest(self, active: Any) -> Any:
        """Return the longest period that fits into the active time, s."""
        ...

    def part(self, k: int, longer: Sequence[float]) -> Part:
        """Return what the k-th of several controls runs, so that all together are orthogonal over whole periods, or nearly so.

        Args:
            k: from 0.
            longer: period of each control over that of the first.
        """
        ...


# Levels one after another: steps, doublets, 3-2-1-1, spirals, random and pseudo-random steps.

LEVELS = 4096  # Random levels that are drawn; a trial that needs more begins them anew


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
        xp = array_module(elapsed, period)
        elapsed, hold = xp.asarray(elapsed), period / self.parts
        until = xp.minimum(elapsed, active) if self.runs == "cut" else elapsed
        index = xp.floor((until + NANOSECOND) / hold)
        count = self._count(levels.size, hold, active)

        def level(index: Any) -> Array:
            inside = (index >= 0) & (index < count)
            return xp.where(inside, xp.asarray(levels)[xp.where(inside, index, 0).astype(int) % levels.size], 0.0)

        def done(since: Any) -> Array:
            return xp.where(ramp > 0, xp.clip(since / xp.where(ramp > 0, ramp, 1.0), 0.0, 1.0), since >= -NANOSECOND)

        before, here = level(index - 1), level(index)
        share = before + (here - before) * done(until - index * hold)
        return share * (1.0 - done(elapsed - active)) if self.runs == "cut" else share

    def shortest(self, period: Any) -> Any:
        """See `Shape.shortest`."""
        return period / self.parts

    def longest(self, active: Any) -> Any:
        """See `Shape.longest`."""
        return active if self.runs == "cut" or isinstance(self.levels, str) else active * self.parts / len(self.levels)

    def part(self, k: int, longer: Sequence[float]) -> Part:
        """See `Shape.part`.

        Doublets of equal period a quarter of it apart are orthogonal, and so are those of half the period (Rademacher functions). 3-2-1-1
        is Barker's code of seven, whose copies three levels apart have correlation 0 or -1/7. Sequences are other ones, or the same
        further on; single steps come one after the other.
        """
        if isinstance(self.levels, str):
            seed = k * (127 // len(longer)) if self.levels == "prbs" else k * 104_729
            return Part(self, period=longer[k], seed=seed)
        if self.levels == (1.0, -1.0):
            share = 0.5 ** (k // 2) * longer[k]
            return Part(self, delay=(k % 2) * share / 4, period=share)
        # Single steps come one after the other; patterns begin at turns of the one before.
        delay = sum(longer[:k]) if self.parts == 1 else 3 * k / self.parts * longer[k]
        return Part(self, delay=delay, period=longer[k])

    def _count(self, size: int, hold: Any, active: Any) -> Any:
        xp = array_module(hold)
        if self.runs == "cut":
            return xp.ceil(active / hold - NANOSECOND)
        whole = xp.floor(active / (hold * size) + NANOSECOND)
        return size * (xp.minimum(whole, 1.0) if self.runs == "once" else whole)


@lru_cache(maxsize=64)
def _random_levels(kind: str, seed: int) -> Float[np.ndarray, " levels"]:
    random = np.random.default_rng(seed)
    if kind == "uniform":
        return random.uniform(-1.0, 1.0, LEVELS)
    if kind == "telegraph":
        return random.choice([-1.0, 1.0], LEVELS)
    # The maximal-length sequence of +-1 of length 127, from the shift register x^7 + x^6 + 1; the seed turns it round.
    register, levels = [1] * 7, []
    for _ in range(127):
        levels.append(2.0 * register[-1] - 1.0)
        register = [register[6] ^ register[5], *register[:-1]]
    return np.roll(levels, -(seed % 127))


class Wave:
    """What sums of sines, and sines that grow faster, have in common: no levels, both sides of trim, and the whole active time."""

    sides = "±"

    def draw(self, seed: int) -> Float[np.ndarray, " levels"]:
        """See `Shape.draw`."""
        return np.empty(0)

    def longest(self, active: Any) -> Any:
        """See `Shape.longest`."""
        return active


@dataclass(frozen=True)
class Multisine(Wave):
    """Sum of harmonics of the period with phases that keep its peaks low, as many whole periods as fit; peak 1.

    Phases are Schroeder's (IEEE Trans. Inf. Theory 16, 1970) for a flat spectrum, and begin the search for those of the lowest peak where
    several controls share the harmonics: these are orthogonal over a period.

    Attributes:
        period_is: what the period is, in words.
        harmonics: of the period.
        lowest: whether the phases of the lowest peak are sought, see `low_peak_phases`.
    """

    period_is: str
    harmonics: tuple[int, ...]
    lowest: bool = False

    def share(self, elapsed: Any, period: Any, active: Any, ramp: Any, levels: Array) -> Array:
        """See `Shape.share`; the ends are joined smoothly by the wave itself, which starts where it is zero."""
        xp = array_module(elapsed, period)
        elapsed = xp.asarray(elapsed)
        phases, shift, peak = _phases(self.harmonics, self.lowest)
        angle = 2 * pi * (elapsed / period + shift)
        wave = sum(xp.cos(k * angle + phase) for k, phase in zip(self.harmonics, phases, strict=True)) / peak
        end = period * xp.floor(active / period + NANOSECOND)
        inside = (elapsed >= -NANOSECOND) & (elapsed < end - NANOSECOND)
        return xp.where(inside, wave, 0.0)

    def shortest(self, period: Any) -> Any:
        """See `Shape.shortest`: half the shortest wave."""
        return period / (2 * max(self.harmonics))

    def part(self, k: int, longer: Sequence[float]) -> Part:
        """See `Shape.part`: of as many controls every so many-th harmonic, of those whose frequency no earlier control has."""
        taken: set[float] = set()
        own = self.harmonics
        for i, period in enumerate(longer[: k + 1]):
            free = [h for h in self.harmonics if round(h / period, 9) not in taken]
            own = tuple(free[:: len(longer) - i])
            taken |= {round(h / period, 9) for h in own}
        return Part(Multisine(self.period_is, own, lowest=True), period=longer[k])


@dataclass(frozen=True)
class Chirp(Wave):
    """Sine whose frequency grows exponentially over the active time, by a stated ratio; it ends on a whole wave.

    The first wave is as long as the period, or longer by what makes the number of waves whole.
    """

    period_is: str
    ratio: float

    def share(self, elapsed: Any, period: Any, active: Any, ramp: Any, levels: Array) -> Array:
        """See `Shape.share`."""
        xp = array_module(elapsed, period)
        elapsed = xp.asarray(elapsed)
        growth = log(self.ratio) / active
        waves = xp.maximum(1.0, xp.floor((self.ratio - 1.0) / (growth * period) + NANOSECOND))
        done = xp.expm1(growth * xp.clip(elapsed, 0.0, active)) / (self.ratio - 1.0)
        return xp.sin(2 * pi * waves * done)

    def shortest(self, period: Any) -> Any:
        """See `Shape.shortest`: half the shortest wave."""
        return period / (2 * self.ratio)

    def part(self, k: int, longer: Sequence[float]) -> Part:
        """See `Shape.part`: later by a quarter of the first wave, so that two are never at one frequency at a time."""
        return Part(self, delay=k / 4, period=longer[k])


def low_peak_phases(harmonics: tuple[int, ...], rounds: int = 300) -> tuple[float, ...]:
    """Return phases of a sum of cosines of equal amplitude with a low peak, rad.

    The sum is clipped, and takes the phases of what is left, again and again (Van der Ouderaa, Schoukens and Renneboog, IEEE Trans.
    Instrum. Meas. 37, 1988); the best sum on the way is kept.

    Args:
        harmonics: of the period.
        rounds: how often.
    """
    size = 64 * max(harmonics)
    places, angle = np.array(harmonics), 2 * np.pi * np.arange(size) / size
    phases, best = np.array(_schroeder(len(harmonics))), (np.inf, ())
    for level in np.linspace(0.75, 0.99, rounds):
        wave = np.cos(np.outer(angle, places) + phases).sum(1)
        peak = float(np.abs(wave).max())
        best = min(best, (peak, tuple(map(float, phases))))
        phases = np.angle(np.fft.rfft(np.clip(wave, -level * peak, level * peak))[places])
    return best[1]


def _schroeder(n: int) -> tuple[float, ...]:
    return tuple(-np.pi * i * (i + 1) / n for i in range(n))


@lru_cache(maxsize=16)
def _phases(harmonics: tuple[int, ...], lowest: bool) -> tuple[tuple[float, ...], float, float]:
    """Return the phases, the share of the period at which the sum rises through zero, and its peak."""
    phases = low_peak_phases(harmonics) if lowest else _schroeder(len(harmonics))
    at = np.linspace(0.0, 1.0, 400 * max(harmonics) + 1)
    wave = np.cos(2 * np.pi * np.outer(at, harmonics) + phases).sum(1)
    rising = int(np.flatnonzero((wave[:-1] < 0) & (wave[1:] >= 0))[0])
    shift = at[rising] - wave[rising] * (at[1] - at[0]) / (wave[rising + 1] - wave[rising])
    return phases, float(shift), float(np.abs(wave).max())


DOWN = (1.0, 0.6, 0.3, 0.1, 0.0, -0.1, -0.3, -0.6, -1.0)
# Every shape by its name in a campaign file.
SHAPES: dict[str, Shape] = {
    "step": Steps("time away from trim", (1.0,), 1, "once"),
    "free-decay": Steps("time away from trim", (-1.0,), 1, "once"),
    "turning-circle": Steps("time of the turn", (1.0,), 1, "once"),
    "doublet": Steps("period", (1.0, -1.0), 2, "once"),
    "repeated-doublet": Steps("period", (1.0, -1.0), 2, "whole"),
    "multistep-3211": Steps("period of the pattern", (1.0, 1.0, 1.0, -1.0, -1.0, 1.0, -1.0), 7, "whole"),
    "spiral": Steps("time at each angle", (*DOWN, *DOWN[-2::-1]), 1, "once"),
    "random-steps": Steps("time at each level", "uniform", 1, "cut"),
    "telegraph": Steps("time at each level", "telegraph", 1, "cut"),
    "prbs": Steps("clock of the sequence", "prbs", 1, "cut"),
    "multisine": Multisine("longest wave", tuple(range(1, 11))),
    "chirp": Chirp("first wave", 8.0),
}
