"""One parameter before and after the data: draws, prior, normal approximation, 95 % interval and, if known, the truth."""

from math import pi, sqrt
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seatrial.report.figures.style import (
    BLUE,
    INK,
    MUTED,
    NARROW,
    PURPLE,
    label_axes,
    limit_ticks,
    new_figure,
    power_of_ten,
    unit_label,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTH, HIGHEST = 4.5, 2.5
"""Half width of the frame, posterior standard deviations; its height, in heights of the draws, at most."""


class PriorShape(NamedTuple):
    """A prior as stored: bounds, mean and standard deviation, whether it is one of the logarithm, and its density at points."""

    lower: float
    upper: float
    mean: float
    sd: float
    is_logarithmic: bool
    value: np.ndarray
    height: np.ndarray

    @property
    def is_bounded(self) -> bool:
        """Whether it has two bounds."""
        return bool(np.isfinite(self.lower) and np.isfinite(self.upper))

    def density(self, x: np.ndarray) -> np.ndarray:
        """Density at x, between the points along straight lines."""
        inside = (x >= self.lower) & (x <= self.upper)
        return np.where(inside, np.interp(x, self.value, self.height), 0.0)


def marginal(
    draws: np.ndarray,
    symbol: str,
    unit: str,
    *,
    prior: PriorShape,
    interval: tuple[float, float],
    normal: tuple[float, float] | None = None,
    truth: float | None = None,
) -> "Figure":
    """Draw the posterior of one parameter.

    Args:
        draws: SI, shape (n,).
        symbol: of the parameter, within dollars.
        unit: its SI unit.
        prior: its prior.
        interval: 95 % interval.
        normal: mode and standard deviation of the normal approximation, where there is one.
        truth: of a simulated vehicle.
    """
    mean, sd = float(draws.mean()), float(draws.std())
    low, high = _frame(draws, mean, sd, prior, truth)
    exponent = power_of_ten(low, high)
    scale = 10.0**-exponent
    figure, (axes,) = new_figure(NARROW, [128], left=14, right=14, bottom=38)
    counts, edges = np.histogram(draws, bins=_bins(draws.size), range=(low, high))
    density = counts / (draws.size * (edges[1] - edges[0]))
    top = float(density.max())
    axes.stairs(density / top, edges * scale, fill=True, color=BLUE, alpha=0.45, linewidth=0, label="posterior draws")
    grid, peak = np.linspace(low, high, 160), 1.1
    axes.plot(grid * scale, prior.density(grid) / top, color=MUTED, linewidth=1.4, linestyle=(0, (4, 3)), label="prior")
    if normal is not None and normal[1] > 0:
        height = normal_density(grid, *normal) / top
        peak = float(np.clip(1.05 * height.max(), peak, HIGHEST))
        axes.plot(grid * scale, height, color=INK, linewidth=1.1, label="normal approximation")
    foot = -0.045 * peak
    axes.plot(
        np.array(interval) * scale, [foot, foot], color=BLUE, linewidth=4, solid_capstyle="butt", label="95 % interval"
    )
    axes.plot(mean * scale, foot, marker="o", markersize=5, color=INK, linestyle="none", label="mean", zorder=5)
    if truth is not None:
        axes.axvline(
            truth * scale, color=PURPLE, linewidth=1.8, linestyle=(0, (1.5, 1.5)), label="true value", zorder=4
        )
    axes.set(xlim=(low * scale, high * scale), ylim=(2.4 * foot, peak))
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    axes.grid(False)
    limit_ticks(axes.xaxis, 5)
    label_axes(axes, unit_label(symbol, unit, exponent))
    return figure


def normal_density(x: np.ndarray, mean: float, sd: float) -> np.ndarray:
    """Density of a normal distribution."""
    return np.exp(-0.5 * ((x - mean) / sd) ** 2) / (sd * sqrt(2 * pi))


def _bins(count: int) -> int:
    return int(np.clip(count**0.4, 20, 60))


def _frame(draws: np.ndarray, mean: float, sd: float, prior: PriorShape, truth: float | None) -> tuple[float, float]:
    """Limits that hold nearly all draws and the truth, and no more of the prior's outside than shows where it ends."""
    low, high = np.quantile(draws, [0.0005, 0.9995])
    low, high = max(float(low), mean - 1.5 * WIDTH * sd), min(float(high), mean + 1.5 * WIDTH * sd)
    low, high = min(low, mean - WIDTH * sd), max(high, mean + WIDTH * sd)
    if prior.is_bounded:
        low, high = max(low, min(prior.lower, draws.min())), min(high, max(prior.upper, draws.max()))
    if truth is not None:
        low, high = min(low, truth), max(high, truth)
    width = high - low if high - low > 1e-9 * abs(high) else abs(high) or 1.0
    return low - 0.04 * width, high + 0.04 * width
