"""What comes of a P, Q or R that is too large: errors, stated doubt, how the state is followed, how estimates wander."""

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from seatrial.report.figures.style import BLUE, INK, MUTED, ORANGE, PURPLE
from seatrial.report.numbers import typeset
from studies.remus100.figures.panels import PAGE, key, logarithmic, name_axes, panels, symbol
from studies.remus100.study import Study

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS, MARKERS = (BLUE, ORANGE, PURPLE), ("o", "s", "^")
RESIDUAL = {"color": MUTED, "marker": "D", "markersize": 4, "linewidth": 0.8}
STATE = {"color": INK, "marker": "o", "markersize": 4, "linewidth": 0.8}


def tuning(study: Study) -> "Figure":
    """Draw four panels over the four tunings; numbers of coefficients are shares of their true values."""
    data = study.part("tuning")
    figure, grid = panels(PAGE, [92, 92], 2, left=52, between=62, bottom=22)
    truth = np.array([study.reading.printed_truth[str(name)] for name in data["coefficient"].values])
    size = xr.DataArray(np.abs(truth), {"coefficient": data["coefficient"]})
    shown = {
        (0, 0): ("rms error at the\nend / true", np.sqrt((data["error"] ** 2).mean("seed")) / size),
        (0, 1): ("stated sd at the\nend / true", data["sd"].mean("seed") / size),
        (1, 0): ("distance travelled\n/ true", data["travelled"].mean("seed") / size),
    }
    for place, (label, values) in shown.items():
        _by_coefficient(grid[place], values)
        name_axes(grid[place], y=label)
    _state(grid[1, 1], data)
    for axes in grid[1]:
        axes.set_xticks(range(data.sizes["change"]), [typeset(str(name)) for name in data["change"].values])
        axes.set_xlim(-0.4, data.sizes["change"] - 0.6)
    entries = {
        symbol(str(name)): {"color": colour, "marker": marker, "markersize": 4, "linewidth": 0.8}
        for name, colour, marker in zip(data["coefficient"].values, COLOURS, MARKERS, strict=False)
    }
    key(figure, entries | {"residual of $u$": RESIDUAL, "error of $u$": STATE})
    return figure


def _by_coefficient(axes: "Axes", values: xr.DataArray) -> None:
    for name, colour, marker in zip(map(str, values["coefficient"].values), COLOURS, MARKERS, strict=False):
        axes.plot(
            values.sel(coefficient=name).values, color=colour, marker=marker, markersize=4, linewidth=0.8, label=name
        )
    logarithmic(axes)


def _state(axes: "Axes", data: xr.Dataset) -> None:
    """Draw how closely the noisy signal is followed, and how closely the true one."""
    for name, look in (("residual", RESIDUAL), ("state_error", STATE)):
        axes.plot(np.sqrt(np.mean(data[name].values ** 2, data[name].get_axis_num("seed"))), label=name, **look)
    axes.set_ylim(bottom=0)
    name_axes(axes, y="rms over the\ntrial [m/s]")
