"""The iteration the paper proposes: what each second trial would leave to doubt, and what was found with the best."""

from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from seatrial.report.figures.style import BLUE, DOTS, INK, MUTED, ORANGE, PURPLE, limit_ticks
from studies.remus100.figures.panels import PAGE, TEXT, key, name_axes, panels, symbol, with_unit
from studies.remus100.study import Study

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = (BLUE, ORANGE, PURPLE, INK)
ALONE = {"color": DOTS, "marker": "o", "markersize": 4, "linestyle": "none"}
FIRST = {"color": INK, "linewidth": 1.0, "linestyle": (0, (4, 2))}


def iteration(study: Study) -> "Figure":
    """Draw the predicted standard deviations of every second trial, and fits of one trial, of two, and of the redesigned two."""
    data = study.part("iteration")
    figure, grid = panels(PAGE, [82, 82], 2, left=112, between=64, gap=14, right=14, share_x=False, bottom=40)
    grid[0, 0].remove()
    axes = grid[1, 0]
    low, high = axes.get_position(), grid[0, 1].get_position()
    axes.set_position((low.x0, low.y0, low.width, high.y1 - low.y0))
    _candidates(axes, data.sel(coefficient=study.reading.doubted))
    name_axes(axes, with_unit(study.reading, study.reading.doubted, "predicted sd of "))
    _fits(grid[0, 1], grid[1, 1], data)
    key(
        figure,
        {
            "with the first trial": {"color": BLUE, "linewidth": 6, "alpha": 0.6},
            "alone": ALONE,
            "first trial alone": FIRST,
        },
    )
    return figure


def _candidates(axes: "Axes", one: xr.Dataset) -> None:
    designs = [str(name) for name in one["design"].values]
    at = -np.arange(len(designs))
    axes.barh(at, one["both"].values, height=0.6, color=BLUE, alpha=0.6, label="with the first trial")
    axes.plot(one["alone"].values, at, label="alone", **ALONE)
    axes.axvline(float(one["first_sd"]), label="first trial alone", **FIRST)
    axes.set_yticks(at, designs)
    axes.set_xlim(0, 1.08 * max(float(one["alone"].max()), float(one["first_sd"])))
    axes.grid(False, axis="y")
    limit_ticks(axes.xaxis, 5)


def _fits(upper: "Axes", lower: "Axes", data: xr.Dataset) -> None:
    """Draw the standard deviations of M-0 over those of one trial, and the probability of M-0 below."""
    fits = [str(name) for name in data["fit"].values]
    at = np.arange(len(fits))
    for colour, name in zip(COLOURS, map(str, data["coefficient"].values), strict=False):
        sd = data["full_sd"].sel(coefficient=name).values
        upper.plot(at, sd / sd[0], color=colour, linewidth=1.1, marker="o", markersize=3.5, label=name)
    upper.set_ylim(0, 1.08)
    upper.set_xticks(at, [])
    upper.legend(
        [symbol(str(name)) for name in data["coefficient"].values],
        loc="lower left",
        ncols=2,
        frameon=False,
        fontsize=TEXT,
        labelcolor=INK,
        borderaxespad=0.1,
        labelspacing=0.2,
        handlelength=1.4,
        columnspacing=1.0,
    )
    p = data["probability"].values
    lower.axhline(0.5, color=MUTED, linewidth=0.9, linestyle=(0, (4, 3)), label="undecided")
    lower.errorbar(at, p, yerr=data["error"].values, color=BLUE, linewidth=1.1, marker="o", markersize=4, label="M-0")
    lower.set(xlim=(-0.4, at[-1] + 0.4), ylim=(0, 1))
    upper.set_xlim(lower.get_xlim())
    lower.set_xticks(at, [fill(name, 12) for name in fits])
    name_axes(upper, y="sd of M-0,\none trial = 1")
    name_axes(lower, y="probability\nof M-0")
