"""By how much is a measured channel early or late against the commands? A search far beyond any delay, for files with clocks of their own.

At each shift s the channel is fitted, by least squares, with

    y(t) = c + a e(t - s) + b (e * h)(t - s),    h(t) = exp(-t / tau) / tau,    a + b > 0,

where e is what one vehicle of the priors would show. Vehicles that are slower or quicker than those of the priors are among these, but all
begin to move when the command does: that tells them from a shift. Two shifts are compared by the squared residuals of the same samples,
whose number is divided by the time over which the residuals are correlated (likelihood ratio of normal errors).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Float

SHARE = 0.5  # Share of the record up to which it is shifted, at most
CELLS = 4096  # Cells of the grid, at most
# Means are taken over so many seconds, or over one of so many pieces of a record where that is shorter: white noise
# counts less then.
MEAN, PIECES = 0.5, 200
START = 4.0  # Seconds at the start that are left out, or a fortieth of the record where that is shorter
LAGS = 6  # Time constants tau that are tried, from two cells to an eighth of the record
NEAREST = 12  # Vehicles with which all of these are tried: those that come nearest with one of them
EXPLAINED = 0.5  # Share of the motion that the best fit has to explain
# Twice the log likelihood ratio, and logarithm of the ratio of squared residuals, from which one shift is better than
# another: the first is far beyond chance among a hundred shifts, as few transients are no large sample; the second
# allows for what the vehicles lack.
SURE, BETTER = 40.0, 0.25
HALO = 0.5  # By how much that logarithm may be off where the samples of two shifts are not the same
APART = 4.0  # Seconds between shifts from which they are alternatives
MIN_CELLS = 50  # Cells with a measurement, at least
# Order of the autoregression that makes residuals white, and the share of white noise that is added to them for it.
ORDER, NUGGET = 12, 1e-3
_RIDGE = 1e-9


class Shifts(NamedTuple):
    """Shifts next to each other that fit alike: the best of them, the least and the greatest, s; positive where the channel is late."""

    best: float
    least: float
    greatest: float


class Timing(NamedTuple):
    """Which shifts explain a channel.

    Attributes:
        likely: those that nothing explains better, the smallest first; several where the motion repeats, none if its sign is reversed.
        is_in_time: whether no shift is among them, or between them.
        is_reversed: whether the reversed channel, without a shift, is explained as well as any.
    """

    likely: tuple[Shifts, ...]
    is_in_time: bool
    is_reversed: bool

    @property
    def within(self) -> float:
        """Largest likely shift of either sign, s."""
        return max((max(-one.least, one.greatest) for one in self.likely), default=0.0)


def find_timing(
    time: Float[np.ndarray, " n"], measured: Float[np.ndarray, " n"], expected: Float[np.ndarray, "d n"], most: float
) -> Timing | None:
    """Return which shifts explain a channel; None if none explains enough of its motion, or too few samples are there.

    Args:
        time: of the record, s.
        measured: SI, NaN if not measured.
        expected: of vehicles of the priors, SI, finite.
        most: largest shift, s.
    """
    grid = _gridded(time, measured, expected, most)
    if np.count_nonzero(grid.weight) < MIN_CELLS or not grid.moving.size:
        return None
    taus = np.geomspace(2 * grid.step, grid.step * grid.y.size / 8, LAGS)
    nearest = np.argsort(
        [min(left[0].min(), left[2].min()) for left in (_left(grid, e, taus[LAGS // 2]) for e in grid.moving)]
    )
    ways = [(e, tau) for e in grid.moving[nearest[:NEAREST]] for tau in taus]
    shifted, unshifted, turned = (np.stack(some) for some in zip(*(_left(grid, *way) for way in ways), strict=True))
    count = np.maximum(_within(grid, grid.weight), 1e-300)
    moved = _within(grid, grid.weight * grid.y**2) - _within(grid, grid.weight * grid.y) ** 2 / count
    with np.errstate(divide="ignore", invalid="ignore"):
        gain, opposite = (
            np.where(left.min(0) <= (1 - EXPLAINED) * moved, np.log(unshifted.min(0)) - np.log(left.min(0)), -np.inf)
            for left in (shifted, turned)
        )
    if not np.isfinite(gain).any():
        return Timing((), False, True) if np.isfinite(opposite).any() else None
    best = int(np.argmax(gain))
    tried = (ways[way] for way in shifted.argmin(0))
    fits = [_Fit(e, tau, int(lag)) for (e, tau), lag in zip(tried, grid.lag, strict=True)]
    noise = _Noise.of(_residuals(grid, fits[best], fits[best].lag))
    lead = opposite[best] - gain[best]
    if noise.tells(lead):
        return Timing((), False, True)
    doubtful = np.flatnonzero([not noise.tells(gain[best] - one - HALO) for one in gain])
    likely = [at for at in doubtful if at == best or not _is_worse(grid, fits[at], fits[best], noise)]
    stretches = _stretches(grid.step, grid.lag[likely], gain[likely])
    return Timing(stretches, any(one.least <= 0 <= one.greatest for one in stretches), not noise.tells(-lead))


@dataclass(frozen=True, eq=False)
class _Grid:
    """A channel and the expected motion as means over even cells.

    Attributes:
        step: from cell to cell, s.
        y: channel, 0 if it is not measured.
        weight: of each cell, 0 if the channel is not measured.
        moving: expected motion of the vehicles that move, in units of its standard deviation, shape (d, m).
        lag: shifts in cells.
    """

    step: float
    y: Float[np.ndarray, " m"]
    weight: Float[np.ndarray, " m"]
    moving: Float[np.ndarray, "d m"]
    lag: np.ndarray


def _gridded(time: np.ndarray, measured: np.ndarray, expected: np.ndarray, most: float) -> _Grid:
    step = max(float(np.median(np.diff(time))), float(np.ptp(time)) / CELLS)
    size = int(np.ptp(time) / step) + 1
    there = np.isfinite(measured)
    place = np.minimum(np.rint((time[there] - time[0]) / step).astype(int), size - 1)
    y = measured[there] - measured[there].mean() if there.any() else measured[there]
    window = np.ones(max(round(min(MEAN, step * size / PIECES) / step), 1))
    count, total = (np.convolve(np.bincount(place, weights, size), window, "same") for weights in (np.ones(y.size), y))
    count = np.where((count > 0.5) & (np.arange(size) >= _start(step, size)), count, 0.0)
    even = time[0] + step * np.arange(size)
    e = np.array([np.interp(even, time, one) for one in expected]).reshape(len(expected), size)
    e = scipy.ndimage.uniform_filter1d(e, window.size, axis=1, mode="nearest")
    spread = e.std(axis=1)
    moves = spread > 1e-9 * np.abs(e).max(axis=1, initial=0.0)
    moving = (e[moves] - e[moves].mean(axis=1, keepdims=True)) / spread[moves, None]
    reach = min(round(most / step), int(SHARE * size))
    return _Grid(
        step, np.where(count > 0, total / np.maximum(count, 1.0), 0.0), count, moving, np.arange(-reach, reach + 1)
    )


def _columns(e: np.ndarray, step: float, tau: float) -> np.ndarray:
    """Return the regressors: a constant, the motion, and the same behind a lag of first order, but for the start; shape (3, m)."""
    keep = np.exp(-step / tau)
    columns = np.stack([np.ones(e.size), e, e[0] + scipy.signal.lfilter([1 - keep], [1, -keep], e - e[0])])
    columns[:, : _start(step, e.size)] = 0.0
    return columns


def _start(step: float, size: int) -> int:
    """Return how many cells at the start are left out: where the simulated motion begins is not known if the clocks are not."""
    return round(min(START, size * step / PIECES * 5) / step)


def _left(grid: _Grid, e: np.ndarray, tau: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Squared residuals at each shift, and of the same samples without a shift and without a shift but reversed."""
    columns = _columns(e, grid.step, tau)
    size = scipy.fft.next_fast_len(2 * e.size, real=True)
    spectra = {False: np.fft.rfft(grid.weight, size), True: np.fft.rfft(grid.weight * grid.y, size)}

    def sums(column: np.ndarray, *, by_y: bool) -> tuple[np.ndarray, np.ndarray]:
        """Sum over the channel's samples of a column that is shifted, and of one that is not."""
        weight = grid.weight * grid.y if by_y else grid.weight
        over = np.fft.irfft(spectra[by_y] * np.conj(np.fft.rfft(column, size)), size)[grid.lag]
        return over, _within(grid, weight * column)

    one, motion, lagged = columns
    count, of_y = (np.stack(sums(one, by_y=by_y)) for by_y in (False, True))
    count = np.maximum(count, 1e-300)
    of = {name: np.stack(sums(column, by_y=False)) for name, column in (("e", motion), ("h", lagged))}

    def about_means(column: np.ndarray, mean: np.ndarray, other: np.ndarray, *, by_y: bool = False) -> np.ndarray:
        return np.stack(sums(column, by_y=by_y)) - mean * other / count

    ee, eh, hh = (
        about_means(a * b, of[i], of[k]) + ridge * _RIDGE * np.maximum(count, 1.0)
        for a, b, i, k, ridge in (
            (motion, motion, "e", "e", 1),
            (motion, lagged, "e", "h", 0),
            (lagged, lagged, "h", "h", 1),
        )
    )
    ey, hy = (about_means(a, of[i], of_y, by_y=True) for a, i in ((motion, "e"), (lagged, "h")))
    square = _within(grid, grid.weight * grid.y**2)
    flat = square - _within(grid, grid.weight * grid.y) ** 2 / count[1]
    area = np.maximum(ee * hh - eh**2, 1e-300)
    a, b = (hh * ey - eh * hy) / area, (ee * hy - eh * ey) / area
    left = np.maximum(square - of_y**2 / count - a * ey - b * hy, 1e-12 * square)
    is_with = a + b > 0
    return (
        np.where(is_with[0], left[0], flat),
        np.where(is_with[1], left[1], flat),
        np.where(is_with[1], flat, left[1]),
    )


def _within(grid: _Grid, values: np.ndarray) -> np.ndarray:
    """Sum over the samples that have an expected motion beside them, at each shift."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    return (
        total[values.size + np.minimum(grid.lag, 0)] - total[_start(grid.step, values.size) + np.maximum(grid.lag, 0)]
    )


class _Fit(NamedTuple):
    """The best fit at a shift: expected motion, time constant, s, and the shift in cells."""

    e: np.ndarray
    tau: float
    lag: int


def _residuals(grid: _Grid, fit: _Fit, *covers: int) -> np.ndarray:
    """Weighted residuals, of the samples that have an expected motion beside them at the shift of the fit and at some others."""
    first = _start(grid.step, grid.y.size) + max(fit.lag, *covers, 0)
    last = grid.y.size + min(fit.lag, *covers, 0)
    root = np.sqrt(grid.weight[first:last])
    columns = _columns(fit.e, grid.step, fit.tau)[:, first - fit.lag : last - fit.lag].T * root[:, None]
    y, normal = grid.y[first:last] * root, columns.T @ columns
    return y - columns @ np.linalg.solve(normal + _RIDGE * max(normal[0, 0], 1.0) * np.eye(3), columns.T @ y)


def _is_worse(grid: _Grid, fit: _Fit, best: _Fit, noise: "_Noise") -> bool:
    """Return whether a shift fits worse than the best one, by the samples of both."""
    left, least = _residuals(grid, fit, best.lag), _residuals(grid, best, fit.lag)
    behind = float(np.log(left @ left) - np.log(least @ least))
    return behind >= BETTER and (noise.tells(behind) or noise.misfit(left) - noise.misfit(least) >= SURE)


class _Noise(NamedTuple):
    """What residuals that fit are like.

    Attributes:
        worth: independent samples that they are worth: Geyer's initial positive sequence.
        whitener: filter that makes them white, by an autoregression (Yule and Walker).
        variance: of them then.
    """

    worth: float
    whitener: np.ndarray
    variance: float

    @classmethod
    def of(cls, residual: np.ndarray) -> "_Noise":
        size = scipy.fft.next_fast_len(2 * residual.size, real=True)
        covariance = np.fft.irfft(np.abs(np.fft.rfft(residual, size)) ** 2, size)[: residual.size]
        below = np.flatnonzero(covariance <= 0)
        last = int(below[0]) if below.size else residual.size
        worth = residual.size / (2 * covariance[:last].sum() / covariance[0] - 1)
        column = covariance[:ORDER] + np.eye(1, ORDER)[0] * NUGGET * covariance[0]
        whitener = np.append(1.0, -scipy.linalg.solve_toeplitz(column, covariance[1 : ORDER + 1]))
        white = scipy.signal.lfilter(whitener, [1.0], residual)
        return cls(max(worth, 1.0), whitener, float(np.mean(white**2)))

    def tells(self, behind: float) -> bool:
        """Return whether a logarithm of the ratio of squared residuals is more than chance."""
        return behind >= max(BETTER, SURE / self.worth)

    def misfit(self, residual: np.ndarray) -> float:
        """Return twice the negative log likelihood of some residuals, but for a constant."""
        return float(np.sum(scipy.signal.lfilter(self.whitener, [1.0], residual) ** 2)) / self.variance


def _stretches(step: float, lag: np.ndarray, gain: np.ndarray) -> tuple[Shifts, ...]:
    """Return shifts in stretches, one if they are less than `APART` from the next, the smallest first."""
    parts = np.split(np.arange(lag.size), np.flatnonzero(np.diff(lag) * step > APART) + 1)
    result = [
        Shifts(*(float(step * lag[at]) for at in (part[np.argmax(gain[part])], part[0], part[-1]))) for part in parts
    ]
    return tuple(sorted(result, key=lambda one: abs(one.best)))
