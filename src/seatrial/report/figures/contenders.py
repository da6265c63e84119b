"""What the choice between two structures changes: by how much the speed of the best exceeds the runner-up's in a manoeuvre."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float

from seatrial.report.figures.style import BAND, BLUE, INK, MUTED, SMALL, WIDE, label_axes, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ROW, HEAD = 92.0, 22.0
"""Height of a panel and of the line above it, points."""


class Gap(NamedTuple):
    """Speed of the best minus the runner-up's in one manoeuvre, m/s, with its 90 % band; `where` is plain text."""

    where: str
    time: Float[np.ndarray, " n"]
    difference: Float[np.ndarray, " n"]
    lower: Float[np.ndarray, " n"]
    upper: Float[np.ndarray, " n"]


def speed_gaps(gaps: Sequence[Gap], noise: float) -> "Figure":
    """Draw one panel for each manoeuvre, on one scale of speed, with the sensor's noise on both sides.

    Args:
        gaps: from the top.
        noise: standard deviation of the sensor, m/s; NaN where the speed is not measured.
    """
    figure, panels = new_figure(
        WIDE, [ROW] * len(gaps), left=58, right=14, top=HEAD, gap=HEAD + 22, bottom=38, share_x=False
    )
    reach = 1.15 * max(float(np.nanmax(np.abs([gap.lower, gap.upper, gap.difference]))) for gap in gaps)
    reach = max(reach, 1.15 * noise if np.isfinite(noise) and noise < 4 * reach else 0.0, 1e-9)
    for axes, gap in zip(panels, gaps, strict=True):
        axes.fill_between(
            gap.time, gap.lower, gap.upper, color=BLUE, alpha=BAND, linewidth=0, label="90 % band of both posteriors"
        )
        axes.plot(gap.time, gap.difference, color=BLUE, linewidth=1.5, label="posterior means")
        axes.axhline(0.0, color=MUTED, linewidth=0.8)
        for side in (-noise, noise):
            if np.isfinite(side):
                axes.axhline(side, color=INK, linewidth=0.9, linestyle=(0, (4, 3)), label="noise of the sensor")
        axes.set(xlim=(float(gap.time[0]), float(gap.time[-1])), ylim=(-reach, reach))
        axes.set_title(gap.where.replace("$", r"\$"), fontsize=SMALL, color=INK, loc="left", pad=4)
        label_axes(axes, y=r"$\Delta u$ [m/s]")
    label_axes(panels[-1], "time [s]")
    return figure
