"""Pictures that commands write into a campaign's folder: profiles, priors, designs, smoothed channels; stand-alone SVG each."""

import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING

from markupsafe import escape

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.data.accelerations import RATE, SmoothedChannel
from seatrial.campaign.design.problem import design_problem
from seatrial.campaign.design.searches import relay_search
from seatrial.campaign.prior.predictive import PriorPredictive
from seatrial.campaign.rehearsal.result import Rehearsal
from seatrial.core.coefficients import CoefficientName
from seatrial.core.display_units import shown_unit
from seatrial.core.files import write_text
from seatrial.core.record import Record
from seatrial.design.results import RelayTrial
from seatrial.estimation.diagnostics.calibration import Calibration
from seatrial.estimation.posterior.profile_result import Profiles
from seatrial.messages.priors import prior_summary
from seatrial.report.drawing import draw_svg, prior_panels, prior_spreads, signal_axis, signal_symbol
from seatrial.report.figures.checks import Progressed, prior_motions, rank_figure, rehearsal_figure
from seatrial.report.figures.fit import SmoothedSignal, smoothed_record
from seatrial.report.figures.posterior import ProfilePanel, profile_figure
from seatrial.report.figures.records import raw_record, relay_figure
from seatrial.report.figures.style import INK, MUTED, PAPER, WIDE, own_settings, unit_label
from seatrial.report.labels import label_mathtext
from seatrial.report.numbers import typeset
from seatrial.report.term_figures import TermFigure, term_figures
from seatrial.selection.contenders import Contenders
from seatrial.selection.screened import Screened
from seatrial.selection.verdict import Selection

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_accelerations_picture(folder: Path, record: Record, channels: Sequence[SmoothedChannel]) -> Path:
    """Write `accelerations-LABEL.svg` in the campaign's folder, atomically, and return its path."""
    curves = []
    for channel in channels:
        name, result, (factor, unit) = channel.name, channel.smoothed, shown_unit(channel.name)
        curves += [
            SmoothedSignal(
                signal_axis(name), factor * result.value, factor * result.value_sd, factor * record.channel(name)
            ),
            SmoothedSignal(
                unit_label(
                    signal_symbol(name + RATE), f"{unit.removesuffix('/s')}/s^2" if unit.endswith("/s") else f"{unit}/s"
                ),
                factor * result.rate,
                factor * result.rate_sd,
            ),
        ]
    name = f"accelerations-{record.label}"
    return _write(folder / f"{name}.svg", name, partial(smoothed_record, record.time, curves))


def write_calibration_picture(folder: Path, name: str, result: Calibration) -> Path:
    """Write `calibration-METHOD.svg`, atomically, and return its path."""
    words = (
        f"{name}: {len(result.ranks)} true vehicles from the priors, estimated again by {result.method}; "
        f"pale bands hold all {len(result.names)} in 99 % of cases"
    )
    return _write(folder / f"calibration-{result.method}.svg", "calibration", partial(rank_figure, result, words))


def write_check_picture(folder: Path, record: Record) -> Path:
    """Write `check-LABEL.svg` in the campaign's folder, atomically, and return its path."""
    shown = [
        (signal_axis(name), record.channel(name) * shown_unit(name)[0]) for name in (*record.measured, *record.controls)
    ]
    path, measured = folder / f"check-{record.label}.svg", len(record.measured)
    return _write(path, f"raw-{record.label}", partial(raw_record, record.time, shown, measured))


def write_prior_picture(folder: Path, name: str, result: PriorPredictive) -> Path:
    """Write `prior.svg` in the campaign's folder, atomically, and return its path."""
    words, spreads = [f"{name}: predictions of the priors", *map(typeset, prior_summary(result))], prior_spreads(result)
    draw = partial(prior_motions, result.time, *prior_panels(result), spreads=spreads, words=words)
    return _write(folder / "prior.svg", "prior", draw)


def write_profile_picture(folder: Path, name: str, truth: Mapping[str, float], result: Profiles) -> Path:
    """Write `profile.svg` in the campaign's folder, atomically, and return its path."""
    panels = [
        ProfilePanel(profile, label_mathtext(profile.label), truth.get(profile.name)) for profile in result.profiles
    ]
    words = [
        f"{name}: profile likelihoods of {result.structure}, with the other parameters fitted",
        "shaded: 95 % interval: the best fit falls by less than 1.92 (dashed)" + "; dotted: true value" * bool(truth),
        *(["orange: open, because the best fit does not fall so far within the prior"] if result.open else []),
    ]
    return _write(folder / "profile.svg", "profile", partial(profile_figure, panels, words))


def write_rehearsal_picture(campaign: Campaign, result: Rehearsal) -> Path:
    """Write `rehearsal.svg`, atomically, and return its path; coefficients that the goal does not name are not drawn."""
    goal, model = campaign.goal, campaign.model(campaign.full)
    assert goal is not None
    named = [i for i, name in enumerate(result.coefficients) if name in goal.shares or name in goal.sds]
    terms = [CoefficientName.parse(result.coefficients[i]) for i in named]
    strategies = [
        Progressed(name, *result.share_met(name), result.median_sd(name)[:, named]) for name in result.strategies
    ]
    words = (
        f"{campaign.name}: {result.vehicles} vehicles from the priors",
        "bars contain 90 %; below, the goals",
    )
    symbols, units = [label_mathtext(term.label) for term in terms], [model.unit_of(term) for term in terms]
    draw = partial(rehearsal_figure, strategies, symbols, units, words)
    return _write(campaign.folder / "rehearsal.svg", "rehearsal", draw)


def write_relay_picture(campaign: Campaign, result: RelayTrial) -> Path:
    """Write `self_oscillation.svg`, atomically, and return its path: the test as it is expected at the prior means."""
    loop = relay_search(campaign).loop(design_problem(campaign))
    manoeuvre, output = loop.foreseen(result.amplitude, result.threshold)
    time, control = manoeuvre.sample(campaign.family.sample_time)
    of_output, of_control = shown_unit(result.output)[0], shown_unit(result.control)[0]
    trim = loop.family.output_trim
    thresholds = ((trim - result.threshold) * of_output, (trim + result.threshold) * of_output)
    axes = signal_axis(result.output), signal_axis(result.control)
    draw = partial(relay_figure, time, output * of_output, control * of_control, thresholds, axes)
    return _write(campaign.folder / "self_oscillation.svg", "self-oscillation", draw)


def _write(path: Path, name: str, draw: "Callable[[], Figure]") -> Path:
    """Write a figure that is drawn under the settings of this library, with ids of this name, and return its path."""
    with own_settings():
        write_text(path, draw_svg(draw(), name))
    return path


COLUMNS, MARGIN, HEAD, LINE = 2, 20.0, 26.0, 13.0
CHARACTERS = 68  # Of a caption's line
# Names that Matplotlib gives to parts and nothing refers to; they would repeat.
_FIGURE_NAME = re.compile(r' id="[A-Za-z0-9.]+_\d+"')


def write_select_picture(
    campaign: Campaign, selection: Selection, screened: Screened | None, contenders: Contenders | None
) -> Path:
    """Write `select.svg` in the campaign's folder, atomically, and return its path."""
    path = campaign.folder / "select.svg"
    with own_settings():
        figures = term_figures(campaign, selection, screened, contenders)
        write_text(path, compose(f"{campaign.name}: which terms are needed", figures))
    return path


def compose(title: str, figures: list[TermFigure]) -> str:
    """Set figures in two columns under their headings, each over its caption."""
    columns, y = min(COLUMNS, len(figures)), MARGIN + 24
    pieces = [_text(MARGIN, MARGIN + 6, title, 14, INK, 600)]
    for row in (figures[i : i + columns] for i in range(0, len(figures), columns)):
        bottom = y
        for place, item in enumerate(row):
            x, height = MARGIN + place * (WIDE + MARGIN), item.figure.get_figheight() * 72
            pieces.append(_text(x, y + 14, item.heading, 12, INK, 600))
            pieces.append(_nested(draw_svg(item.figure, item.name), x, y + HEAD, height))
            lines = wrap(item.caption, CHARACTERS)
            for number, line in enumerate(lines):
                pieces.append(_text(x, y + HEAD + height + LINE * (number + 1), line, 9.5, MUTED))
            bottom = max(bottom, y + HEAD + height + LINE * len(lines) + MARGIN)
        y = bottom
    width = MARGIN + columns * (WIDE + MARGIN)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" width="{width:g}pt" '
        f'height="{y:g}pt" viewBox="0 0 {width:g} {y:g}">\n<rect width="100%" height="100%" fill="{PAPER}"/>\n'
        + "\n".join(pieces)
        + "\n</svg>\n"
    )


def _nested(text: str, x: float, y: float, height: float) -> str:
    """Return a whole SVG file as an element at this place."""
    body = _FIGURE_NAME.sub("", text[text.index("<svg") :])
    inside = body[body.index(">") + 1 :]
    return f'<svg x="{x:g}" y="{y:g}" width="{WIDE:g}" height="{height:g}" viewBox="0 0 {WIDE:g} {height:g}">{inside}'.rstrip()


def _text(x: float, y: float, text: str, size: float, colour: str, weight: int = 400) -> str:
    return (
        f'<text x="{x:g}" y="{y:g}" font-family="DejaVu Sans, sans-serif" font-size="{size:g}" font-weight="{weight}" '
        f'fill="{colour}">{escape(text)}</text>'
    )
