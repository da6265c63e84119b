"""A record and its prediction from the inputs alone: measured, mean and 90 % band, with the control below."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seatrial.report.figures.style import (
    BAND,
    BLUE,
    DOTS,
    MUTED,
    ORANGE,
    WIDE,
    draw_dots,
    label_axes,
    limit_ticks,
    new_figure,
    thin,
    thin_steps,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Z90 = 1.6448536269514722


class Predicted(NamedTuple):
    """One channel of one record, in the unit of its label: measured (NaN where not), predicted mean and standard deviation."""

    label: str
    measured: np.ndarray
    mean: np.ndarray
    sd: np.ndarray

    @property
    def residual(self) -> np.ndarray:
        """Residual in units of the predicted standard deviation."""
        return (self.measured - self.mean) / self.sd


class Driven(NamedTuple):
    """One control of one record, in the unit of its label."""

    label: str
    values: np.ndarray


def record_fit(
    time: np.ndarray,
    channels: Sequence[Predicted],
    controls: Sequence[Driven] = (),
    held_back: bool = False,
    most: int = 1500,
) -> "Figure":
    """Draw a panel for each channel, then a low one for each control; held-back records are orange.

    Args:
        time: s, shape (n,).
        channels: what was measured and predicted.
        controls: what drove the vehicle.
        held_back: whether the record was kept out of the fit.
        most: number of samples worth drawing.
    """
    figure, axes = new_figure(WIDE, [*[150.0] * len(channels), *[52.0] * len(controls)])
    colour = ORANGE if held_back else BLUE
    for panel, channel in zip(axes, channels, strict=False):
        measured = np.flatnonzero(np.isfinite(channel.measured))
        measured = measured[thin(measured.size, most)]
        draw_dots(panel, time[measured], channel.measured[measured], color=DOTS, label="measured")
        keep = thin(time.size, min(most, 700))
        at, mean, half = time[keep], channel.mean[keep], Z90 * channel.sd[keep]
        panel.fill_between(
            at, mean - half, mean + half, color=colour, alpha=BAND, linewidth=0, label="90 % band", zorder=1.5
        )
        panel.plot(at, mean, color=colour, linewidth=1.5, label="predicted", zorder=3)
        label_axes(panel, y=channel.label)
    for panel, control in zip(axes[len(channels) :], controls, strict=True):
        keep = thin_steps(control.values, most)
        panel.plot(time[keep], control.values[keep], color=MUTED, linewidth=1.0, label="control")
        limit_ticks(panel.yaxis, 2)
        panel.margins(y=0.12)
        label_axes(panel, y=control.label)
    axes[-1].set_xlim(float(time[0]), float(time[-1]))
    label_axes(axes[-1], "time [s]")
    return figure
