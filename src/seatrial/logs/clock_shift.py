"""How far the clocks of two logs differ: the shift at which something that both recorded correlates best."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from seatrial.core.errors import InputError

MAX_STEPS = 1 << 17
"""Steps of the grid on which the longer of two curves is compared, at most."""
MIN_OVERLAP = 0.5
"""Share of the shorter curve that has to lie on the other."""
MIN_COMMON_STEPS = 16
"""Steps in common, at least."""
RIVAL_SHARE, BEST_SHARE = 0.95, 0.99
"""Share of the best correlation from which another shift is worth naming, and down to which a shift is as good as the best."""


class Samples(NamedTuple):
    """A curve in one log: times, s, increasing, and values, NaN where there is none; shape (n,)."""

    time: Float[np.ndarray, " n"]
    value: Float[np.ndarray, " n"]


class ClockShift(NamedTuple):
    """How far two clocks differ.

    Attributes:
        shift: what to add to the stamps of the second log, s.
        correlation: there.
        rival: another shift that fits almost as well, s; None if there is none.
        lower: least shift about the best one whose correlation is nearly as high, s: how sharp the peak is.
        upper: largest such shift, s.
    """

    shift: float
    correlation: float
    rival: float | None
    lower: float
    upper: float

    def later(self, seconds: float) -> "ClockShift":
        """Return the same of a second log whose stamps are less by so many seconds."""
        rival = None if self.rival is None else self.rival + seconds
        moved = {"shift": self.shift + seconds, "lower": self.lower + seconds, "upper": self.upper + seconds}
        return self._replace(rival=rival, **moved)


def shift_between(first: Samples, second: Samples) -> ClockShift:
    """Find the shift of the second curve's clock at which it correlates best with the first, of either sign.

    Both curves become means over the steps of one grid, as long as the slower of the two samples. At each shift by whole steps Pearson's
    correlation is that of the part in common; a parabola through the best and its neighbours gives the fraction of a step.

    Args:
        first: the curve whose clock is kept.
        second: the same quantity, or one that follows it without delay: a delay between the two would be part of the shift.

    Raises:
        InputError: a curve that is too short or never moves.
    """
    first, second = (_known(one, name) for one, name in ((first, "first"), (second, "second")))
    longest = max(np.ptp(first.time), np.ptp(second.time))
    step = max(*(float(np.median(np.diff(one.time))) for one in (first, second)), longest / MAX_STEPS)
    a, b = (_means(one, step) for one in (first, second))
    lag, correlation = _correlations(a, b)
    if lag.size == 0 or not np.isfinite(correlation).any():
        raise InputError(
            "two curves to line up",
            found=f"{a.size} and {b.size} steps of {step:.3g} s, of which no {MIN_COMMON_STEPS} in common move",
            expected="curves that both move while they overlap",
            remedy="choose other columns, or type the shift",
        )
    size = np.nan_to_num(np.abs(correlation), nan=-1.0)
    best = int(np.argmax(size))
    part = 0.0
    if 0 < best < size.size - 1:
        before, here, after = size[best - 1 : best + 2]
        bend = before - 2 * here + after
        part = (
            float(np.clip(0.5 * (before - after) / bend, -0.5, 0.5)) if bend < 0 and before >= 0 and after >= 0 else 0.0
        )
    before, after = np.append(-np.inf, size[:-1]), np.append(size[1:], -np.inf)
    peaks = (size >= before) & (size > after) & (size > RIVAL_SHARE * size[best])
    peaks[best] = False
    rival = int(np.argmax(np.where(peaks, size, -np.inf))) if peaks.any() else None
    between, place = float(first.time[0] - second.time[0]), float(lag[best]) + part
    left, right = (_reach(size[::way], at) for way, at in ((-1, size.size - 1 - best), (1, best)))
    return ClockShift(
        between + place * step,
        float(correlation[best]),
        None if rival is None else between + float(lag[rival]) * step,
        between + min(lag[best] - left, place) * step,
        between + max(lag[best] + right, place) * step,
    )


def _reach(size: Float[np.ndarray, " l"], best: int) -> float:
    """Return how many steps after the best one the correlation is nearly as high, by straight lines between the steps."""
    after, level = size[best:], BEST_SHARE * size[best]
    below = np.flatnonzero(after < level)
    if not below.size:
        return float(after.size - 1)
    end = int(below[0])
    return end - 1 + float((after[end - 1] - level) / (after[end - 1] - after[end]))


def _known(curve: Samples, name: str) -> Samples:
    is_present = np.isfinite(curve.value) & np.isfinite(curve.time)
    known = Samples(np.asarray(curve.time, float)[is_present], np.asarray(curve.value, float)[is_present])
    if known.time.size < MIN_COMMON_STEPS or np.ptp(known.value) == 0 or not np.ptp(known.time) > 0:
        raise InputError(
            f"the {name} curve to line up",
            found=f"{known.time.size} numbers" + (", all the same" if known.time.size >= MIN_COMMON_STEPS else ""),
            expected=f"at least {MIN_COMMON_STEPS} that move",
            remedy="choose another column, or type the shift",
        )
    return known


def _means(curve: Samples, step: float) -> Float[np.ndarray, " m"]:
    """Means of the straight lines between the samples over each step from the first sample on, less the mean of all."""
    count = max(int(np.ptp(curve.time) / step), 1)
    area = np.concatenate([[0.0], np.cumsum(0.5 * (curve.value[1:] + curve.value[:-1]) * np.diff(curve.time))])
    edges = curve.time[0] + step * np.arange(count + 1)
    inside = np.clip(np.searchsorted(curve.time, edges, side="right") - 1, 0, curve.time.size - 2)
    past = edges - curve.time[inside]
    slope = np.diff(curve.value)[inside] / np.diff(curve.time)[inside]
    means = np.diff(area[inside] + past * (curve.value[inside] + 0.5 * slope * past)) / step
    return means - means.mean()


def _correlations(
    a: Float[np.ndarray, " m"], b: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " l"], Float[np.ndarray, " l"]]:
    """Shifts by whole steps with enough in common, and Pearson's correlation of a[i + shift] and b[i] at each; NaN where one is flat."""
    lag = np.arange(1 - b.size, a.size)
    start, stop = np.maximum(lag, 0), np.minimum(a.size, b.size + lag)
    count = stop - start
    size = 1 << int(np.ceil(np.log2(a.size + b.size)))
    product = np.fft.irfft(np.fft.rfft(a, size) * np.conj(np.fft.rfft(b, size)), size)[lag]

    def sums(values: np.ndarray, first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        once, squared = (np.concatenate([[0.0], np.cumsum(values**power)]) for power in (1, 2))
        return once[last] - once[first], squared[last] - squared[first]

    (sum_a, square_a), (sum_b, square_b) = sums(a, start, stop), sums(b, start - lag, stop - lag)
    spread = (square_a - sum_a**2 / count, square_b - sum_b**2 / count)
    with np.errstate(invalid="ignore", divide="ignore"):
        correlations = (product - sum_a * sum_b / count) / np.sqrt(spread[0] * spread[1])
    flat = (spread[0] <= 1e-9 * square_a.max()) | (spread[1] <= 1e-9 * square_b.max())
    enough = count >= max(MIN_COMMON_STEPS, MIN_OVERLAP * min(a.size, b.size))
    return lag[enough], np.where(flat, np.nan, np.clip(correlations, -1.0, 1.0))[enough]
