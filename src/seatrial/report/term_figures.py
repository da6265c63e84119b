"""Figures of a selection, for the page and for its picture: they draw the screening beside the contenders."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seatrial.campaign.store.structures import Contenders, Screened
from seatrial.core.coefficients import CoefficientName
from seatrial.report.figures.structures import (
    CoefficientPath,
    Gap,
    coefficient_paths,
    inclusion_bars,
    inclusion_paths,
    model_space,
    speed_gaps,
)
from seatrial.report.labels import label_mathtext
from seatrial.selection.verdict import Selection

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PATHS = 6
"""Coefficients whose paths are drawn at most: of the optional terms, the most doubtful first."""


class TermFigure(NamedTuple):
    """A figure with its name, heading and what to read in it, plain text."""

    name: str
    figure: "Figure"
    heading: str
    caption: str


def term_figures(
    units: Mapping[str, str], selection: Selection, screened: Screened | None, contenders: Contenders | None
) -> list[TermFigure]:
    """Draw what there is; `units` are those of the coefficients, SI."""
    result = _of_screening(units, selection, screened) if screened is not None else []
    return result if contenders is None else [*result, _gap(contenders)]


def symbol(term: str) -> str:
    """Return a term for a figure."""
    return label_mathtext(CoefficientName.parse(term).label)


def _of_screening(units: Mapping[str, str], selection: Selection, screened: Screened) -> list[TermFigure]:
    data, optional = screened.data, screened.optional
    inclusion = dict(zip(optional, data["inclusion"].sel(term=optional).values, strict=True))
    bars = sorted(optional, key=lambda term: -inclusion[term])
    scale = data["scale"].values
    paths = sorted(optional, key=lambda term: abs(inclusion[term] - 0.5))[:PATHS]
    rows = [*bars, *(str(term) for term in data["term"].values if str(term) not in optional)]
    names = [symbol(term) for term in rows]
    return [
        TermFigure(
            "inclusion",
            inclusion_bars(
                [symbol(term) for term in bars],
                [inclusion[term] for term in bars],
                _column(selection.inclusion, bars),
                _column(selection.inclusion_error, bars),
            ),
            "Which terms are needed",
            "Grey: screening of all structures in closed form. Blue: by simulation, which counts; its error bars are one "
            "standard error of the computation. Beyond the dashed lines the data have decided.",
        ),
        TermFigure(
            "space",
            model_space(
                names,
                data["member"].sel(term=rows).values,
                data["probability"].values,
                data["mean"].sel(term=rows).values,
            ),
            "The structures",
            f"The most probable of {data.attrs['count']} structures by the screening, each as wide as it is probable. Filled: the "
            "term is in it; blue where its averaged coefficient is positive, orange where it is negative.",
        ),
        TermFigure(
            "inclusion-scale",
            inclusion_paths([symbol(term) for term in optional], scale, data["inclusion_at"].sel(term=optional).values),
            "Inclusion and the prior",
            "The screening with priors narrower and wider than given (1). Where a line crosses a dashed one, the prior decides, "
            "not the data.",
        ),
        TermFigure(
            "coefficient-scale",
            coefficient_paths(
                scale,
                [
                    CoefficientPath(symbol(term), units[term], data["mean_at"].sel(term=term).values)
                    for term in sorted(paths, key=optional.index)
                ],
            ),
            "Coefficients and the prior",
            "Coefficients averaged over all structures, absent counting as zero, with priors narrower and wider than given (1).",
        ),
    ]


def _gap(contenders: Contenders) -> TermFigure:
    best, runner = contenders.labels
    gaps = []
    for index in contenders.shown:
        curve = contenders.curve(index)
        words = contenders.where(index)
        columns = (curve[name].values for name in ("time", "difference", "lower", "upper"))
        gaps.append(Gap(words[:1].upper() + words[1:], *columns))
    return TermFigure(
        "contenders",
        speed_gaps(gaps, float(contenders.data.attrs["noise"])),
        "What the choice changes",
        f"Speed by {best} minus speed by {runner}. Line: at the posterior means. Band: 90 %, both posteriors drawn independently. "
        "Dashed, where it is in sight: the noise of the speed sensor.",
    )


def _column(values: Mapping[str, float], terms: list[str]) -> np.ndarray:
    return np.array([values.get(term, np.nan) for term in terms])
