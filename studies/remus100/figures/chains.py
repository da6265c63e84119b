"""Figures 6 to 8: a Markov chain parameter by parameter: its trace, its autocorrelation, and the posterior it found."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from seatrial.report.figures.posterior import normal_density
from seatrial.report.figures.style import BLUE, INK, MUTED, ORANGE, PURPLE, limit_ticks, thin
from studies.remus100.figures.panels import PAGE, TEXT, key, name_axes, panels, symbol, with_unit
from studies.remus100.study import Study

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BINS, LIMIT = 50, 2.0
GEWEKE = {"color": ORANGE, "marker": "o", "markersize": 3, "linestyle": "none"}
NORMAL = {"color": INK, "linewidth": 1.0, "linestyle": (0, (4, 2))}
BURN_IN = {"color": INK, "linewidth": 0.9, "linestyle": (0, (1, 1.5))}
INSIDE = {"color": ORANGE, "linewidth": 6, "alpha": 0.16}
RAW = {"color": ORANGE, "linewidth": 6, "alpha": 0.25}
DETRENDED = {"color": ORANGE, "linewidth": 1.4}
DRAWS = {"color": BLUE, "linewidth": 6, "alpha": 0.45}
TRUE = {"color": PURPLE, "linewidth": 1.5, "linestyle": (0, (1.5, 1.2))}
MEAN = {"color": BLUE, "linewidth": 1.4}
HPD = {"color": MUTED, "linewidth": 6, "alpha": 0.3}


def chain_figure(part: str) -> Callable[[Study], "Figure"]:
    """Figure of the chain kept under this name."""

    def draw(study: Study) -> "Figure":
        return draw_chain(study, study.part(part))

    return draw


def draw_chain(study: Study, data: xr.Dataset) -> "Figure":
    """Draw one row of three panels for each parameter."""
    names = [str(name) for name in data["parameter"].values]
    figure, grid = panels(PAGE, [74] * len(names), 3, left=46, right=12, top=38, between=57, gap=31, share_x=False)
    for row, name in enumerate(names):
        one = data.sel(parameter=name)
        right = _trace(grid[row, 0], one, study.sizes.burn_in)
        _autocorrelation(grid[row, 1], one)
        _posterior(grid[row, 2], one)
        last = row == len(names) - 1
        name_axes(grid[row, 0], "iteration [1000]" if last else "", f"{symbol(name)} / true")
        name_axes(grid[row, 1], "lag [iterations]" if last else "", "autocorr.")
        name_axes(grid[row, 2], with_unit(study.reading, name), "density")
        name_axes(right, y="z")
    key(
        figure,
        {
            "trace": {"color": BLUE, "linewidth": 0.8},
            "end of burn-in": BURN_IN,
            "Geweke score z": GEWEKE,
            "z within ± 2": INSIDE,
            "raw autocorr.": RAW,
            "detrended": DETRENDED,
            "draws": DRAWS,
            "95 % HPD": HPD,
            "normal": NORMAL,
            "mean": MEAN,
            "true": TRUE,
        },
        columns=6,
    )
    return figure


def _trace(axes: "Axes", one: xr.Dataset, burn_in: int) -> "Axes":
    """Draw the trace over all iterations; return the right axis, of the scores over the first half of the kept ones."""
    iteration, keep = one["iteration"].values / 1000, thin(one.sizes["iteration"], 600)
    values = one["trace"].values / float(one["truth"])
    axes.plot(iteration[keep], values[keep], color=BLUE, linewidth=0.5, alpha=0.85, label="trace")
    axes.axvline(burn_in / 1000, label="end of burn-in", **BURN_IN)
    axes.set_xlim(float(iteration[0]), float(iteration[-1]))
    right = axes.twinx()
    for name, spine in right.spines.items():
        spine.set_visible(name == "right")
        spine.set_color(MUTED)
        spine.set_linewidth(0.8)
    score = one["geweke"].values
    at = (burn_in + one["geweke_start"].values) / 1000
    reach = max(4.0, 1.15 * float(np.nanmax(np.abs(score))))
    end = (burn_in / 1000 + float(iteration[-1])) / 2
    right.fill_between([burn_in / 1000, end], -LIMIT, LIMIT, color=ORANGE, alpha=0.16, linewidth=0, label="± 2")
    right.plot(at, score, label="Geweke", zorder=4, **GEWEKE)
    right.set_ylim(-reach, reach)
    right.tick_params(colors=MUTED, labelsize=TEXT, length=3, width=0.8, labelcolor=INK, pad=2)
    limit_ticks(right.yaxis, 4)
    return right


def _autocorrelation(axes: "Axes", one: xr.Dataset) -> None:
    lag = one["lag"].values
    axes.fill_between(lag, 0, one["raw_acf"].values, color=ORANGE, alpha=0.25, linewidth=0, label="raw")
    heights = np.stack([np.zeros(lag.size), one["acf"].values, np.full(lag.size, np.nan)], -1).ravel()
    axes.plot(np.repeat(lag, 3), heights, color=ORANGE, linewidth=0.7, label="detrended")
    axes.set(xlim=(float(lag[0]), float(lag[-1])), ylim=(min(-0.1, float(one["acf"].min())), 1.05))


def _posterior(axes: "Axes", one: xr.Dataset) -> None:
    draws = one["draws"].values.ravel()
    mean, sd, truth = (float(one[name]) for name in ("mean", "sd", "truth"))
    low, high = min(mean - 4 * sd, truth - 0.3 * sd), max(mean + 4 * sd, truth + 0.3 * sd)
    counts, edges = np.histogram(draws, bins=BINS, range=(low, high))
    axes.axvspan(float(one["hpd_low"]), float(one["hpd_high"]), color=MUTED, alpha=0.16, linewidth=0, label="95 % HPD")
    axes.stairs(counts / (draws.size * np.diff(edges)), edges, fill=True, color=BLUE, alpha=0.45, label="draws")
    grid = np.linspace(low, high, 120)
    axes.plot(grid, normal_density(grid, mean, sd), label="normal", **NORMAL)
    axes.axvline(truth, label="true", zorder=4, **TRUE)
    axes.axvline(mean, label="mean", zorder=3, **MEAN)
    axes.set(xlim=(low, high), yticks=[])
    axes.set_ylim(bottom=0)
    axes.spines["left"].set_visible(False)
    axes.grid(False)
    limit_ticks(axes.xaxis, 4)
