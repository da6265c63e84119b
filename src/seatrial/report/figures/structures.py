"""Probabilities with their Monte Carlo error: of models, and of terms."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from seatrial.report.figures.style import BLUE, DOTS, FONT, INK, SMALL, WIDE, label_axes, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike


def probability_bars(
    labels: Sequence[str],
    probability: "ArrayLike",
    error: "ArrayLike",
    chosen: int | None = None,
    axis_label: str = "probability",
) -> "Figure":
    """Draw one bar for each entry, from the top down, with error bars of one standard error inside [0, 1].

    Args:
        labels: names; text within dollars is mathematics.
        probability: shape (k,).
        error: Monte Carlo standard errors, shape (k,).
        chosen: the entry to single out; None for all alike.
        axis_label: label of the probabilities.
    """
    count = len(labels)
    value, spread = np.asarray(probability, float), np.nan_to_num(np.asarray(error, float))
    figure, (axes,) = new_figure(WIDE, [max(40.0, 22.0 * count)], left=62, right=44)
    place = np.arange(count)
    colours = [BLUE if chosen in (None, index) else DOTS for index in range(count)]
    axes.barh(place, value, height=0.62, color=colours, zorder=2)
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
    label_axes(axes, axis_label)
    return figure
