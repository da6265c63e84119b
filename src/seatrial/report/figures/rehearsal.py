"""Trials that a campaign's goal takes by each strategy: share of vehicles that have met it, and what is known after each trial."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float

from seatrial.report.figures.style import (
    BAND,
    BLUE,
    INK,
    MUTED,
    ORANGE,
    PURPLE,
    SMALL,
    WIDE,
    label_axes,
    new_figure,
    power_of_ten,
    unit_label,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHARE, SD, GAP, LINE = 130.0, 84.0, 30.0, 13.0
"""Height of the panel of shares, of a panel of standard deviations, between panels, and of a line of text, points."""
STYLES = {
    "adaptive": (BLUE, "-", "o"),
    "fixed": (ORANGE, "-", "s"),
    "doublet": (PURPLE, (0, (4, 2)), "D"),
    "random": (MUTED, (0, (1.5, 1.5)), "^"),
}
"""Colour, line and marker of each strategy."""
ROUND = (
    (1.0,),
    (1.0, 3.0),
    (1.0, 2.0, 5.0),
    (1.0, 1.5, 2.0, 3.0, 5.0, 7.0),
    (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0),
)
"""First digits of ticks on a logarithmic axis, the fewest first."""
APART = 0.07
"""Distance between the bands of two strategies, trials."""


class Progressed(NamedTuple):
    """One strategy, a key of `STYLES`, over N trials: share of vehicles that met the goal, its band, and the median sd of each of k
    coefficients, SI."""

    name: str
    share: Float[np.ndarray, " N"]
    band: Float[np.ndarray, "2 N"]
    sd: Float[np.ndarray, "N k"]


def rehearsal_figure(
    strategies: Sequence[Progressed], symbols: Sequence[str], units: Sequence[str], words: Sequence[str] = ()
) -> "Figure":
    """Draw the shares with their bands above, and below a panel for each coefficient with its sd on a logarithmic scale.

    Args:
        strategies: in the order of the legend.
        symbols: of the coefficients, within dollars.
        units: their SI units.
        words: lines printed above, plain text.
    """
    top = 14.0 + LINE * (len(words) + 1)
    heights = [SHARE, *[SD] * len(symbols)]
    figure, (shares, *panels) = new_figure(WIDE, heights, left=58, right=12, top=top, bottom=36, gap=GAP)
    trial = np.arange(1, strategies[0].share.size + 1)
    for i, one in enumerate(strategies):
        colour, line, marker = STYLES[one.name]
        look = {"color": colour, "linestyle": line, "marker": marker, "markersize": 3.6, "linewidth": 1.4}
        at = trial + APART * (i - 0.5 * (len(strategies) - 1))
        shares.vlines(at, *(100 * one.band), color=colour, alpha=2 * BAND, linewidth=3.0)
        shares.plot(at, 100 * one.share, label=one.name, **look)
        for j, (axes, symbol, unit) in enumerate(zip(panels, symbols, units, strict=True)):
            exponent = power_of_ten(*(value for s in strategies for value in s.sd[:, j]))
            axes.plot(at, one.sd[:, j] * 10.0**-exponent, **look)
            axes.set_yscale("log")
            title = unit_label(f"median sd of {symbol}", unit, exponent)
            axes.set_title(title, fontsize=SMALL, color=INK, loc="left", pad=5)
    for axes in panels:
        _few_ticks(axes)
    shares.set(xlim=(0.6, trial[-1] + 0.4), ylim=(-3, 103), xticks=trial[:: -(-trial.size // 12)])
    label_axes(shares, y="goal met [%]")
    label_axes([shares, *panels][-1], "trials run")
    total = sum(heights) + GAP * len(symbols) + top + 36
    for i, text in enumerate(words):
        figure.text(8 / WIDE, 1 - (12 + LINE * i) / total, text.replace("$", r"\$"), fontsize=SMALL, color=INK)
    figure.legend(
        loc="upper left",
        bbox_to_anchor=(4 / WIDE, 1 - (6 + LINE * len(words)) / total),
        ncols=len(strategies),
        frameon=False,
        fontsize=SMALL,
        labelcolor=INK,
        borderpad=0.0,
        handlelength=2.2,
        columnspacing=1.2,
    )
    return figure


def _few_ticks(axes: "Axes") -> None:
    """Three to six plain numbers on a logarithmic axis."""
    from matplotlib.ticker import FixedLocator, FormatStrFormatter, NullLocator

    low, high = axes.get_ylim()
    tens = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    inside = tens
    for digits in ROUND:
        ticks = np.outer(tens, digits).ravel()
        inside = ticks[(low <= ticks) & (ticks <= high)]
        if inside.size >= 3:
            break
    axes.yaxis.set_major_locator(FixedLocator(inside))
    axes.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    axes.yaxis.set_minor_locator(NullLocator())
