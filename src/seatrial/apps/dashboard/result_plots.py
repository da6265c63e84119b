"""Figures of stored results as inline SVG, from the files alone: nothing here knows a vehicle, so nothing heavy is imported."""

import tempfile
from bisect import bisect_left, bisect_right
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from seatrial.apps.dashboard.downsample import Drawn, Envelope, draw_record, envelopes, rows_of
from seatrial.apps.dashboard.view_models import Plot, Recorded, Swept
from seatrial.campaign.store.designs import read_sweeps
from seatrial.campaign.store.estimates import Predictions, read_estimate, read_predictions
from seatrial.core.dataset import Dataset
from seatrial.core.dataset_file import open_dataset, stored, write_dataset
from seatrial.core.display_units import shown_unit
from seatrial.report.drawing import axes_box, inline_svg, signal_axis, signal_symbol
from seatrial.report.figures.fit import Z90, autocorrelation
from seatrial.report.figures.posterior import PriorShape, draw_marginal
from seatrial.report.figures.structures import probability_bars
from seatrial.report.figures.style import (
    BAND,
    BLUE,
    DOTS,
    INK,
    MUTED,
    NARROW,
    ORANGE,
    WIDE,
    draw_dots,
    label_axes,
    limit_ticks,
    new_figure,
    own_settings,
    thin_steps,
    unit_label,
)
from seatrial.report.figures.surface import design_surface
from seatrial.report.labels import label_mathtext

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CORRELATED = 10_000
"""Samples of which the autocorrelation is drawn, at most."""
MOST_LISTED = 12


def ready() -> bool:
    """Nothing, but everything is imported, also what reading a file imports, and the fonts are found then."""
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "nothing.nc"
        write_dataset(path, Dataset({"nothing": ("name", np.zeros(1))}, {"name": ["nothing"]}))
        open_dataset(path)
    with own_settings():
        figure, axes = new_figure(WIDE, [96.0])
        label_axes(axes[0], signal_axis("u"), "time [s]")
        as_plot(figure, "nothing", "nothing")
    return True


def swept(path: Path) -> Swept:
    """Read a sweep.

    Raises:
        InputError: missing or damaged.
    """
    stored = read_sweeps(path)
    factor, unit = shown_unit(stored.control)
    best = np.unravel_index(np.nanargmax(stored.worth), stored.worth.shape)
    return Swept(
        stored.families,
        stored.control,
        unit,
        tuple((stored.amplitude * factor).tolist()),
        tuple(stored.period.tolist()),
        stored.gain,
        stored.worth,
        (int(best[0]), int(best[1]), int(best[2])),
        stored.names,
        tuple(stored.sd_before.tolist()),
        stored.final_sd,
        stored.peak_speed,
        stored.length,
        stored.basis,
        stored.refused,
        stored.safety,
        stored.prediction,
    )


def surface(path: Path, family: int, measure: str) -> Plot:
    """Draw what every design of a family is worth; `measure` is gain or worth."""
    found = swept(path)
    values = (found.gain if measure == "gain" else found.worth)[family]
    best = np.unravel_index(int(np.nanargmax(found.worth[family])), values.shape)
    labels = (unit_label("period", "s"), unit_label(f"amplitude of {signal_symbol(found.control)}", found.unit))
    with own_settings():
        figure = design_surface(
            np.array(found.period), np.array(found.amplitude), values, (int(best[0]), int(best[1])), labels
        )
        if measure == "worth" and len(figure.axes) > 1:
            figure.axes[1].set_ylabel("utility")
        return as_plot(figure, "surface", f"What each design would teach: {found.families[family].replace('-', ' ')}")


def record(path: Path, most: int = 8) -> Recorded:
    """Draw a stored record as it is: one panel for each of its first channels.

    Raises:
        OSError: no such file, or none of ours.
    """
    try:
        drawn = draw_record(path)
    except (KeyError, ValueError) as cause:
        raise OSError(0, f"no record that can be read ({cause})", str(path)) from cause
    return as_recorded(drawn, most)


def as_recorded(drawn: Drawn, most: int = 8) -> Recorded:
    """Draw a record, over seconds from the beginning of its files' overlap."""
    names = sorted(drawn.curves, key=lambda name: drawn.about[name][1] == "control")[:most]
    options = drawn.options
    start, time = float(options.get("start") or 0.0), next(iter(drawn.curves.values())).time
    end = float(options.get("end", start + time[-1]))
    curves = [
        (signal_axis(name), _moved(drawn.curves[name], shown_unit(name)[0], start), drawn.about[name][1])
        for name in names
    ]
    notes = [*options.get("notes", []), *options.get("cautions", [])]
    available = float(options.get("available", end))
    return Recorded(
        panels(curves, f"{drawn.samples} samples"), drawn.samples, start, end, available, drawn.source, tuple(notes)
    )


def panels(curves: Sequence[tuple[str, Envelope, str]], title: str) -> Plot:
    """Draw envelopes one above another: measurements as marks, controls as lines."""
    with own_settings():
        figure, axes = new_figure(WIDE, [96.0 if role != "control" else 56.0 for _, _, role in curves])
        for panel, (label, curve, role) in zip(axes, curves, strict=True):
            if role == "control":
                _stairs(panel, curve)
            else:
                _marks(panel, curve, DOTS)
            panel.margins(y=0.1)
            label_axes(panel, y=label)
        times = [curve.time for _, curve, _ in curves]
        axes[-1].set_xlim(min(float(t[0]) for t in times), max(float(t[-1]) for t in times))
        label_axes(axes[-1], "time [s]")
        return as_plot(figure, "record", f"The record as it is, {title}")


def predicted(path: Path) -> Predictions:
    """Read all but the curves.

    Raises:
        InputError: missing or damaged.
    """
    return read_predictions(path)


def fit(path: Path, index: int, channel: int) -> tuple[str, str]:
    """Draw one channel of one record beside its prediction, and what that leaves over."""
    about = predicted(path)
    held_back, name = about.records[index] in about.held_back, about.channels[channel]
    factor = shown_unit(name)[0]
    with stored(path) as file:
        owner = file[
            "record"
        ]  # increases: some twenty looks find where a record begins and ends among millions of rows
        first, last = (find(owner, index) for find in (bisect_left, bisect_right))  # pyright: ignore[reportArgumentType]
        time = rows_of(file, "time", first, last)

        def load(a: int, b: int) -> Mapping[str, np.ndarray]:
            measured, mean, sd = (
                rows_of(file, part, first + a, first + b)[:, channel] for part in ("measured", "mean", "sd")
            )
            return {
                "measured": measured * factor,
                "mean": mean * factor,
                "lower": (mean - Z90 * sd) * factor,
                "upper": (mean + Z90 * sd) * factor,
                "residual": (measured - mean) / sd,
            }

        drawn = envelopes(time, load)
        few = load(0, min(time.size, CORRELATED))["residual"]
    title = f"Run {about.records[index]}, {name}"
    with own_settings():
        curve = _fit_figure(drawn, signal_axis(name), ORANGE if held_back else BLUE)
        left = _residual_figure(
            drawn["residual"], autocorrelation(time[: few.size], few), ORANGE if held_back else BLUE
        )
        return (
            str(inline_svg(curve, "fit", f"{title}: measured and predicted")),
            str(inline_svg(left, "residuals", f"{title}: residuals and their autocorrelation")),
        )


def posteriors(path: Path, truth: tuple[tuple[str, float], ...], most: int = MOST_LISTED) -> list[str]:
    """Draw every parameter of one structure before and after the data."""
    data, known = read_estimate(path).data, dict(truth)
    found = []
    with own_settings():
        for index, name in enumerate(map(str, data["parameter"].values[:most])):
            row = data.sel(parameter=name)
            draws = row["draws"].values.ravel()
            prior = PriorShape(
                lower=float(row["prior_lower"]),
                upper=float(row["prior_upper"]),
                mean=float(row["prior_mean"]),
                sd=float(row["prior_sd"]),
                is_logarithmic=str(row["prior_kind"].item()).startswith("Log"),
                value=row["prior_value"].values,
                height=row["prior_density"].values,
            )
            low, high = np.quantile(draws, [0.025, 0.975])
            symbol, unit = label_mathtext(str(row["label"].item())), str(row["unit"].item())
            normal = float(row["mode"]), float(row["laplace_sd"])
            figure, (axes,) = new_figure(NARROW, [128], left=14, right=14, bottom=38)
            draw_marginal(
                axes,
                draws,
                symbol,
                unit,
                prior=prior,
                interval=(float(low), float(high)),
                normal=normal,
                truth=known.get(name),
            )
            found.append(str(inline_svg(figure, f"posterior-{index}", f"Posterior of {name}")))
    return found


def bars(labels: tuple[str, ...], share: tuple[float, ...], error: tuple[float, ...], title: str, first: bool) -> str:
    """Draw probabilities; `first` singles out the first of them."""
    with own_settings():
        figure = probability_bars(list(labels), share, error, 0 if first else None)
        return str(inline_svg(figure, title.split()[0].lower(), title))


def _fit_figure(drawn: Mapping[str, Envelope], label: str, colour: str) -> "Figure":
    figure, (axes,) = new_figure(WIDE, [170.0])
    mean = drawn["mean"]
    _marks(axes, drawn["measured"], DOTS)
    axes.fill_between(
        mean.time, drawn["lower"].least, drawn["upper"].greatest, color=colour, alpha=BAND, linewidth=0, zorder=1.5
    )
    if (mean.greatest - mean.least).max(initial=0.0) > 0:
        axes.fill_between(mean.time, mean.least, mean.greatest, color=colour, linewidth=0.8, zorder=3)
    else:
        axes.plot(mean.time, mean.least, color=colour, linewidth=1.5, zorder=3)
    axes.set_xlim(float(mean.time[0]), float(mean.time[-1]))
    label_axes(axes, "time [s]", label)
    return figure


def _residual_figure(residual: Envelope, correlation: tuple[np.ndarray, np.ndarray, int], colour: str) -> "Figure":
    figure, (axes, below) = new_figure(WIDE, [110.0, 58.0], gap=38, share_x=False)
    axes.axhspan(-Z90, Z90, color=colour, alpha=BAND, linewidth=0)
    axes.axhline(0.0, color=MUTED, linewidth=0.8)
    _marks(axes, residual, DOTS)
    sizes = np.abs(np.concatenate([residual.least, residual.greatest]))
    reach = max(4.0, 1.08 * float(np.nanmax(sizes, initial=0.0)))
    axes.set(xlim=(float(residual.time[0]), float(residual.time[-1])), ylim=(-reach, reach))
    label_axes(axes, "time [s]", "residual [sd]")
    lag, values, count = correlation
    if lag.size:
        white = 2 / np.sqrt(count)
        below.axhspan(-white, white, color=MUTED, alpha=BAND, linewidth=0)
        below.vlines(lag, 0, values, color=colour, linewidth=1.4)
    below.axhline(0.0, color=MUTED, linewidth=0.8)
    below.set_ylim(min(-0.55, 1.1 * float(values.min(initial=0.0))), 1.0)
    below.set_yticks([-0.5, 0, 0.5, 1])
    label_axes(below, "lag [s]", "autocorr.")
    return figure


def _marks(axes: "Axes", curve: Envelope, colour: str) -> None:
    """Dots where each column holds one sample, else a stroke from the least to the greatest."""
    there = np.isfinite(curve.least)
    if np.array_equal(curve.least[there], curve.greatest[there]):
        draw_dots(axes, curve.time, curve.least, color=colour)
    else:
        _strokes(axes, curve, colour, 0.8)


def _stairs(axes: "Axes", curve: Envelope) -> None:
    if np.array_equal(curve.least, curve.greatest):
        keep = thin_steps(curve.least)
        axes.plot(curve.time[keep], curve.least[keep], color=INK, linewidth=1.0)
    else:
        _strokes(axes, curve, INK, 1.0)
    limit_ticks(axes.yaxis, 2)


def _strokes(axes: "Axes", curve: Envelope, colour: str, width: float) -> None:
    """Least and greatest of one column after the other as one line, up and down."""
    time = np.repeat(curve.time, 2)
    down = np.column_stack([curve.least, curve.greatest])
    down[1::2] = down[1::2, ::-1]
    axes.plot(time, down.ravel(), color=colour, linewidth=width)


def _moved(curve: Envelope, factor: float, later: float) -> Envelope:
    return Envelope(curve.time + later, curve.least * factor, curve.greatest * factor)


def as_plot(figure: "Figure", name: str, title: str) -> Plot:
    """Draw a figure, and say where its axes are."""
    (x0, x1), (y0, y1) = figure.axes[0].get_xlim(), figure.axes[0].get_ylim()
    return Plot(str(inline_svg(figure, name, title)), axes_box(figure), (x0, x1), (y0, y1))
