"""Parameters before and after the data: one at a time, those known together, and profile likelihoods."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seatrial.core.normal import normal_density
from seatrial.estimation.posterior.profile_result import DROP, Profile
from seatrial.report.figures.style import (
    BAND,
    BLUE,
    FONT,
    INK,
    MUTED,
    ORANGE,
    PAPER,
    PURPLE,
    SMALL,
    draw_dots,
    label_axes,
    limit_ticks,
    power_of_ten,
    sized_figure,
    style_axes,
    thin,
    unit_label,
    write_lines,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH, FAR = 4.5, 12.0  # Half width of the frame, and the most for an interval, posterior standard deviations
SHARES = (0.95, 0.5)
PROFILE_WIDTH, ROW, HEAD, BELOW = 640.0, 104.0, 22.0, 40.0
COLUMNS = 3
MAX_DEPTH = 2.4  # How far below the maximum the curves are shown


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
        """Return the density at x, between the points along straight lines."""
        inside = (x >= self.lower) & (x <= self.upper)
        return np.where(inside, np.interp(x, self.value, self.height), 0.0)


class ProfilePanel(NamedTuple):
    """One profile with its symbol for the figure, within dollars, and its true value where there is one."""

    profile: Profile
    symbol: str
    truth: float | None = None


def draw_marginal(
    axes: "Axes",
    draws: np.ndarray,
    symbol: str,
    unit: str,
    *,
    prior: PriorShape | None,
    interval: tuple[float, float],
    normal: tuple[float, float] | None = None,
    truth: float | None = None,
) -> None:
    """Draw the posterior of one parameter into axes.

    Args:
        axes: where.
        draws: SI, shape (n,).
        symbol: of the parameter, within dollars.
        unit: its SI unit.
        prior: its prior; None to hide it.
        interval: 95 % interval.
        normal: mode and standard deviation of the normal approximation, if there is one.
        truth: of a simulated vehicle.
    """
    mean, sd = float(draws.mean()), float(draws.std())
    low, high = _frame(draws, mean, sd, prior, truth, interval)
    exponent = power_of_ten(low, high)
    scale = 10.0**-exponent
    counts, edges = np.histogram(draws, bins=int(np.clip(draws.size**0.4, 20, 60)), range=(low, high))
    density = counts / (draws.size * (edges[1] - edges[0]))
    top = float(density.max())
    axes.stairs(density / top, edges * scale, fill=True, color=BLUE, alpha=0.45, linewidth=0, label="posterior draws")
    grid, peak = np.linspace(low, high, 160), 1.1
    if prior is not None:
        height = prior.density(grid) / top
        peak = max(peak, 1.05 * float(height.max()))
        axes.plot(grid * scale, height, color=MUTED, linewidth=1.4, linestyle=(0, (4, 3)), label="prior")
    if normal is not None and normal[1] > 0:
        height = normal_density(grid, *normal) / top
        peak = max(peak, 1.05 * float(height.max()))
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


def draw_pair(
    axes: "Axes",
    x: np.ndarray,
    y: np.ndarray,
    symbols: tuple[str, str],
    units: tuple[str, str],
    truth: tuple[float, float] | None = None,
) -> None:
    """Draw joint draws of two parameters into axes, with the regions that hold 50 % and 95 % of them.

    Args:
        axes: where.
        x: draws of the first, SI, shape (n,).
        y: draws of the second, likewise.
        symbols: within dollars.
        units: SI.
        truth: of a simulated vehicle.
    """
    from scipy.ndimage import gaussian_filter

    exponents = [power_of_ten(*np.quantile(values, [0.001, 0.999])) for values in (x, y)]
    x, y = x * 10.0 ** -exponents[0], y * 10.0 ** -exponents[1]
    keep = thin(x.size, 900)
    draw_dots(axes, x[keep], y[keep], size=1.5, label="draws").set_alpha(0.6)
    ranges = [np.quantile(values, [0.0005, 0.9995]) + np.ptp(values) * np.array([-0.06, 0.06]) for values in (x, y)]
    counts, x_edges, y_edges = np.histogram2d(x, y, bins=48, range=ranges)
    smooth = gaussian_filter(counts, 1.6)
    # Heights above which the shares of the density lie, lowest first.
    ordered = np.sort(smooth.ravel())[::-1]
    held = np.cumsum(ordered) / ordered.sum()
    levels = [float(ordered[min(int(np.searchsorted(held, share)), ordered.size - 1)]) for share in SHARES]
    if levels[0] < levels[1]:
        axes.contour(
            (x_edges[1:] + x_edges[:-1]) / 2,
            (y_edges[1:] + y_edges[:-1]) / 2,
            smooth.T,
            levels=levels,
            colors=BLUE,
            linewidths=[1.1, 1.9],
        )
    axes.plot(x.mean(), y.mean(), marker="o", markersize=5, color=INK, linestyle="none", label="mean", zorder=5)
    if truth is not None:
        axes.plot(
            truth[0] * 10.0 ** -exponents[0],
            truth[1] * 10.0 ** -exponents[1],
            marker="X",
            markersize=8,
            color=PURPLE,
            linestyle="none",
            label="true value",
            zorder=6,
        )
    axes.set(xlim=ranges[0], ylim=ranges[1])
    limit_ticks(axes.xaxis, 4)
    label_axes(axes, unit_label(symbols[0], units[0], exponents[0]), unit_label(symbols[1], units[1], exponents[1]))


def profile_figure(panels: Sequence[ProfilePanel], words: Sequence[str] = ()) -> "Figure":
    """Draw a panel for each parameter: curve, threshold, 95 % interval, and the ends of the prior where it is met.

    Args:
        panels: profiles.
        words: lines printed above, plain text.
    """
    from matplotlib.patches import Rectangle

    columns = min(COLUMNS, len(panels))
    rows = -(-len(panels) // columns)
    top = 10.0 + 14.0 * len(words)
    total = top + rows * (HEAD + ROW + BELOW)
    figure = sized_figure(PROFILE_WIDTH, total)
    figure.add_artist(Rectangle((0, 0), 1, 1, transform=figure.transFigure, facecolor=PAPER, zorder=-9))
    write_lines(figure, words, 44, 14)
    width = (PROFILE_WIDTH - 44 - 12 - 22 * (columns - 1)) / columns
    for i, panel in enumerate(panels):
        left = 44 + (i % columns) * (width + 22)
        bottom = total - top - (i // columns) * (HEAD + ROW + BELOW) - HEAD - ROW
        axes = style_axes(figure.add_axes((left / PROFILE_WIDTH, bottom / total, width / PROFILE_WIDTH, ROW / total)))
        _draw(axes, panel)
        axes.tick_params(labelleft=i % columns == 0)
        if i % columns == 0:
            label_axes(axes, y="log-likelihood")
    return figure


def _frame(
    draws: np.ndarray,
    mean: float,
    sd: float,
    prior: PriorShape | None,
    truth: float | None,
    interval: tuple[float, float],
) -> tuple[float, float]:
    """Limits that hold nearly all draws, the truth and the interval, and no more of the prior's outside than shows where it ends."""
    low, high = np.quantile(draws, [0.0005, 0.9995])
    low, high = max(float(low), mean - 1.5 * WIDTH * sd), min(float(high), mean + 1.5 * WIDTH * sd)
    low, high = min(low, mean - WIDTH * sd), max(high, mean + WIDTH * sd)
    if prior is not None and prior.is_bounded:
        low, high = max(low, min(prior.lower, draws.min())), min(high, max(prior.upper, draws.max()))
    # The interval holds more than the noise, of which the draws are; where it holds far more, they would be a line.
    low, high = min(low, max(interval[0], mean - FAR * sd)), max(high, min(interval[1], mean + FAR * sd))
    if truth is not None:
        low, high = min(low, truth), max(high, truth)
    width = high - low if high - low > 1e-9 * abs(high) else abs(high) or 1.0
    return low - 0.04 * width, high + 0.04 * width


def _draw(axes: "Axes", panel: ProfilePanel) -> None:
    profile = panel.profile
    exponent = power_of_ten(*profile.values)
    scale = 10.0**-exponent
    values, drop = profile.values * scale, profile.drop
    grid, curve = _smooth(values, drop, profile.best * scale)
    low, high = _profile_frame(grid, curve)
    inside = grid[(curve <= DROP)]
    colour = BLUE if profile.kind == "closed" else ORANGE
    edges = zip((profile.lower, profile.upper), (low, high), strict=True)
    ends = [end * scale if np.isfinite(end) else edge for end, edge in edges]
    axes.axvspan(*ends, color=colour, alpha=BAND, linewidth=0, label="95 % interval")
    axes.axhline(-DROP, color=MUTED, linewidth=0.9, linestyle="--", label="1.92 below")
    axes.plot(grid, -curve, color=colour, linewidth=1.6, label="profile")
    axes.plot(values, -drop, color=colour, marker="o", markersize=2.4, linestyle="none")
    axes.plot(profile.best * scale, 0.0, color=INK, marker="o", markersize=4, linestyle="none", label="best", zorder=4)
    for bound in profile.bounds:
        if low <= bound * scale <= high and inside.size:
            axes.axvline(bound * scale, color=INK, linewidth=1.4, label="end of the prior")
    if panel.truth is not None:
        axes.axvline(panel.truth * scale, color=PURPLE, linewidth=1.2, linestyle=":", label="true value")
    axes.set(xlim=(low, high), ylim=(-MAX_DEPTH, 0.25))
    axes.set_title(_title(profile, scale), fontsize=SMALL, color=INK, loc="left", pad=4)
    label_axes(axes, unit_label(panel.symbol, profile.unit, exponent))
    axes.xaxis.label.set_fontsize(FONT)


def _smooth(values: np.ndarray, drop: np.ndarray, best: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the curve between its points: the signed root of the fall is nearly straight, so it is what is interpolated."""
    grid = np.linspace(values.min(), values.max(), 301)
    root = np.sign(values - best) * np.sqrt(2 * drop)
    return grid, 0.5 * np.interp(grid, values, root) ** 2


def _profile_frame(grid: np.ndarray, curve: np.ndarray) -> tuple[float, float]:
    """Return where the curve is not too deep, with some room."""
    near = grid[curve <= MAX_DEPTH]
    low, high = float(near.min()), float(near.max())
    room = 0.06 * ((high - low) or max(abs(high), 1e-12))
    return low - room, high + room


def _title(profile: Profile, scale: float) -> str:
    lower, upper = (f"{end * scale:.4g}".replace("-", "−") for end in (profile.lower, profile.upper))
    return {
        "closed": f"{lower} to {upper}",
        "open below": f"below {upper}",
        "open above": f"above {lower}",
        "flat": "flat: any value of the prior",
    }[profile.kind]
