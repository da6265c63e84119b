"""A record and its prediction from the inputs alone, what that leaves over, and signals with their rates by smoothing."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seatrial.core.normal import Z90
from seatrial.report.figures.style import (
    BAND,
    BLUE,
    MUTED,
    ORANGE,
    WIDE,
    draw_dots,
    label_axes,
    limit_ticks,
    new_figure,
    thin,
    thin_steps,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_LAGS = 60
MIN_PAIRS = 6  # Pairs of samples below which a correlation is not worth drawing


class DrawnChannel(NamedTuple):
    """One channel of one record, in the unit of its label: measured (NaN if not), predicted mean and standard deviation."""

    label: str
    measured: np.ndarray
    mean: np.ndarray
    sd: np.ndarray

    @property
    def residual(self) -> np.ndarray:
        """Residual in units of the predicted standard deviation."""
        return (self.measured - self.mean) / self.sd


class Driven(NamedTuple):
    """One control of one record, in the unit of its label."""

    label: str
    values: np.ndarray


class SmoothedSignal(NamedTuple):
    """A signal or a rate in the unit of its label; `measured` is None for what no sensor shows."""

    label: str
    mean: np.ndarray
    sd: np.ndarray
    measured: np.ndarray | None = None


def record_fit(
    time: np.ndarray,
    channels: Sequence[DrawnChannel],
    controls: Sequence[Driven] = (),
    held_back: bool = False,
    most: int = 1500,
) -> "Figure":
    """Draw a column of panels, one for each channel, then a low one for each control; see `draw_fit`."""
    figure, axes = new_figure(WIDE, [*[150.0] * len(channels), *[52.0] * len(controls)])
    draw_fit(axes, time, channels, controls, held_back, most)
    return figure


def draw_fit(
    axes: "Sequence[Axes]",
    time: np.ndarray,
    channels: Sequence[DrawnChannel],
    controls: Sequence[Driven] = (),
    held_back: bool = False,
    most: int = 1500,
) -> None:
    """Draw each channel, then each control, into axes of its own; held-back records are orange.

    Args:
        axes: one for each channel and each control.
        time: s, shape (n,).
        channels: measured and predicted.
        controls: of the vehicle.
        held_back: whether the record was kept out of the fit.
        most: number of samples worth drawing.
    """
    colour = ORANGE if held_back else BLUE
    for panel, channel in zip(axes, channels, strict=False):
        draw_dots(panel, time, channel.measured, most, label="measured")
        keep = thin(time.size, min(most, 400))
        at, mean, half = time[keep], channel.mean[keep], Z90 * channel.sd[keep]
        panel.fill_between(
            at, mean - half, mean + half, color=colour, alpha=BAND, linewidth=0, label="90 % band", zorder=1.5
        )
        panel.plot(at, mean, color=colour, linewidth=1.5, label="predicted", zorder=3)
        label_axes(panel, y=channel.label)
    for panel, control in zip(axes[len(channels) :], controls, strict=True):
        keep = thin_steps(control.values, most)
        panel.plot(time[keep], control.values[keep], color=MUTED, linewidth=1.0, label="control")
        limit_ticks(panel.yaxis, 2)
        panel.margins(y=0.12)
        label_axes(panel, y=control.label)
    axes[-1].set_xlim(float(time[0]), float(time[-1]))
    label_axes(axes[-1], "time [s]")


def record_residuals(
    time: np.ndarray,
    channels: Sequence[DrawnChannel],
    held_back: bool = False,
    most: int = 1500,
    slow: bool = False,
) -> "Figure":
    """Draw two panels for each channel, its residuals over their autocorrelation; see `draw_residuals`."""
    figure, axes = new_figure(WIDE, [120.0, 58.0] * len(channels), gap=38, share_x=False)
    draw_residuals(axes, time, channels, held_back, most, slow)
    return figure


def draw_residuals(
    axes: "Sequence[Axes]",
    time: np.ndarray,
    channels: Sequence[DrawnChannel],
    held_back: bool = False,
    most: int = 1500,
    slow: bool = False,
) -> None:
    """Draw for each channel its residuals over time and, in the next axes, their autocorrelation over lag.

    Args:
        axes: two for each channel.
        time: s, shape (n,).
        channels: measured and predicted.
        held_back: whether the record was kept out of the fit.
        most: number of samples worth drawing.
        slow: whether the noise was fitted as correlated in time, which these residuals still are.
    """
    colour = ORANGE if held_back else BLUE
    for panel, below, channel in zip(axes[::2], axes[1::2], channels, strict=True):
        present = np.flatnonzero(np.isfinite(channel.residual))
        present = present[thin(present.size, most)]
        residual = channel.residual[present]
        reach = max(4.0, 1.08 * float(np.abs(residual).max(initial=0.0)))
        panel.axhspan(-Z90, Z90, color=colour, alpha=BAND, linewidth=0, label="90 % of samples belong here")
        panel.axhline(0.0, color=MUTED, linewidth=0.8)
        draw_dots(panel, time[present], residual, label="residual")
        panel.set(xlim=(float(time[0]), float(time[-1])), ylim=(-reach, reach))
        label_axes(
            panel,
            "time [s]",
            "residual [sd]" if len(channels) == 1 else f"{channel.label.split(' [')[0]} residual [sd]",
        )
        _draw_autocorrelation(below, *autocorrelation(time, channel.residual), colour)
        label_axes(below, f"lag [s]{', before the fitted correlation is removed' * slow}", "autocorr.")


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
    lags, results = np.arange(1, min(MAX_LAGS, values.size // 3) + 1), []
    for lag in lags:
        later = np.minimum(np.searchsorted(place, place + lag), place.size - 1)
        pair = place[later] == place + lag
        count = int(pair.sum())
        # As many pairs as without gaps weigh as they do there, so that long lags shrink towards zero alike.
        weight = values.size * (1 - lag / (place[-1] + 1)) / max(count, 1)
        results.append(weight * float(values[pair] @ values[later[pair]]) / total if count >= MIN_PAIRS else np.nan)
    correlation = np.array(results)
    places = np.isfinite(correlation)
    return lags[places] * spacing, correlation[places], int(values.size)


def smoothed_record(time: np.ndarray, curves: Sequence[SmoothedSignal]) -> "Figure":
    """Draw a panel for each curve.

    Args:
        time: s, shape (n,).
        curves: each of shape (n,).
    """
    figure, axes = new_figure(WIDE, [110.0] * len(curves), left=60)
    keep = thin(time.size)
    for panel, curve in zip(axes, curves, strict=True):
        at, mean, half = time[keep], curve.mean[keep], Z90 * curve.sd[keep]
        if curve.measured is not None:
            draw_dots(panel, time, curve.measured, 1500, label="measured")
        panel.fill_between(at, mean - half, mean + half, color=BLUE, alpha=BAND, linewidth=0, label="90 % band")
        panel.plot(at, mean, color=BLUE, linewidth=0.8, label="smoothed")
        panel.margins(y=0.1)
        label_axes(panel, y=curve.label)
    axes[-1].set_xlim(float(time[0]), float(time[-1]))
    label_axes(axes[-1], "time [s]")
    return figure


def _draw_autocorrelation(axes: "Axes", lag: np.ndarray, correlation: np.ndarray, count: int, colour: str) -> None:
    if lag.size:
        white = 2 / np.sqrt(count)
        axes.axhspan(-white, white, color=MUTED, alpha=BAND, linewidth=0, label="white noise")
        axes.vlines(lag, 0, correlation, color=colour, linewidth=1.4, label="autocorrelation")
        axes.margins(x=0.02)
    axes.axhline(0.0, color=MUTED, linewidth=0.8)
    reach = 1.25 * max(0.08, float(np.abs(correlation).max(initial=0.0)), 2 / np.sqrt(max(count, 4)))
    axes.set_ylim(max(-1.0, -reach), min(1.0, reach))
    limit_ticks(axes.yaxis, 3)
