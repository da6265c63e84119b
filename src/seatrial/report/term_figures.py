"""Figures of a selection, for the page and for its picture."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seatrial.core.coefficients import CoefficientName
from seatrial.core.display_units import shown_unit
from seatrial.core.record import Record
from seatrial.report.drawing import signal_axis
from seatrial.report.figures.structures import (
    CoefficientPath,
    MotionGap,
    coefficient_paths,
    inclusion_paths,
    model_space,
    probability_bars,
    structure_gaps,
)
from seatrial.report.figures.style import thin
from seatrial.report.labels import label_mathtext
from seatrial.selection.contenders import Contenders
from seatrial.selection.screened import Screened
from seatrial.selection.structures import structure_names
from seatrial.selection.verdict import Selection

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from seatrial.campaign.config.campaign import Campaign

PATHS = 4  # Coefficients whose paths are drawn at most: of the optional terms, the most doubtful first
DOTS = 400  # Samples of a record that are drawn


class TermFigure(NamedTuple):
    """A figure with its name, heading and what to read in it, plain text."""

    name: str
    figure: "Figure"
    heading: str
    caption: str


def term_figures(
    campaign: "Campaign", selection: Selection, screened: Screened | None, contenders: Contenders | None
) -> list[TermFigure]:
    """Draw what there is, by simulation first; the campaign says in which units coefficients are shown."""
    results = [_simulated(selection)] if selection.inclusion and len(selection.structures) > 1 else []
    if contenders is not None:
        results.append(contenders_figure(contenders, structure_names(selection.structures)))
    return results + (screening_figures(campaign, screened) if screened is not None else [])


def symbol(term: str) -> str:
    """Return a term for a figure."""
    return label_mathtext(CoefficientName.parse(term).label)


def screening_figures(campaign: "Campaign", screened: Screened) -> list[TermFigure]:
    """Draw what the screening says of all structures; the campaign says in which units coefficients are shown."""
    data, optional = screened.data, screened.optional
    inclusion = dict(zip(optional, data["inclusion"].sel(term=optional).values, strict=True))
    bars = sorted(optional, key=lambda term: -inclusion[term])
    scale = data["scale"].values
    paths = sorted(optional, key=lambda term: abs(inclusion[term] - 0.5))[:PATHS]
    rows = [*bars, *(str(term) for term in data["term"].values if str(term) not in optional)]
    names = [symbol(term) for term in rows]
    return [
        TermFigure(
            "inclusion-screening",
            _bars(bars, inclusion, dict.fromkeys(bars, 0.0)),
            "Which terms are needed, by screening",
            "Probability of each optional term by the screening of all structures in closed form, which is approximate.",
        ),
        TermFigure(
            "space",
            model_space(
                names,
                data["member"].sel(term=rows).values,
                data["probability"].values,
                data["mean"].sel(term=rows).values,
            ),
            "The structures, by screening",
            f"The most probable of {data.attrs['count']} structures by the screening, each as wide as it is probable. Filled: the term "
            f"is in it; blue if its averaged coefficient is positive, orange if it is negative.",
        ),
        TermFigure(
            "inclusion-scale",
            inclusion_paths([symbol(term) for term in optional], scale, data["inclusion_at"].sel(term=optional).values),
            "Which terms are needed if the priors were wider",
            "The screening with priors narrower and wider than given (1). If a line crosses a dashed one, the prior decides.",
        ),
        TermFigure(
            "coefficient-scale",
            coefficient_paths(
                scale,
                [
                    CoefficientPath(symbol(term), unit, factor * data["mean_at"].sel(term=term).values)
                    for term in sorted(paths, key=optional.index)
                    for factor, unit in [campaign.shown(term, campaign.units[term])]
                ],
            ),
            "Coefficients if the priors were wider",
            "Coefficients averaged over all structures, zero in those without the term, with priors narrower and wider than given (1).",
        ),
    ]


def contenders_figure(contenders: Contenders, names: Mapping[str, str], records: Sequence[Record] = ()) -> TermFigure:
    """Draw the two most probable structures over one plot.

    Args:
        contenders: of the selection.
        names: of the structures, by their labels.
        records: fitted ones, of which one is drawn with what was measured; without, the next trial is drawn too.
    """
    best, runner = (names[label] for label in contenders.labels)
    channel = contenders.channel
    factor = shown_unit(channel)[0]
    measured = {f"run {record.label}": _measured(record, channel, factor) for record in records}
    gaps = []
    for one in contenders.shown[: 1 if records else None]:
        columns = {name: getattr(one, name) * factor for name in ("best", "difference", "lower", "upper")}
        title = one.words[:1].upper() + one.words[1:]
        gaps.append(MotionGap(title, one.time, **columns, measured=measured.get(one.words)))
    same = all(gap.coincides for gap in gaps)
    motions = (
        f"Only the difference is shown, {best} minus {runner}, because it is smaller than the width of a line: "
        if same
        else f"Blue: {best}. Orange, dashed: {runner}. Dots: measured. Below, their difference: "
    )
    return TermFigure(
        "contenders",
        structure_gaps(gaps, factor * contenders.noise, signal_axis(channel)),
        "Difference between the two most probable models" if same else "The two most probable models over one plot",
        f"{motions}at the posterior means (line), and the 90 % band of both posteriors. "
        "Dashed, if inside the axes: the standard deviation of the residuals.",
    )


def _simulated(selection: Selection) -> TermFigure:
    terms = sorted(selection.inclusion, key=lambda term: -selection.inclusion[term])
    return TermFigure(
        "inclusion",
        _bars(terms, selection.inclusion, selection.inclusion_error),
        "Which terms are needed, by simulation",
        "Probability of each optional term: the sum over all simulated models that have it, with one standard error of the "
        "computation. Outside the dashed lines the data decide.",
    )


def _bars(terms: Sequence[str], value: Mapping[str, float], error: Mapping[str, float]) -> "Figure":
    values, errors = ([of[term] for term in terms] for of in (value, error))
    return probability_bars([symbol(term) for term in terms], values, errors)


def _measured(record: Record, channel: str, factor: float) -> tuple[np.ndarray, np.ndarray] | None:
    if channel not in record.measured:
        return None
    places = np.flatnonzero(np.isfinite(record.channel(channel)))
    places = places[thin(places.size, DOTS)]
    return record.time[places], factor * record.channel(channel)[places]
