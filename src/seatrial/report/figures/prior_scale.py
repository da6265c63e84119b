"""What the prior has to do with the answer: inclusion and averaged coefficients along the factor on the priors' standard deviations."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float

from seatrial.report.figures.style import (
    BLUE,
    FONT,
    INK,
    MUTED,
    ORANGE,
    SMALL,
    WIDE,
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

AXIS = "factor on the priors’ standard deviations"
NEAR = 11.0
"""Least distance of two names at the right edge, points."""


class CoefficientPath(NamedTuple):
    """Averaged coefficient of one term along the factor: symbol within dollars, SI unit, values."""

    symbol: str
    unit: str
    mean: Float[np.ndarray, " s"]


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
