"""Listing 1 over many seeds beside evidences that agree, and what the data say as the doubted term grows."""

from typing import TYPE_CHECKING

import numpy as np

from seatrial.report.figures.style import BLUE, DOTS, INK, MUTED, ORANGE, PURPLE, limit_ticks
from seatrial.report.numbers import plain
from studies.remus100.figures.panels import COLUMN, PAGE, TEXT, key, name_axes, panels, symbol, with_unit
from studies.remus100.study import Study

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PRINTED = {4: 0.4642, 5: 0.5501}
"""Probability of M-0 that the paper prints in Tables IV and V."""
BINS = np.linspace(0, 1, 21)
TALL, TALLEST = 1.7, 1.2
"""Height of a row that holds a histogram, and of a bar in it that holds every seed, in rows that hold one value."""


def listing_1(study: Study) -> "Figure":
    """Draw how the answer of Listing 1 varies from seed to seed, for both tables, over the answers of four other methods."""
    figure, (row,) = panels(PAGE, [200], 2, left=112, top=8, between=16, share_x=False)
    for axes, table in zip(row, (4, 5), strict=True):
        _answers(axes, study, table)
        value = study.reading.source.doubted.values[table - 4]
        name_axes(axes, f"probability of M-0, true {symbol(study.reading.doubted)} = {plain(value)}")
    row[1].tick_params(labelleft=False)
    return figure


def _answers(axes: "Axes", study: Study, table: int) -> None:
    listing, evidence = study.part(f"listing-{table}"), study.part(f"evidence-{table}")
    ticks, y = [], 0.0
    for name, title, colour in (
        ("probability", "independent draws", ORANGE),
        ("shared_probability", "shared draws", PURPLE),
    ):
        p = listing[name].sel(model="M-0").values
        share = np.histogram(p, BINS)[0] / p.size
        y -= TALL
        axes.stairs(y + TALLEST * share, BINS, baseline=y, fill=True, color=colour, alpha=0.6, label=title)
        axes.axhline(y, color=MUTED, linewidth=0.6)
        for edge, inside, nearby in ((0.0, p < BINS[1], share[:3]), (1.0, p > BINS[-2], share[-3:])):
            if inside.any():
                axes.annotate(
                    f"{100 * inside.mean():.0f} %",
                    (edge, y + TALLEST * nearby.max()),
                    xytext=(-3 if edge else 3, 2),
                    textcoords="offset points",
                    ha="right" if edge else "left",
                    fontsize=TEXT,
                    color=INK,
                )
        ticks.append((y + 0.45, f"Listing 1, {p.size} seeds,\n{title}"))
    printed = study.reading.printed(PRINTED[table])
    if printed is not None:
        y -= 1
        axes.plot(printed, y, marker="D", markersize=5, color=INK, linestyle="none", label="printed")
        ticks.append((y, "as printed"))
    for row, method in enumerate(map(str, evidence["method"].values)):
        p, error = _probability(evidence["log_value"].values[row], evidence["error"].values[row])
        y -= 1
        axes.errorbar(
            p, y, xerr=[[min(error, p)], [min(error, 1 - p)]], color=BLUE, marker="o", markersize=4, label=method
        )
        ticks.append((y, method))
    axes.set(xlim=(-0.02, 1.02), ylim=(y - 0.7, 0))
    axes.set_yticks([at for at, _ in ticks], [text for _, text in ticks])
    axes.grid(False, axis="y")


def _probability(log_value: np.ndarray, error: np.ndarray) -> tuple[float, float]:
    """Probability of M-0 with its Monte Carlo error, from the log evidences of M-0 and M-1."""
    p = float(1 / (1 + np.exp(log_value[1] - log_value[0])))
    return p, float(p * (1 - p) * np.hypot(*error))


def odds(study: Study) -> "Figure":
    """Draw the probability of M-0 on several trials, one dot for each, against the true value of the doubted term."""
    data = study.part("odds")
    figure, ((axes,),) = panels(COLUMN, [120], 1, top=20)
    p = data["probability"].values
    at = np.arange(p.shape[0])
    spread = np.linspace(-0.16, 0.16, p.shape[1]) if p.shape[1] > 1 else np.zeros(1)
    axes.axhline(0.5, color=MUTED, linewidth=0.9, linestyle=(0, (4, 3)), label="undecided")
    for row, x in enumerate(at):
        axes.plot(x + spread, p[row], marker="o", markersize=3, color=DOTS, linestyle="none", label="trials")
    axes.plot(at, p.mean(1), marker="D", markersize=5, color=BLUE, linestyle="none", label="mean", zorder=4)
    axes.set_xticks(at, [plain(value) for value in data["value"].values])
    axes.set(xlim=(-0.5, at[-1] + 0.5), ylim=(-0.05, 1.05))
    axes.grid(False, axis="x")
    limit_ticks(axes.yaxis, 5)
    name_axes(axes, with_unit(study.reading, study.reading.doubted, "true "), "probability of M-0")
    key(
        figure,
        {
            "a trial": {"color": DOTS, "marker": "o", "markersize": 3, "linestyle": "none"},
            "mean": {"color": BLUE, "marker": "D", "markersize": 4, "linestyle": "none"},
        },
    )
    return figure
