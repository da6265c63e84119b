"""A record as it is, and a self-oscillating test: the output between its thresholds, and the control that they reverse."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from seatrial.report.figures.style import (
    BLUE,
    INK,
    MUTED,
    ORANGE,
    SMALL,
    WIDE,
    draw_dots,
    label_axes,
    limit_ticks,
    new_figure,
    thin,
    thin_steps,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


MOST = 3000  # Samples worth drawing in a panel of a raw record


def raw_record(time: np.ndarray, columns: Sequence[tuple[str, np.ndarray]], measured: int) -> "Figure":
    """Draw one panel for each column.

    Args:
        time: s, shape (n,).
        columns: label and values in its unit, shape (n,); measured ones first.
        measured: how many of them are measured.
    """
    figure, axes = new_figure(WIDE, [110.0] * measured + [70.0] * (len(columns) - measured))
    for index, (panel, (label, values)) in enumerate(zip(axes, columns, strict=True)):
        if index < measured:
            draw_dots(panel, time, values, MOST, label="measured")
        else:
            keep = thin_steps(values, MOST)
            panel.plot(time[keep], values[keep], color=MUTED, linewidth=1.0, label="control")
        panel.margins(y=0.1)
        label_axes(panel, y=label)
    axes[-1].set_xlim(float(time[0]), float(time[-1]))
    label_axes(axes[-1], "time [s]")
    return figure


def covered(
    fitted: Sequence[tuple[np.ndarray, np.ndarray]],
    held_back: Sequence[tuple[np.ndarray, np.ndarray]],
    labels: tuple[str, str],
) -> "Figure":
    """Draw control and motion of all records as dots; held-back runs that reach beyond the fitted ones are extrapolation.

    Args:
        fitted: control and motion of each fitted record, in the units of the labels, NaN if not measured.
        held_back: likewise of those held back.
        labels: of control and motion, units included.
    """
    figure, (axes,) = new_figure(WIDE, [190])
    for records, colour, label in ((held_back, ORANGE, "held back"), (fitted, BLUE, "fitted")):
        if records:
            x, y = (np.concatenate(columns) for columns in zip(*records, strict=True))
            draw_dots(axes, x, y, 900, color=colour, size=2.4, label=label).set_alpha(0.55)
    axes.margins(x=0.04, y=0.06)
    axes.autoscale_view()
    label_axes(axes, *labels)
    return figure


Ends = tuple[float | None, float | None]  # Lowest and highest value allowed, where there are any


def controls_over_time(time: np.ndarray, panels: Sequence[tuple[np.ndarray, str, Ends]]) -> "Figure":
    """Draw controls below each other, with those of their limits that are near.

    Args:
        time: s, shape (n,).
        panels: of each control its values in the unit of its label, shape (n,), its label with that unit, and its limits.
    """
    figure, every = new_figure(WIDE, [190] * len(panels))
    for axes, (control, label, limits) in zip(every, panels, strict=True):
        _draw_control(axes, time, control, label, limits)
    return figure


def _draw_control(axes: "Axes", time: np.ndarray, control: np.ndarray, label: str, limits: Ends) -> None:
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
