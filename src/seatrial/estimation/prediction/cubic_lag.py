"""Norrbin's cubic lag, for yaw behind a rudder: its simulation and its fit by least squares of the simulated output.

    dr/dt = k c(t - d) + b - alpha r - beta r^3,    beta >= 0

is T dr/dt = K c + b/alpha - r - a r^3 (Norrbin, SSPA report B 104-3, 1963) with T = 1/alpha, K = k/alpha and a = beta/alpha. A ship of
alpha < 0 does not keep its course, and turns steadily with the rudder amidships. Each step is split (Strang, SIAM J. Numer. Anal. 5,
1968): half a step of the linear part, a step of the cubic, half a step of the linear, each exact for the mean of the control over the step.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np
import scipy
from jaxtyping import Float

from seatrial.estimation.prediction.lag_response import Lags, Run, longest_delay

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
    found = [
        scipy.optimize.least_squares(
            residuals,
            np.clip(np.array([*begin[:2] * pull, begin[2] * share, bend, begin[4]]), lower, upper),
            bounds=(lower, upper),
            max_nfev=EVALUATIONS,
        )
        for share, bend, pull in ((1.0, 1e-3, 1.0), (0.3, 5.0, 1.0), (2.0, 20.0, 2.0))
    ]
    return law_of(min(found, key=lambda one: one.cost).x)
