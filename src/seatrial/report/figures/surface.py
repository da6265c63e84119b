"""How informative every design of a sweep is: entropy reduction over period and amplitude."""

from typing import TYPE_CHECKING

import numpy as np

from seatrial.report.figures.style import (
    BLUE,
    FONT,
    HATCH,
    INK,
    MUTED,
    PAPER,
    SMALL,
    WIDE,
    draw_dots,
    label_axes,
    new_figure,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS, LEVELS = "viridis", 12
STAR = {
    "marker": "*",
    "markersize": 15,
    "color": "#ffffff",
    "markeredgecolor": "#000000",
    "linestyle": "none",
    "clip_on": False,
    "zorder": 5,
    "label": "best design",
}


def design_surface(
    period: np.ndarray, amplitude: np.ndarray, gain: np.ndarray, best: tuple[int, int], labels: tuple[str, str]
) -> "Figure":
    """Draw the entropy reduction over a grid of designs; see `draw_surface`."""
    thin = min(gain.shape) < 2
    figure, (axes,) = new_figure(WIDE, [170]) if thin else new_figure(WIDE, [190], right=78)
    draw_surface(axes, period, amplitude, gain, best, labels)
    return figure


def draw_surface(
    axes: "Axes",
    period: np.ndarray,
    amplitude: np.ndarray,
    gain: np.ndarray,
    best: tuple[int, int],
    labels: tuple[str, str],
) -> None:
    """Draw the entropy reduction as filled contours, the best design as a star, and hatch what the limits forbid.

    Where one setting alone is swept, a line takes the place of the contours.

    Args:
        axes: where; the colour bar stands to the right of it.
        period: s, shape (P,).
        amplitude: change from trim, in the unit of its label, shape (A,).
        gain: nats, NaN if a limit is broken, shape (A, P).
        best: indices of the best design.
        labels: of period and amplitude, units included.
    """
    if min(gain.shape) < 2:
        _line(axes, period, amplitude, gain, best, labels)
        return
    axes.grid(False)
    if np.isnan(gain).any():
        _hatch(axes)
    from matplotlib.ticker import MaxNLocator

    low, high = float(np.nanmin(gain)), float(np.nanmax(gain))
    spread = max(high - low, 1e-6 * max(abs(high), 1.0))
    contours = axes.contourf(
        period,
        amplitude,
        gain,
        levels=np.asarray(MaxNLocator(LEVELS).tick_values(high - spread, high)),
        cmap=COLOURS,
        zorder=1,
    )
    contours.set_edgecolor("face")
    at_amplitude, at_period = np.meshgrid(amplitude, period, indexing="ij")
    tried = np.isfinite(gain)
    draw_dots(axes, at_period[tried], at_amplitude[tried], color=PAPER, size=1.3).set(alpha=0.45, zorder=2)
    axes.plot(period[best[1]], amplitude[best[0]], markeredgewidth=0.9, **STAR)
    axes.set(xlim=(period[0], period[-1]), ylim=(amplitude[0], amplitude[-1]))
    for spine in axes.spines.values():
        spine.set_visible(True)
    label_axes(axes, *labels)
    _bar(axes, contours)


def _hatch(axes: "Axes") -> None:
    """Hatch the whole frame; contours of allowed designs cover their part of it."""
    from matplotlib.patches import Rectangle

    axes.add_patch(
        Rectangle(
            (0, 0),
            1,
            1,
            transform=axes.transAxes,
            facecolor="none",
            edgecolor=HATCH,
            hatch="////",
            linewidth=0,
            zorder=0,
            label="breaks a limit",
        )
    )


def _bar(axes: "Axes", contours) -> None:
    figure = axes.get_figure()
    assert figure is not None
    holder = axes.inset_axes((1.046, 0.0, 0.049, 1.0))
    bar = figure.colorbar(contours, cax=holder)
    holder.set_frame_on(False)
    for part in holder.collections:
        part.set_edgecolor("face")
    bar.ax.tick_params(colors=MUTED, labelsize=SMALL, length=2, width=0.6, labelcolor=INK)
    bar.set_label("entropy reduction [nat]", fontsize=FONT, color=INK, labelpad=5)


def _line(
    axes: "Axes",
    period: np.ndarray,
    amplitude: np.ndarray,
    gain: np.ndarray,
    best: tuple[int, int],
    labels: tuple[str, str],
) -> None:
    """Draw a sweep over one setting only."""
    over_period = gain.shape[0] == 1
    x = period if over_period else amplitude
    axes.plot(x, gain.ravel(), color=BLUE, linewidth=1.6, marker="o", markersize=3)
    axes.plot(x[best[1] if over_period else best[0]], gain[best], **STAR)
    axes.margins(x=0.03)
    label_axes(axes, labels[0] if over_period else labels[1], "entropy reduction [nat]")
