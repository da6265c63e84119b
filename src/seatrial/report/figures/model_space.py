"""The space of structures: one column for each of the most probable ones, as wide as it is probable; one row for each term."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float

from seatrial.report.figures.style import BLUE, FONT, HATCH, ORANGE, PAPER, WIDE, label_axes, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ROW = 18.0
"""Height of a term, points."""


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
    figure, (axes,) = new_figure(WIDE, [max(40.0, ROW * count)], left=62, right=14)
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
