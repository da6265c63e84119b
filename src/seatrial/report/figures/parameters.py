"""All parameters in one picture: every pair of them, their chains, and how a filter's belief about each narrows along the records.

Each picture is one pair of axes, in which rows and panels are laid out by hand: so many axes would take a minute to draw.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float

from seatrial.report.figures.posterior import PriorShape
from seatrial.report.figures.style import (
    BAND,
    BLUE,
    DOTS,
    FONT,
    INK,
    MUTED,
    ORANGE,
    PURPLE,
    RULE,
    SMALL,
    draw_dots,
    label_axes,
    new_figure,
    power_of_ten,
    thin,
    unit_label,
)
from seatrial.report.numbers import Digits

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Width of the picture of pairs at most, of one of its panels at most, of its margins, and height of a row of traces,
# points.
PAGE, PANEL, MARGIN, ROW = 640.0, 118.0, 64.0, 46.0
# Between panels, in panels; half width of a panel, standard deviations; bins of a histogram and of each side of a joint
# one.
GAP, FRAME, BINS, GRID = 0.07, 4.2, 30, 40
MIN_NUMBERED_WIDTH = 80.0  # Width of a panel below which it has no numbers, points
SHARES = (0.95, 0.5)
COLOURS = (BLUE, ORANGE, PURPLE, DOTS)
SHORTEST, SETTLED, REACH = 5, 0.06, 16.0


class Traced(NamedTuple):
    """A filter's belief about one coefficient, shape (n,), where it began, what the sampler says, and the truth where it is known."""

    symbol: str
    mean: Float[np.ndarray, " n"]
    sd: Float[np.ndarray, " n"]
    prior_mean: float
    posterior_mean: float
    truth: float | None = None


def corner(
    draws: Float[np.ndarray, "n k"],
    symbols: Sequence[str],
    units: Sequence[str],
    digits: Sequence[Digits],
    priors: Sequence[PriorShape],
    truth: Sequence[float | None],
) -> "Figure":
    """Draw each parameter on the diagonal, over its prior, and below it every pair with the regions that hold 50 % and 95 %.

    Args:
        draws: SI.
        symbols: of the parameters, within dollars.
        units: SI.
        digits: how the numbers at the edges are written.
        priors: of each.
        truth: of each, None if it is not known.
    """
    from matplotlib.collections import LineCollection

    count = draws.shape[1]
    side = min(PANEL * count, PAGE - MARGIN)
    figure, (axes,) = new_figure(side + MARGIN + 10, [side], left=MARGIN, right=10, top=8, bottom=MARGIN - 12)
    axes.axis("off")
    frames = [_frame(column) for column in draws.T]
    unit = [
        np.clip((column - low) / (high - low), -0.5, 1.5) for column, (low, high) in zip(draws.T, frames, strict=True)
    ]
    place = (1 + GAP) * np.arange(count)
    panels, inner, outer = [], [], []
    for row in range(count):
        for column in range(row + 1):
            corner_at = np.array([place[column], -place[row]])
            panels.append(corner_at + np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]))
            if row == column:
                _diagonal(axes, corner_at, unit[row], frames[row], priors[row])
                continue
            for lines, line in _regions(unit[column], unit[row], (outer, inner)):
                lines.append(corner_at + line)
        _mark(
            axes,
            place,
            row,
            [None if t is None else (t - lo) / (hi - lo) for t, (lo, hi) in zip(truth, frames, strict=True)],
        )
    axes.add_collection(LineCollection(panels, colors=RULE, linewidths=0.8, zorder=1))
    axes.add_collection(LineCollection(outer, colors=BLUE, linewidths=0.9, zorder=3, label="95 % of the draws"))
    axes.add_collection(LineCollection(inner, colors=BLUE, linewidths=1.7, zorder=3, label="50 % of the draws"))
    panel = side / (place[-1] + 1)
    for at, (symbol, one) in enumerate(zip(symbols, units, strict=True)):
        label = unit_label(symbol, one, digits[at].exponent) if panel > MIN_NUMBERED_WIDTH else symbol
        _edges(axes, place, at, panel, frames[at], label, digits[at])
    axes.set(xlim=(0, place[-1] + 1), ylim=(-place[-1], 1))
    return figure


def chain_rows(draws: Float[np.ndarray, "c n k"], symbols: Sequence[str]) -> "Figure":
    """Draw four chains of each parameter, those of the lowest and highest mean among them; chains that agree lie over each other.

    Args:
        draws: of each chain.
        symbols: of the parameters, within dollars.
    """
    figure, axes = _rows(symbols, 22.0, "draw")
    keep = thin(draws.shape[1], min(160, 5000 // (len(COLOURS) * len(symbols))))
    for row in range(len(symbols)):
        values = draws[:, :, row]
        sd = float(values.std()) or 1.0
        ranked = np.argsort(values.mean(axis=1), kind="stable")
        shown = dict.fromkeys(ranked[np.linspace(0, len(ranked) - 1, len(COLOURS)).round().astype(int)].tolist())
        for chain, colour in zip(shown, COLOURS, strict=False):
            at = np.clip((values[chain, keep] - values.mean()) / (2 * FRAME * sd), -0.48, 0.48)
            axes.plot(keep, at - row, color=colour, linewidth=0.7, alpha=0.85)
    axes.set_xlim(0, draws.shape[1] - 1)
    return figure


def draw_chains(axes: "Axes", draws: np.ndarray, symbol: str, unit: str) -> None:
    """Draw every chain of one parameter over its draws, and the mean of all of them.

    Chains that have mixed look alike; one that stays away from the others has not.

    Args:
        axes: where.
        draws: SI, shape (chains, draws).
        symbol: of the parameter, within dollars.
        unit: its SI unit.
    """
    exponent = power_of_ten(*np.quantile(draws, [0.001, 0.999]))
    keep, values = thin(draws.shape[1], 400), draws * 10.0**-exponent
    for index, chain in enumerate(values):
        colour = COLOURS[index % len(COLOURS)]
        axes.plot(keep, chain[keep], color=colour, linewidth=0.6, alpha=0.7, label=f"chain {index + 1}")
    axes.axhline(float(values.mean()), color=INK, linewidth=1.0, label="mean", zorder=3)
    axes.set_xlim(0, max(draws.shape[1] - 1, 1))
    label_axes(axes, "draw after warm-up", unit_label(symbol, unit, exponent))


def belief_rows(time: Float[np.ndarray, " n"], rows: Sequence[Traced], starts: Sequence[float] = ()) -> "Figure":
    """Draw the filter's mean and a band of two standard deviations, a row for each coefficient.

    The first instants, where the band is as wide as the prior, may leave the row: what follows is what matters.

    Args:
        time: of the records one after another, s.
        rows: of each coefficient.
        starts: where the second record, the third, and so on begin, s.
    """
    figure, axes = _rows([one.symbol for one in rows], ROW, "time, records in sequence [s]" if starts else "time [s]")
    keep = thin(time.size, min(260, 2000 // len(rows)))
    for row, one in enumerate(rows):
        low, high = _settled(one)

        def scaled(values, low=low, high=high, row=row):
            return np.clip((values - low) / (high - low) - 0.5, -0.47, 0.47) - row

        axes.fill_between(
            time[keep],
            scaled((one.mean - 2 * one.sd)[keep]),
            scaled((one.mean + 2 * one.sd)[keep]),
            color=BLUE,
            alpha=BAND,
            linewidth=0,
        )
        for value, colour, dashes in (
            (one.prior_mean, MUTED, (0, (4, 3))),
            (one.posterior_mean, ORANGE, (0, (7, 2))),
            (one.truth, PURPLE, (0, (1.5, 1.5))),
        ):
            if value is not None and low <= value <= high:
                axes.hlines(scaled(value), time[0], time[-1], color=colour, linewidth=1.3, linestyle=dashes, zorder=2.5)
        axes.plot(time[keep], scaled(one.mean[keep]), color=BLUE, linewidth=1.4, zorder=3)
    for start in starts:
        axes.axvline(start, color=MUTED, linewidth=0.9, linestyle=(0, (1, 2)))
    axes.set_xlim(float(time[0]), float(time[-1]))
    return figure


def _rows(symbols: Sequence[str], height: float, x: str) -> "tuple[Figure, Axes]":
    """Return a figure and its axes, with a row of height 1 about 0, -1, -2 and so on for each symbol."""
    count = len(symbols)
    figure, (axes,) = new_figure(PAGE, [max(60.0, height * count)], left=MARGIN, right=10)
    axes.set_yticks(-np.arange(count), symbols, fontsize=FONT)
    axes.tick_params(axis="y", length=0)
    axes.grid(False, axis="y")
    axes.hlines(-np.arange(1, count) + 0.5, 0, 1, transform=axes.get_yaxis_transform(), color=RULE, linewidth=0.8)
    axes.set_ylim(0.5 - count, 0.5)
    label_axes(axes, x)
    return figure, axes


def _frame(values: np.ndarray) -> tuple[float, float]:
    mean, sd = float(values.mean()), float(values.std())
    half = FRAME * sd if sd > 1e-9 * abs(mean) else abs(mean) or 1.0
    return mean - half, mean + half


def _diagonal(axes: "Axes", at: np.ndarray, unit: np.ndarray, frame: tuple[float, float], prior: PriorShape) -> None:
    counts, edges = np.histogram(unit, bins=BINS, range=(0, 1))
    x, bin_width = np.linspace(0, 1, 60), (frame[1] - frame[0]) / BINS
    height = prior.density(frame[0] + x * (frame[1] - frame[0])) * unit.size * bin_width
    top = 1.12 * max(counts.max(), height.max()) or 1
    axes.stairs(counts / top + at[1], at[0] + edges, baseline=at[1], fill=True, color=BLUE, alpha=0.45, linewidth=0)
    axes.plot(at[0] + x, at[1] + height / top, color=MUTED, linewidth=1.1, linestyle=(0, (4, 3)))


def _regions(x: np.ndarray, y: np.ndarray, kinds: tuple[list, list]) -> list[tuple[list, np.ndarray]]:
    """Return the lines round the regions that hold the shares of the draws, in units of a panel, each with the list it belongs to."""
    from contourpy import contour_generator
    from scipy.ndimage import gaussian_filter

    counts, edges, _ = np.histogram2d(x, y, bins=GRID, range=[(-0.05, 1.05)] * 2)
    smooth = gaussian_filter(counts, 1.0)
    ordered = np.sort(smooth.ravel())[::-1]
    held = np.cumsum(ordered) / ordered.sum()
    centre = (edges[1:] + edges[:-1]) / 2
    generator = contour_generator(centre, centre, smooth.T)
    contours = []
    for kind, share in zip(kinds, SHARES, strict=True):
        level = float(ordered[min(int(np.searchsorted(held, share)), ordered.size - 1)])
        contours += (
            [(kind, np.clip(np.asarray(line), 0, 1)) for line in generator.lines(level)]
            if 0 < level < ordered[0]
            else []
        )
    return contours


def _mark(axes: "Axes", place: np.ndarray, row: int, truth: Sequence[float | None]) -> None:
    """Mark the truth: across the panel of one parameter, and in those of two."""
    own = truth[row]
    if own is None or not 0 <= own <= 1:
        return
    axes.plot(
        [place[row] + own] * 2, [-place[row], 1 - place[row]], color=PURPLE, linewidth=1.5, linestyle=(0, (1.5, 1.5))
    )
    known = [(place[c] + t, own - place[row]) for c, t in enumerate(truth[:row]) if t is not None and 0 <= t <= 1]
    if known:
        draw_dots(axes, *np.array(known).T, color=PURPLE, size=5.0).set_zorder(5)


def _edges(
    axes: "Axes", place: np.ndarray, at: int, panel: float, frame: tuple[float, float], label: str, digits: Digits
) -> None:
    """Write below the lowest panels, and beside the leftmost, what they show and the values two standard deviations from the middle.

    Args:
        axes: of the whole picture.
        place: of the panels along it.
        at: which parameter.
        panel: width of a panel, points; numbers have no room in small ones.
        frame: what a panel holds.
        label: of the parameter.
        digits: its own.
    """
    middle, step = sum(frame) / 2, (frame[1] - frame[0]) / (2 * FRAME)
    small = {"fontsize": SMALL - 1.5, "color": MUTED, "va": "center", "ha": "center"}
    large = {"fontsize": FONT, "color": INK, "va": "center", "ha": "center"}
    for shift in (-2, 2) if panel > MIN_NUMBERED_WIDTH else ():
        share, text = 0.5 + shift / (2 * FRAME), digits.bare(middle + shift * step)
        axes.text(place[at] + share, -place[-1] - 9 / panel, text, **small)
        if at:
            axes.text(-8 / panel, share - place[at], text, rotation=90, **small)
    away = (26 if panel > MIN_NUMBERED_WIDTH else 12) / panel
    axes.text(place[at] + 0.5, -place[-1] - away, label, **large)
    if at:
        axes.text(-away, 0.5 - place[at], label, rotation=90 * (panel > MIN_NUMBERED_WIDTH), **large)


def _settled(one: Traced) -> tuple[float, float]:
    """Limits that hold the band once it has settled, and the values that must be seen."""
    mean, sd, always = one.mean, one.sd, [one.posterior_mean, *([] if one.truth is None else [one.truth])]
    first = max(min(SHORTEST, mean.size - 1), int(SETTLED * mean.size))
    low, high = float(np.min((mean - 2 * sd)[first:])), float(np.max((mean + 2 * sd)[first:]))
    low, high = max(low, mean[-1] - REACH * sd[-1]), min(high, mean[-1] + REACH * sd[-1])
    low, high = min([low, *always]), max([high, *always])
    pad = 0.08 * ((high - low) or abs(high) or 1.0)
    return low - pad, high + pad
