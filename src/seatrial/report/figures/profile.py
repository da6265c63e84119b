"""Profile likelihoods: how far the best fit falls when one parameter is held, and where it has fallen by 1.92."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seatrial.estimation.profile import DROP, Profile
from seatrial.report.figures.style import (
    BAND,
    BLUE,
    FONT,
    INK,
    MUTED,
    ORANGE,
    PAPER,
    POINT,
    PURPLE,
    SMALL,
    label_axes,
    power_of_ten,
    style_axes,
    unit_label,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH, ROW, HEAD, BELOW = 640.0, 104.0, 22.0, 40.0
COLUMNS = 3
DEEPEST = 2.4
"""How far below the maximum the curves are shown."""


class Panel(NamedTuple):
    """One profile with its symbol for the figure, within dollars, and its true value where there is one."""

    profile: Profile
    symbol: str
    truth: float | None = None


def profile_figure(panels: Sequence[Panel], words: Sequence[str] = ()) -> "Figure":
    """Draw a panel for each parameter: curve, threshold, 95 % interval, and the ends of the prior where it is met.

    Args:
        panels: profiles.
        words: lines printed above, plain text.
    """
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    columns = min(COLUMNS, len(panels))
    rows = -(-len(panels) // columns)
    top = 10.0 + 14.0 * len(words)
    total = top + rows * (HEAD + ROW + BELOW)
    figure = Figure(figsize=(WIDTH * POINT, total * POINT), dpi=72)
    figure.add_artist(Rectangle((0, 0), 1, 1, transform=figure.transFigure, facecolor=PAPER, zorder=-9))
    for i, text in enumerate(words):
        figure.text(
            44 / WIDTH, 1 - (14 + 14 * i) / total, text.replace("$", r"\$"), fontsize=SMALL, color=INK, va="baseline"
        )
    width = (WIDTH - 44 - 12 - 22 * (columns - 1)) / columns
    for i, panel in enumerate(panels):
        left = 44 + (i % columns) * (width + 22)
        bottom = total - top - (i // columns) * (HEAD + ROW + BELOW) - HEAD - ROW
        axes = style_axes(figure.add_axes((left / WIDTH, bottom / total, width / WIDTH, ROW / total)))
        _draw(axes, panel)
        axes.tick_params(labelleft=i % columns == 0)
        if i % columns == 0:
            label_axes(axes, y="log-likelihood")
    return figure


def _draw(axes: "Axes", panel: Panel) -> None:
    profile = panel.profile
    exponent = power_of_ten(*profile.values)
    scale = 10.0**-exponent
    values, drop = profile.values * scale, profile.drop
    grid, curve = _smooth(values, drop, profile.best * scale)
    low, high = _frame(grid, curve)
    inside = grid[(curve <= DROP)]
    colour = BLUE if profile.kind == "closed" else ORANGE
    ends = [end * scale if np.isfinite(end) else edge for end, edge in zip(_ends(profile), (low, high), strict=True)]
    axes.axvspan(*ends, color=colour, alpha=BAND, linewidth=0, label="95 % interval")
    axes.axhline(-DROP, color=MUTED, linewidth=0.9, linestyle="--", label="1.92 below")
    axes.plot(grid, -curve, color=colour, linewidth=1.6, label="profile")
    axes.plot(values, -drop, color=colour, marker="o", markersize=2.4, linestyle="none")
    axes.plot(profile.best * scale, 0.0, color=INK, marker="o", markersize=4, linestyle="none", label="best", zorder=4)
    for bound in profile.bounds:
        if low <= bound * scale <= high and inside.size:
            axes.axvline(bound * scale, color=INK, linewidth=1.4, label="end of the prior")
    if panel.truth is not None:
        axes.axvline(panel.truth * scale, color=PURPLE, linewidth=1.2, linestyle=":", label="true value")
    axes.set(xlim=(low, high), ylim=(-DEEPEST, 0.25))
    axes.set_title(_title(profile, scale), fontsize=SMALL, color=INK, loc="left", pad=4)
    label_axes(axes, unit_label(panel.symbol, profile.unit, exponent))
    axes.xaxis.label.set_fontsize(FONT)


def _ends(profile: Profile) -> tuple[float, float]:
    return profile.lower, profile.upper


def _smooth(values: np.ndarray, drop: np.ndarray, best: float) -> tuple[np.ndarray, np.ndarray]:
    """The curve between its points: the signed root of the fall is nearly straight, so it is what is interpolated."""
    grid = np.linspace(values.min(), values.max(), 301)
    root = np.sign(values - best) * np.sqrt(2 * drop)
    return grid, 0.5 * np.interp(grid, values, root) ** 2


def _frame(grid: np.ndarray, curve: np.ndarray) -> tuple[float, float]:
    """Where the curve is not too deep, with some room."""
    near = grid[curve <= DEEPEST]
    low, high = float(near.min()), float(near.max())
    room = 0.06 * ((high - low) or max(abs(high), 1e-12))
    return low - room, high + room


def _title(profile: Profile, scale: float) -> str:
    lower, upper = (f"{end * scale:.4g}".replace("-", "−") for end in _ends(profile))
    return {
        "closed": f"{lower} to {upper}",
        "open below": f"below {upper}",
        "open above": f"above {lower}",
        "flat": "flat: any value of the prior",
    }[profile.kind]
