"""What the prediction leaves over: residuals in units of the predicted standard deviation, and their autocorrelation."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from seatrial.report.figures.fit import Z90, Predicted
from seatrial.report.figures.style import BAND, BLUE, DOTS, MUTED, ORANGE, WIDE, draw_dots, label_axes, new_figure, thin

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_LAGS = 60
FEWEST = 6
"""Pairs of samples below which a correlation is not worth drawing."""


def record_residuals(
    time: np.ndarray, channels: Sequence[Predicted], held_back: bool = False, most: int = 1500
) -> "Figure":
    """Draw for each channel its residuals over time and, below, their autocorrelation over lag.

    Args:
        time: s, shape (n,).
        channels: what was measured and predicted.
        held_back: whether the record was kept out of the fit.
        most: number of samples worth drawing.
    """
    figure, axes = new_figure(WIDE, [120.0, 58.0] * len(channels), gap=38, share_x=False)
    colour = ORANGE if held_back else BLUE
    for panel, below, channel in zip(axes[::2], axes[1::2], channels, strict=True):
        present = np.flatnonzero(np.isfinite(channel.residual))
        present = present[thin(present.size, most)]
        residual = channel.residual[present]
        reach = max(4.0, 1.08 * float(np.abs(residual).max(initial=0.0)))
        panel.axhspan(-Z90, Z90, color=colour, alpha=BAND, linewidth=0, label="90 % of samples belong here")
        panel.axhline(0.0, color=MUTED, linewidth=0.8)
        draw_dots(panel, time[present], residual, color=DOTS, label="residual")
        panel.set(xlim=(float(time[0]), float(time[-1])), ylim=(-reach, reach))
        label_axes(
            panel,
            "time [s]",
            "residual [sd]" if len(channels) == 1 else f"{channel.label.split(' [')[0]} residual [sd]",
        )
        _draw_autocorrelation(below, *autocorrelation(time, channel.residual), colour)
    return figure


def autocorrelation(time: np.ndarray, residual: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Autocorrelation of the samples that are present, from one sample apart on; samples across a gap are as far apart as they are.

    Returns:
        lags (multiples of the median spacing, s) that enough pairs of samples have, correlations, and the number of samples.
    """
    present = np.isfinite(residual)
    values, at = residual[present] - residual[present].mean() if present.any() else residual[present], time[present]
    total = float(values @ values)
    if values.size < 8 or total == 0.0:
        return np.empty(0), np.empty(0), int(values.size)
    spacing = float(np.median(np.diff(at)))
    place = np.round((at - at[0]) / spacing).astype(int)
    lags, found = np.arange(1, min(MOST_LAGS, values.size // 3) + 1), []
    for lag in lags:
        later = np.minimum(np.searchsorted(place, place + lag), place.size - 1)
        pair = place[later] == place + lag
        count = int(pair.sum())
        # As many pairs as without gaps weigh as they do there, so that long lags shrink towards zero alike.
        weight = values.size * (1 - lag / (place[-1] + 1)) / max(count, 1)
        found.append(weight * float(values[pair] @ values[later[pair]]) / total if count >= FEWEST else np.nan)
    correlation = np.array(found)
    there = np.isfinite(correlation)
    return lags[there] * spacing, correlation[there], int(values.size)


def _draw_autocorrelation(axes: "Axes", lag: np.ndarray, correlation: np.ndarray, count: int, colour: str) -> None:
    if lag.size:
        white = 2 / np.sqrt(count)
        axes.axhspan(-white, white, color=MUTED, alpha=BAND, linewidth=0, label="white noise")
        axes.vlines(lag, 0, correlation, color=colour, linewidth=1.4, label="autocorrelation")
        axes.margins(x=0.02)
    axes.axhline(0.0, color=MUTED, linewidth=0.8)
    axes.set_ylim(min(-0.55, 1.1 * float(correlation.min(initial=0.0))), 1.0)
    axes.set_yticks([-0.5, 0, 0.5, 1])
    label_axes(axes, "lag [s]", "autocorr.")
