"""Figures 1, 2 and 4: what Kalman filters make of a trial: response, coefficients, and how sure they are of them."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr

from seatrial.report.figures.style import (
    BLUE,
    DOTS,
    INK,
    MUTED,
    ORANGE,
    PURPLE,
    draw_dots,
    limit_ticks,
    thin,
    thin_steps,
)
from studies.remus100.compute.filters import BOUND_SHARE
from studies.remus100.figures.panels import PAGE, TEXT, key, logarithmic, name_axes, panels, plain_axes, rpm, with_unit
from studies.remus100.study import Study

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LOOKS = {
    "EKF": {"color": BLUE, "linewidth": 1.6},
    "UKF": {"color": ORANGE, "linewidth": 1.3, "linestyle": (0, (5, 2))},
    "SRUKF": {"color": PURPLE, "linewidth": 1.2, "linestyle": (0, (1.5, 1.5))},
}
CONSTRAINED = {"SRUKF": {"color": PURPLE, "linewidth": 1.0}, "SRUKF-C": {"color": BLUE, "linewidth": 1.3}}
ALONE = {"SRUKF": {"color": BLUE, "linewidth": 1.3}}
TRUE = {"color": INK, "linewidth": 0.9, "linestyle": (0, (6, 2))}
BOUND = {"color": MUTED, "linewidth": 1.0, "linestyle": (0, (1, 2))}
MEASURED = {"color": DOTS, "marker": "o", "markersize": 2, "linestyle": "none"}
SETTLED = 3.0
"""Seconds after which the estimates have left the first guess and decide the frame."""
BINS = 10
"""Samples over which clipping is averaged."""
BELOW, HIGH = 92, 56
"""Room for the lowest row of Figure 2, and the height of its panels, in points."""


class Run(NamedTuple):
    """What one filter made of the trial."""

    name: str
    u: np.ndarray
    udot: np.ndarray
    mean: np.ndarray
    sd: np.ndarray


def figure_1(study: Study) -> "Figure":
    """Draw the extended, unscented and square-root unscented filters along one trial of random steps."""
    data = study.part("filters")
    return _traces(study, data, _runs(data, LOOKS), LOOKS)


def figure_2(study: Study) -> "Figure":
    """Draw the square-root filter with and without constraints; below, when points are clipped, and the first second."""
    data = study.part("filters")
    runs = _runs(data, CONSTRAINED)
    figure = _traces(study, data, runs, CONSTRAINED, below=BELOW)
    for axes, name in zip(figure.axes[1:9:3], map(str, data["coefficient"].values), strict=True):
        truth = study.reading.printed_truth[name]
        bounds = sorted(share * truth for share in (1 - BOUND_SHARE, 1 + BOUND_SHARE))
        low, high = axes.get_ylim()
        pad = 0.05 * (bounds[1] - bounds[0])
        axes.set_ylim(min(low, bounds[0] - pad), max(high, bounds[1] + pad))
        for bound in bounds:
            axes.axhline(bound, label="bound", zorder=2.4, **BOUND)
    left, middle, right = (axes.get_position() for axes in figure.axes[6:9])
    low, tall = 30 / figure.get_figheight() / 72, HIGH / figure.get_figheight() / 72
    _clipping(plain_axes(figure.add_axes((left.x0, low, middle.x1 - left.x0, tall))), data)
    _first_second(plain_axes(figure.add_axes((right.x0, low, right.width, tall))), data, runs)
    return figure


def figure_4(study: Study) -> "Figure":
    """Draw the square-root filter along the largest doublets of 10 s, with the long quiet tail."""
    data = study.part("chosen-doublet")
    run = Run("SRUKF", data["u"].values, data["udot"].values, data["mean"].values, data["sd"].values)
    return _traces(study, data, [run], ALONE)


def _runs(data: xr.Dataset, names: Mapping[str, Any]) -> list[Run]:
    chosen = {name: data.sel(filter=name) for name in names}
    return [Run(name, *(one[part].values for part in ("u", "udot", "mean", "sd"))) for name, one in chosen.items()]


def _traces(
    study: Study, data: xr.Dataset, runs: list[Run], looks: Mapping[str, Mapping[str, Any]], below: float = 0
) -> "Figure":
    """Draw a column of response, one of estimates and one of their standard deviations; `below` is room left free, points."""
    figure, grid = panels(PAGE, [84, 84, 84], 3, left=46, between=57, bottom=30 + below)
    time = data["time"].values
    keep = thin(time.size, 500)
    _response(grid[:, 0], data, runs, looks)
    for row, name in enumerate(map(str, data["coefficient"].values)):
        truth = study.reading.printed_truth[name]
        for run in runs:
            for axes, values in zip(grid[row, 1:], (run.mean, run.sd), strict=True):
                axes.plot(time[keep], values[keep, row], label=run.name, **looks[run.name])
        grid[row, 1].axhline(truth, label="true", zorder=2.5, **TRUE)
        settled = np.concatenate([run.mean[time >= min(SETTLED, time[-1] / 2), row] for run in runs])
        low, high = min(settled.min(), truth), max(settled.max(), truth)
        pad = 0.08 * ((high - low) or abs(truth))
        grid[row, 1].set_ylim(low - pad, high + pad)
        logarithmic(grid[row, 2])
        label = with_unit(study.reading, name).replace(" [", "\n[")
        name_axes(grid[row, 1], y=label)
        name_axes(grid[row, 2], y=f"sd of {label}")
    for axes in grid[2]:
        axes.set_xlim(float(time[0]), float(2 * time[-1] - time[-2]))
        limit_ticks(axes.xaxis, 4)
        name_axes(axes, "time [s]")
    bounds = {"bounds": BOUND} if below else {}
    key(figure, {"measured": MEASURED, "true": TRUE} | {run.name: looks[run.name] for run in runs} | bounds)
    return figure


def _response(column: "np.ndarray", data: xr.Dataset, runs: list[Run], looks: Mapping[str, Mapping[str, Any]]) -> None:
    time, n = data["time"].values, rpm(data["n"].values)
    steps, dots, keep = thin_steps(n), thin(time.size, 400), thin(time.size, 500)
    column[0].plot(time[steps], n[steps], color=MUTED, linewidth=1.2, label="n")
    column[0].margins(y=0.1)
    for axes, channel in zip(column[1:], ("u", "udot"), strict=True):
        measured, true = (data[part].sel(channel=channel).values for part in ("measured", "true"))
        draw_dots(axes, time[dots], measured[dots], label="measured", size=1.4)
        for run in runs:
            values = run.u if channel == "u" else run.udot
            axes.plot(time[keep], values[keep], label=run.name, **looks[run.name])
        axes.plot(time[keep], true[keep], label="true", zorder=3, **TRUE)
        pad = 0.1 * float(np.ptp(measured))
        axes.set_ylim(measured.min() - pad, measured.max() + pad)
    for axes, label in zip(column, ("$n$ [rpm]", "$u$ [m/s]", r"$\dot{u}$ [m/s²]"), strict=True):
        name_axes(axes, y=label)


def _clipping(axes: "Axes", data: xr.Dataset) -> None:
    """Draw how many of the constrained filter's points are clipped, on average over the trials."""
    clipped = data["clipped"].sel(filter="SRUKF-C").values / data.sizes["seed"]
    count = clipped.size // BINS * BINS
    edges = np.append(data["time"].values[:count:BINS], data["time"].values[count - 1])
    axes.stairs(clipped[:count].reshape(-1, BINS).mean(1), edges, fill=True, color=BLUE, alpha=0.6, label="clipped")
    early = clipped[data["time"].values < 5.0].sum() / max(clipped.sum(), 1e-300)
    axes.annotate(
        f"{100 * early:.0f} % of the clipping in the first 5 s",
        (0.99, 0.85),
        xycoords="axes fraction",
        ha="right",
        va="top",
        fontsize=TEXT,
        color=INK,
    )
    axes.set_xlim(float(edges[0]), float(edges[-1]))
    limit_ticks(axes.xaxis, 4)
    limit_ticks(axes.yaxis, 3)
    name_axes(axes, "time [s]", "clipped points\na step")


def _first_second(axes: "Axes", data: xr.Dataset, runs: list[Run]) -> None:
    """Draw the acceleration that the filters believe in during the first second, where clipping is densest."""
    time = data["time"].values
    early = time <= 1.0
    for run in runs:
        axes.plot(time[early], run.udot[early], label=run.name, **CONSTRAINED[run.name])
    axes.plot(time[early], data["true"].sel(channel="udot").values[early], label="true", zorder=3, **TRUE)
    limit_ticks(axes.yaxis, 3)
    name_axes(axes, "time [s]", "$\\dot{u}$\n[m/s²]")
