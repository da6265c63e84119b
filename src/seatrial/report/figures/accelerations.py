"""Signals and their rates by smoothing: what was measured, the smoothed signal and its rate, each with its 90 % band."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seatrial.report.figures.fit import Z90
from seatrial.report.figures.style import BAND, BLUE, DOTS, WIDE, draw_dots, label_axes, new_figure, thin

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Curve(NamedTuple):
    """A signal or a rate in the unit of its label; `measured` is None for what no sensor shows."""

    label: str
    mean: np.ndarray
    sd: np.ndarray
    measured: np.ndarray | None = None


def smoothed_record(time: np.ndarray, curves: Sequence[Curve], most: int = 1500) -> "Figure":
    """Draw a panel for each curve.

    Args:
        time: s, shape (n,).
        curves: each of shape (n,).
        most: samples worth drawing in a panel.
    """
    figure, axes = new_figure(WIDE, [110.0] * len(curves), left=60)
    keep = thin(time.size, most)
    for panel, curve in zip(axes, curves, strict=True):
        at, mean, half = time[keep], curve.mean[keep], Z90 * curve.sd[keep]
        if curve.measured is not None:
            there = np.flatnonzero(np.isfinite(curve.measured))
            there = there[thin(there.size, most)]
            draw_dots(panel, time[there], curve.measured[there], color=DOTS, label="measured")
        panel.fill_between(at, mean - half, mean + half, color=BLUE, alpha=BAND, linewidth=0, label="90 % band")
        panel.plot(at, mean, color=BLUE, linewidth=0.8, label="smoothed")
        panel.margins(y=0.1)
        label_axes(panel, y=curve.label)
    axes[-1].set_xlim(float(time[0]), float(time[-1]))
    label_axes(axes[-1], "time [s]")
    return figure
