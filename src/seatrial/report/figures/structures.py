"""Probabilities of models and of terms with their Monte Carlo error, and how they hang on the width of the prior."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from seatrial.report.figures.style import (
    BAND,
    BLUE,
    FONT,
    HATCH,
    INK,
    MUTED,
    ORANGE,
    PAPER,
    SMALL,
    WIDE,
    draw_dots,
    label_axes,
    limit_ticks,
    new_figure,
    power_of_ten,
    unit_label,
)
from seatrial.selection.verdict import DECIDED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

STRUCTURE_ROW = 18.0  # Height of a term, points
# Heights of the panels of motion and of difference, and of the line above them, points.
MOTION_ROW, GAP_ROW, HEAD = 110.0, 60.0, 22.0
AXIS = "factor on the priors’ standard deviations"
LINE = 0.01  # Width of a line as a share of the height of its panel
NEAR = 11.0  # Least distance of two names at the right edge, points


class MotionGap(NamedTuple):
    """Speed, or force, of the best minus the runner-up's in one manoeuvre, as shown, with its 90 % band; `where` is plain text.

    `best` is that of the best; `measured` are times and values of the record, none of a trial that was not run.
    """

    where: str
    time: Float[np.ndarray, " n"]
    best: Float[np.ndarray, " n"]
    difference: Float[np.ndarray, " n"]
    lower: Float[np.ndarray, " n"]
    upper: Float[np.ndarray, " n"]
    measured: tuple[np.ndarray, np.ndarray] | None = None

    @property
    def coincides(self) -> bool:
        """Whether a plot of the motion shows one line for both: they differ by less than its width."""
        return float(np.abs(self.difference).max()) < LINE * float(np.ptp(self.best))


class CoefficientPath(NamedTuple):
    """Averaged coefficient of one term along the factor: symbol within dollars, SI unit, values."""

    symbol: str
    unit: str
    mean: Float[np.ndarray, " s"]


def model_space(
    labels: Sequence[str],
    member: Bool[np.ndarray, "m k"],
    probability: Float[np.ndarray, " m"],
    sign: Float[np.ndarray, " k"],
) -> "Figure":
    """Draw the structures from the left, the best first; what those not shown hold together is hatched on the right.

    Args:
        labels: of the terms, from the top; text within dollars is mathematics.
        member: which terms each structure has.
        probability: of each structure, falling.
        sign: of each term's averaged coefficient: positive is blue, negative orange.
    """
    from matplotlib.collections import PolyCollection

    count = len(labels)
    figure, (axes,) = new_figure(WIDE, [max(40.0, STRUCTURE_ROW * count)], left=62, right=14)
    edges = np.concatenate([[0.0], np.cumsum(probability)])
    for colour, name, chosen in ((BLUE, "positive", sign >= 0), (ORANGE, "negative", sign < 0)):
        columns, rows = np.nonzero(member & chosen)
        left, right = edges[columns], edges[columns + 1]
        corners = [(left, rows - 0.5), (right, rows - 0.5), (right, rows + 0.5), (left, rows + 0.5)]
        boxes = np.stack([np.stack(corner, -1) for corner in corners], 1) if rows.size else np.zeros((0, 4, 2))
        axes.add_collection(
            PolyCollection(list(boxes), facecolor=colour, alpha=0.75, linewidth=0, label=name), autolim=False
        )
    if edges[-1] < 1 - 1e-3:
        axes.axvspan(edges[-1], 1.0, facecolor="none", edgecolor=HATCH, hatch="////", linewidth=0, label="not shown")
    wide = np.concatenate([[0.0], edges[1:][np.diff(edges) > 0.004], [1.0]])
    axes.vlines(wide, -0.5, count - 0.5, color=PAPER, linewidth=1.2, zorder=3)
    axes.hlines(np.arange(1, count) - 0.5, 0, 1, color=PAPER, linewidth=1.6, zorder=3)
    axes.set(xlim=(0, 1), ylim=(count - 0.5, -0.5))
    axes.set_yticks(np.arange(count), labels, fontsize=FONT)
    axes.set_xticks([0, 0.25, 0.5, 0.75, 1.0])
    axes.tick_params(axis="y", length=0)
    axes.grid(False)
    label_axes(axes, "structures, each as wide as it is probable")
    return figure


def structure_gaps(gaps: Sequence[MotionGap], noise: float, axis: str) -> "Figure":
    """Draw two panels for each manoeuvre: both structures over what was measured, and their difference, on one scale.

    Without the first where both would be one line.

    Args:
        gaps: from the top.
        noise: standard deviation of the sensor, as shown; NaN if there is none.
        axis: symbol of the channel and its unit in brackets.
    """
    heights = [height for gap in gaps for height in ([MOTION_ROW] * (not gap.coincides) + [GAP_ROW])]
    figure, panels = new_figure(WIDE, heights, left=58, right=14, top=HEAD, gap=HEAD + 14, bottom=38, share_x=False)
    reach = 1.15 * max(float(np.nanmax(np.abs([gap.lower, gap.upper, gap.difference]))) for gap in gaps)
    reach = max(reach, 1.15 * noise if np.isfinite(noise) and noise < 4 * reach else 0.0, 1e-9)
    left = iter(panels)
    for gap in gaps:
        first = axes = next(left)
        if not gap.coincides:
            _draw_motions(first, gap, axis)
            axes = next(left)
        axes.fill_between(
            gap.time, gap.lower, gap.upper, color=BLUE, alpha=BAND, linewidth=0, label="90 % band of both posteriors"
        )
        axes.plot(gap.time, gap.difference, color=BLUE, linewidth=1.5, label="posterior means")
        axes.axhline(0.0, color=MUTED, linewidth=0.8)
        for side in (-noise, noise):
            if np.isfinite(side):
                axes.axhline(side, color=INK, linewidth=0.9, linestyle=(0, (4, 3)), label="residuals of the fit, sd")
        axes.set(xlim=(float(gap.time[0]), float(gap.time[-1])), ylim=(-reach, reach))
        first.set_title(gap.where.replace("$", r"\$"), fontsize=SMALL, color=INK, loc="left", pad=4)
        label_axes(axes, y=f"difference\n[{axis.rpartition('[')[2]}")
    label_axes(panels[-1], "time [s]")
    return figure


def _draw_motions(axes: "Axes", gap: MotionGap, axis: str) -> None:
    if gap.measured is not None:
        draw_dots(axes, *gap.measured, label="measured")
    axes.plot(gap.time, gap.best, color=BLUE, linewidth=1.6, label="best", zorder=3)
    other = gap.best - gap.difference
    axes.plot(gap.time, other, color=ORANGE, linewidth=1.4, linestyle=(0, (4, 3)), label="runner-up", zorder=4)
    axes.set_xlim(float(gap.time[0]), float(gap.time[-1]))
    axes.tick_params(labelbottom=False)
    label_axes(axes, y=axis)


def probability_bars(labels: Sequence[str], probability: "ArrayLike", error: "ArrayLike") -> "Figure":
    """Draw one bar for each term, and the lines beyond which the data have decided; see `draw_probabilities`."""
    figure, (axes,) = new_figure(WIDE, [max(40.0, 22.0 * len(labels))], left=62, right=44)
    draw_probabilities(axes, labels, probability, error)
    for line in (1 - DECIDED, DECIDED):
        axes.axvline(line, color=ORANGE, linewidth=1.1, linestyle=(0, (4, 3)), zorder=4)
    return figure


def draw_probabilities(axes: "Axes", labels: Sequence[str], probability: "ArrayLike", error: "ArrayLike") -> None:
    """Draw one bar for each term into axes, from the top down, with error bars of one standard error inside [0, 1].

    Args:
        axes: where.
        labels: names; text within dollars is mathematics.
        probability: shape (k,).
        error: Monte Carlo standard errors, shape (k,).
    """
    count = len(labels)
    value, spread = np.asarray(probability, float), np.nan_to_num(np.asarray(error, float))
    place = np.arange(count)
    axes.barh(place, value, height=0.62, color=BLUE, zorder=2)
    lower, upper = np.minimum(spread, value), np.minimum(spread, 1 - value)
    axes.errorbar(
        value,
        place,
        xerr=[np.maximum(lower, 0), np.maximum(upper, 0)],
        fmt="none",
        ecolor=INK,
        elinewidth=1.2,
        capsize=3,
        zorder=3,
    )
    for index in range(count):
        axes.annotate(
            f"{value[index]:.2f}",
            (min(float(value[index] + spread[index]), 1.0), index),
            xytext=(5, 0),
            textcoords="offset points",
            va="center",
            fontsize=SMALL,
            color=INK,
            annotation_clip=False,
        )
    axes.set(xlim=(0, 1), ylim=(count - 0.4, -0.6))
    axes.set_yticks(place, labels, fontsize=FONT)
    axes.set_xticks([0, 0.25, 0.5, 0.75, 1.0])
    axes.grid(False, axis="y")
    label_axes(axes, "probability that it is needed")


def inclusion_paths(
    labels: Sequence[str], scale: Float[np.ndarray, " s"], inclusion: Float[np.ndarray, "s k"]
) -> "Figure":
    """Draw the inclusion probability of every optional term along the factor, and the lines beyond which it is decided.

    Args:
        labels: of the terms; text within dollars is mathematics.
        scale: factors, rising; 1 is the prior as given.
        inclusion: probabilities.
    """
    height = max(150.0, NEAR * len(labels))
    figure, (axes,) = new_figure(WIDE, [height], left=48, right=58, bottom=38)
    for line in (1 - DECIDED, DECIDED):
        axes.axhline(line, color=ORANGE, linewidth=1.1, linestyle=(0, (4, 3)))
    axes.plot(scale, inclusion, color=BLUE, linewidth=1.5, marker="o", markersize=3, clip_on=False, zorder=3)
    ends = _spread(inclusion[-1], NEAR / height)
    for label, value, end in zip(labels, inclusion[-1], ends, strict=True):
        axes.annotate(
            label,
            (scale[-1], value),
            xytext=(1.04, end),
            textcoords="axes fraction",
            va="center",
            fontsize=FONT,
            color=INK,
            annotation_clip=False,
            arrowprops={"arrowstyle": "-", "color": MUTED, "linewidth": 0.6, "shrinkA": 0, "shrinkB": 3},
        )
    axes.set(ylim=(0, 1))
    axes.set_yticks([0, 0.25, 0.5, 0.75, 1.0])
    _along(axes, scale)
    label_axes(axes, AXIS, "probability that it is needed")
    return figure


def coefficient_paths(scale: Float[np.ndarray, " s"], paths: Sequence[CoefficientPath]) -> "Figure":
    """Draw one panel for each term: its coefficient, averaged over all structures, absent counting as zero.

    Args:
        scale: factors, rising.
        paths: of each term.
    """
    left, right = 138, 14
    figure, panels = new_figure(WIDE, [50.0] * len(paths), left=left, right=right, bottom=38)
    for axes, path in zip(panels, paths, strict=True):
        exponent = power_of_ten(*path.mean)
        mean = path.mean * 10.0**-exponent
        axes.plot(scale, mean, color=BLUE, linewidth=1.5, marker="o", markersize=3, clip_on=False)
        low, high = float(np.min(mean)), float(np.max(mean))
        room = max(0.15 * (high - low), 0.02 * max(abs(low), abs(high)), 1e-12)
        axes.set(ylim=(low - room, high + room))
        axes.axhline(0.0, color=MUTED, linewidth=0.8)
        limit_ticks(axes.yaxis, 3)
        axes.yaxis.set_label_coords(-0.6 * left / (WIDE - left - right), 0.5)
        axes.set_ylabel(
            unit_label(path.symbol, path.unit, exponent).replace(" [", "\n["), fontsize=SMALL, color=INK, rotation=0
        )
        axes.yaxis.label.set(ha="center", va="center")
        _along(axes, scale)
    label_axes(panels[-1], AXIS)
    return figure


def _along(axes: "Axes", scale: np.ndarray) -> None:
    """A logarithmic axis whose ticks are the factors; a line at the prior as given."""
    axes.set_xscale("log")
    axes.set_xlim(scale[0], scale[-1])
    axes.set_xticks(scale, [f"{factor:g}" for factor in scale])
    axes.set_xticks([], minor=True)
    axes.axvline(1.0, color=MUTED, linewidth=0.9, zorder=1)


def _spread(values: np.ndarray, apart: float) -> np.ndarray:
    """Places near these values, within [0, 1] where they fit, at least so far from each other."""
    order = np.argsort(values, kind="stable")
    places = np.array(values, float)[order]
    for i in range(1, places.size):
        places[i] = max(places[i], places[i - 1] + apart)
    if places.size and places[-1] > 1:
        places[-1] = 1.0
        for i in range(places.size - 2, -1, -1):
            places[i] = min(places[i], places[i + 1] - apart)
    return places[np.argsort(order)]
