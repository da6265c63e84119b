"""Bode plot of a linear model with the band of its draws."""

from typing import TYPE_CHECKING

import numpy as np

from seatrial.report.figures.style import BAND, BLUE, FONT, INK, WIDE, label_axes, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def bode_figure(frequency: np.ndarray, responses: np.ndarray, title: str, unit: str) -> "Figure":
    """Draw amplitude and phase over frequency: the mean as a line, the 90 % band of the draws in each point.

    Args:
        frequency: rad/s, shape (f,).
        responses: complex, of the mean and then of the draws, shape (1 + n, f); NaN of a draw without.
        title: above the panels.
        unit: of the amplitude.
    """
    figure, (upper, lower) = new_figure(WIDE, [130.0, 100.0], left=60, top=24)
    mean = responses[0]
    phase = np.unwrap(np.angle(mean))
    turned = phase + np.angle(responses / mean)  # of draws, near that of the mean
    for axes, line, draws in (
        (upper, np.abs(mean), np.abs(responses[1:])),
        (lower, np.degrees(phase), np.degrees(turned[1:])),
    ):
        if len(draws):
            low, high = np.nanquantile(draws, (0.05, 0.95), axis=0)
            axes.fill_between(frequency, low, high, color=BLUE, alpha=BAND, linewidth=0, label="90 % band")
        axes.plot(frequency, line, color=BLUE, linewidth=1.5, label="mean")
    upper.set_xscale("log")
    upper.set_yscale("log")
    upper.minorticks_off()  # they would take most of the time
    upper.set_title(title, fontsize=FONT, color=INK, loc="left", pad=5)
    upper.legend(frameon=False, fontsize=FONT, loc="lower left")
    label_axes(upper, y=f"amplitude [{unit}]")
    label_axes(lower, "frequency [rad/s]", "phase [deg]")
    return figure
