"""Checks of a campaign: what its priors mean in metres per second, ranks of truths in posteriors, and rehearsed trials."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float

from seatrial.estimation.diagnostics.calibration import BINS, DRAWS, Calibration
from seatrial.report.figures.fit import Driven
from seatrial.report.figures.style import (
    BAND,
    BLUE,
    DOTS,
    FONT,
    INK,
    MUTED,
    ORANGE,
    PAPER,
    PURPLE,
    SMALL,
    WIDE,
    draw_dots,
    label_axes,
    limit_ticks,
    new_figure,
    power_of_ten,
    sized_figure,
    style_axes,
    thin_steps,
    unit_label,
    write_lines,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH, HEIGHT = 560.0, 420.0  # Of the picture, points: it stands alone
MOTION, ALONE = 66.0, 120.0  # Height of the panel of one channel among several, and of one alone at least, points
REACH = 1.25  # How far above the bands single motions are followed, in widths of the frame of the bands and the record
RANK_WIDTH, ROW, TOP, BOTTOM, LEFT, RANK_GAP = 640.0, 84.0, 26.0, 40.0, 110.0, 20.0
# Height of the panel of shares, of a panel of standard deviations, between panels, and of a line of text, points.
SHARE, SD, GAP, LINE = 130.0, 84.0, 30.0, 13.0
# Colour, line and marker of each strategy.
STYLES = {
    "adaptive": (BLUE, "-", "o"),
    "fixed": (ORANGE, "-", "s"),
    "doublet": (PURPLE, (0, (4, 2)), "D"),
    "random": (MUTED, (0, (1.5, 1.5)), "^"),
}
LEGEND = {"frameon": False, "fontsize": SMALL, "labelcolor": INK, "borderpad": 0.0, "columnspacing": 1.2}
# First digits of ticks on a logarithmic axis, the fewest first.
ROUND = (
    (1.0,),
    (1.0, 3.0),
    (1.0, 2.0, 5.0),
    (1.0, 1.5, 2.0, 3.0, 5.0, 7.0),
    (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0),
)
APART = 0.07  # Distance between the bands of two strategies, trials


class Progressed(NamedTuple):
    """One strategy, a key of `STYLES`, over N trials: share of vehicles that met the goal, its band, and the median sd of each of k
    coefficients, SI."""

    name: str
    share: Float[np.ndarray, " N"]
    band: Float[np.ndarray, "2 N"]
    sd: Float[np.ndarray, "N k"]


class Moved(NamedTuple):
    """One channel as the prior expects it.

    Attributes:
        label: of its axis.
        bands: its quantiles 5, 25, 50, 75 and 95 %, shape (5, n); NaN if there are none.
        single: of a few draws, NaN once they have run away, shape (k, n).
        measured: NaN if not, shape (n,); None if it is not measured.
    """

    label: str
    bands: Float[np.ndarray, "5 n"]
    single: Float[np.ndarray, "k n"]
    measured: Float[np.ndarray, " n"] | None


def prior_motions(
    time: np.ndarray,
    motions: Sequence[Moved],
    controls: Sequence[Driven],
    *,
    spreads: Sequence[tuple[str, np.ndarray]] = (),
    words: Sequence[str] = (),
    figure: "Figure | None" = None,
) -> "Figure":
    """Draw channels over time as the prior expects them, the controls below, and how numbers of the draws are spread.

    Args:
        time: s, shape (n,).
        motions: channels.
        controls: what drives the vehicle.
        spreads: labels and values of numbers that each draw has, two at most, NaN if it has none, shape (draws,).
        words: lines printed above.
        figure: an empty one to draw into; made if not given.
    """
    from matplotlib.patches import Rectangle

    top, beneath = 12.0 + 14.0 * len(words), 158.0 if spreads else 40.0
    low_panels = 46.0 * len(controls)
    each = max(HEIGHT - 24 - beneath - low_panels, ALONE) if len(motions) == 1 else MOTION
    total = top + 12 + len(motions) * (each + 12) + low_panels + beneath
    figure = sized_figure(WIDTH, total, figure)
    figure.add_artist(Rectangle((0, 0), 1, 1, transform=figure.transFigure, facecolor=PAPER, zorder=-9))
    write_lines(figure, words, LEFT, 16)

    def panel(left: float, bottom: float, width: float, height: float) -> "Axes":
        return style_axes(figure.add_axes((left / WIDTH, bottom / total, width / WIDTH, height / total)))

    half, above = (WIDTH - LEFT - 12 - 24) / 2, beneath + low_panels + 12
    moved = [panel(LEFT, above + (each + 12) * i, WIDTH - LEFT - 12, each) for i in reversed(range(len(motions)))]
    driven = [panel(LEFT, beneath + 46.0 * i, WIDTH - LEFT - 12, 36) for i in reversed(range(len(controls)))]
    spread = [panel(LEFT + (half + 24) * i, 40, half, 66) for i in range(len(spreads))]
    for upper in [*moved, *driven][:-1]:
        upper.tick_params(labelbottom=False)
    draw_motions([*moved, *driven, *spread], time, motions, controls, spreads=spreads)
    return figure


def draw_motions(
    axes: "Sequence[Axes]",
    time: np.ndarray,
    motions: Sequence[Moved],
    controls: Sequence[Driven],
    *,
    spreads: Sequence[tuple[str, np.ndarray]] = (),
) -> None:
    """Draw what `prior_motions` does into axes: each channel, each control, each spread."""
    moved, rest = axes[: len(motions)], axes[len(motions) :]
    driven, spread = rest[: len(controls)], rest[len(controls) :]
    for i, (one, motion) in enumerate(zip(moved, motions, strict=True)):
        _draw_motion(one, time, motion, legend=i == 0)
    for below, control in zip(driven, controls, strict=True):
        keep = thin_steps(control.values)
        below.plot(
            time[keep], control.values[keep], color=MUTED, linewidth=1.0, drawstyle="steps-post", label="control"
        )
        below.set_xlim(float(time[0]), float(time[-1]))
        below.margins(y=0.15)
        limit_ticks(below.yaxis, 2)
        label_axes(below, y=control.label)
    label_axes([*moved, *driven][-1], "time [s]")
    for one, (label, values) in zip(spread, spreads, strict=True):
        _draw_spread(one, values, label)


def rank_figure(result: Calibration, words: str) -> "Figure":
    """Draw a row for each quantity: histogram left, distance from the diagonal right, bands that hold all of them in 99 % of cases.

    Args:
        result: ranks.
        words: heading, plain text.
    """
    k = len(result.names)
    height = TOP + k * ROW + (k - 1) * RANK_GAP + BOTTOM
    figure = sized_figure(RANK_WIDTH, height)
    figure.text(8 / RANK_WIDTH, 1 - 14 / height, words, fontsize=SMALL + 1, color=INK)
    half = 0.5 * (RANK_WIDTH - LEFT - 70)
    low, high = result.count_band()
    outside = result.outside()
    for i, name in enumerate(result.names):
        y = (height - TOP - (i + 1) * ROW - i * RANK_GAP) / height
        box = (half / RANK_WIDTH, ROW / height)
        left = style_axes(figure.add_axes((LEFT / RANK_WIDTH, y, *box)))
        right = style_axes(figure.add_axes(((LEFT + half + 54) / RANK_WIDTH, y, *box)))
        color = ORANGE if name in outside else BLUE
        edges = np.linspace(0, DRAWS + 1, BINS + 1)
        left.axhspan(low, high, color=BLUE, alpha=BAND, linewidth=0)
        left.bar(
            edges[:-1], result.counts()[i], np.diff(edges), align="edge", color=color, edgecolor="none", alpha=0.75
        )
        at, band = np.arange(1, DRAWS + 1), result.distance_band()
        right.fill_between(at, -band, band, color=BLUE, alpha=BAND, linewidth=0)
        right.axhline(0.0, color=MUTED, linewidth=0.8)
        right.plot(at, result.distance()[i], color=color, linewidth=1.4)
        right.set_ylim(-2.2 * band.max(), 2.2 * band.max())
        figure.text(8 / RANK_WIDTH, y + 0.5 * ROW / height, name, fontsize=SMALL + 1, color=INK, va="center")
        last = i == k - 1
        for axes in (left, right):
            axes.set_xlim(0, DRAWS + 1)
            axes.tick_params(labelbottom=last)
        if last:
            label_axes(left, x="rank of the truth among 99 draws")
            label_axes(right, x="rank: distribution minus the uniform one")
    return figure


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
    write_lines(figure, words, 8, 12, LINE)
    figure.legend(
        loc="upper left",
        bbox_to_anchor=(4 / WIDE, 1 - (6 + LINE * len(words)) / total),
        ncols=len(strategies),
        handlelength=2.2,
        **LEGEND,
    )
    return figure


def _draw_motion(axes: "Axes", time: np.ndarray, motion: Moved, legend: bool) -> None:
    label, bands, single, measured = motion
    if np.isfinite(bands).any():
        for low, high, opacity, what in ((0, 4, 0.16, "90 % of draws"), (1, 3, 0.28, "50 %")):
            axes.fill_between(time, bands[low], bands[high], color=BLUE, alpha=opacity, linewidth=0, label=what)
        axes.plot(time, bands[2], color=BLUE, linewidth=1.8, label="median", zorder=3)
    for i, one in enumerate(single):
        axes.plot(time, one, color=ORANGE, linewidth=0.9, alpha=0.9, label="" if i else "single draws", zorder=2.5)
    if measured is not None:
        draw_dots(axes, time, measured, 1500, color=INK, size=2.0).set_zorder(4)
        axes.plot([], [], marker="o", markersize=2.5, color=INK, linestyle="none", label="measured")
    axes.set(xlim=(float(time[0]), float(time[-1])), ylim=_frame(bands, single, measured))
    label_axes(axes, y=label)
    if legend:
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=5, handlelength=1.4, **LEGEND)


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
    places = values[np.isfinite(values)]
    label_axes(axes, label)
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    axes.grid(False)
    if places.size < 0.5 * values.size:
        axes.text(0.5, 0.5, "most draws have none", transform=axes.transAxes, ha="center", fontsize=FONT, color=MUTED)
        axes.set_xticks([])
        return
    first, low, middle, high, last = (float(value) for value in np.quantile(places, (0.01, 0.05, 0.5, 0.95, 0.99)))
    if not last > first:
        first, last = first - 0.5, last + 0.5
    counts, edges = np.histogram(places, bins=40, range=(first, last))
    axes.stairs(counts / counts.max(), edges, fill=True, color=DOTS, alpha=0.6, linewidth=0, label="draws")
    axes.plot([low, high], [-0.08, -0.08], color=BLUE, linewidth=4, solid_capstyle="butt", label="90 %", clip_on=False)
    axes.plot(middle, -0.08, marker="o", markersize=5, color=INK, linestyle="none", label="median", zorder=5)
    axes.set(xlim=(first, last), ylim=(-0.2, 1.05))
    limit_ticks(axes.xaxis, 6)


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
