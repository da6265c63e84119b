"""Linear lags with delayed inputs: their exact response to held controls, and their fit by least squares of the simulated output.

    T_i dx_i/dt = sum_j K_ij c_j(t - d) - x_i,    y = sum_i x_i + b

Simulated from the measurement y_s at t_s, where every x_i but the slowest goes on from its response since the beginning of the run,
and the slowest takes what is left of y_s, so that

    y(t) = y_s e + sum_ij K_ij (S_ij(t) - e S_ij(t_s)) + b (1 - e),    e = exp(-(t - t_s) / T_1)

with S_ij the response of unit gain, in equilibrium with the first control when the run begins. The controls are held from sample
to sample, so that S is exact at any time. Gains and offset are linear in it: they follow in closed form for each choice of time
constants and delay (separable least squares: Golub and Pereyra, SIAM J. Numer. Anal. 10, 1973), of which the best of a grid is refined.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import sqrt
from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Float, Int

ROWS = 2000  # Measured samples, evenly taken from all, on which the grid is judged
CONSTANTS = {1: 24, 2: 12}  # Time constants in the grid, by order
DELAYS = {1: 10, 2: 4}  # Delays in the grid, by order
LATEST = 0.05  # Longest delay, in lengths of the median run; longer ones are not told from a slow lag
LONGEST = 10.0  # Longest time constant, in lengths of the longest run: an integrator


class Run(NamedTuple):
    """One channel of one run and the controls that move it: time, s, shape (n,); controls (n, k); measurements (n,), NaN if none."""

    time: Float[np.ndarray, " n"]
    control: Float[np.ndarray, "n k"]
    measured: Float[np.ndarray, " n"]

    @property
    def there(self) -> Int[np.ndarray, " m"]:
        """Indices of the samples that were measured."""
        return np.flatnonzero(np.isfinite(self.measured))


@dataclass(frozen=True, eq=False)
class Lags:
    """One channel as a sum of lags of the same controls.

    Attributes:
        time_constants: s, the slowest first, shape (o,).
        delay: of the controls, s.
        gains: static gain of each lag from each control, unit of the channel over that of the control, shape (o, k).
        offset: b, in the unit of the channel.
    """

    time_constants: tuple[float, ...]
    delay: float
    gains: Float[np.ndarray, "o k"]
    offset: float

    def simulate(self, run: Run, start: int = 0) -> Float[np.ndarray, " n"]:
        """Return the output at every sample of a run from its first measurement at or after `start`, and that value before it."""
        shape = _Shape(self.time_constants, self.delay)
        free, regressors = _design(run, shape, np.arange(run.time.size), start)
        return free + regressors @ np.append(self.gains.ravel(), self.offset)


class _Shape(NamedTuple):
    """What the output is not linear in: time constants, the slowest first, and the delay, s."""

    time_constants: tuple[float, ...]
    delay: float


def lag_response(
    time: Float[np.ndarray, " n"],
    control: Float[np.ndarray, "n k"],
    time_constant: float,
    delay: float,
    at: Int[np.ndarray, " m"],
) -> Float[np.ndarray, "m k"]:
    """Return the response of T dx/dt = c(t - d) - x at some samples, exact for controls held from sample to sample.

    Args:
        time: s, strictly increasing.
        control: SI; before the first sample it was as there, and x in equilibrium with it.
        time_constant: T, s.
        delay: d, s, not negative.
        at: indices of the samples that are wanted.
    """
    change = control - control[0]
    decay = np.exp(-np.diff(time) / time_constant)
    bands = np.ones((2, time.size))
    bands[1, :-1] = -decay
    driven = np.zeros_like(change)
    driven[1:] = (1 - decay)[:, None] * change[:-1]
    response = scipy.linalg.solve_banded((1, 0), bands, driven, check_finite=False)
    seen = time[at] - delay
    before = np.searchsorted(time, seen, side="right") - 1
    known = before >= 0
    left = np.where(known, np.exp(-np.where(known, seen - time[before], 0.0) / time_constant), 1.0)[:, None]
    return control[0] + np.where(known[:, None], left * response[before] + (1 - left) * change[before], 0.0)


def longest_delay(runs: Sequence[Run]) -> float:
    """Return the longest delay that is tried, s."""
    return LATEST * float(np.median([np.ptp(run.time) for run in runs]))


def fit_lags(runs: Sequence[Run], order: int = 1) -> Lags:
    """Fit a channel of several runs by least squares of its simulation.

    Args:
        runs: each with a measurement at least, the same controls in all.
        order: number of lags, 1 or 2.
    """
    usual = float(np.median(np.concatenate([np.diff(run.time) for run in runs])))
    longest = LONGEST * max(float(np.ptp(run.time)) for run in runs)
    latest = longest_delay(runs)
    constants = np.geomspace(longest, 0.5 * usual, CONSTANTS[order])
    delays = np.append(0.0, np.geomspace(min(usual, latest), latest, DELAYS[order] - 1))
    thin = _rows_of(runs, ROWS)
    cost = _cost(runs, thin)
    grid = [_Shape(chosen, delay) for chosen in combinations(constants.tolist(), order) for delay in delays.tolist()]
    best = min(grid, key=cost)
    shape = _refined(_cost(runs, _rows_of(runs, 10 * ROWS)), best, (0.5 * usual, longest), latest, constants, usual)
    theta = _solve(runs, _rows_of(runs), shape)[0]
    return Lags(shape.time_constants, shape.delay, theta[:-1].reshape(order, -1), float(theta[-1]))


def _refined(
    cost: Callable[[_Shape], float],
    best: _Shape,
    bounds: tuple[float, float],
    latest: float,
    constants: np.ndarray,
    usual: float,
) -> _Shape:
    """Improve a shape from the grid by the simplex of Nelder and Mead (1965), in the logarithms of the time constants and in the delay."""
    order = len(best.time_constants)

    def shape_of(x: np.ndarray) -> _Shape:
        slowest_first = sorted(np.exp(x[:order]).tolist(), reverse=True)
        return _Shape(tuple(slowest_first), float(x[order]) * latest)

    start = np.append(np.log(best.time_constants), best.delay / latest)
    limits = [tuple(np.log(bounds))] * order + [(0.0, 1.0)]
    ratio = 0.5 * np.log(constants[0] / constants[1])
    away = np.append(np.full(order, -ratio), min(0.5, max(usual / latest, 0.3 * start[-1])))
    away = np.where([low <= x <= high for x, (low, high) in zip(start + away, limits, strict=True)], away, -away)
    simplex = np.vstack([start, start + np.diag(away)])
    result = scipy.optimize.minimize(
        lambda x: cost(shape_of(x)),
        start,
        method="Nelder-Mead",
        bounds=limits,
        options={"initial_simplex": simplex, "xatol": 1e-5, "fatol": 1e-12 * cost(best), "maxfev": 400},
    )
    return shape_of(result.x)


def _rows_of(runs: Sequence[Run], most: int | None = None) -> list[np.ndarray]:
    """Return indices of measured samples of each run, about `most` in all."""
    there = [run.there for run in runs]
    every = 1 if most is None else -(-sum(map(len, there)) // most)
    return [one[::every] for one in there]


def _cost(runs: Sequence[Run], rows: Sequence[np.ndarray]) -> Callable[[_Shape], float]:
    return lambda shape: _solve(runs, rows, shape)[1]


def _solve(runs: Sequence[Run], rows: Sequence[np.ndarray], shape: _Shape) -> tuple[np.ndarray, float]:
    """Return gains and offset for a shape, and the sum of squares that they leave at some rows."""
    designs = [_design(run, shape, at) for run, at in zip(runs, rows, strict=True)]
    target = np.concatenate([run.measured[at] - free for run, at, (free, _) in zip(runs, rows, designs, strict=True)])
    regressors = np.concatenate([phi for _, phi in designs])
    size = np.linalg.norm(regressors, axis=0)
    size[size == 0] = 1.0
    theta = np.linalg.lstsq(regressors / size, target, rcond=1e-9)[0] / size
    left = target - regressors @ theta
    return theta, float(left @ left)


def _design(run: Run, shape: _Shape, at: np.ndarray, start: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return what is left of the measurement started from, and what gains and offset are multiplied by, at some samples."""
    there = run.there
    first = int(there[np.searchsorted(there, start)])
    both = np.append(at, first)
    responses = [lag_response(run.time, run.control, constant, shape.delay, both) for constant in shape.time_constants]
    every = np.column_stack([*responses, np.ones(both.size)])
    decay = np.exp(-np.maximum(run.time[at] - run.time[first], 0.0) / shape.time_constants[0])
    regressors = every[:-1] - decay[:, None] * every[-1]
    regressors[at < first] = 0.0
    return run.measured[first] * decay, regressors


# Norrbin's cubic lag, for yaw behind a rudder: its simulation and its fit by least squares of the simulated output.
#
#     dr/dt = k c(t - d) + b - alpha r - beta r^3,    beta >= 0
#
# is T dr/dt = K c + b/alpha - r - a r^3 (Norrbin, SSPA report B 104-3, 1963) with T = 1/alpha, K = k/alpha and a =
# beta/alpha. A ship of alpha < 0 does not keep its course, and turns steadily with the rudder amidships. Each step is
# split (Strang, SIAM J. Numer. Anal. 5, 1968): half a step of the linear part, a step of the cubic, half a step of the
# linear, each exact for the mean of the control over the step.

EVALUATIONS = 40  # Steps of the search from each start
# How much faster than the linear fit the motion may be, and how much faster it may run away by a twentieth of that.
FASTER = 20.0
BEYOND = 100.0  # Ranges of the channel that a simulation may leave it by before it is cut, so that squares stay finite


@dataclass(frozen=True, eq=False)
class CubicLag:
    """One channel as a cubic lag of one control.

    Attributes:
        gain: k, unit of the channel over that of the control and over s.
        offset: b, unit of the channel over s.
        linear: alpha, 1/s.
        cubic: beta, 1/s over the square of the channel's unit.
        delay: of the control, s.
    """

    gain: float
    offset: float
    linear: float
    cubic: float
    delay: float

    def simulate(self, run: Run, start: int = 0) -> Float[np.ndarray, " n"]:
        """Return the output at every sample of a run from its first measurement at or after `start`, and that value before it."""
        there = run.there
        first = int(there[np.searchsorted(there, start)])
        value = float(run.measured[first])
        step = np.diff(run.time)[first:]
        # The mean of the delayed control over each step; before the first sample it was as there.
        held, time = run.control[:, 0], run.time
        total = np.concatenate([[0.0], np.cumsum(held[:-1] * np.diff(time))])
        seen = time - self.delay
        until = np.where(seen < time[0], held[0] * (seen - time[0]), np.interp(seen, time, total))
        pushed = self.gain * (np.diff(until) / np.diff(time))[first:] + self.offset
        half = -0.5 * self.linear * step
        keep = np.exp(half)
        near = np.abs(half) < 1e-8
        add = 0.5 * step * pushed * np.where(near, 1.0, np.expm1(half) / np.where(near, 1.0, half))
        bend = 2.0 * self.cubic * step
        values = [value] * (first + 1)
        for e, f, c in zip(keep.tolist(), add.tolist(), bend.tolist(), strict=True):
            value = e * value + f
            value = e * (value / sqrt(1.0 + c * value * value)) + f
            values.append(value)
        return np.array(values)


def fit_cubic(runs: Sequence[Run], linear: Lags) -> CubicLag:
    """Fit a channel of several runs by least squares of its simulation, from its first-order lag.

    Args:
        runs: each with a measurement at least, of one control.
        linear: the first-order lag that was fitted to them.
    """
    rate = 1.0 / linear.time_constants[0]
    seen = np.concatenate([run.measured[run.there] for run in runs])
    extent, push = float(np.ptp(seen)) or 1.0, float(np.ptp(np.concatenate([run.control for run in runs])))
    size = np.array([extent * rate / push, extent * rate, rate, rate / extent**2, longest_delay(runs)])
    begin = np.array([linear.gains[0, 0] * rate, linear.offset * rate, rate, 0.0, linear.delay]) / size

    def law_of(x: np.ndarray) -> CubicLag:
        return CubicLag(*(x * size).tolist())

    def residuals(x: np.ndarray) -> np.ndarray:
        law = law_of(x)
        left = [(law.simulate(run) - run.measured)[run.there] for run in runs]
        return np.clip(np.nan_to_num(np.concatenate(left) / extent, nan=BEYOND), -BEYOND, BEYOND)

    lower = np.array([-np.inf, -np.inf, -0.05 * FASTER, 0.0, 0.0])
    upper = np.array([np.inf, np.inf, FASTER, np.inf, 1.0])
    result = [
        scipy.optimize.least_squares(
            residuals,
            np.clip(np.array([*begin[:2] * pull, begin[2] * share, bend, begin[4]]), lower, upper),
            bounds=(lower, upper),
            max_nfev=EVALUATIONS,
        )
        for share, bend, pull in ((1.0, 1e-3, 1.0), (0.3, 5.0, 1.0), (2.0, 20.0, 2.0))
    ]
    return law_of(min(result, key=lambda one: one.cost).x)
