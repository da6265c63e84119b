"""What the priors mean in metres per second: bands of u(t), a few single motions, the record; steady speeds and time constants."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from seatrial.report.figures.fit import Driven
from seatrial.report.figures.style import (
    BLUE,
    DOTS,
    FONT,
    INK,
    MUTED,
    ORANGE,
    PAPER,
    POINT,
    SMALL,
    draw_dots,
    label_axes,
    limit_ticks,
    style_axes,
    thin,
    thin_steps,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH, HEIGHT = 560.0, 420.0
"""Of the picture, points: it stands alone."""
REACH = 1.25
"""How far above the bands single motions are followed, in widths of the frame of the bands and the record."""


def prior_motions(
    time: np.ndarray,
    bands: np.ndarray,
    single: np.ndarray,
    controls: Sequence[Driven],
    *,
    measured: np.ndarray | None = None,
    steady: np.ndarray,
    settling: np.ndarray,
    words: Sequence[str] = (),
) -> "Figure":
    """Draw u(t) as the prior expects it, its control below, and the steady speed and time constant of every draw.

    Args:
        time: s, shape (n,).
        bands: quantiles 5, 25, 50, 75 and 95 % of u, m/s, shape (5, n); NaN where there are none.
        single: u of a few draws, m/s, NaN once they have run away, shape (k, n).
        controls: what drives the vehicle.
        measured: u as measured, m/s, NaN where not, shape (n,).
        steady: steady speed of each draw, m/s, NaN where there is none, shape (draws,).
        settling: time constant of each draw, s, likewise.
        words: lines printed above.
    """
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    top = 12.0 + 14.0 * len(words)
    total = HEIGHT + top
    figure = Figure(figsize=(WIDTH * POINT, total * POINT), dpi=72)
    figure.add_artist(Rectangle((0, 0), 1, 1, transform=figure.transFigure, facecolor=PAPER, zorder=-9))
    for i, text in enumerate(words):
        figure.text(
            48 / WIDTH, 1 - (16 + 14 * i) / total, text.replace("$", r"\$"), fontsize=SMALL, color=INK, va="baseline"
        )

    def panel(left: float, bottom: float, width: float, height: float) -> "Axes":
        return style_axes(figure.add_axes((left / WIDTH, bottom / total, width / WIDTH, height / total)))

    low_panels = 46.0 * len(controls)
    motion = panel(48, 158 + low_panels + 12, WIDTH - 60, HEIGHT - 182 - low_panels)
    _draw_motion(motion, time, bands, single, measured)
    for i, control in enumerate(controls):
        driven = panel(48, 158 + 46.0 * (len(controls) - 1 - i), WIDTH - 60, 36)
        keep = thin_steps(control.values)
        driven.plot(
            time[keep], control.values[keep], color=MUTED, linewidth=1.0, drawstyle="steps-post", label="control"
        )
        driven.set_xlim(float(time[0]), float(time[-1]))
        driven.margins(y=0.15)
        limit_ticks(driven.yaxis, 2)
        label_axes(driven, y=control.label)
        if i < len(controls) - 1:
            driven.tick_params(labelbottom=False)
        else:
            label_axes(driven, "time [s]")
    motion.tick_params(labelbottom=False)
    half = (WIDTH - 48 - 12 - 24) / 2
    _draw_spread(panel(48, 40, half, 66), steady, "steady speed [m/s]")
    _draw_spread(panel(48 + half + 24, 40, half, 66), settling, "time constant [s]")
    return figure


def _draw_motion(
    axes: "Axes", time: np.ndarray, bands: np.ndarray, single: np.ndarray, measured: np.ndarray | None
) -> None:
    if np.isfinite(bands).any():
        for low, high, opacity, label in ((0, 4, 0.16, "90 % of draws"), (1, 3, 0.28, "50 %")):
            axes.fill_between(time, bands[low], bands[high], color=BLUE, alpha=opacity, linewidth=0, label=label)
        axes.plot(time, bands[2], color=BLUE, linewidth=1.8, label="median", zorder=3)
    for i, motion in enumerate(single):
        axes.plot(time, motion, color=ORANGE, linewidth=0.9, alpha=0.9, label="" if i else "single draws", zorder=2.5)
    if measured is not None:
        there = np.flatnonzero(np.isfinite(measured))
        there = there[thin(there.size)]
        draw_dots(axes, time[there], measured[there], color=INK, size=2.0).set_zorder(4)
        axes.plot([], [], marker="o", markersize=2.5, color=INK, linestyle="none", label="measured")
    axes.set(xlim=(float(time[0]), float(time[-1])), ylim=_frame(bands, single, measured))
    label_axes(axes, y="$u$ [m/s]")
    axes.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=5,
        frameon=False,
        fontsize=SMALL,
        labelcolor=INK,
        borderpad=0,
        handlelength=1.4,
        columnspacing=1.2,
    )


def _frame(bands: np.ndarray, single: np.ndarray, measured: np.ndarray | None) -> tuple[float, float]:
    """Limits that hold the bands and the record, and single motions as far as they stay near."""
    held = np.concatenate([bands.ravel(), [] if measured is None else measured])
    held = held[np.isfinite(held)] if np.isfinite(held).any() else np.array([0.0, 2.0])
    low, high = float(held.min()), float(held.max())
    width = max(high - low, 0.05)
    near = single[np.isfinite(single)]
    if near.size:
        low, high = (
            max(min(low, near.min()), low - (REACH - 1) * width),
            min(max(high, near.max()), high + (REACH - 1) * width),
        )
    return low - 0.05 * width, high + 0.05 * width


def _draw_spread(axes: "Axes", values: np.ndarray, label: str) -> None:
    """Histogram of the draws between their 1 and 99 % quantiles, median and 90 % range marked; plain words if there are none."""
    there = values[np.isfinite(values)]
    label_axes(axes, label)
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    axes.grid(False)
    if there.size < 0.5 * values.size:
        axes.text(0.5, 0.5, "most draws have none", transform=axes.transAxes, ha="center", fontsize=FONT, color=MUTED)
        axes.set_xticks([])
        return
    first, low, middle, high, last = (float(value) for value in np.quantile(there, (0.01, 0.05, 0.5, 0.95, 0.99)))
    if not last > first:
        first, last = first - 0.5, last + 0.5
    counts, edges = np.histogram(there, bins=40, range=(first, last))
    axes.stairs(counts / counts.max(), edges, fill=True, color=DOTS, alpha=0.6, linewidth=0, label="draws")
    axes.plot([low, high], [-0.08, -0.08], color=BLUE, linewidth=4, solid_capstyle="butt", label="90 %", clip_on=False)
    axes.plot(middle, -0.08, marker="o", markersize=5, color=INK, linestyle="none", label="median", zorder=5)
    axes.set(xlim=(first, last), ylim=(-0.2, 1.05))
    limit_ticks(axes.xaxis, 6)
