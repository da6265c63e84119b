"""What the records cover: motion against control, fitted and held back."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from seatrial.report.figures.style import BLUE, ORANGE, WIDE, draw_dots, label_axes, new_figure, thin

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def covered(
    fitted: Sequence[tuple[np.ndarray, np.ndarray]],
    held_back: Sequence[tuple[np.ndarray, np.ndarray]],
    labels: tuple[str, str],
    most: int = 900,
) -> "Figure":
    """Draw control and motion of all records as dots; held-back runs that reach beyond the fitted ones are extrapolation.

    Args:
        fitted: control and motion of each fitted record, in the units of the labels, NaN where not measured.
        held_back: likewise of those held back.
        labels: of control and motion, units included.
        most: number of dots worth drawing of each kind.
    """
    figure, (axes,) = new_figure(WIDE, [190])
    for records, colour, label in ((held_back, ORANGE, "held back"), (fitted, BLUE, "fitted")):
        if records:
            x, y = (np.concatenate(columns) for columns in zip(*records, strict=True))
            present = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
            present = present[thin(present.size, most)]
            draw_dots(axes, x[present], y[present], color=colour, size=2.4, label=label).set_alpha(0.55)
    axes.margins(x=0.04, y=0.06)
    axes.autoscale_view()
    label_axes(axes, *labels)
    return figure
