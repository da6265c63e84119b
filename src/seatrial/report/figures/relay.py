"""A self-oscillating test: the output between its thresholds, and the control that they reverse."""

from typing import TYPE_CHECKING

import numpy as np

from seatrial.report.figures.style import BLUE, MUTED, WIDE, label_axes, limit_ticks, new_figure, thin, thin_steps

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def relay_figure(
    time: np.ndarray, output: np.ndarray, control: np.ndarray, thresholds: tuple[float, float], labels: tuple[str, str]
) -> "Figure":
    """Draw both over time.

    Args:
        time: s, shape (n,).
        output: fed back, in the unit of its label, shape (n,).
        control: in the unit of its label, shape (n,).
        thresholds: of the output, lower and upper.
        labels: of output and control, units included.
    """
    figure, (above, below) = new_figure(WIDE, [150.0, 70.0])
    for threshold in thresholds:
        above.axhline(threshold, color=MUTED, linestyle=(0, (5, 3)), linewidth=1.0, label="threshold")
    keep = thin(time.size, 1500)
    above.plot(time[keep], output[keep], color=BLUE, linewidth=1.5, label="expected output")
    keep = thin_steps(control)
    below.plot(time[keep], control[keep], color=MUTED, linewidth=1.2, label="control")
    limit_ticks(below.yaxis, 3)
    below.margins(y=0.12)
    below.set_xlim(float(time[0]), float(time[-1]))
    label_axes(above, y=labels[0])
    label_axes(below, "time [s]", labels[1])
    return figure
