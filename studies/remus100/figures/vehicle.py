"""The longitudinal vehicle of Section II after a step of the propeller speed: whole, linearised, and surge alone."""

from typing import TYPE_CHECKING

import xarray as xr

from seatrial.core.display_units import shown_unit
from seatrial.report.drawing import signal_symbol
from seatrial.report.figures.style import BLUE, MUTED, ORANGE, PURPLE, thin, unit_label
from studies.remus100.figures.panels import PAGE, key, name_axes, panels
from studies.remus100.study import Study

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LOOKS = {
    "longitudinal, non-linear": {"color": BLUE, "linewidth": 1.6},
    "longitudinal, linearised": {"color": ORANGE, "linewidth": 1.3, "linestyle": (0, (5, 2))},
    "surge alone": {"color": PURPLE, "linewidth": 1.4, "linestyle": (0, (1.5, 1.5))},
}
PARTS = ("full", "linear")
"""Names in the results of the first two."""
POLES = {"color": BLUE, "marker": "x", "markersize": 5, "markeredgewidth": 1.4, "linestyle": "none"}


def vehicle(study: Study) -> "Figure":
    """Draw every state after the step, speed by the surge model too, and the poles of the linear model."""
    data = study.part("vehicle")
    figure, grid = panels(PAGE, [84, 84], 3, left=48, between=56, gap=34, share_x=False)
    time = data["time"].values
    keep = thin(time.size, 400)
    for axes, name in zip(grid.flat, map(str, data["state"].values), strict=False):
        factor, unit = shown_unit(name)
        lines = {look: data[part].sel(state=name).values for look, part in zip(LOOKS, PARTS, strict=False)}
        if name == "u":
            lines["surge alone"] = data["surge"].values
        for label, values in lines.items():
            axes.plot(time[keep], factor * values[keep], label=label, **LOOKS[label])
        axes.margins(y=0.08)
        name_axes(axes, "time [s]", unit_label(signal_symbol(name), unit))
    _poles(grid.flat[-1], data)
    key(figure, LOOKS)
    return figure


def _poles(axes: "Axes", data: xr.Dataset) -> None:
    """Draw the eigenvalues of the linear model; what lies right of the line grows."""
    real, imaginary = data["eigenvalues"].values.T
    axes.axvline(0, color=MUTED, linewidth=0.9, label="stable to the left")
    axes.plot(real, imaginary, label="poles", **POLES)
    axes.margins(0.15)
    name_axes(axes, "real part of poles [1/s]", "imaginary part [1/s]")
