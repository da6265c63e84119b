"""What the figures of the paper share: widths of a two-column article, a grid of panels, keys, units of coefficients."""

from collections.abc import Mapping, Sequence
from math import log10
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.core.coefficients import CoefficientName
from seatrial.report.figures.style import INK, POINT, style_axes
from seatrial.report.labels import label_mathtext
from seatrial.report.numbers import times_ten, unit_text
from studies.remus100.reading import RPM, Reading

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMN, PAGE = 252, 516  # Widths of one column and of two, in points
TEXT = 8
NOISE_PREFIX = "sigma_"  # Parameters of this name are the standard deviation of the channel that follows


def panels(
    width: float,
    heights: Sequence[float],
    columns: int = 1,
    *,
    left: float = 42,
    right: float = 8,
    top: float = 24,
    bottom: float = 30,
    gap: float = 9,
    between: float = 50,
    share_x: bool = True,
) -> "tuple[Figure, np.ndarray]":
    """Return a figure with a grid of axes, shape (rows, columns); all sizes in points.

    Args:
        width: of the figure.
        heights: of the rows of axes.
        columns: how many.
        left: margin, as are right, top and bottom.
        right: likewise.
        top: likewise; a key fits into it.
        bottom: likewise.
        gap: between rows.
        between: from one column to the next, labels of the next included.
        share_x: whether each column has one x axis, labelled below.
    """
    from matplotlib.figure import Figure

    total = sum(heights) + gap * (len(heights) - 1) + top + bottom
    each = (width - left - right - between * (columns - 1)) / columns
    figure = Figure(figsize=(width * POINT, total * POINT), dpi=72)
    grid = np.empty((len(heights), columns), dtype=object)
    y = total - top
    for row, height in enumerate(heights):
        y -= height
        for column in range(columns):
            box = ((left + column * (each + between)) / width, y / total, each / width, height / total)
            grid[row, column] = plain_axes(figure.add_axes(box, sharex=grid[0, column] if share_x and row else None))
            grid[row, column].tick_params(labelbottom=not share_x or row == len(heights) - 1)
        y -= gap
    return figure, grid


def plain_axes(axes: "Axes") -> "Axes":
    """Give axes the quiet frame of all figures, with text of the article's size."""
    style_axes(axes).tick_params(labelsize=TEXT, pad=2)
    return axes


def name_axes(axes: "Axes", x: str = "", y: str = "") -> None:
    """Name the axes at the article's size."""
    if x:
        axes.set_xlabel(x, fontsize=TEXT, color=INK, labelpad=2)
    if y:
        axes.set_ylabel(y, fontsize=TEXT, color=INK, labelpad=2)


def logarithmic(axes: "Axes") -> None:
    """Make the y axis logarithmic, with powers of ten alone for labels."""
    from matplotlib.ticker import NullFormatter

    axes.set_yscale("log")
    axes.yaxis.set_minor_formatter(NullFormatter())


def key(figure: "Figure", entries: Mapping[str, Mapping[str, Any]], *, x: float = 0.0, columns: int = 0) -> None:
    """Draw a key along the top edge: what each look of a line means."""
    from matplotlib.lines import Line2D

    figure.legend(
        [Line2D([], [], solid_capstyle="butt", **look) for look in entries.values()],
        list(entries),
        loc="upper left",
        bbox_to_anchor=(x, 1.0),
        ncols=columns or len(entries),
        frameon=False,
        fontsize=TEXT,
        labelcolor=INK,
        handlelength=1.8,
        handletextpad=0.5,
        columnspacing=1.3,
        borderaxespad=0.2,
    )


def symbol(name: str) -> str:
    """Return the symbol of a parameter within dollars; the noise of a channel is a sigma with the channel's name."""
    if name.startswith(NOISE_PREFIX):
        return label_mathtext(rf"\sigma_{{{name.removeprefix(NOISE_PREFIX)}}}")
    return label_mathtext(CoefficientName.parse(name).label)


def printed_unit(reading: Reading, name: str) -> str:
    """Return the unit in which a parameter is printed, as text: `10⁻² N/(rev/s)²`."""
    if name.startswith(NOISE_PREFIX):
        return "m/s"
    if name != "T_nabsn":
        return unit_text(CoefficientName.parse(name).unit)
    number, _, unit = reading.printed_thrust.partition(" ")
    return f"{times_ten(round(log10(float(number)))).removeprefix(' × ')} {unit_text(unit)}"


def with_unit(reading: Reading, name: str, before: str = "") -> str:
    """Return the axis label of a parameter: symbol and printed unit."""
    return f"{before}{symbol(name)} [{printed_unit(reading, name)}]"


def rpm(n: np.ndarray) -> np.ndarray:
    """Return the propeller speed in rpm."""
    return np.asarray(n) / RPM
