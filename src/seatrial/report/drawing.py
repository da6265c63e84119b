"""A Matplotlib figure as SVG in a page, with its caption, labels by name, and the look of one record.

Text stays text, colours follow the page, ids are its own. The same figure gives the same bytes, whatever else is on the page and
whenever it is drawn.
"""

import io
import re
from collections.abc import Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from markupsafe import Markup, escape

from seatrial.campaign.config.truth import true_coefficients
from seatrial.core.coefficients import CoefficientName
from seatrial.core.display_units import shown_unit
from seatrial.core.record import Record
from seatrial.core.signals import GAUGE_CHANNELS, SIGNALS, is_thruster, signal_label
from seatrial.manoeuvres.manoeuvre import Limits
from seatrial.manoeuvres.schedule import Schedule
from seatrial.report.figures.checks import Moved
from seatrial.report.figures.fit import DrawnChannel, Driven
from seatrial.report.figures.records import controls_over_time
from seatrial.report.figures.style import PALETTE, unit_label
from seatrial.report.labels import label_html, label_mathtext, name_html, sentence_about
from seatrial.report.numbers import Digits
from seatrial.selection.structures import structure_names

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from seatrial.campaign.prior.predictive import PriorPredictive
    from seatrial.campaign.store.estimates import Estimate
    from seatrial.campaign.workflow.outcome import Outcome

_ID = re.compile(r'\sid="([^"]*)"')
_REFERENCE = re.compile(r'(?:url\(#|href="#)([^)"]*)')
_TAG = re.compile(r"<[^>]*>")
_NUMBER = re.compile(r"-?\d+\.\d{3,}")
_PATH = re.compile(r'\sd="([^"]*)"')
_LONG_NUMBER = re.compile(r"-?\d+\.\d{2,}")
_SPACE = re.compile(r"\s*([MLCQz])\s*")
_LEVEL = re.compile(r"M([\d.-]+) ([\d.-]+)L([\d.-]+) \2(?=M|$)")
# Points beyond which a path is written more coarsely, and length below which a stroke is a dot, points.
COARSE_POINTS, DOT = 20, 0.2
_FONT = re.compile(r"'DejaVu Sans'[^;\"]*")
_VARIABLE = {light: f"var(--{name})" for name, (light, _) in PALETTE.items()}
_COLOUR = re.compile("|".join(_VARIABLE))
# Matplotlib's style sheet would apply to the whole page; the page has its own.
_STYLE = re.compile(r"<defs>\s*<style[^>]*>.*?</style>\s*</defs>", re.DOTALL)


class Drawing(NamedTuple):
    """An inline SVG with its heading and caption; plain strings are escaped by the template."""

    svg: Markup
    caption: str = ""
    heading: str = ""


def inlined(text: str, name: str, title: str, description: str = "") -> Markup:
    """Make an inline element of a whole SVG file.

    Args:
        text: the file, as `draw_svg` drew it, with colours of the palette.
        name: unique on the page, letters, digits and hyphens: prefix of every id.
        title: what the figure is, for those who cannot see it.
        description: what it shows, likewise.
    """
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
    text = _TAG.sub(lambda tag: _NUMBER.sub(_round, tag[0]), _PATH.sub(_short, text))
    return re.sub(r"\s*\n\s*", "\n", text)


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
    return Drawing(inlined(draw_svg(figure, name), name, title, description), caption, heading)


@lru_cache(maxsize=1)
def labels_of(outcome: "Outcome") -> dict[str, str]:
    """Return the LaTeX label of every parameter of every structure, of terms that none has or that are known, and of signals whose
    names are no symbols."""
    campaign = outcome.campaign
    signals = {
        name: signal_label(name)
        for name in (*SIGNALS, *GAUGE_CHANNELS, *campaign.model(campaign.full).controls)
        if "_" in name
    }
    terms = {term: CoefficientName.parse(term).label for term in (*campaign.structure.optional, *campaign.hull.fixed)}
    return signals | terms | _of_parameters(outcome, "label")


@lru_cache(maxsize=1)
def units_of(outcome: "Outcome") -> dict[str, str]:
    """Return the unit in which every parameter of every structure is shown."""
    return {name: outcome.campaign.shown(name, unit)[1] for name, unit in _of_parameters(outcome, "unit").items()}


@lru_cache(maxsize=1)
def factors_of(outcome: "Outcome") -> dict[str, float]:
    """Return the factor from SI to these units."""
    return {name: outcome.campaign.shown(name, unit)[0] for name, unit in _of_parameters(outcome, "unit").items()}


@lru_cache(maxsize=1)
def digits_of(outcome: "Outcome") -> dict[str, Digits]:
    """Return how every parameter is written, wherever it stands: by the chosen structure, or else the first that has it."""
    digits = {}
    for estimate in (outcome.chosen, *outcome.estimates):
        digits = {name: Digits.of(*moments) for name, moments in moments_of(outcome, estimate).items()} | digits
    return digits


def unit_row(outcome: "Outcome", name: str) -> dict[str, Markup]:
    """Return the symbol of a parameter and its unit, with the power of ten that its numbers are to be multiplied by."""
    return {
        "label": label_html(labels_of(outcome)[name]),
        "unit": digits_of(outcome)[name].unit_html(units_of(outcome)[name]),
    }


def moments_of(outcome: "Outcome", estimate: "Estimate") -> dict[str, tuple[float, float]]:
    """Return posterior mean and standard deviation of each parameter of a structure, in the units in which they are shown."""
    factor = np.array([factors_of(outcome)[name] for name in estimate.names])
    mean, sd = (map(float, factor * estimate.data[name].values) for name in ("mean", "sd"))
    return dict(zip(estimate.names, zip(mean, sd, strict=True), strict=True))


@lru_cache(maxsize=1)
def names_of(outcome: "Outcome") -> dict[str, str]:
    """Return the name of every structure by its terms, by its label."""
    return structure_names([estimate.structure for estimate in outcome.estimates])


def model_html(outcome: "Outcome", label: str) -> Markup:
    """Return the name of a structure for the page."""
    return name_html(names_of(outcome)[label], labels_of(outcome))


def model_said(outcome: "Outcome", label: str) -> Markup:
    """Return a structure within a sentence of the page: its name in quotes, or `the model` if there is no other."""
    return Markup("“{}”").format(model_html(outcome, label)) if len(outcome.estimates) > 1 else Markup("the model")


def sentence_of(outcome: "Outcome", text: str) -> Markup:
    """Typeset a sentence about this outcome: structures by their terms in quotes, parameters by their symbols."""
    return sentence_about(text, names_of(outcome), labels_of(outcome))


def finding_of(outcome: "Outcome", text: str) -> dict[str, str | Markup]:
    """Return a sentence as a finding of the page: a caution only if the summary counts it, so that no section has one of its own."""
    kind = "caution" if text in outcome.summary.cautions else "finding"
    return {"kind": kind, "text": sentence_of(outcome, text)}


def _of_parameters(outcome: "Outcome", column: str) -> dict[str, str]:
    pairs = {}
    for estimate in outcome.estimates:
        pairs |= dict(zip(estimate.names, map(str, estimate.data[column].values), strict=True))
    return pairs


def signal_symbol(name: str) -> str:
    """Return a signal's symbol for a figure, within dollars; `udot` is the derivative of `u`."""
    known = is_thruster(name) or name.removesuffix("dot") in (*SIGNALS, *GAUGE_CHANNELS)
    return label_mathtext(signal_label(name) if known else rf"\mathrm{{{name}}}")


def signal_axis(name: str) -> str:
    """Return the axis label of a signal in the unit in which it is shown."""
    return unit_label(signal_symbol(name), shown_unit(name)[1])


def record_curves(
    outcome: "Outcome", index: int, record: Record
) -> tuple[np.ndarray, list[DrawnChannel], list[Driven]]:
    """Time, channels and controls of one record, in the units in which they are shown."""
    data = outcome.predictions
    rows = data["record"].values == index
    channels = []
    for column, name in enumerate(map(str, data["channel"].values)):
        factor = shown_unit(name)[0]
        columns = (data[part].values[rows, column] * factor for part in ("measured", "mean", "sd"))
        channels.append(DrawnChannel(signal_axis(name), *columns))
    controls = [Driven(signal_axis(name), record.channel(name) * shown_unit(name)[0]) for name in record.controls]
    return data["time"].values[rows], channels, controls


def schedule_figure(schedule: Schedule, limits: Mapping[str, Limits]) -> "Figure":
    """Draw every control of a schedule, in the unit in which it is shown; limits by name."""
    panels = []
    for name, values in schedule.controls.items():
        (factor, _), bounds = shown_unit(name), limits.get(name, Limits())
        low, high = (None if bound is None else bound * factor for bound in (bounds.lower, bounds.upper))
        panels.append((values * factor, signal_axis(name), (low, high)))
    return controls_over_time(schedule.time, panels)


def truth_of(outcome: "Outcome") -> Mapping[str, float]:
    """Return the true coefficients of a simulated campaign, in the units in which they are shown; none for real logs."""
    campaign, factors = outcome.campaign, factors_of(outcome)
    true = true_coefficients(campaign, campaign.model(campaign.full)) if campaign.is_simulated else {}
    return {name: factors.get(name, 1.0) * value for name, value in true.items()}


def _own_ids(body: str, name: str) -> str:
    """Prefix the ids that something refers to and drop the others."""
    used = set(_REFERENCE.findall(body))
    body = _ID.sub(lambda match: f' id="{name}-{match[1]}"' if match[1] in used else "", body)
    return re.sub(r'(url\(#|href="#)', rf"\g<1>{name}-", body)


def _short(path: re.Match) -> str:
    """Write a path of many points to a tenth of a point, without what need not be said; a stroke as short as a dot has no length."""
    text = path[1]
    if text.count("\n") > COARSE_POINTS:
        text = _LONG_NUMBER.sub(lambda number: f"{float(number[0]):.1f}".removesuffix(".0"), text)
    text = _SPACE.sub(r"\1", text.strip())
    return f' d="{_LEVEL.sub(_level, text)}"'


def _level(stroke: re.Match) -> str:
    start, height, end = stroke.groups()
    return f"M{start} {height}" + ("h0" if abs(float(end) - float(start)) < DOT else f"H{end}")


def _round(number: re.Match) -> str:
    text = f"{float(number[0]):.2f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def prior_panels(result: "PriorPredictive") -> tuple[list[Moved], list[Driven]]:
    """Return the channels of a prior, and the controls that move, in the units of display; all controls if none does."""
    moved = []
    for one in result.channels:
        factor = shown_unit(one.channel)[0]
        measured = None if one.measured is None else factor * one.measured
        moved.append(Moved(signal_axis(one.channel), factor * one.bands, factor * one.single, measured))
    moving = {name: values for name, values in result.control.items() if np.ptp(values) > 0} or result.control
    return moved, [Driven(signal_axis(name), values * shown_unit(name)[0]) for name, values in moving.items()]


def prior_spreads(result: "PriorPredictive") -> list[tuple[str, np.ndarray]]:
    """Return what is drawn of how surge vehicles settle; nothing of others."""
    if result.settled is None:
        return []
    return [("steady speed [m/s]", result.settled.speed), ("time constant [s]", result.settled.time_constant)]
