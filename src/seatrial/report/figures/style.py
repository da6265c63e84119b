"""What all figures share: the palette, the frame, dots, and how many points are worth drawing.

The palette is safe for colour-blind readers (after Okabe and Ito, 2008): blue and orange carry meaning, never red and green.
Every colour has a light and a dark form; figures are drawn in the light one and the page swaps them.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure
    from matplotlib.patches import PathPatch

# Name to (light, dark).
PALETTE: dict[str, tuple[str, str]] = {
    "ink": ("#1d2733", "#e4e9ef"),
    "muted": ("#5a6674", "#9fabb8"),
    "rule": ("#dde3ea", "#303a45"),
    "paper": ("#fdfefe", "#161c23"),
    "dots": ("#8593a3", "#76859a"),
    "blue": ("#0a67ad", "#56b0f2"),
    "orange": ("#c35207", "#ff9b52"),
    "purple": ("#9b2f86", "#e08bd0"),
    "hatch": ("#c3ccd6", "#3c4855"),
}
INK, MUTED, RULE, PAPER, DOTS, BLUE, ORANGE, PURPLE, HATCH = (light for light, _ in PALETTE.values())
POINT = 1 / 72
WIDE, NARROW = 360, 270  # Widths of a figure, in points
FONT, SMALL = 10, 9
BAND = 0.22  # Opacity of bands


@contextmanager
def own_settings() -> Iterator[None]:
    """Set aside what users have configured for their own figures, while the block runs."""
    import matplotlib

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        yield


def new_figure(
    width: float,
    heights: Sequence[float],
    *,
    left: float = 48,
    right: float = 8,
    top: float = 8,
    bottom: float = 36,
    gap: float = 14,
    share_x: bool = True,
    figure: "Figure | None" = None,
) -> "tuple[Figure, list[Axes]]":
    """Return a figure with a column of axes of the given heights; all sizes in points.

    Margins are fixed rather than fitted, so that the axes of neighbouring figures align.
    """
    total = sum(heights) + gap * (len(heights) - 1) + top + bottom
    figure = sized_figure(width, total, figure)
    axes, y = [], total - top
    for height in heights:
        y -= height
        box = (left / width, y / total, (width - left - right) / width, height / total)
        axes.append(style_axes(figure.add_axes(box, sharex=axes[0] if axes and share_x else None)))
        y -= gap
    if share_x:
        for upper in axes[:-1]:
            upper.tick_params(labelbottom=False)
    return figure, axes


def sized_figure(width: float, height: float, figure: "Figure | None" = None) -> "Figure":
    """Return an empty figure of this size, points; the one given, if there is one, as that of a notebook."""
    if figure is not None:
        figure.set_size_inches(width * POINT, height * POINT)
        return figure
    from matplotlib.figure import Figure

    return Figure(figsize=(width * POINT, height * POINT), dpi=72)


def style_axes(axes: "Axes") -> "Axes":
    """Give axes a quiet frame: two thin spines, light grid, short ticks."""
    axes.set_facecolor("none")
    for name, spine in axes.spines.items():
        spine.set_visible(name in ("left", "bottom"))
        spine.set_color(MUTED)
        spine.set_linewidth(0.8)
    axes.grid(True, color=RULE, linewidth=0.7)
    axes.set_axisbelow(True)
    axes.tick_params(colors=MUTED, labelsize=SMALL, length=3, width=0.8, labelcolor=INK)
    limit_ticks(axes.xaxis, 6)
    limit_ticks(axes.yaxis, 4)
    axes.margins(x=0)
    return axes


def limit_ticks(axis: "Axis", most: int) -> None:
    """Put ticks at round numbers, about so many at most."""
    from matplotlib.ticker import MaxNLocator

    axis.set_major_locator(MaxNLocator(most, steps=[1, 2, 2.5, 5, 10]))


def label_axes(axes: "Axes", x: str = "", y: str = "") -> None:
    """Name the axes; text within dollars is mathematics, so names from users must not come here.

    Args:
        axes: to label.
        x: name and unit below; none if empty.
        y: name and unit at the side; none if empty.
    """
    if x:
        axes.set_xlabel(x, fontsize=FONT, color=INK, labelpad=3)
    if y:
        axes.set_ylabel(y, fontsize=FONT, color=INK, labelpad=4)


def write_lines(figure: "Figure", lines: Sequence[str], left: float, first: float, step: float = 14.0) -> None:
    """Write lines of plain text on a figure.

    Args:
        figure: where.
        lines: from the top.
        left: of them, points from the left of the figure.
        first: foot of the first one, points from the top of the figure.
        step: from one line to the next, points.
    """
    width, height = figure.get_size_inches() / POINT
    for i, text in enumerate(lines):
        place = left / width, 1 - (first + step * i) / height
        figure.text(*place, text.replace("$", r"\$"), fontsize=SMALL, color=INK)


def draw_dots(
    axes: "Axes",
    x: np.ndarray,
    y: np.ndarray,
    most: int | None = None,
    *,
    color: str = DOTS,
    size: float = 1.7,
    label: str = "",
) -> "PathPatch":
    """Draw many dots, those without numbers left out, `most` of them at most.

    They are one path of very short round-capped strokes: a twentieth of the bytes of as many markers.
    """
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    present = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    present = present if most is None else present[thin(present.size, most)]
    x, y = x[present], y[present]
    nudge = 1e-4 * (np.ptp(x) or 1.0) if x.size else 0.0
    vertices = np.stack([np.stack([x, y], -1), np.stack([x + nudge, y], -1)], 1).reshape(-1, 2)
    path = Path(vertices, np.tile([Path.MOVETO, Path.LINETO], x.size)) if x.size else Path(np.zeros((0, 2)))
    path.should_simplify = False
    patch = PathPatch(path, fill=False, edgecolor=color, linewidth=size, capstyle="round", label=label)
    patch.set_snap(False)  # snapped to pixels, strokes as short as these vanish
    axes.add_artist(patch)  # of a patch Matplotlib would look for the limits of every stroke
    if x.size:
        axes.update_datalim(np.stack([x, y], -1))
        axes.autoscale_view()
    return patch


def thin(count: int, most: int = 1500) -> np.ndarray:
    """Return the indices of at most about `most` of `count` samples, evenly spread, first and last included."""
    return np.arange(count) if count <= most else np.unique(np.round(np.linspace(0, count - 1, most)).astype(int))


def thin_steps(values: np.ndarray, most: int = 1500) -> np.ndarray:
    """Return the indices that keep the look of a signal with steps: its changes if they are few, else the extremes of each stretch."""
    count = values.size
    changes = np.flatnonzero(np.diff(values) != 0)
    corners = np.unique(np.concatenate([[0], changes, changes + 1, [count - 1]]))
    if corners.size <= most:
        return corners
    stretches = np.array_split(np.arange(count), max(1, most // 2))
    extremes = [
        stretch[[int(np.argmin(values[stretch])), int(np.argmax(values[stretch]))]]
        for stretch in stretches
        if stretch.size
    ]
    return np.unique(np.concatenate([[0], *extremes, [count - 1]]))


def power_of_ten(*values: float) -> int:
    """Return the power of ten to pull out of an axis so that its tick labels stay short."""
    size = max((abs(value) for value in values if np.isfinite(value)), default=0.0)
    return 0 if size == 0.0 or 0.05 <= size < 10000 else int(np.floor(np.log10(size)))


def unit_label(symbol: str, unit: str, exponent: int = 0) -> str:
    """Return the axis label such as `$X_{u}$ [10⁻⁴ kg/s]`.

    Args:
        symbol: LaTeX.
        unit: as it is printed; none if empty.
        exponent: of ten, taken out of the numbers.
    """
    from seatrial.report.numbers import times_ten, unit_text

    unit = unit_text("" if unit == "1" else unit)
    inside = " ".join(part for part in (times_ten(exponent).removeprefix(" × "), unit) if part)
    return f"{symbol} [{inside}]" if inside else symbol
