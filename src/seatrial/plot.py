"""Pictures of results in one call each: a result in, Matplotlib axes out, in the look of the report.

Every function takes a result first: of one step or, but for the priors, the outcome of `run_loop`. It draws into `ax` if that is given:
one Axes, or as many as the function returns. Without it a figure of the right size is made, whose axes come back; `axes.figure` is the
figure. Axes have names and SI units, but for propellers (rpm) and angles (deg).
"""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from seatrial.campaign.prior.predictive import PriorPredictive
from seatrial.campaign.store.estimates import Estimate, shortest_interval
from seatrial.campaign.workflow.outcome import Outcome
from seatrial.core.argument_checks import check_choice, check_kind, check_names, check_numbers
from seatrial.core.coefficients import base_name, is_coefficient
from seatrial.core.display_units import shown_unit
from seatrial.core.errors import InputError, nearest
from seatrial.design.sweep import Sweep
from seatrial.design.trial_design import TrialDesign
from seatrial.estimation.posterior.mode import Mode
from seatrial.estimation.posterior.posterior import check_priors
from seatrial.estimation.prediction.prediction import Prediction
from seatrial.estimation.priors import Prior, prior_curve
from seatrial.report.drawing import prior_panels, prior_spreads, record_curves, signal_axis
from seatrial.report.figures.checks import draw_motions, prior_motions
from seatrial.report.figures.fit import DrawnChannel, Driven, draw_fit, draw_residuals
from seatrial.report.figures.parameters import draw_chains
from seatrial.report.figures.posterior import PriorShape, draw_marginal, draw_pair
from seatrial.report.figures.structures import draw_probabilities
from seatrial.report.figures.style import INK, NARROW, SMALL, WIDE, new_figure, own_settings, sized_figure, style_axes
from seatrial.report.figures.surface import draw_surface
from seatrial.report.labels import name_mathtext
from seatrial.sampling.run import Draws
from seatrial.selection.verdict import Selection

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    Place = Axes | Sequence[Axes] | np.ndarray | None

__all__ = ["entropy_surface", "fit", "inclusion", "pairs", "posteriors", "prior_predictive", "residuals", "traces"]


def __dir__() -> list[str]:
    return __all__


DOTS_PER_INCH = 100  # Of pictures on a screen; a figure is as many points wide as in the report
# How the drawn things are explained.
LEGEND: dict[str, Any] = {
    "frameon": False,
    "fontsize": SMALL,
    "labelcolor": INK,
    "handlelength": 1.4,
    "columnspacing": 1.2,
}
MAX_PAIRS = 8  # Parameters beyond which a grid of pairs cannot be read


def fit(
    result: Prediction | Outcome,
    *,
    record: str | None = None,
    controls: Sequence[str] | None = None,
    ax: "Place" = None,
) -> np.ndarray:
    """Draw a record and its prediction with the 90 % band: a panel for each channel, then one for each control.

    Args:
        result: what `predict` returned, or the outcome of `run_loop`.
        record: label of one of the outcome's records; the first if not given.
        controls: which are drawn; all if not given.
        ax: one Axes for each panel; a column of panels is made if not given.

    Returns:
        the axes, shape (channels + controls,).

    Raises:
        InputError: no such record or control, or another number of axes.
    """
    time, channels, driven, held_back = _curves(result, record)
    names = tuple(driven) if controls is None else check_names(controls, "controls")
    chosen = [driven[check_choice(one, tuple(driven), "controls")] for one in names]
    heights = [150.0] * len(channels) + [52.0] * len(chosen)
    axes = _column(ax, heights, share_x=True, top=24)
    draw_fit(axes, time, channels, chosen, held_back)
    if ax is None:
        axes[0].legend(*_keys(axes[0]), loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, **LEGEND)
    return _array(axes)


def residuals(result: Prediction | Outcome, *, record: str | None = None, ax: "Place" = None) -> np.ndarray:
    """Draw the residuals of each channel in units of the predicted standard deviation, and below their autocorrelation.

    Args:
        result: what `predict` returned, or the outcome of `run_loop`.
        record: label of one of the outcome's records; the first if not given.
        ax: two Axes for each channel; a column of panels is made if not given.

    Returns:
        the axes, shape (2 channels,).

    Raises:
        InputError: no such record, or another number of axes.
    """
    time, channels, _, held_back = _curves(result, record)
    axes = _column(ax, [120.0, 58.0] * len(channels), gap=38)
    draw_residuals(axes, time, channels, held_back)
    return _array(axes)


def posteriors(
    result: Draws | Estimate | Outcome,
    names: Sequence[str] | None = None,
    *,
    priors: Mapping[str, Prior] | None = None,
    mode: Mode | None = None,
    truth: Mapping[str, float] | None = None,
    ax: "Place" = None,
) -> np.ndarray:
    """Draw the posterior of each parameter: draws, 95 % interval and mean.

    Args:
        result: draws of `sample`; an estimate of a campaign, which brings its priors and modes; or an outcome, for its chosen structure.
        names: parameters; all if not given.
        priors: by name, drawn dashed where they are given.
        mode: of `find_mode`, whose normal approximation is drawn over the draws.
        truth: true values by name, SI; of coefficients that were not estimated too.
        ax: one Axes for each parameter; a row of three after another is made if not given.

    Returns:
        the axes, shape (parameters,).

    Raises:
        InputError: no such parameter, something that is no prior, mode or true value, or another number of axes.
    """
    result = _drawn(result)
    table, truth = _table(result, names), _true_values(truth, result)
    if priors is not None:
        check_priors(priors)
    if mode is not None:
        check_kind(mode, Mode, "mode", "give the result of `find_mode`, or leave it out")
    axes = _grid(ax, len(table), columns=3, height=128.0)
    for one, panel in zip(table, axes, strict=True):
        drawn = one.draws.ravel()
        draw_marginal(
            panel,
            drawn,
            one.symbol,
            one.unit,
            prior=_shape(one.name, priors, result),
            interval=shortest_interval(drawn),
            normal=_normal(one.name, mode, result),
            truth=truth.get(one.name),
        )
    if ax is None:
        axes[0].figure.legend(*_keys(axes[0]), loc="outside upper left", ncols=3 if len(table) < 2 else 6, **LEGEND)
    return _array(axes)


def pairs(
    result: Draws | Estimate | Outcome,
    names: Sequence[str] | None = None,
    *,
    truth: Mapping[str, float] | None = None,
    ax: "Place" = None,
) -> np.ndarray:
    """Draw every pair of parameters with the regions that hold 50 % and 95 % of the draws, and each parameter on the diagonal.

    Args:
        result: draws of `sample`, an estimate of a campaign, or an outcome, for its chosen structure.
        names: parameters, at most eight; the first eight if not given.
        truth: true values by name, SI; of coefficients that were not estimated too.
        ax: k rows of k Axes for k parameters, of which the upper triangle stays empty; made if not given.

    Returns:
        the axes, shape (k, k).

    Raises:
        InputError: no such parameter, too many of them, something that is no true value, or another number of axes.
    """
    truth = _true_values(truth, _drawn(result))
    table = _table(_drawn(result), names)[: MAX_PAIRS if names is None else None]
    if len(table) > MAX_PAIRS:
        raise InputError(
            "names",
            found=f"{len(table)} parameters",
            expected=f"at most {MAX_PAIRS}",
            remedy="name those that matter",
        )
    count = len(table)
    axes = np.array(_grid(ax, count * count, columns=count, height=150.0), object).reshape(count, count)
    for row, low in enumerate(table):
        for column, left in enumerate(table):
            panel = axes[row, column]
            if column > row:
                panel.set_axis_off()
            elif column == row:
                drawn, known = low.draws.ravel(), truth.get(low.name)
                draw_marginal(
                    panel, drawn, low.symbol, low.unit, prior=None, interval=shortest_interval(drawn), truth=known
                )
            else:
                pair = None if not {left.name, low.name} <= set(truth) else (truth[left.name], truth[low.name])
                draw_pair(
                    panel, left.draws.ravel(), low.draws.ravel(), (left.symbol, low.symbol), (left.unit, low.unit), pair
                )
    if ax is None and count > 1:
        axes[0, 0].figure.legend(*_keys(axes[1, 0]), loc="upper right", **LEGEND)
    return axes


def traces(result: Draws | Estimate | Outcome, names: Sequence[str] | None = None, *, ax: "Place" = None) -> np.ndarray:
    """Draw the chains of each parameter, draw after draw: chains that have mixed cannot be separated.

    Args:
        result: draws of `sample`, an estimate of a campaign, or an outcome, for its chosen structure.
        names: parameters; all if not given.
        ax: one Axes for each parameter; a column is made if not given.

    Returns:
        the axes, shape (parameters,).

    Raises:
        InputError: no such parameter, another number of axes, or a population, which has no chains.
    """
    result = _drawn(result)
    if isinstance(result, Draws) and result.is_population:
        raise InputError(
            "result", found="a population of particles", expected="chains", remedy="plot `posteriors`, or sample chains"
        )
    table = _table(result, names)
    axes = _column(ax, [100.0] * len(table), left=66, share_x=True)
    for one, panel in zip(table, axes, strict=True):
        draw_chains(panel, one.draws, one.symbol, one.unit)
    for panel in axes[:-1] if ax is None else ():
        panel.set_xlabel("")
    return _array(axes)


def entropy_surface(result: TrialDesign | Sweep | Outcome, *, family: str | None = None, ax: "Place" = None) -> "Axes":
    """Draw how much every design of one family would tell, over period and amplitude; the best is the star.

    Args:
        result: of `design_trial`, of `design_first`, or an outcome, for its next trial.
        family: kind of one of its families, such as `doublet`; that of the best design if not given.
        ax: where; made if not given.

    Raises:
        InputError: no design of that family, or none at all.
    """
    asked = result.next if isinstance(result, Outcome) else result
    remedy = "call `design_trial`, or give the campaign a [design]"
    swept = check_kind(asked, (TrialDesign, Sweep), "result", remedy)
    sweeps = (swept,) if isinstance(swept, Sweep) else swept.sweeps
    known = {sweep.family.kind: sweep for sweep in reversed(sweeps)}
    sweep = sweeps[0] if family is None else known[check_choice(family, tuple(known), "family")]
    thin = min(sweep.gain.shape) < 2
    (axes,) = _column(ax, [170.0 if thin else 190.0], right=8 if thin else 78)
    factor, unit = shown_unit(sweep.family.control)
    labels = (f"{sweep.family.shape.period_is} [s]", f"amplitude [{unit}]")
    draw_surface(axes, sweep.period, sweep.amplitude * factor, sweep.gain, sweep.best, labels)
    return axes


def inclusion(result: Selection | Outcome, *, ax: "Place" = None) -> "Axes":
    """Draw the probability that each term in question is needed, with its Monte Carlo standard error.

    Args:
        result: of `compare`, of `select_structure`, or an outcome.
        ax: where; made if not given.

    Raises:
        InputError: no term is in question.
    """
    result = result.selection if isinstance(result, Outcome) else result
    check_kind(result, Selection, "result", "compare models with `compare`, or run a campaign")
    terms = sorted(result.inclusion, key=lambda term: -result.inclusion[term])
    if not terms:
        raise InputError(
            "result",
            found="no term in question",
            expected="models that differ in a parameter",
            remedy="compare a model with a term and one without",
        )
    (axes,) = _column(ax, [max(40.0, 22.0 * len(terms))], left=62, right=44)
    values, errors = ([of[term] for term in terms] for of in (result.inclusion, result.inclusion_error))
    draw_probabilities(axes, [name_mathtext(term) for term in terms], values, errors)
    axes.set_xlabel("probability that it is needed")
    return axes


def prior_predictive(result: PriorPredictive, *, ax: "Place" = None) -> np.ndarray:
    """Draw the motions that the priors expect, the controls that move, and of a surge vehicle how every draw settles.

    Args:
        result: of `predict_from_prior`.
        ax: one Axes for each channel and each control, and of a surge vehicle for steady speeds and time constants; made if not given.

    Returns:
        the axes, shape (channels + controls + spreads,).

    Raises:
        InputError: another number of axes.
    """
    check_kind(result, PriorPredictive, "result", "make it with `predict_from_prior`")
    (moved, controls), spreads = prior_panels(result), prior_spreads(result)
    shown = result.time, moved, controls
    if ax is None:
        return _array(_made(lambda figure: prior_motions(*shown, spreads=spreads, figure=figure).axes))
    axes = _given(ax, len(moved) + len(controls) + len(spreads))
    draw_motions(axes, *shown, spreads=spreads)
    return _array(axes)


class _DrawnParameter(NamedTuple):
    """One parameter: its draws, SI, shape (chains, draws), and how it is printed."""

    name: str
    symbol: str
    unit: str
    draws: np.ndarray


def _drawn(result: Draws | Estimate | Outcome) -> Draws | Estimate:
    """Return what has draws; of an outcome the estimate of the chosen structure."""
    chosen = result.chosen if isinstance(result, Outcome) else result
    return check_kind(chosen, (Draws, Estimate), "result", "draw with `sample`, or estimate a campaign")


def _table(result: Draws | Estimate, names: Sequence[str] | None) -> list[_DrawnParameter]:
    wanted = result.names if names is None else check_names(names, "names")
    chosen = [check_choice(one, result.names, "names") for one in wanted]
    if not chosen:
        raise InputError(
            "names", found="none", expected="one parameter at least", remedy="leave it out, and all are drawn"
        )
    if isinstance(result, Draws):
        units = dict(zip(result.names, result.units, strict=True))
        return [_DrawnParameter(name, name_mathtext(name), units[name], result[name]) for name in chosen]
    data = result.data
    units = dict(zip(result.names, map(str, data["unit"].values), strict=True))
    return [
        _DrawnParameter(name, name_mathtext(name), units[name], data["draws"].sel(parameter=name).values)
        for name in chosen
    ]


def _true_values(truth: Mapping[str, float] | None, result: Draws | Estimate) -> dict[str, float]:
    """Return true values by name, of the result's parameters and of coefficients that it does not have; none if none are given."""
    known = check_numbers(truth, "truth", remedy='write for example {"X_uabsu": -3.0}')
    for name in known:
        if name not in result.names and not is_coefficient(name):
            raise InputError(
                "truth",
                found=f'"{name}", which is no parameter',
                expected="among " + ", ".join(result.names),
                remedy=nearest(name, result.names),
            )
    return known


def _shape(name: str, priors: Mapping[str, Prior] | None, result: Draws | Estimate) -> PriorShape | None:
    """Return the prior of a parameter as it is drawn; None if none is known."""
    if isinstance(result, Estimate):
        row = result.data.sel(parameter=name)
        lower, upper, mean, sd = (float(row[key]) for key in ("prior_lower", "prior_upper", "prior_mean", "prior_sd"))
        kind = str(row["prior_kind"].item())
        curve = row["prior_value"].values, row["prior_density"].values
        return PriorShape(lower, upper, mean, sd, kind.startswith("Log"), *curve)
    base = base_name(name)
    if priors is None or (name not in priors and base not in priors):
        return None
    prior = priors.get(name, priors.get(base))
    assert prior is not None
    value, height = (np.asarray(of) for of in prior_curve(prior))
    order = np.argsort(value)
    is_logarithmic = type(prior).__name__.startswith("Log")
    return PriorShape(*prior.bounds, prior.mean, prior.sd, is_logarithmic, value[order], np.exp(height[order]))


def _normal(name: str, mode: Mode | None, result: Draws | Estimate) -> tuple[float, float] | None:
    """Return mode and standard deviation of the normal approximation; None if it is not known."""
    if isinstance(result, Estimate):
        row = result.data.sel(parameter=name)
        return float(row["mode"]), float(row["laplace_sd"])
    if mode is None or name not in mode.names:
        return None
    at = mode.names.index(name)
    return float(mode.values[at]), float(mode.sd[at])


def _curves(
    result: Prediction | Outcome, record: str | None
) -> tuple[np.ndarray, list[DrawnChannel], dict[str, Driven], bool]:
    """Return time, channels and controls in the units in which they are shown, and whether the record was held back."""
    if isinstance(result, Outcome):
        records = {one.label: one for one in (*result.trials.fit, *result.trials.predict)}
        label = check_choice(next(iter(records)) if record is None else record, tuple(records), "record")
        held_back = label in [one.label for one in result.trials.predict]
        time, channels, driven = record_curves(result, list(records).index(label), records[label])
        return time, channels, dict(zip(records[label].controls, driven, strict=True)), held_back
    of = check_kind(result, Prediction, "result", "predict a record with `predict`, or run a campaign").record
    if record not in (None, of.label):
        raise InputError(
            "record", found=f'"{record}"', expected=f'"{of.label}", the one predicted', remedy="leave it out"
        )
    channels = []
    for column, name in enumerate(result.channels):
        factor = shown_unit(name)[0]
        parts = of.channel(name), result.mean[:, column], result.sd[:, column]
        channels.append(DrawnChannel(signal_axis(name), *(part * factor for part in parts)))
    controls = {name: Driven(signal_axis(name), of.channel(name) * shown_unit(name)[0]) for name in of.controls}
    return of.time, channels, controls, False


def _column(ax: "Place", heights: list[float], *, share_x: bool = False, **margins: float) -> "list[Axes]":
    """Return a column of axes of these heights, points; those given if some are."""
    if ax is not None:
        return _given(ax, len(heights))
    return _made(lambda figure: new_figure(WIDE, heights, share_x=share_x, figure=figure, **margins)[1])


def _grid(ax: "Place", count: int, *, columns: int, height: float) -> "list[Axes]":
    """Return axes in rows of so many columns; those given if some are."""
    if ax is not None:
        return _given(ax, count)

    def rows_of_axes(figure: "Figure") -> "list[Axes]":
        rows, across = -(-count // columns), min(columns, count)
        sized_figure(across * NARROW, rows * (height + 44), figure).set_layout_engine("constrained")
        return [style_axes(figure.add_subplot(rows, across, place + 1)) for place in range(count)]

    return _made(rows_of_axes)


def _keys(axes: "Axes") -> "tuple[list[Artist], list[str]]":
    """Return what a legend explains: each label once, dots as a dot."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import PathPatch

    handles = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    for label, artist in handles.items():
        if isinstance(artist, PathPatch) and not artist.get_fill():
            handles[label] = Line2D([], [], marker="o", markersize=3, color=artist.get_edgecolor(), linestyle="none")
    return list(handles.values()), list(handles)


def _given(ax: "Place", count: int) -> "list[Axes]":
    axes = np.atleast_1d(np.asarray(ax, object)).ravel().tolist()
    if len(axes) != count:
        raise InputError(
            "ax", found=f"{len(axes)} axes", expected=f"{count}", remedy="leave it out, and a figure is made"
        )
    return [style_axes(one) for one in axes]


def _made(make: "Callable[[Figure], list[Axes]]") -> "list[Axes]":
    """Make axes in a figure of pyplot, so that a notebook shows it; what users have configured for their own figures is set aside."""
    from matplotlib import pyplot

    with own_settings():
        return make(pyplot.figure(dpi=DOTS_PER_INCH))


def _array(axes: "Sequence[Axes]") -> np.ndarray:
    return np.array(axes, object)
