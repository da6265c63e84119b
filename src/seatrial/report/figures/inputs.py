"""The control of a designed trial over time, with the limits it keeps."""

from typing import TYPE_CHECKING

import numpy as np

from seatrial.report.figures.style import BLUE, INK, MUTED, SMALL, WIDE, label_axes, new_figure, thin_steps

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def control_over_time(
    time: np.ndarray, control: np.ndarray, label: str, limits: tuple[float | None, float | None] = (None, None)
) -> "Figure":
    """Draw one control, and those of its limits that are near.

    Args:
        time: s, shape (n,).
        control: in the unit of its label, shape (n,).
        label: of the control, unit included.
        limits: lowest and highest value allowed, where there are any.
    """
    figure, (axes,) = new_figure(WIDE, [190])
    keep = thin_steps(control)
    axes.plot(time[keep], control[keep], color=BLUE, linewidth=1.4, label="control")
    low, high = float(control.min()), float(control.max())
    reach = 0.6 * ((high - low) or 1.0)
    for limit in limits:
        if limit is not None and low - reach <= limit <= high + reach:
            axes.axhline(limit, color=MUTED, linestyle=(0, (5, 3)), linewidth=1.0, label="limit")
            axes.annotate(
                "limit",
                (1, limit),
                xycoords=("axes fraction", "data"),
                xytext=(-2, 3 if limit >= high else -10),
                textcoords="offset points",
                ha="right",
                fontsize=SMALL,
                color=INK,
            )
            low, high = min(low, limit), max(high, limit)
    pad = 0.1 * ((high - low) or 1.0)
    axes.set(xlim=(float(time[0]), float(time[-1])), ylim=(low - pad, high + pad))
    label_axes(axes, "time [s]", label)
    return figure
