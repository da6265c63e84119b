"""Parameters that are known together: one pair in the plane, and the correlations of all."""

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from seatrial.report.figures.style import (
    BLUE,
    DOTS,
    INK,
    MUTED,
    NARROW,
    ORANGE,
    PURPLE,
    SMALL,
    draw_dots,
    label_axes,
    limit_ticks,
    new_figure,
    power_of_ten,
    thin,
    unit_label,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHARES = (0.95, 0.5)
LEGIBLE, FAINT, SYMBOL = 6, 0.05, 9


def pair(
    x: np.ndarray,
    y: np.ndarray,
    symbols: tuple[str, str],
    units: tuple[str, str],
    truth: tuple[float, float] | None = None,
) -> "Figure":
    """Draw joint draws of two parameters with the regions that hold 50 % and 95 % of them.

    Args:
        x: draws of the first, SI, shape (n,).
        y: draws of the second, likewise.
        symbols: within dollars.
        units: SI.
        truth: of a simulated vehicle.
    """
    from scipy.ndimage import gaussian_filter

    exponents = [power_of_ten(*np.quantile(values, [0.001, 0.999])) for values in (x, y)]
    x, y = x * 10.0 ** -exponents[0], y * 10.0 ** -exponents[1]
    figure, (axes,) = new_figure(NARROW, [190], left=50)
    keep = thin(x.size, 900)
    draw_dots(axes, x[keep], y[keep], size=1.5, color=DOTS, label="draws").set_alpha(0.6)
    ranges = [np.quantile(values, [0.0005, 0.9995]) + np.ptp(values) * np.array([-0.06, 0.06]) for values in (x, y)]
    counts, x_edges, y_edges = np.histogram2d(x, y, bins=48, range=ranges)
    smooth = gaussian_filter(counts, 1.6)
    levels = _levels(smooth)
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
    return figure


def correlations(matrix: np.ndarray, symbols: Sequence[str]) -> "Figure":
    """Draw the correlation of every pair as a square whose size and colour show it; strong ones are written out.

    Args:
        matrix: shape (k, k).
        symbols: within dollars, shape (k,).
    """
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Rectangle

    count = len(symbols)
    margin = 14 + 5.0 * max(map(_length, symbols))
    side = NARROW - margin - 10
    figure, (axes,) = new_figure(NARROW, [side], left=margin, right=10, bottom=margin, top=6)
    axes.grid(False)
    rows, columns = np.tril_indices(count, -1)
    for sign, colour in ((1, BLUE), (-1, ORANGE)):
        chosen = [(r, c) for r, c in zip(rows, columns, strict=True) if sign * matrix[r, c] >= FAINT]
        sizes = [0.92 * np.sqrt(abs(matrix[r, c])) for r, c in chosen]
        squares = [
            Rectangle((c - size / 2, r - size / 2), size, size) for (r, c), size in zip(chosen, sizes, strict=True)
        ]
        axes.add_collection(PatchCollection(squares, facecolor=colour, edgecolor="none", alpha=0.55))
    for row, column in zip(rows, columns, strict=True):
        if np.isfinite(matrix[row, column]) and (count <= LEGIBLE or abs(matrix[row, column]) >= 0.5):
            text = f"{matrix[row, column]:+.2f}".replace("-", "−")
            axes.text(
                float(column),
                float(row),
                text,
                ha="center",
                va="center",
                fontsize=SMALL if count <= LEGIBLE else 6,
                color=INK,
            )
    axes.set(xlim=(-0.5, count - 1.5), ylim=(count - 0.5, 0.5))
    axes.set_xticks(range(count - 1), symbols[:-1], rotation=90 if count > 5 else 0)
    axes.set_yticks(range(1, count), symbols[1:])
    axes.tick_params(length=0, labelsize=SYMBOL)
    for spine in axes.spines.values():
        spine.set_color(MUTED)
    return figure


def _length(symbol: str) -> int:
    """Number of characters that a symbol prints, about."""
    bare = re.sub(r"\\(mathrm|dot)|[${}_^]", "", symbol)
    return len(re.sub(r"\\[A-Za-z]+ ?", "x", bare))


def _levels(density: np.ndarray) -> list[float]:
    """Heights above which the given shares of the density lie, lowest first."""
    ordered = np.sort(density.ravel())[::-1]
    held = np.cumsum(ordered) / ordered.sum()
    return [float(ordered[min(int(np.searchsorted(held, share)), ordered.size - 1)]) for share in SHARES]
