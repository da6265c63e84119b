"""What the sections share: a drawn figure with its caption, labels by name, and the look of one record."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from markupsafe import Markup

from seatrial.core.display_units import shown_unit
from seatrial.core.record import Record
from seatrial.core.signals import SIGNALS
from seatrial.report.figures.fit import Driven, Predicted
from seatrial.report.figures.style import unit_label
from seatrial.report.labels import label_mathtext
from seatrial.report.svg import inline_svg

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from seatrial.campaign.workflow.run import Outcome


class Drawing(NamedTuple):
    """An inline SVG with its heading and caption; plain strings are escaped by the template."""

    svg: Markup
    caption: str = ""
    heading: str = ""


def draw(figure: "Figure", name: str, title: str, caption: str = "", heading: str = "") -> Drawing:
    """Draw a figure for the page.

    Args:
        figure: the figure.
        name: unique on the page.
        title: what it is, in plain text, for those who cannot see it.
        caption: printed below.
        heading: printed above.
    """
    description = caption.striptags() if isinstance(caption, Markup) else caption
    return Drawing(inline_svg(figure, name, title, description), caption, heading)


def labels_of(outcome: "Outcome") -> dict[str, str]:
    """LaTeX label of every parameter of every structure."""
    pairs = {}
    for estimate in outcome.estimates:
        pairs |= dict(zip(estimate.names, map(str, estimate.data["label"].values), strict=True))
    return pairs


def units_of(outcome: "Outcome") -> dict[str, str]:
    """SI unit of every parameter of every structure."""
    pairs = {}
    for estimate in outcome.estimates:
        pairs |= dict(zip(estimate.names, map(str, estimate.data["unit"].values), strict=True))
    return pairs


def signal_symbol(name: str) -> str:
    """A signal's symbol for a figure, within dollars; `udot` is the derivative of `u`."""
    if name in SIGNALS:
        return label_mathtext(SIGNALS[name].label)
    base = name.removesuffix("dot")
    return label_mathtext(rf"\dot{{{SIGNALS[base].label}}}" if base in SIGNALS else rf"\mathrm{{{name}}}")


def signal_axis(name: str) -> str:
    """Axis label of a signal in the unit in which it is shown."""
    return unit_label(signal_symbol(name), shown_unit(name)[1])


def record_curves(outcome: "Outcome", index: int, record: Record) -> tuple[np.ndarray, list[Predicted], list[Driven]]:
    """Time, channels and controls of one record, in the units in which they are shown."""
    data = outcome.predictions
    rows = data["record"].values == index
    channels = []
    for column, name in enumerate(map(str, data["channel"].values)):
        factor = shown_unit(name)[0]
        columns = (data[part].values[rows, column] * factor for part in ("measured", "mean", "sd"))
        channels.append(Predicted(signal_axis(name), *columns))
    controls = [Driven(signal_axis(name), record.channel(name) * shown_unit(name)[0]) for name in record.controls]
    return data["time"].values[rows], channels, controls


def truth_of(outcome: "Outcome") -> Mapping[str, float]:
    """True coefficients of a simulated campaign; those the truth does not name are zero. Empty for real logs."""
    campaign = outcome.campaign
    if not campaign.is_simulated:
        return {}
    return {term: campaign.truth.get(term, 0.0) for term in outcome.campaign.full.terms}
