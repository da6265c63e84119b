"""Ranks of truths in their posteriors: histograms, and the distance of their distribution from the uniform one, with bands."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from seatrial.estimation.calibration import BINS, DRAWS, Calibration
from seatrial.report.figures.style import BAND, BLUE, INK, MUTED, ORANGE, POINT, SMALL, label_axes, style_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTH, ROW, TOP, BOTTOM, LEFT, GAP = 640.0, 84.0, 26.0, 40.0, 110.0, 20.0


def rank_figure(found: Calibration, words: str) -> "Figure":
    """Draw a row for each quantity: histogram left, distance from the diagonal right, bands that hold all of them in 99 % of cases.

    Args:
        found: ranks.
        words: heading, plain text.
    """
    from matplotlib.figure import Figure

    k = len(found.names)
    height = TOP + k * ROW + (k - 1) * GAP + BOTTOM
    figure = Figure(figsize=(WIDTH * POINT, height * POINT), dpi=72)
    figure.text(8 / WIDTH, 1 - 14 / height, words, fontsize=SMALL + 1, color=INK)
    half = 0.5 * (WIDTH - LEFT - 70)
    low, high = found.count_band()
    outside = found.outside()
    for i, name in enumerate(found.names):
        y = (height - TOP - (i + 1) * ROW - i * GAP) / height
        box = (half / WIDTH, ROW / height)
        left = style_axes(figure.add_axes((LEFT / WIDTH, y, *box)))
        right = style_axes(figure.add_axes(((LEFT + half + 54) / WIDTH, y, *box)))
        color = ORANGE if name in outside else BLUE
        edges = np.linspace(0, DRAWS + 1, BINS + 1)
        left.axhspan(low, high, color=BLUE, alpha=BAND, linewidth=0)
        left.bar(edges[:-1], found.counts()[i], np.diff(edges), align="edge", color=color, edgecolor="none", alpha=0.75)
        at, band = np.arange(1, DRAWS + 1), found.distance_band()
        right.fill_between(at, -band, band, color=BLUE, alpha=BAND, linewidth=0)
        right.axhline(0.0, color=MUTED, linewidth=0.8)
        right.plot(at, found.distance()[i], color=color, linewidth=1.4)
        right.set_ylim(-2.2 * band.max(), 2.2 * band.max())
        figure.text(8 / WIDTH, y + 0.5 * ROW / height, name, fontsize=SMALL + 1, color=INK, va="center")
        last = i == k - 1
        for axes in (left, right):
            axes.set_xlim(0, DRAWS + 1)
            axes.tick_params(labelbottom=last)
        if last:
            label_axes(left, x="rank of the truth among 99 draws")
            label_axes(right, x="rank: distribution less the uniform one")
    return figure


def distance_figure(found: Mapping[str, Calibration], columns: int = 4) -> "Figure":
    """Draw, for each of several calibrations, the distance of every quantity's distribution from the uniform one.

    Args:
        found: calibrations by title.
        columns: panels side by side.
    """
    from matplotlib.figure import Figure

    rows = -(-len(found) // columns)
    box_width = (WIDTH - 48) / columns - 16
    height = rows * (ROW + 34) + BOTTOM
    figure = Figure(figsize=(WIDTH * POINT, height * POINT), dpi=72)
    for i, (title, one) in enumerate(found.items()):
        x, y = 44 + (i % columns) * (box_width + 16), height - (i // columns + 1) * (ROW + 34) + 10
        axes = style_axes(figure.add_axes((x / WIDTH, y / height, box_width / WIDTH, ROW / height)))
        at, band = np.arange(1, DRAWS + 1), one.distance_band()
        axes.fill_between(at, -band, band, color=BLUE, alpha=BAND, linewidth=0)
        outside = one.outside()
        for name, line in zip(one.names, one.distance(), strict=True):
            axes.plot(at, line, color=ORANGE if name in outside else BLUE, linewidth=0.9)
        axes.set_xlim(0, DRAWS + 1)
        axes.set_ylim(-0.15, 0.15)
        axes.tick_params(labelbottom=i + columns >= len(found), labelleft=i % columns == 0)
        axes.set_title(title.replace(", ", "\n"), fontsize=SMALL, color=INK, pad=3, loc="left")
    figure.text(0.5, 10 / height, "rank of the truth among 99 draws", fontsize=SMALL + 1, color=INK, ha="center")
    return figure
