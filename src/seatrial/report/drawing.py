"""A Matplotlib figure as SVG in a page or as PDF for an article, with its caption, labels by name, and the look of one record.

Text stays text, colours follow the page, ids are its own; PDF embeds fonts as outlines that journals accept. The same figure gives
the same bytes, whatever else is on the page and whenever it is drawn.
"""

import io
import re
from typing import TYPE_CHECKING

from markupsafe import Markup, escape

from seatrial.report.figures.style import PALETTE

if TYPE_CHECKING:
    from matplotlib.figure import Figure
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure
from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seatrial.campaign.config.truth import true_coefficients
from seatrial.core.display_units import shown_unit
from seatrial.core.record import Record
from seatrial.core.signals import SIGNALS
from seatrial.manoeuvres.manoeuvre import Limits
from seatrial.manoeuvres.schedule import Schedule
from seatrial.report.figures.fit import Driven, Predicted
from seatrial.report.figures.records import control_over_time
from seatrial.report.figures.style import unit_label
from seatrial.report.labels import label_mathtext

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from seatrial.campaign.workflow.outcome import Outcome

_ID = re.compile(r'\sid="([^"]*)"')
_REFERENCE = re.compile(r'(?:url\(#|href="#)([^)"]*)')
_TAG = re.compile(r"<[^>]*>")
_NUMBER = re.compile(r"-?\d+\.\d{3,}")
_FONT = re.compile(r"'DejaVu Sans'[^;\"]*")
_VARIABLE = {light: f"var(--{name})" for name, (light, _) in PALETTE.items()}
_COLOUR = re.compile("|".join(_VARIABLE))
_STYLE = re.compile(r"<defs>\s*<style[^>]*>.*?</style>\s*</defs>", re.DOTALL)
"""Matplotlib's style sheet would apply to the whole page; the page has its own."""


class Drawing(NamedTuple):
    """An inline SVG with its heading and caption; plain strings are escaped by the template."""

    svg: Markup
    caption: str = ""
    heading: str = ""


def inline_svg(figure: "Figure", name: str, title: str, description: str = "") -> Markup:
    """Draw a figure as an inline SVG element.

    Args:
        figure: figure whose colours come from the palette.
        name: unique on the page, letters, digits and hyphens: prefix of every id.
        title: what the figure is, for those who cannot see it.
        description: what it shows, likewise.
    """
    return inlined(draw_svg(figure, name), name, title, description)


def inlined(text: str, name: str, title: str, description: str = "") -> Markup:
    """Make an inline element of a whole SVG file that `draw_svg` drew; see `inline_svg`."""
    head, body = text[text.index("<svg") :].split(">", 1)
    box = re.search(r'viewBox="([^"]*)"', head)
    assert box is not None
    body = _STYLE.sub("", body)
    body = _COLOUR.sub(lambda match: _VARIABLE[match[0]], _FONT.sub("var(--figure-font)", body))
    described = f'<title id="{name}-title">{escape(title)}</title>'
    described += f'<desc id="{name}-desc">{escape(description)}</desc>' if description else ""
    labelled = f"{name}-title {name}-desc" if description else f"{name}-title"
    return Markup(
        f'<svg viewBox="{box[1]}" role="img" aria-labelledby="{labelled}" focusable="false">{described}{_own_ids(body, name)}'
    )


def axes_box(figure: "Figure") -> tuple[float, float, float, float]:
    """Left, top, right and bottom of all axes of a figure, as shares of its width and height from the upper left corner."""
    places = [axes.get_position() for axes in figure.axes]
    return places[0].x0, 1 - places[0].y1, places[0].x1, 1 - min(place.y0 for place in places)


def draw_svg(figure: "Figure", salt: str = "seatrial") -> str:
    """Draw a figure as a whole SVG file, in the light palette, without date or other accidents, coordinates to 0.01 point."""
    import matplotlib

    stream = io.StringIO()
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": salt, "path.simplify": True}):
        figure.savefig(
            stream,
            format="svg",
            transparent=True,
            metadata={"Date": None, "Creator": None, "Format": None, "Type": None},
        )
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", stream.getvalue(), flags=re.DOTALL)
    return re.sub(r"\s*\n\s*", "\n", _TAG.sub(lambda tag: _NUMBER.sub(_round, tag[0]), text))


def draw_pdf(figure: "Figure") -> bytes:
    """Draw a figure as a PDF file, in the light palette, its text embedded as TrueType."""
    import matplotlib

    stream = io.BytesIO()
    with matplotlib.rc_context({"pdf.fonttype": 42}):
        figure.savefig(
            stream, format="pdf", transparent=True, metadata={"CreationDate": None, "Creator": None, "Producer": None}
        )
    return stream.getvalue()


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
    """Return the LaTeX label of every parameter of every structure."""
    pairs = {}
    for estimate in outcome.estimates:
        pairs |= dict(zip(estimate.names, map(str, estimate.data["label"].values), strict=True))
    return pairs


def units_of(outcome: "Outcome") -> dict[str, str]:
    """Return the SI unit of every parameter of every structure."""
    pairs = {}
    for estimate in outcome.estimates:
        pairs |= dict(zip(estimate.names, map(str, estimate.data["unit"].values), strict=True))
    return pairs


def signal_symbol(name: str) -> str:
    """Return a signal's symbol for a figure, within dollars; `udot` is the derivative of `u`."""
    if name in SIGNALS:
        return label_mathtext(SIGNALS[name].label)
    base = name.removesuffix("dot")
    return label_mathtext(rf"\dot{{{SIGNALS[base].label}}}" if base in SIGNALS else rf"\mathrm{{{name}}}")


def signal_axis(name: str) -> str:
    """Return the axis label of a signal in the unit in which it is shown."""
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


def schedule_figure(schedule: Schedule, limits: Limits) -> "Figure":
    """Draw the one control of a schedule, as `control_over_time`, in the unit in which it is shown."""
    ((name, values),) = schedule.controls.items()
    factor, _ = shown_unit(name)
    low, high = (None if bound is None else bound * factor for bound in (limits.lower, limits.upper))
    return control_over_time(schedule.time, values * factor, signal_axis(name), (low, high))


def truth_of(outcome: "Outcome") -> Mapping[str, float]:
    """Return the true coefficients of a simulated campaign; none for real logs."""
    campaign = outcome.campaign
    return true_coefficients(campaign, campaign.model(campaign.full)) if campaign.is_simulated else {}


def _own_ids(body: str, name: str) -> str:
    """Prefix the ids that something refers to and drop the others."""
    used = set(_REFERENCE.findall(body))
    body = _ID.sub(lambda match: f' id="{name}-{match[1]}"' if match[1] in used else "", body)
    return re.sub(r'(url\(#|href="#)', rf"\g<1>{name}-", body)


def _round(number: re.Match) -> str:
    text = f"{float(number[0]):.2f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
