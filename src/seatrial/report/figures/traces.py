"""How the belief about one coefficient narrows along the fitted records."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from seatrial.report.figures.style import (
    BAND,
    BLUE,
    INK,
    MUTED,
    ORANGE,
    PURPLE,
    WIDE,
    label_axes,
    new_figure,
    power_of_ten,
    thin,
    unit_label,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHORTEST, SETTLED, REACH = 5, 0.06, 16.0


def coefficient_trace(
    time: np.ndarray,
    mean: np.ndarray,
    sd: np.ndarray,
    symbol: str,
    unit: str,
    *,
    starts: Sequence[float] = (),
    prior_mean: float | None = None,
    posterior_mean: float | None = None,
    truth: float | None = None,
    most: int = 800,
) -> "Figure":
    """Draw the filter's mean and a band of two standard deviations.

    The first instants, where the band is as wide as the prior, may leave the frame: what follows is what matters.

    Args:
        time: of the records one after another, s, shape (n,).
        mean: of the coefficient, SI, shape (n,).
        sd: likewise.
        symbol: of the coefficient, within dollars.
        unit: its SI unit.
        starts: where the second record, the third, and so on begin, s.
        prior_mean: where it began.
        posterior_mean: what the sampler says in the end.
        truth: of a simulated vehicle.
        most: number of points worth drawing.
    """
    low, high = _frame(mean, sd, [value for value in (posterior_mean, truth) if value is not None])
    exponent = power_of_ten(low, high)
    scale = 10.0**-exponent
    figure, (axes,) = new_figure(WIDE, [150])
    keep = thin(time.size, most)
    at, centre, half = time[keep], mean[keep] * scale, 2 * sd[keep] * scale
    axes.fill_between(
        at,
        np.clip(centre - half, 3 * low * scale - 2 * high * scale, None),
        np.clip(centre + half, None, 3 * high * scale - 2 * low * scale),
        color=BLUE,
        alpha=BAND,
        linewidth=0,
        label="± 2 sd",
    )
    for start in starts:
        axes.axvline(start, color=MUTED, linewidth=0.9, linestyle=(0, (1, 2)))
    for value, colour, dashes, label in (
        (prior_mean, MUTED, (0, (4, 3)), "prior mean"),
        (posterior_mean, ORANGE, (0, (7, 2)), "posterior mean"),
        (truth, PURPLE, (0, (1.5, 1.5)), "true value"),
    ):
        if value is not None:
            axes.axhline(value * scale, color=colour, linewidth=1.4, linestyle=dashes, label=label, zorder=2.5)
    axes.plot(at, centre, color=BLUE, linewidth=1.6, label="filter mean", zorder=3)
    axes.plot(
        at[-1],
        centre[-1],
        marker="o",
        markersize=4.5,
        color=INK,
        linestyle="none",
        clip_on=False,
        zorder=4,
        label="final",
    )
    axes.set(xlim=(float(time[0]), float(time[-1])), ylim=(low * scale, high * scale))
    label_axes(
        axes,
        "time [s]" if not len(starts) else "time, records one after another [s]",
        unit_label(symbol, unit, exponent),
    )
    return figure


def _frame(mean: np.ndarray, sd: np.ndarray, always: Sequence[float]) -> tuple[float, float]:
    """Limits that hold the band once it has settled, and the values that must be seen."""
    first = max(min(SHORTEST, mean.size - 1), int(SETTLED * mean.size))
    low, high = float(np.min((mean - 2 * sd)[first:])), float(np.max((mean + 2 * sd)[first:]))
    low, high = max(low, mean[-1] - REACH * sd[-1]), min(high, mean[-1] + REACH * sd[-1])
    low, high = min([low, *always]), max([high, *always])
    pad = 0.08 * ((high - low) or abs(high) or 1.0)
    return low - pad, high + pad
