"""A record as it is: measured channels as dots, controls as lines below."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from seatrial.report.figures.style import DOTS, MUTED, WIDE, draw_dots, label_axes, new_figure, thin, thin_steps

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def raw_record(
    time: np.ndarray, columns: Sequence[tuple[str, np.ndarray]], measured: int, most: int = 3000
) -> "Figure":
    """Draw one panel for each column.

    Args:
        time: s, shape (n,).
        columns: label and values in its unit, shape (n,); measured ones first.
        measured: how many of them are measured.
        most: samples worth drawing in a panel.
    """
    figure, axes = new_figure(WIDE, [110.0] * measured + [70.0] * (len(columns) - measured))
    for index, (panel, (label, values)) in enumerate(zip(axes, columns, strict=True)):
        if index < measured:
            there = np.flatnonzero(np.isfinite(values))
            there = there[thin(there.size, most)]
            draw_dots(panel, time[there], values[there], color=DOTS, label="measured")
        else:
            keep = thin_steps(values, most)
            panel.plot(time[keep], values[keep], color=MUTED, linewidth=1.0, label="control")
        panel.margins(y=0.1)
        label_axes(panel, y=label)
    axes[-1].set_xlim(float(time[0]), float(time[-1]))
    label_axes(axes[-1], "time [s]")
    return figure
