"""The picture of a selection: all its figures in one stand-alone SVG in the campaign's folder."""

import re
from pathlib import Path
from textwrap import wrap

from markupsafe import escape

from seatrial.campaign.config import Campaign
from seatrial.campaign.contenders import Contenders
from seatrial.campaign.screen import Screened
from seatrial.core.files import write_text
from seatrial.report.figures.style import INK, MUTED, PAPER, WIDE, own_settings
from seatrial.report.svg import draw_svg
from seatrial.report.term_figures import TermFigure, term_figures
from seatrial.selection.verdict import Selection

COLUMNS, MARGIN, HEAD, LINE = 2, 20.0, 26.0, 13.0
CHARACTERS = 68
"""Of a caption's line."""
_FIGURE_NAME = re.compile(r' id="[A-Za-z0-9.]+_\d+"')
"""Names that Matplotlib gives to parts and nothing refers to; they would repeat."""


def write_select_picture(
    campaign: Campaign, selection: Selection, screened: Screened | None, contenders: Contenders | None
) -> Path:
    """Write `select.svg` in the campaign's folder, atomically, and return its path."""
    path = campaign.folder / "select.svg"
    with own_settings():
        figures = term_figures(campaign, selection, screened, contenders)
        write_text(path, compose(f"{campaign.source.campaign.name}: which terms are real", figures))
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
    """A whole SVG file as an element at this place."""
    body = _FIGURE_NAME.sub("", text[text.index("<svg") :])
    inside = body[body.index(">") + 1 :]
    return f'<svg x="{x:g}" y="{y:g}" width="{WIDE:g}" height="{height:g}" viewBox="0 0 {WIDE:g} {height:g}">{inside}'.rstrip()


def _text(x: float, y: float, text: str, size: float, colour: str, weight: int = 400) -> str:
    return (
        f'<text x="{x:g}" y="{y:g}" font-family="DejaVu Sans, sans-serif" font-size="{size:g}" font-weight="{weight}" '
        f'fill="{colour}">{escape(text)}</text>'
    )
