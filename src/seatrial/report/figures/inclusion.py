"""Probability that each term is needed: by the closed form over all structures, and beside it by simulation where there is one."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from seatrial.report.figures.style import (
    BLUE,
    DOTS,
    FONT,
    INK,
    MUTED,
    ORANGE,
    PAPER,
    SMALL,
    WIDE,
    label_axes,
    new_figure,
)
from seatrial.selection.verdict import DECIDED

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

ROW = 30.0
"""Height of a term, points."""


def inclusion_bars(
    labels: Sequence[str], closed: "ArrayLike", simulated: "ArrayLike", error: "ArrayLike | None" = None
) -> "Figure":
    """Draw two bars for each term, from the top down, and the lines beyond which the data have decided.

    Args:
        labels: names; text within dollars is mathematics.
        closed: probability by the screening, NaN where there is none, shape (k,).
        simulated: probability by simulation, NaN where there is none, shape (k,).
        error: Monte Carlo standard error of `simulated`, shape (k,); None for none.
    """
    count = len(labels)
    first, second = np.asarray(closed, float), np.asarray(simulated, float)
    spread = np.zeros(count) if error is None else np.nan_to_num(np.asarray(error, float))
    figure, (axes,) = new_figure(WIDE, [max(44.0, ROW * count)], left=62, right=44, top=24)
    place = np.arange(count)
    both = np.isfinite(first).any() and np.isfinite(second).any()
    height, apart = (0.34, 0.19) if both else (0.6, 0.0)
    for value, offset, colour, name in (
        (first, -apart, DOTS, "closed form"),
        (second, apart, BLUE, "simulation"),
    ):
        there = np.isfinite(value)
        if not there.any():
            continue
        axes.barh(place[there] + offset, value[there], height=height, color=colour, zorder=2, label=name)
        for index in place[there]:
            edge = value[index] + (spread[index] if value is second else 0.0)
            axes.annotate(
                f"{value[index]:.2f}",
                (min(float(edge), 1.0), index + offset),
                xytext=(5, 0),
                textcoords="offset points",
                va="center",
                fontsize=SMALL,
                color=INK,
                annotation_clip=False,
                bbox={"facecolor": PAPER, "linewidth": 0, "pad": 0.6},
                zorder=5,
            )
    there = np.isfinite(second)
    value, spread = second[there], spread[there]
    axes.errorbar(
        value,
        place[there] + apart,
        xerr=[np.minimum(spread, value), np.minimum(spread, 1 - value)],
        fmt="none",
        ecolor=INK,
        elinewidth=1.2,
        capsize=2,
        zorder=3,
    )
    for line in (1 - DECIDED, DECIDED):
        axes.axvline(line, color=ORANGE, linewidth=1.1, linestyle=(0, (4, 3)), zorder=4)
        axes.annotate(
            f"{line:.2f}",
            (line, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, 4),
            textcoords="offset points",
            ha="center",
            fontsize=SMALL,
            color=MUTED,
        )
    axes.set(xlim=(0, 1), ylim=(count - 0.45, -0.55))
    axes.set_yticks(place, labels, fontsize=FONT)
    axes.set_xticks([0, 0.25, 0.5, 0.75, 1.0])
    axes.grid(False, axis="y")
    label_axes(axes, "probability that it is needed")
    return figure
